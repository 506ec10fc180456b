"""Scalar expressions as a graph in which every operation occurs once.

Nodes are numbers in order of construction, so operands come before results. Building a node simplifies it where that
changes no rounding, and returns the existing node where there is one: common subexpressions never arise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Place = tuple[str, int]
SHARED = "shared"  # the group of numbers that all lanes have in common
FLOAT, INTEGER, BOOLEAN = "float", "integer", "boolean"
COMPARISONS = ("lt", "le", "eq", "ne")
LOGIC = ("and", "or", "xor", "not")
_COMMUTATIVE = ("add", "mul", "eq", "ne", "and", "or", "xor", "max", "min")
_FOLDS: dict[str, Callable] = {
    "add": np.add, "sub": np.subtract, "mul": np.multiply, "div": np.divide, "neg": np.negative, "abs": np.abs,
    "sqrt": np.sqrt, "floor": np.floor, "max": np.maximum, "min": np.minimum, "lt": np.less, "le": np.less_equal,
    "eq": np.equal, "ne": np.not_equal, "and": np.logical_and, "or": np.logical_or, "xor": np.logical_xor,
    "not": np.logical_not, "sin": np.sin, "cos": np.cos, "exp": np.exp, "log": np.log, "atan2": np.arctan2,
    "tan": np.tan, "tanh": np.tanh, "asin": np.arcsin, "acos": np.arccos, "atan": np.arctan, "sinh": np.sinh,
    "cosh": np.cosh, "pow": np.power, "copysign": np.copysign,
}  # fmt: skip


_UNFOLDED: dict[str, Callable] = {
    "select": np.where, "to_float": np.float64, "to_integer": np.int64, "power_of_two": lambda a: np.ldexp(1.0, a),
}  # fmt: skip


class Node(NamedTuple):
    """An operation: operands are nodes; `value` is that of a constant, `place` the group and row of an input.

    A ``lookup`` reads its group in the row of its place plus its operand.
    """

    op: str
    args: tuple[int, ...]
    value: float | int | bool | None = None
    place: Place = ("", 0)


class Graph:
    """A growing graph; `kinds` holds the type of each node."""

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self.kinds: list[str] = []
        self._known: dict[tuple, int] = {}

    def copy(self) -> Graph:
        """The same graph, to grow on its own."""
        other = Graph()
        other.nodes, other.kinds, other._known = list(self.nodes), list(self.kinds), dict(self._known)
        return other

    def _add(self, node: Node, kind: str) -> int:
        key = node, kind, isinstance(node.value, float) and np.signbit(node.value)  # -0.0 is not 0.0
        if key not in self._known:
            self._known[key] = len(self.nodes)
            self.nodes.append(node)
            self.kinds.append(kind)
        return self._known[key]

    def constant(self, value: float | int | bool) -> int:
        """A number."""
        if isinstance(value, bool | np.bool_):
            return self._add(Node("constant", (), bool(value)), BOOLEAN)
        if isinstance(value, int | np.integer):
            return self._add(Node("constant", (), int(value)), INTEGER)
        return self._add(Node("constant", (), float(value)), FLOAT)

    def input(self, group: str, row: int) -> int:
        """A row of a group of inputs."""
        return self._add(Node("input", (), place=(group, row)), FLOAT)

    def lookup(self, group: str, row: int, index: int) -> int:
        """The input at ``row + index`` of a group, the index a node."""
        return self._add(Node("lookup", (index,), place=(group, row)), FLOAT)

    def value(self, node: int) -> float | int | bool | None:
        """The number of a constant, else None."""
        return self.nodes[node].value

    def is_number(self, node: int, *numbers: float) -> bool:
        """Whether a node is a constant equal to one of these."""
        value = self.value(node)
        return value is not None and value in numbers

    def apply(self, op: str, *args: int) -> int:
        """The node of an operation."""
        values = [self.value(a) for a in args]
        if op in _FOLDS and all(v is not None for v in values):
            with np.errstate(all="ignore"):
                folded = _FOLDS[op](*values)
            return self.constant(folded.item() if isinstance(folded, np.generic) else folded)
        simple = _SIMPLIFY.get(op, lambda *_: None)(self, *args)
        if simple is not None:
            return simple
        if op in _COMMUTATIVE:
            args = tuple(sorted(args, key=lambda a: (self.nodes[a].op == "constant", a)))
        return self._add(Node(op, args), self._kind(op, args))

    def _kind(self, op: str, args: tuple[int, ...]) -> str:
        if op in COMPARISONS or op in LOGIC:
            return BOOLEAN
        if op in ("to_float", "to_integer"):
            return op.removeprefix("to_")
        if op == "power_of_two":
            return FLOAT
        return self.kinds[args[-1]]

    def operand(self, node: int, op: str) -> tuple[int, ...] | None:
        """Operands of a node if it is this operation."""
        found = self.nodes[node]
        return found.args if found.op == op else None

    def evaluate(self, wanted: Iterable[int], given: Mapping[str, NDArray[np.float64]]) -> list[Any]:
        """Values of nodes by NumPy, one operation after the other: for what is asked once, and not worth compiling.

        Args:
            wanted: Nodes.
            given: Each group of inputs (R,).
        """
        wanted, known = list(wanted), dict[int, Any]()
        functions = _FOLDS | _UNFOLDED
        with np.errstate(all="ignore"):
            for number in self.needed(wanted):
                op, args, value, (group, row) = self.nodes[number]
                if op == "constant":
                    known[number] = value
                elif op == "input":
                    known[number] = given[group][row]
                elif op == "lookup":
                    known[number] = given[group][row + known[args[0]]]
                else:
                    known[number] = functions[op](*(known[a] for a in args))
        return [known[number] for number in wanted]

    def needed(self, wanted: Iterable[int]) -> list[int]:
        """All nodes that some nodes depend on, themselves included, operands first."""
        seen: set[int] = set()
        stack = list(wanted)
        while stack:
            node = stack.pop()
            if node not in seen:
                seen.add(node)
                stack.extend(self.nodes[node].args)
        return sorted(seen)


def _neg(g: Graph, a: int) -> int | None:
    if inner := g.operand(a, "neg"):
        return inner[0]
    return None


def _add(g: Graph, a: int, b: int) -> int | None:
    if g.is_number(a, 0):
        return b
    if g.is_number(b, 0):
        return a
    if inner := g.operand(b, "neg"):
        return g.apply("sub", a, inner[0])
    if inner := g.operand(a, "neg"):
        return g.apply("sub", b, inner[0])
    return None


def _sub(g: Graph, a: int, b: int) -> int | None:
    if g.is_number(b, 0):
        return a
    if g.is_number(a, 0):
        return g.apply("neg", b)
    if inner := g.operand(b, "neg"):
        return g.apply("add", a, inner[0])
    if inner := g.operand(a, "neg"):
        return g.apply("neg", g.apply("add", inner[0], b))
    if a > b and g.kinds[a] == FLOAT:
        return g.apply("neg", g.apply("sub", b, a))
    return None


def _signs(g: Graph, op: str, a: int, b: int) -> int | None:
    """Signs of factors move out, so that products which differ in sign only are one node."""
    left, right = g.operand(a, "neg"), g.operand(b, "neg")
    if left and right:
        return g.apply(op, left[0], right[0])
    if left:
        return g.apply("neg", g.apply(op, left[0], b))
    if right:
        return g.apply("neg", g.apply(op, a, right[0]))
    return None


def _mul(g: Graph, a: int, b: int) -> int | None:
    for one, other in ((a, b), (b, a)):
        if g.is_number(one, 1):
            return other
        if g.is_number(one, -1):
            return g.apply("neg", other)
    return _signs(g, "mul", a, b)


def _div(g: Graph, a: int, b: int) -> int | None:
    return a if g.is_number(b, 1) else _signs(g, "div", a, b)


def _select(g: Graph, mask: int, yes: int, no: int) -> int | None:
    if yes == no:
        return yes
    known = g.value(mask)
    return None if known is None else (yes if known else no)


def _convert(g: Graph, a: int, kind: str, number: Callable) -> int | None:
    value = g.value(a)
    return a if g.kinds[a] == kind else None if value is None else g.constant(number(value))


_SIMPLIFY: dict[str, Callable[..., int | None]] = {
    "neg": _neg,
    "add": _add,
    "sub": _sub,
    "mul": _mul,
    "div": _div,
    "select": _select,
    "to_float": lambda g, a: _convert(g, a, FLOAT, float),
    "to_integer": lambda g, a: _convert(g, a, INTEGER, int),
}
