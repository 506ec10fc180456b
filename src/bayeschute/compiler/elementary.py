"""Elementary functions written out in arithmetic, so that they run on several lanes at once without calls.

Reduction to a small interval, then the Taylor polynomial: errors of a few units in the last place at most. Sine and
cosine hold that up to 1e6 rad.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from bayeschute.compiler.graph import Graph

# pi/2 and log(2) as sums; multiples of all but the last part are exact up to 2^20 (Cody & Waite 1980).
_QUARTER = tuple(float.fromhex(part) for part in ("0x1.921fb544p+0", "0x1.0b4611a6p-34", "0x1.3198a2e037073p-69"))
_LOG2 = (math.ldexp(2977044471, -32), 1.9082149292705877e-10)


def written_out(graph: Graph, wanted: Sequence[int]) -> tuple[Graph, list[int]]:
    """A graph without elementary functions that have a form here, and the nodes in it that stand for `wanted`."""
    new = Graph()
    at: dict[int, int] = {}
    for node in graph.needed(wanted):
        op, args, value, place = graph.nodes[node]
        mapped = [at[a] for a in args]
        if value is not None:
            at[node] = new.constant(value)
        elif op == "input":
            at[node] = new.input(*place)
        elif op == "lookup":
            at[node] = new.lookup(*place, mapped[0])
        else:
            at[node] = _FORMS[op](new, *mapped) if op in _FORMS else new.apply(op, *mapped)
    return new, [at[node] for node in wanted]


def _polynomial(g: Graph, z: int, coefficients: Sequence[float]) -> int:
    """Sum of c_i z^i by pairs (Estrin): few operations in a row."""
    terms = [g.constant(c) for c in coefficients]
    while len(terms) > 1:
        pairs = [terms[i : i + 2] for i in range(0, len(terms), 2)]
        terms = [p[0] if len(p) == 1 else g.apply("add", p[0], g.apply("mul", p[1], z)) for p in pairs]
        z = g.apply("mul", z, z)
    return terms[0]


def _reduced(g: Graph, x: int, inverse: float, parts: Sequence[float]) -> tuple[int, int]:
    """Nearest multiple k of a constant, and x - k times it."""
    k = g.apply("floor", g.apply("add", g.apply("mul", x, g.constant(inverse)), g.constant(0.5)))
    for part in parts:
        x = g.apply("sub", x, g.apply("mul", k, g.constant(part)))
    return k, x


def _circular(g: Graph, x: int, quarters: float) -> int:
    """sin(x + quarters pi/2)."""
    k, r = _reduced(g, x, 2.0 / math.pi, _QUARTER)
    z = g.apply("mul", r, r)
    odd = [(-1.0) ** i / math.factorial(2 * i + 1) for i in range(1, 9)]
    even = [(-1.0) ** i / math.factorial(2 * i) for i in range(9)]
    sine = g.apply("add", r, g.apply("mul", g.apply("mul", r, z), _polynomial(g, z, odd)))
    cosine = _polynomial(g, z, even)
    k = g.apply("add", k, g.constant(quarters))
    turn = g.apply("sub", k, g.apply("mul", g.constant(4.0), g.apply("floor", g.apply("mul", k, g.constant(0.25)))))
    half = g.apply("le", g.constant(2.0), turn)
    which = g.apply("sub", turn, g.apply("select", half, g.constant(2.0), g.constant(0.0)))
    value = g.apply("select", g.apply("eq", which, g.constant(1.0)), cosine, sine)
    return g.apply("select", half, g.apply("neg", value), value)


def _exponential(g: Graph, x: int) -> int:
    inside = g.apply("min", g.apply("max", x, g.constant(-1400.0)), g.constant(1400.0))
    k, r = _reduced(g, inside, 1.0 / math.log(2.0), _LOG2)
    value = _polynomial(g, r, [1.0 / math.factorial(i) for i in range(15)])
    low = g.apply("floor", g.apply("mul", k, g.constant(0.5)))
    for part in (low, g.apply("sub", k, low)):  # in two steps: each power is a normal number
        value = g.apply("mul", value, g.apply("power_of_two", g.apply("to_integer", part)))
    return value


def _angle(g: Graph, y: int, x: int) -> int:
    """Four-quadrant angle: atan of the smaller over the larger side, its range cut to pi/16 about 0, pi/8 or pi/4."""
    a, b = g.apply("abs", y), g.apply("abs", x)
    steep = g.apply("lt", b, a)
    high, low = g.apply("select", steep, a, b), g.apply("select", steep, b, a)

    def beyond(angle: float) -> int:
        return g.apply("lt", g.apply("mul", high, g.constant(math.tan(angle))), low)

    def by_range(values: Sequence[float]) -> int:
        first, second, third = (g.constant(v) for v in values)
        inner = g.apply("select", beyond(math.pi / 16.0), second, first)
        return g.apply("select", beyond(3.0 * math.pi / 16.0), third, inner)

    slope = by_range((0.0, math.tan(math.pi / 8.0), 1.0))
    top = g.apply("sub", low, g.apply("mul", slope, high))
    bottom = g.apply("add", high, g.apply("mul", slope, low))
    t = g.apply("div", top, g.apply("select", g.apply("eq", bottom, g.constant(0.0)), g.constant(1.0), bottom))
    z = g.apply("mul", t, t)
    series = _polynomial(g, z, [(-1.0) ** i / (2 * i + 1) for i in range(1, 12)])
    angle = g.apply("add", t, g.apply("mul", g.apply("mul", t, z), series))
    angle = g.apply("add", by_range((0.0, math.pi / 8.0, math.pi / 4.0)), angle)
    angle = g.apply("select", steep, g.apply("sub", g.constant(math.pi / 2.0), angle), angle)
    behind = g.apply("lt", x, g.constant(0.0))
    angle = g.apply("select", behind, g.apply("sub", g.constant(math.pi), angle), angle)
    return g.apply("copysign", angle, y)


_FORMS: dict[str, Callable[..., int]] = {
    "sin": lambda g, x: _circular(g, x, 0.0),
    "cos": lambda g, x: _circular(g, x, 1.0),
    "exp": _exponential,
    "atan2": _angle,
}
