"""The passes of the filter's means and of the smoother as machine code: `kalman.forward` and `kalman.backward`."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

from bayeschute.compiler.emit import Program
from bayeschute.compiler.sections import Memory
from bayeschute.likelihood.filter_code.rows import RowCode, padded

SYSTEM = ("by_state", "by_latent", "transition", "kept", "output", "seen", "gain")
"""Arguments that both passes share: fields of `kalman.Gains`."""


class MeanSizes(NamedTuple):
    """Numbers of a flight's own states, latent states, outputs, columns, states with inputs; whether there is slack."""

    own: int
    latent: int
    outputs: int
    columns: int
    driven: int = 0
    slack: bool = False

    @property
    def body(self) -> int:
        """Own and latent states."""
        return self.own + self.latent

    @property
    def states(self) -> int:
        """All states."""
        return self.body + self.outputs


class _Sample(NamedTuple):
    """Addresses of a sample's matrices."""

    by_state: str
    by_latent: str
    output: str
    seen: str
    gain: str


def _sample(code: RowCode, sizes: MeanSizes, t: str, step: str) -> _Sample:
    x, c = sizes.own, sizes.outputs
    return _Sample(
        code.row_of("%by_state", step, x * x),
        code.row_of("%by_latent", step, x * sizes.latent),
        code.row_of("%output", t, c * x),
        code.row_of("%seen", t, c),
        code.row_of("%gain", t, sizes.states * c),
    )


@cache
def forward_pass(sizes: MeanSizes, told: int) -> Program:
    """Innovations and predicted means of M columns; S states, X of them the flight's own.

    Arguments of the function: `SYSTEM`; ``inverse`` (T, C, C); ``series`` (T, C, M); ``inputs`` (T, driven, M); results
    ``unit``, ``weighted`` (T, C, M), ``predicted`` (T, told, M); ``scratch``; then the number of samples and of steps.

    Args:
        sizes: Of the flight and its columns.
        told: Of how many states the means are a result, from the first on.
    """
    x, latent, c, m, driven, _ = sizes
    n, s, wide, code, memory = sizes.body, sizes.states, padded(m), RowCode(), Memory(1)
    mean, later, off, scaled = (code.address("%scratch", memory.take(rows * wide)) for rows in (s, s, c, c))
    code.emptied(s * wide, mean)
    last = code.integer("sub", "%steps", 1)
    with code.loop("%samples") as t:
        one = _sample(code, sizes, t, code.least(t, last))
        inverse, series, inputs = (
            code.row_of(name, t, size)
            for name, size in (("%inverse", c * c), ("%series", c * m), ("%inputs", driven * m))
        )
        if driven:
            with code.loop(driven) as i:
                to = code.row_of(mean, i, wide)
                code.put(code.plus(code.row(to, wide), code.read(code.row_of(inputs, i, m), m)), to)
        with code.loop(told) as i:
            row = code.row(code.row_of(mean, i, wide), wide)
            code.put(row, code.row_of(code.row_of("%predicted", t, told * m), i, m), m)
        with code.loop(c) as j:
            to, h = code.row_of(off, j, wide), code.row_of(one.output, j, x)
            code.put(code.zeros(wide), to)
            with code.loop(code.new(f"fptosi double {code.number(one.seen, j)} to i64")):  # once, or not at all
                row = code.read(code.row_of(series, j, m), m)
                row = code.plus(row, code.row(code.row_of(mean, code.integer("add", j, n), wide), wide), "fsub")
                pairs = [(code.address(h, k), code.address(mean, k * wide)) for k in range(x)]
                code.put(code.combined(row, pairs, "fsub"), to)
        with code.loop(c) as j:
            pairs = [(code.row_of(inverse, j, c, k), code.address(off, k * wide)) for k in range(c)]
            row = code.combined(code.zeros(wide), pairs)
            code.put(row, code.row_of(scaled, j, wide))
            code.put(row, code.row_of(code.row_of("%unit", t, c * m), j, m), m)
        with code.loop(c) as j:
            pairs = [(code.row_of(inverse, k, c, j), code.address(scaled, k * wide)) for k in range(c)]
            row = code.combined(code.zeros(wide), pairs)
            code.put(row, code.row_of(code.row_of("%weighted", t, c * m), j, m), m)
        with code.loop(s) as i:
            to, gain = code.row_of(mean, i, wide), code.row_of(one.gain, i, c)
            pairs = [(code.address(gain, k), code.address(off, k * wide)) for k in range(c)]
            code.put(code.combined(code.row(to, wide), pairs), to)
        with code.loop(x) as i:
            pairs = [(code.row_of(one.by_state, i, x, k), code.address(mean, k * wide)) for k in range(x)]
            pairs += [
                (code.row_of(one.by_latent, i, latent, k), code.address(mean, (x + k) * wide)) for k in range(latent)
            ]
            code.put(code.combined(code.zeros(wide), pairs), code.row_of(later, i, wide))
        with code.loop(latent) as i:
            pairs = [
                (code.row_of("%transition", i, latent, k), code.address(mean, (x + k) * wide)) for k in range(latent)
            ]
            code.put(code.combined(code.zeros(wide), pairs), code.row_of(later, code.integer("add", i, x), wide))
        with code.loop(c) as j:
            row = code.row(code.row_of(mean, code.integer("add", j, n), wide), wide)
            code.put(code.times(code.spread("%kept", j), row), code.row_of(later, code.integer("add", j, n), wide))
        code.copied(s * wide, later, mean)
    pointers = (*SYSTEM, "inverse", "series", "inputs", "unit", "weighted", "predicted", "scratch")
    return code.program("forward", pointers, ("samples", "steps"), memory.size + wide)


@cache
def backward_pass(sizes: MeanSizes) -> Program:
    """Smoothed process noise and states of M columns, and the adjoint vectors of the first sample.

    Arguments of the function: `SYSTEM`; ``by_shock`` (T - 1, X, L); ``noise_gain`` (L, L); ``slack`` (X,); ``spread``
    (T, X, S); ``weighted`` (T, C, M); ``predicted`` (T, X, M); results ``first`` (S, M), ``shocks`` (T, W, M), that of
    the first sample left out, ``states`` (T, X, M); ``scratch``; then the number of samples and of steps.
    """
    x, latent, c, m, _, slack = sizes
    n, s, wide, code, memory = sizes.body, sizes.states, padded(m), RowCode(), Memory(1)
    shocks = latent + x * slack
    adjoint, back, left = (code.address("%scratch", memory.take(rows * wide)) for rows in (s, s, c))
    code.emptied(s * wide, adjoint)
    final, last = (code.integer("sub", count, 1) for count in ("%samples", "%steps"))
    with code.loop("%samples") as from_end:
        t = code.integer("sub", final, from_end)
        step = code.least(t, last)
        one = _sample(code, sizes, t, step)
        by_shock = code.row_of("%by_shock", step, x * latent)
        with code.loop(code.least(from_end, "1")):  # not after the last sample
            to = code.row_of("%shocks", code.integer("add", t, 1), shocks * m)
            with code.loop(latent) as i:
                pairs = [(code.row_of(by_shock, k, latent, i), code.address(adjoint, k * wide)) for k in range(x)]
                pairs += [
                    (code.row_of("%noise_gain", k, latent, i), code.address(adjoint, (x + k) * wide))
                    for k in range(latent)
                ]
                code.put(code.combined(code.zeros(wide), pairs), code.row_of(to, i, m), m)
            if slack:
                with code.loop(x) as i:
                    row = code.times(code.spread("%slack", i), code.row(code.row_of(adjoint, i, wide), wide))
                    code.put(row, code.row_of(to, code.integer("add", i, latent), m), m)
        with code.loop(x) as i:
            pairs = [(code.row_of(one.by_state, k, x, i), code.address(adjoint, k * wide)) for k in range(x)]
            code.put(code.combined(code.zeros(wide), pairs), code.row_of(back, i, wide))
        with code.loop(latent) as i:
            pairs = [(code.row_of(one.by_latent, k, latent, i), code.address(adjoint, k * wide)) for k in range(x)]
            pairs += [
                (code.row_of("%transition", k, latent, i), code.address(adjoint, (x + k) * wide)) for k in range(latent)
            ]
            code.put(code.combined(code.zeros(wide), pairs), code.row_of(back, code.integer("add", i, x), wide))
        with code.loop(c) as j:
            row = code.row(code.row_of(adjoint, code.integer("add", j, n), wide), wide)
            code.put(code.times(code.spread("%kept", j), row), code.row_of(back, code.integer("add", j, n), wide))
        with code.loop(c) as j:
            row = code.read(code.row_of(code.row_of("%weighted", t, c * m), j, m), m)
            pairs = [(code.row_of(one.gain, k, c, j), code.address(back, k * wide)) for k in range(s)]
            code.put(code.combined(row, pairs, "fsub"), code.row_of(left, j, wide))
        with code.loop(x) as i:
            pairs = [(code.row_of(one.output, k, x, i), code.address(left, k * wide)) for k in range(c)]
            row = code.combined(code.row(code.row_of(back, i, wide), wide), pairs)
            code.put(row, code.row_of(adjoint, i, wide))
        code.copied(latent * wide, code.address(back, x * wide), code.address(adjoint, x * wide))
        with code.loop(c) as j:
            own = code.integer("add", j, n)
            row = code.times(code.spread(one.seen, j), code.row(code.row_of(left, j, wide), wide))
            row = code.plus(row, code.row(code.row_of(back, own, wide), wide))
            code.put(row, code.row_of(adjoint, own, wide))
        with code.loop(x) as i:
            row = code.read(code.row_of(code.row_of("%predicted", t, x * m), i, m), m)
            spread = code.row_of(code.row_of("%spread", t, x * s), i, s)
            pairs = [(code.address(spread, k), code.address(adjoint, k * wide)) for k in range(s)]
            code.put(code.combined(row, pairs), code.row_of(code.row_of("%states", t, x * m), i, m), m)
    with code.loop(s) as i:
        code.put(code.row(code.row_of(adjoint, i, wide), wide), code.row_of("%first", i, m), m)
    given = (*SYSTEM, "by_shock", "noise_gain", "slack", "spread", "weighted", "predicted")
    pointers = (*given, "first", "shocks", "states", "scratch")
    return code.program("backward", pointers, ("samples", "steps"), memory.size + wide)
