"""Exact derivatives of a graph's outputs by elimination of its inner nodes (Griewank & Walther 2008, chapters 9, 10).

Every node contributes an edge to each operand, weighted with the partial derivative. Removing a node connects its
users with its operands; the node that leaves the fewest edges goes first, then the one that makes the fewest products
(Markowitz). What is left is the sparse Jacobian, for a fraction of the operations of forward or reverse mode.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayeschute.compiler.graph import FLOAT, Graph, Place
from bayeschute.compiler.trace import Traced, UnknownOperationError

Partials = list[tuple[int, int]]


def jacobian(graph: Graph, outputs: Sequence[int], groups: Sequence[str]) -> list[tuple[int, Place, int]]:
    """Derivatives of outputs by the inputs of some groups.

    Args:
        graph: Grows by what the derivatives need.
        outputs: Nodes.
        groups: Groups of inputs that vary.

    Returns:
        The entries that are not zero everywhere: number of the output, place of the input, node of the derivative.

    Raises:
        UnknownOperationError: If an operation has no rule.
    """
    active: set[int] = set()
    down: dict[int, dict[int, int]] = {}
    for node in graph.needed(outputs):
        op, args, _, place = graph.nodes[node]
        if op == "input" and place[0] in groups:
            active.add(node)
        elif graph.kinds[node] == FLOAT and active.intersection(args):
            edges: dict[int, int] = {}
            for operand, partial in _partials(graph, node):
                if operand in active and not graph.is_number(partial, 0):
                    edges[operand] = graph.apply("add", edges[operand], partial) if operand in edges else partial
            if edges:
                active.add(node)
                down[node] = edges
    one = graph.constant(1.0)
    sinks = {~i: {node: one} for i, node in enumerate(outputs) if node in active}
    _eliminate(graph, down | sinks)
    return [(~i, graph.nodes[n].place, slope) for i, row in sinks.items() for n, slope in row.items()]


class Jacobian:
    """Derivatives of a traced function by one of its arguments, without compiling anything."""

    def __init__(self, traced: Traced, by: str) -> None:
        """Differentiate.

        Args:
            traced: The function.
            by: The group of inputs that the argument has become.

        Raises:
            UnknownOperationError: If an operation has no rule.
        """
        self._traced, self._graph = traced, traced.graph.copy()
        self._entries = jacobian(self._graph, traced.result, (by,))
        self._shape = len(traced.result), traced.rows[by]

    def at(self, first: Any, *others: Any) -> NDArray[np.float64]:
        """Array (C, R) of C results by R inputs, at the function's arguments."""
        given = self._traced.given(first, *others)
        values = self._graph.evaluate([node for _, _, node in self._entries], given)
        made = np.zeros(self._shape)
        for (i, (_, row), _), value in zip(self._entries, values, strict=True):
            made[i, row] = value
        return made


def _eliminate(graph: Graph, down: dict[int, dict[int, int]]) -> None:
    up: dict[int, set[int]] = {}
    for user, edges in down.items():
        for operand in edges:
            up.setdefault(operand, set()).add(user)
    inner = {node for node in down if node >= 0}

    def cost(node: int) -> tuple[int, int]:
        operands, users = down[node], up.get(node, set())
        fill = sum(operand not in down[user] for user in users for operand in operands)
        return fill - len(operands) - len(users), len(operands) * len(users)

    queue = [(cost(node), node) for node in inner]
    heapq.heapify(queue)
    while queue:
        estimate, node = heapq.heappop(queue)
        if node not in inner:
            continue
        if estimate != cost(node):
            heapq.heappush(queue, (cost(node), node))
            continue
        inner.discard(node)
        operands, users = down.pop(node), up.pop(node, set())
        for operand in operands:
            up[operand].discard(node)
        for user in users:
            weight = down[user].pop(node)
            for operand, partial in operands.items():
                product = _times(graph, weight, partial)
                have = down[user].get(operand)
                down[user][operand] = product if have is None else graph.apply("add", have, product)
                up[operand].add(user)


def _times(graph: Graph, a: int, b: int) -> int:
    """Product in which a zero of a switched-off branch stays zero whatever the other factor."""
    zero = graph.constant(0.0)
    for switch, other in ((a, b), (b, a)):
        found = graph.operand(switch, "select")
        if found and graph.is_number(found[1], 0, 1) and graph.is_number(found[2], 0, 1):
            mask, yes, no = found
            return graph.apply(
                "select", mask, other if graph.is_number(yes, 1) else zero, other if graph.is_number(no, 1) else zero
            )
    return graph.apply("mul", a, b)


def _partials(graph: Graph, node: int) -> Partials:
    op, args, _, _ = graph.nodes[node]
    if op not in _RULES:
        raise UnknownOperationError(f"derivative of {op}")
    return _RULES[op](graph, node, *args)


def _divided(g: Graph, node: int, a: int, b: int) -> Partials:
    inverse = g.apply("div", g.constant(1.0), b)
    return [(a, inverse), (b, g.apply("neg", g.apply("mul", node, inverse)))]


def _extreme(g: Graph, a: int, b: int, first: int) -> Partials:
    """By both operands where `first` says which is taken; half of each at a tie, like JAX."""
    zero, half, one = (g.constant(v) for v in (0.0, 0.5, 1.0))
    tie = g.apply("eq", a, b)
    by_a, by_b = g.apply("select", first, one, zero), g.apply("select", first, zero, one)
    return [(a, g.apply("select", tie, half, by_a)), (b, g.apply("select", tie, half, by_b))]


def _selected(g: Graph, node: int, mask: int, yes: int, no: int) -> Partials:
    zero, one = g.constant(0.0), g.constant(1.0)
    return [(yes, g.apply("select", mask, one, zero)), (no, g.apply("select", mask, zero, one))]


def _angle(g: Graph, node: int, y: int, x: int) -> Partials:
    inverse = g.apply("div", g.constant(1.0), g.apply("add", g.apply("mul", x, x), g.apply("mul", y, y)))
    return [(y, g.apply("mul", x, inverse)), (x, g.apply("neg", g.apply("mul", y, inverse)))]


def _root(g: Graph, node: int, a: int) -> Partials:
    return [(a, g.apply("div", g.constant(0.5), node))]


def _magnitude(g: Graph, node: int, a: int) -> Partials:
    zero = g.constant(0.0)
    below = g.apply("select", g.apply("lt", a, zero), g.constant(-1.0), zero)
    return [(a, g.apply("select", g.apply("lt", zero, a), g.constant(1.0), below))]


_RULES: dict[str, Callable[..., Partials]] = {
    "add": lambda g, node, a, b: [(a, g.constant(1.0)), (b, g.constant(1.0))],
    "sub": lambda g, node, a, b: [(a, g.constant(1.0)), (b, g.constant(-1.0))],
    "mul": lambda g, node, a, b: [(a, b), (b, a)],
    "neg": lambda g, node, a: [(a, g.constant(-1.0))],
    "div": _divided,
    "sqrt": _root,
    "abs": _magnitude,
    "floor": lambda g, node, a: [],
    "to_float": lambda g, node, a: [],
    "lookup": lambda g, node, a: [],
    "max": lambda g, node, a, b: _extreme(g, a, b, g.apply("lt", b, a)),
    "min": lambda g, node, a, b: _extreme(g, a, b, g.apply("lt", a, b)),
    "select": _selected,
    "sin": lambda g, node, a: [(a, g.apply("cos", a))],
    "cos": lambda g, node, a: [(a, g.apply("neg", g.apply("sin", a)))],
    "exp": lambda g, node, a: [(a, node)],
    "log": lambda g, node, a: [(a, g.apply("div", g.constant(1.0), a))],
    "tan": lambda g, node, a: [(a, g.apply("add", g.constant(1.0), g.apply("mul", node, node)))],
    "tanh": lambda g, node, a: [(a, g.apply("sub", g.constant(1.0), g.apply("mul", node, node)))],
    "atan2": _angle,
}
