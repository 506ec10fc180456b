"""Operations of a graph sorted by how often they must be evaluated (loop-invariant code motion)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from bayeschute.compiler.emit import Code
from bayeschute.compiler.graph import BOOLEAN, FLOAT, SHARED, Graph

RUN, SAMPLE, STATE = 1, 2, 3
LEVELS = {
    SHARED: RUN,
    "theta": RUN,
    "now": SAMPLE,
    "then": SAMPLE,
    "error_now": SAMPLE,
    "error_then": SAMPLE,
    "x": STATE,
    "step": STATE,
    "change": STATE,
    "start": STATE,
    "share": STATE,
}


class Place(NamedTuple):
    """Where a group of inputs lies: rows of neighbouring lanes `stride` apart, or one number for all lanes if None."""

    base: str
    stride: str | None = None


class Memory:
    """Scratch memory, handed out in pieces of one number per lane."""

    def __init__(self, lanes: int) -> None:
        self.lanes, self.size = lanes, 0

    def take(self, count: int = 1) -> int:
        """Offset of this number of vectors [doubles]."""
        offset = self.size
        self.size += count * self.lanes
        return offset


class Sections:
    """The operations that some nodes need, by level: once per run, once per sample, at every state."""

    def __init__(self, graph: Graph, wanted: Sequence[int], code: Code, memory: Memory) -> None:
        self.graph, self.code = graph, code
        self.level: dict[int, int] = {}
        needed = graph.needed(wanted)
        for node in needed:
            op, args, _, (group, _) = graph.nodes[node]
            own = LEVELS[group] if op in ("input", "lookup") else 0
            self.level[node] = max([own, *(self.level[a] for a in args)])
        self.operations = [n for n in needed if graph.nodes[n].args]
        asked = {a for n in self.operations for a in graph.nodes[n].args if self.level[n] > self.level[a]}
        asked |= set(wanted)
        self.slots = {n: memory.take() for n in self.operations if self.level[n] < STATE and n in asked}

    def write(self, level: int, places: Mapping[str, Place], share: str | None = None) -> Callable[[int], str]:
        """Write the operations of a level.

        Args:
            level: `RUN`, `SAMPLE` or `STATE`.
            places: Where the inputs lie.
            share: Name of the share of the sample that has passed.

        Returns:
            What names any node of this level or below, at this point of the code.
        """
        names: dict[int, str] = {}

        def name(node: int) -> str:
            stack = [node]
            while stack:
                top = stack[-1]
                own = self.level[top] == level and self.graph.nodes[top].args
                missing = [a for a in self.graph.nodes[top].args if a not in names] if own and top not in names else []
                if missing:
                    stack.extend(reversed(missing))
                    continue
                stack.pop()
                if top not in names:
                    names[top] = self._written(top, names, places) if own else self._outside(top, places, share)
            return names[node]

        if level != STATE:
            for node in self.slots:
                if self.level[node] == level:
                    self._keep(node, name(node))
        return name

    def _keep(self, node: int, value: str) -> None:
        """Write a value for later levels, as a double whatever it is."""
        kind = self.graph.kinds[node]
        self.code.store(
            value if kind == FLOAT else self.code.operation("to_float", kind, [value]), "%scratch", self.slots[node]
        )

    def _kept(self, node: int) -> str:
        """Read a value of an earlier level."""
        kind, value = self.graph.kinds[node], self.code.load("%scratch", self.slots[node])
        if kind == BOOLEAN:
            return self.code.operation("ne", FLOAT, [value, self.code.constant(0.0)])
        return value if kind == FLOAT else self.code.operation("to_integer", FLOAT, [value])

    def _written(self, node: int, names: Mapping[int, str], places: Mapping[str, Place]) -> str:
        graph, code = self.graph, self.code
        op, args, _, (group, row) = graph.nodes[node]
        given = [names[a] for a in args]
        if op == "lookup":
            return code.gather(code.address(places[group].base, row), given[0])
        return code.operation(op, graph.kinds[args[-1]], given, graph.value(args[-1]))

    def _outside(self, node: int, places: Mapping[str, Place], share: str | None) -> str:
        op, _, value, (group, row) = self.graph.nodes[node]
        if value is not None:
            return self.code.constant(value)
        if op != "input":
            return self._kept(node)
        if group == "share":
            assert share is not None
            return share
        base, stride = places[group]
        if stride is None:
            return self.code.spread(base, row)
        return self.code.load(base, self.code.integer("mul", stride, row))
