"""The program that evaluates a function and its derivatives for several inputs side by side: outputs, first states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bayeschute.compiler.derivative import jacobian
from bayeschute.compiler.elementary import written_out
from bayeschute.compiler.emit import Code, Program
from bayeschute.compiler.graph import Graph
from bayeschute.compiler.sections import RUN, SAMPLE, STATE, Memory, Place, Sections


def evaluation(
    graph: Graph,
    results: Sequence[int],
    rows: Mapping[str, int],
    varied: Sequence[str],
    by: Sequence[str],
    lanes: int,
) -> Program:
    """Evaluate a function.

    Arguments of the function: the groups of inputs in the order of `rows`, (R,) or, where they vary, (R, stride);
    ``values`` (stride, C); the derivatives by each group of `by` (stride, C, R), zero before; ``scratch``; then stride,
    first and last block of lanes.

    Args:
        graph: Expressions; grows.
        results: Nodes of the results.
        rows: Rows of the groups of inputs.
        varied: Groups that differ from lane to lane.
        by: Groups to differentiate by.
        lanes: Evaluations per block.
    """
    code, memory = Code(lanes), Memory(lanes)
    entries = jacobian(graph, results, by) if by else []
    graph, nodes = written_out(graph, [*results, *(slope for _, _, slope in entries)])
    sections, count = Sections(graph, nodes, code, memory), len(results)
    with code.loop("%last", "%first") as block:
        lane = code.integer("mul", block, lanes)
        places = {
            group: Place(code.address(f"%{group}", lane), "%stride") if group in varied else Place(f"%{group}")
            for group in rows
        }
        for level in (RUN, SAMPLE, STATE):
            name_of = sections.write(level, places)

        def put(node: int, array: str, width: int, at: int) -> None:
            base = code.address(f"%{array}", code.integer("mul", lane, width))
            code.scatter(name_of(node), [code.address(base, k * width + at) for k in range(lanes)])

        for i, node in enumerate(nodes[:count]):
            put(node, "values", count, i)
        for (i, (group, row), _), node in zip(entries, nodes[count:], strict=True):
            put(node, f"by_{group}", count * rows[group], i * rows[group] + row)
    pointers = (*rows, "values", *(f"by_{group}" for group in by), "scratch")
    return code.program("evaluate", pointers, ("stride", "first", "last"), memory.size)
