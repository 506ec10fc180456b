"""Functions and their derivatives evaluated for several inputs side by side: outputs, first states, retractions.

A function of one sample's numbers is evaluated at all samples of a flight (`BySample`), or of many flights at once.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Mapping, Sequence
from contextlib import ExitStack
from typing import Any

import jax
import numpy as np

from bayeschute.compiler.derivative import jacobian
from bayeschute.compiler.elementary import written_out
from bayeschute.compiler.emit import Code, Program
from bayeschute.compiler.graph import SHARED, Graph
from bayeschute.compiler.machine import Array, aligned, compiled, in_parts, padded, takes
from bayeschute.compiler.sections import RUN, SAMPLE, STATE, Memory, Place, Sections
from bayeschute.compiler.trace import Traced, UnknownOperationError, trace

LANES = 8
_lock = threading.RLock()
_known: dict[Hashable, BySample | None] = {}


def evaluation(
    graph: Graph,
    results: Sequence[int],
    rows: Mapping[str, int],
    varied: Sequence[str],
    by: Sequence[str],
    lanes: int,
    along: Sequence[str] | None = None,
) -> Program:
    """Evaluate a function.

    Arguments of the function: the groups of inputs in the order of `rows`, (R,) or, where they vary, (R, stride);
    ``values`` (stride, C); the derivatives by each group of `by` (stride, C, R), zero before; ``scratch``; then stride,
    first and last block of lanes. Along samples these are groups with one more axis in front, the values are (T, C,
    stride), and first and last sample follow.

    Args:
        graph: Expressions; grows.
        results: Nodes of the results.
        rows: Rows of the groups of inputs.
        varied: Groups that differ from lane to lane.
        by: Groups to differentiate by.
        lanes: Evaluations per block.
        along: Groups that differ from sample to sample; None: there is one sample.
    """
    code, memory = Code(lanes), Memory(lanes)
    entries = jacobian(graph, results, by) if by else []
    graph, nodes = written_out(graph, [*results, *(slope for _, _, slope in entries)])
    sections, count = Sections(graph, nodes, code, memory), len(results)
    with ExitStack() as loops:
        sample = None if along is None else loops.enter_context(code.loop("%end", "%begin"))
        block = loops.enter_context(code.loop("%last", "%first"))
        lane = code.integer("mul", block, lanes)

        def place(group: str) -> Place:
            base = f"%{group}"
            if along and group in along:
                size = code.integer("mul", "%stride", rows[group]) if group in varied else rows[group]
                base = code.address(base, code.integer("mul", sample or 0, size))
            return Place(code.address(base, lane), "%stride") if group in varied else Place(base)

        places = {group: place(group) for group in rows}
        for level in (RUN, SAMPLE, STATE):
            name_of = sections.write(level, places)

        def put(node: int, array: str, width: int, entry: int) -> None:
            if sample is not None:
                row = code.integer("add", code.integer("mul", sample, width), entry)
                code.store(name_of(node), code.address(f"%{array}", code.integer("mul", row, "%stride")), lane)
                return
            base = code.address(f"%{array}", code.integer("mul", lane, width))
            code.scatter(name_of(node), [code.address(base, k * width + entry) for k in range(lanes)])

        for i, node in enumerate(nodes[:count]):
            put(node, "values", count, i)
        for (i, (group, row), _), node in zip(entries, nodes[count:], strict=True):
            put(node, f"by_{group}", count * rows[group], i * rows[group] + row)
    pointers = (*rows, "values", *(f"by_{group}" for group in by), "scratch")
    sizes = ("stride", "first", "last", *(() if along is None else ("begin", "end")))
    return code.program("evaluate", pointers, sizes, memory.size)


class BySample:
    """A function of a sample, with machine code for one flight, its samples side by side, and for many flights.

    Attributes:
        function: The function.
    """

    def __init__(self, function: Traced, along: Sequence[str]) -> None:
        """Keep a function.

        Args:
            function: Of numbers that all samples share and of further groups.
            along: Groups that differ from sample to sample.
        """
        self.function, self._along = function, tuple(along)
        self._made: dict[tuple[str, ...], tuple[Callable[..., None], int]] = {}

    def at(self, shared: Any, given: Mapping[str, Any]) -> Array:
        """Values (T, C) or (T, C, B).

        Args:
            shared: What all samples share, as the function was traced with.
            given: The other groups: (T, R) or (T, R, B) where they differ from sample to sample, else (R,) or (R, B).
        """
        arrays = {name: np.asarray(a, float) for name, a in given.items()}
        wide = [name for name, a in arrays.items() if a.ndim == (3 if name in self._along else 2)]
        samples = len(arrays[self._along[0]])
        if not wide:
            return self._of_one(shared, arrays, samples)
        return self._of_many(shared, arrays, tuple(wide), samples)

    def _of_one(self, shared: Any, arrays: Mapping[str, Array], samples: int) -> Array:
        blocks = -(-samples // LANES)
        groups = [padded(a.T, blocks * LANES) if name in self._along else a.copy() for name, a in arrays.items()]
        call, scratch = self._program(self._along, False)
        values = aligned(blocks * LANES, len(self.function.result))

        def work(first: int, last: int) -> None:
            call(self.function.shared(shared), *groups, values, aligned(scratch), blocks * LANES, first, last)

        in_parts(blocks, work)
        return values[:samples]

    def _of_many(self, shared: Any, arrays: Mapping[str, Array], wide: tuple[str, ...], samples: int) -> Array:
        flights = arrays[wide[0]].shape[-1]
        blocks = -(-flights // LANES)
        groups = [padded(a, blocks * LANES) if name in wide else np.ascontiguousarray(a) for name, a in arrays.items()]
        call, scratch = self._program(wide, True)
        values = aligned(samples, len(self.function.result), blocks * LANES)

        def work(begin: int, end: int) -> None:
            given = self.function.shared(shared), *groups, values, aligned(scratch)
            call(*given, blocks * LANES, 0, blocks, begin, end)

        in_parts(samples, work)
        return values[..., :flights]

    def _program(self, varied: tuple[str, ...], many: bool) -> tuple[Callable[..., None], int]:
        key = ("many" if many else "one", *varied)
        with _lock:
            if key not in self._made:
                made, along = self.function, self._along if many else None
                program = evaluation(made.graph.copy(), made.result, made.rows, varied, (), LANES, along)
                self._made[key] = compiled(program), program.scratch
            return self._made[key]


def by_sample(
    key: Hashable, function: Callable[..., jax.Array], shared: Any, given: Mapping[str, Any], along: Sequence[str]
) -> Array | None:
    """A function's values at all samples (T, C) or (T, C, B); None where there is no machine code, or JAX is tracing.

    Args:
        key: What functions have in common that share their code, shapes of the arguments apart.
        function: Of what is shared and of the other groups, each (R,), to (C,).
        shared: A pytree of numbers.
        given: The other groups by name (see `sections.LEVELS`), in the order of the function's arguments: (T, R) or
            (T, R, B) where they differ from sample to sample, else (R,) or (R, B).
        along: Groups that differ from sample to sample.
    """
    if jax.default_backend() != "cpu" or not takes(shared, *given.values()):
        return None
    rows = [np.shape(a)[1 if name in along else 0] for name, a in given.items()]
    leaves, structure = jax.tree.flatten(shared)
    whole = key, structure, tuple(np.shape(leaf) for leaf in leaves), tuple(zip(given, rows, strict=True))
    with _lock:
        if whole not in _known:
            try:
                examples = (shared, *(np.zeros(count) for count in rows))
                _known[whole] = BySample(trace(function, examples, (SHARED, *given)), along)
            except UnknownOperationError:
                _known[whole] = None
        made = _known[whole]
    return None if made is None else made.at(shared, given)
