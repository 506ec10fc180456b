"""From a JAX function of small arrays to scalar expressions: every array becomes an array of nodes of a `Graph`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.extend import core
from numpy.typing import NDArray

from bayeschute.compiler.graph import SHARED, Graph

Nodes = NDArray[np.int64]


class UnknownOperationError(Exception):
    """A primitive that has no scalar form here; the function stays with JAX."""


class Traced(NamedTuple):
    """A function as expressions.

    Attributes:
        graph: The expressions.
        result: Nodes of the flattened result.
        rows: Number of rows of each group of inputs.
        read: Numbers of the leaves of the first argument that are read; its group holds these, one after the other.
    """

    graph: Graph
    result: list[int]
    rows: dict[str, int]
    read: list[int]

    def shared(self, first: Any) -> NDArray[np.float64]:
        """Numbers of the first argument, in the order of their group of inputs."""
        leaves = jax.tree.leaves(first)
        return np.concatenate([np.zeros(0), *(np.ravel(np.asarray(leaves[i], float)) for i in self.read)])

    def given(self, first: Any, *others: Any) -> dict[str, NDArray[np.float64]]:
        """All groups of inputs by arguments."""
        flat = (np.concatenate([np.zeros(0), *map(np.ravel, jax.tree.leaves(other))]) for other in others)
        return dict(zip(self.rows, (self.shared(first), *flat), strict=True))

    def value(self, first: Any, *others: Any) -> NDArray[np.float64]:
        """The flattened result for arguments, without compiling anything."""
        return np.array(self.graph.evaluate(self.result, self.given(first, *others)), float)


class _Leaf(NamedTuple):
    """A leaf of an argument, made into inputs when first read; `row` is None where that decides its place."""

    group: str
    number: int
    row: int | None
    shape: tuple[int, ...]


def trace(function: Callable, examples: Sequence[Any], groups: Sequence[str]) -> Traced:
    """Write a function's operations as scalar expressions.

    Args:
        function: A JAX function of pytrees that returns one array.
        examples: Arguments; only shapes and types matter.
        groups: Name of the group of inputs that each argument's leaves become, leaf after leaf. In that of the first
            argument, leaves which nothing reads have no place.

    Raises:
        UnknownOperationError: If some operation has no scalar form.
    """
    # A function of its own: JAX keeps what it traced, and PyTreeDefs of models of different classes but equal fields
    # compare equal (JAX 0.10), so it could give the trace of another.
    closed = jax.make_jaxpr(lambda *given: function(*given))(*examples)
    arguments: list[_Leaf] = []
    rows = dict.fromkeys(groups, 0)
    for example, group in zip(examples, groups, strict=True):
        for number, leaf in enumerate(jax.tree.leaves(example)):
            shape = np.shape(leaf)
            arguments.append(_Leaf(group, number, None if group == groups[0] else rows[group], shape))
            rows[group] += int(np.prod(shape, dtype=int))
    rows[groups[0]] = 0
    made = Traced(Graph(), [], rows, [])
    (result,) = _interpret(made, closed, arguments)
    made.result.extend(int(node) for node in result.ravel())
    return made


def _inputs(made: Traced, leaf: _Leaf) -> Nodes:
    size, row = int(np.prod(leaf.shape, dtype=int)), leaf.row
    if row is None:
        row = made.rows[leaf.group]
        made.rows[leaf.group] += size
        made.read.append(leaf.number)
    nodes = [made.graph.input(leaf.group, row + i) for i in range(size)]
    return np.array(nodes, dtype=np.int64).reshape(leaf.shape)


def _numbers(graph: Graph, value: Any) -> Nodes:
    array = np.asarray(value)
    return np.array([graph.constant(v) for v in array.ravel().tolist()], dtype=np.int64).reshape(array.shape)


def _interpret(made: Traced, closed: Any, arguments: Sequence[_Leaf | Nodes]) -> list[Nodes]:
    known: dict[Any, Any] = dict(zip(closed.jaxpr.invars, arguments, strict=True))
    known.update({v: _numbers(made.graph, c) for v, c in zip(closed.jaxpr.constvars, closed.consts, strict=True)})

    def read(atom: Any) -> Nodes:
        if isinstance(atom, core.Literal):
            return _numbers(made.graph, atom.val)
        if isinstance(known[atom], _Leaf):
            known[atom] = _inputs(made, known[atom])
        return known[atom]

    for equation in closed.jaxpr.eqns:
        if equation.primitive.name in _CALLS:
            body = equation.params.get("jaxpr", equation.params.get("call_jaxpr"))
            inner = body if hasattr(body, "consts") else core.ClosedJaxpr(body, ())
            passed = [v if isinstance(v, core.Literal) else known[v] for v in equation.invars]
            given = [p if isinstance(p, _Leaf) else read(v) for p, v in zip(passed, equation.invars, strict=True)]
            results = _interpret(made, inner, given)
        else:
            results = _equation(made.graph, equation, [read(v) for v in equation.invars])
        known.update(zip(equation.outvars, results, strict=True))
    return [read(v) for v in closed.jaxpr.outvars]


def _equation(graph: Graph, equation: Any, operands: list[Nodes]) -> list[Nodes]:
    name, params = equation.primitive.name, equation.params
    if name in _ELEMENTWISE:
        function, wide = _ELEMENTWISE[name], np.broadcast_arrays(*operands)
        each = zip(*(w.ravel().tolist() for w in wide), strict=True)
        return [np.array([function(graph, params, *nodes) for nodes in each], dtype=np.int64).reshape(wide[0].shape)]
    if name in _ARRAYS:
        return [_ARRAYS[name](graph, params, equation.outvars[0].aval.shape, *operands)]
    if name in _PARTS:
        return _PARTS[name](params, *operands)
    raise UnknownOperationError(name)


_CALLS = ("jit", "pjit", "closed_call", "core_call", "custom_jvp_call", "custom_vjp_call", "remat", "checkpoint")


def _plain(op: str) -> Callable[..., int]:
    return lambda g, params, *args: g.apply(op, *args)


def _power(g: Graph, params: Any, a: int) -> int:
    y = params["y"]
    result, square, left = None, a, abs(y)
    while left:
        if left & 1:
            result = square if result is None else g.apply("mul", result, square)
        left >>= 1
        square = g.apply("mul", square, square) if left else square
    result = g.constant(1.0) if result is None else result
    return result if y >= 0 else g.apply("div", g.constant(1.0), result)


def _convert(g: Graph, params: Any, a: int) -> int:
    kind = np.dtype(params["new_dtype"]).kind
    if kind == "b":
        return g.apply("ne", a, g.constant(0 if g.kinds[a] == "integer" else 0.0)) if g.kinds[a] != "boolean" else a
    return g.apply("to_float" if kind == "f" else "to_integer", a)


def _sign(g: Graph, params: Any, a: int) -> int:
    zero = g.constant(0.0)
    below = g.apply("select", g.apply("lt", a, zero), g.constant(-1.0), a)
    return g.apply("select", g.apply("lt", zero, a), g.constant(1.0), below)


def _select_n(g: Graph, params: Any, which: int, *cases: int) -> int:
    if len(cases) != 2 or g.kinds[which] != "boolean":
        raise UnknownOperationError("select_n")
    return g.apply("select", which, cases[1], cases[0])


def _clamp(g: Graph, params: Any, low: int, a: int, high: int) -> int:
    return g.apply("min", g.apply("max", a, low), high)


_ELEMENTWISE: dict[str, Callable[..., int]] = {
    name: _plain(name)
    for name in (
        "add", "sub", "mul", "div", "neg", "abs", "sqrt", "floor", "max", "min", "lt", "le", "eq", "ne", "and", "or",
        "xor", "not", "sin", "cos", "exp", "log", "atan2", "tan", "tanh", "asin", "acos", "atan", "sinh", "cosh", "pow",
    )
} | {
    "add_any": _plain("add"),
    "gt": lambda g, params, a, b: g.apply("lt", b, a),
    "ge": lambda g, params, a, b: g.apply("le", b, a),
    "square": lambda g, params, a: g.apply("mul", a, a),
    "rsqrt": lambda g, params, a: g.apply("div", g.constant(1.0), g.apply("sqrt", a)),
    "integer_pow": _power,
    "sign": _sign,
    "select_n": _select_n,
    "clamp": _clamp,
    "convert_element_type": _convert,
    "copy": lambda g, params, a: a,
    "stop_gradient": lambda g, params, a: a,
}  # fmt: skip


def _broadcast(g: Graph, params: Any, shape: tuple, a: Nodes) -> Nodes:
    placed = [1] * len(shape)
    for axis, size in zip(params["broadcast_dimensions"], a.shape, strict=True):
        placed[axis] = size
    return np.broadcast_to(a.reshape(placed), shape)


def _slice(g: Graph, params: Any, shape: tuple, a: Nodes) -> Nodes:
    strides = params["strides"] or (1,) * a.ndim
    return a[tuple(map(slice, params["start_indices"], params["limit_indices"], strides))]


def _reduce(op: str) -> Callable[..., Nodes]:
    def reduce(g: Graph, params: Any, shape: tuple, a: Nodes) -> Nodes:
        moved = np.moveaxis(a, params["axes"], range(len(params["axes"]))).reshape(-1, int(np.prod(shape, dtype=int)))
        total = list(moved[0])
        for row in moved[1:]:
            total = [g.apply(op, int(t), int(r)) for t, r in zip(total, row, strict=True)]
        return np.array(total, dtype=np.int64).reshape(shape)

    return reduce


def _item(g: Graph, table: Nodes, index: int) -> int:
    """An element of a one-dimensional table of neighbouring inputs; the index lies inside."""
    places = [g.nodes[int(n)] for n in table]
    group, row = places[0].place
    known = g.value(index)
    if known is not None:
        return int(table[int(known)])
    if group != SHARED or any(p.op != "input" or p.place != (group, row + i) for i, p in enumerate(places)):
        raise UnknownOperationError("an index into what varies")
    return g.lookup(group, row, index)


def _inside(g: Graph, index: int, last: int) -> int:
    return g.apply("min", g.apply("max", index, g.constant(0)), g.constant(last))


def _dynamic_slice(g: Graph, params: Any, shape: tuple, a: Nodes, *starts: Nodes) -> Nodes:
    if a.ndim != 1 or tuple(params["slice_sizes"]) != (1,):
        raise UnknownOperationError("dynamic_slice")
    return np.array([_item(g, a, _inside(g, int(starts[0]), a.size - 1))], dtype=np.int64)


def _gather(g: Graph, params: Any, shape: tuple, a: Nodes, indices: Nodes) -> Nodes:
    beyond = jax.lax.GatherScatterMode.from_any(params["mode"])
    if beyond not in (jax.lax.GatherScatterMode.CLIP, jax.lax.GatherScatterMode.PROMISE_IN_BOUNDS):
        raise UnknownOperationError("gather that fills")
    if a.ndim != 1 or tuple(params["slice_sizes"]) != (1,) or indices.shape != (*shape, 1):
        raise UnknownOperationError("gather")
    made = [_item(g, a, _inside(g, int(i), a.size - 1)) for i in indices.ravel()]
    return np.array(made, dtype=np.int64).reshape(shape)


_ARRAYS: dict[str, Callable[..., Nodes]] = {
    "broadcast_in_dim": _broadcast,
    "slice": _slice,
    "reshape": lambda g, params, shape, a: a.reshape(shape),
    "squeeze": lambda g, params, shape, a: a.reshape(shape),
    "expand_dims": lambda g, params, shape, a: a.reshape(shape),
    "concatenate": lambda g, params, shape, *parts: np.concatenate(parts, axis=params["dimension"]),
    "stack": lambda g, params, shape, *parts: np.stack(parts, axis=params["axis"]),
    "tile": lambda g, params, shape, a: np.tile(a, params["reps"]),
    "transpose": lambda g, params, shape, a: a.transpose(params["permutation"]),
    "rev": lambda g, params, shape, a: np.flip(a, params["dimensions"]),
    "reduce_sum": _reduce("add"),
    "reduce_max": _reduce("max"),
    "reduce_min": _reduce("min"),
    "dynamic_slice": _dynamic_slice,
    "gather": _gather,
}
_PARTS: dict[str, Callable[..., list[Nodes]]] = {
    "unstack": lambda params, a: list(np.moveaxis(a, params["axis"], 0)),
    "split": lambda params, a: np.split(a, np.cumsum(params["sizes"])[:-1], axis=params["axis"]),
}
