"""The covariance pass of the filter as machine code: `kalman.covariances`, sample by sample.

State covariances are held as one symmetric matrix of the flight's own and latent states, n together, and of the C
outputs' residual noise behind them; columns and rows of that begin at a whole register.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

from bayeschute.compiler.emit import Program
from bayeschute.compiler.sections import Memory
from bayeschute.likelihood.filter_code.rows import RowCode, padded, parts

GIVEN = (
    "by_state", "by_now", "by_then", "out_state", "seen", "white", "latent", "latent_then", "latent_noise",
    "transition", "noise_gain", "slack", "kept", "fresh", "start", "stationary",
)  # fmt: skip
"""Arguments, in their order; see `covariance_pass`."""


class Sizes(NamedTuple):
    """Numbers of a flight's own states, latent states, outputs, disturbances, and whether own states have slack.

    Results are those for a smoother, or those for the gradient by the noise parameters (``score``).
    """

    own: int
    latent: int
    outputs: int
    disturbances: int
    slack: bool = False
    score: bool = False

    @property
    def states(self) -> int:
        """All states."""
        return self.own + self.latent + self.outputs

    def results(self, samples: int) -> dict[str, tuple[int, int, int]]:
        """Shapes of the results: by step, then by sample."""
        x, size, c, s = self.own, self.latent, self.outputs, self.states
        by_step = {"by_latent": (x, size), "by_shock": (x, size)}
        by_sample = {"output": (c, x), "gain": (s, c), "root": (c, c), "inverse": (c, c)}
        more = {"latents": (s, size), "noises": (s, c)} if self.score else {"spread": (x, s)}
        both = [(name, (samples - 1, *shape)) for name, shape in by_step.items()]
        return dict([*both, *((name, (samples, *shape)) for name, shape in (by_sample | more).items())])


class _Pass:
    """The code under construction, its sizes and places in memory."""

    def __init__(self, sizes: Sizes) -> None:
        self.sizes, self.code, memory = sizes, RowCode(), Memory(1)
        x, self.c = sizes.own, sizes.outputs
        self.n, self.s = x + sizes.latent, sizes.states
        self.wn, self.wc = padded(self.n), padded(self.c)
        self.w, self.wa = self.wn + self.wc, self.wc + self.wn + 2 * self.wc
        room = {
            "covariance": (self.wn + self.c) * self.w,  # all states' given the data so far
            "table": self.c * self.wa,  # innovations' covariance | products with states | one; then factored
            "outputs": x * self.wc,  # transposed
            "shocks": sizes.latent * self.wn,  # effect of the process noise, transposed
            "moved": (self.wn + self.c) * self.w,  # transition times covariance
            "square": self.wn * self.wn,
            "turned": self.wn * self.wn,
            "seen": self.wc,
        }
        self.place = {name: self.code.address("%scratch", memory.take(padded(size))) for name, size in room.items()}
        self.scratch = memory.size + self.w

    def noise(self, name: str, output: str, column: str | int = 0) -> str:
        """Address in the row of an output's residual noise."""
        return self.code.row_of(self.place[name], self.code.integer("add", output, self.wn), self.w, column)

    def at(self, name: str, row: str, column: str | int = 0) -> str:
        """Address in the row of another state."""
        return self.code.row_of(self.place[name], row, self.w, column)

    def column(self, name: str, row: int, column: str | int = 0) -> str:
        """Likewise of a row known when the code is made."""
        return self.code.address(self.code.address(self.place[name], row * self.w), column)

    def begin(self) -> None:
        """Covariances at the first sample."""
        code, n = self.code, self.n
        for name, rows, columns in (("covariance", self.wn + self.c, self.w), ("moved", self.wn + self.c, self.w)):
            code.emptied(rows * columns, self.place[name])
        code.emptied(self.c * self.wa, self.place["table"])
        code.emptied(self.sizes.own * self.wc, self.place["outputs"])
        code.emptied(self.wn * self.wn, self.place["square"])
        code.emptied(self.sizes.latent * self.wn, self.place["shocks"])
        code.emptied(self.wc, self.place["seen"])
        with code.loop(n) as i:
            code.copied(n, code.row_of("%start", i, n), self.at("covariance", i))
        with code.loop(self.c) as j:
            code.keep(code.number("%stationary", j), self.noise("covariance", j, self.wn), j)
        x, size = self.sizes.own, self.sizes.latent
        with code.loop(size) as i:
            to = code.address(code.address(self.place["shocks"], x), i)
            code.copied(size, code.row_of("%noise_gain", i, size), to, self.wn)

    def system(self, sample: dict[str, str]) -> None:
        """What a sample's step adds to the linearised flight: effects of latent states, of their noise, outputs."""
        code, (x, size, c, a, *_) = self.code, self.sizes
        wide = padded(size)
        with code.loop(x) as i:
            now, then = (code.row_of(sample[name], i, a) for name in ("by_now", "by_then"))
            pairs = [(code.address(now, k), code.address("%latent", k * wide)) for k in range(a)]
            pairs += [(code.address(then, k), code.address("%latent_then", k * wide)) for k in range(a)]
            code.put(code.combined(code.zeros(wide), pairs), code.row_of(sample["by_latent"], i, size), size)
            pairs = [(code.address(then, k), code.address("%latent_noise", k * wide)) for k in range(a)]
            to = code.row_of(sample["by_shock"], i, size)
            code.put(code.combined(code.zeros(wide), pairs), to, size)
            code.copied(size, to, code.address(self.place["shocks"], i), self.wn)
        with code.loop(c) as j:
            to = code.row_of(sample["output"], j, x)
            with code.loop(code.new(f"fptosi double {code.number(sample['seen'], j)} to i64")):  # once, or not at all
                code.copied(x, code.row_of(sample["out_state"], j, x), to)
            code.copied(x, to, code.address(self.place["outputs"], j), self.wc)
        code.copied(c, sample["seen"], self.place["seen"])

    def innovations(self, sample: dict[str, str]) -> None:
        """Covariance of the innovations, its factor, and this one's inverse times their products with the states."""
        code, c, wc, wn, wa = self.code, self.c, self.wc, self.wn, self.wa
        x, table = self.sizes.own, self.place["table"]
        with code.loop(c) as i:
            at, h = code.row_of(table, i, wa), code.row_of(sample["output"], i, x)
            here = code.spread(sample["seen"], i)
            for first, count in parts(self.w):
                row = code.times(here, code.row(self.noise("covariance", i, first), count))
                pairs = ((code.address(h, k), self.column("covariance", k, first)) for k in range(x))
                code.put(code.combined(row, pairs), code.address(at, wc + first))
            own, seen = code.row(code.address(at, wc + wn), wc), code.row(self.place["seen"], wc)
            row = [code.new(f"fmul contract {code.type()} {u}, {v}") for u, v in zip(own, seen, strict=True)]
            pairs = ((code.address(at, wc + k), code.address(self.place["outputs"], k * wc)) for k in range(x))
            code.put(code.combined(row, pairs), at)
            total = code.new(f"fadd double {code.number(at, i)}, {code.number(sample['white'], i)}")
            code.keep(total, at, i)
            code.put(code.zeros(wc), code.address(at, wc + self.w))
            code.keep(code.scalar(1.0), code.address(at, wc + self.w), i)
        with code.loop(c) as k:  # Cholesky factor by columns, and all that is behind it
            at = code.row_of(table, k, wa)
            pivot = code.call("sqrt", code.everywhere(code.number(at, k)))
            inverse = code.new(f"fdiv {code.type()} {code.constant(1.0)}, {pivot}")
            for first, count in parts(wa):
                to = code.address(at, first)
                code.put(code.times(inverse, code.row(to, count)), to)
            with code.loop(c, code.integer("add", k, 1)) as i:
                factor, other = code.spread(code.address(at, i), 0), code.row_of(table, i, wa)
                for first, count in parts(wa):
                    to, row = code.address(other, first), code.row(code.address(at, first), count)
                    code.put(code.plus(code.row(to, count), code.times(factor, row), "fsub"), to)
            with code.loop(c, k) as i:
                code.keep(code.number(at, i), code.row_of(sample["root"], i, c, k))
            code.put(code.row(code.address(at, wc + self.w), wc), code.row_of(sample["inverse"], k, c), c)

    def updated(self, row: str, gain: str) -> None:
        """A state's gain, and its covariances given the sample; `row`: its place in memory."""
        code, wc, wa, table = self.code, self.wc, self.wa, self.place["table"]
        halves = [code.address(code.address(table, k * wa + wc), row) for k in range(self.c)]
        pairs = ((half, code.address(table, k * wa + wc + self.w)) for k, half in enumerate(halves))
        code.put(code.combined(code.zeros(wc), pairs), gain, self.c)
        for first, count in parts(self.w):
            to = self.at("covariance", row, first)
            pairs = ((half, code.address(table, k * wa + wc + first)) for k, half in enumerate(halves))
            code.put(code.combined(code.row(to, count), pairs, "fsub"), to)

    def _transition(self, own: bool, row: str, sample: dict[str, str]) -> list[tuple[int, str]]:
        """A state's row of the transition: columns, and addresses of their numbers."""
        code, x, size = self.code, self.sizes.own, self.sizes.latent
        if not own:  # latent states follow from latent states alone
            return [(x + k, code.row_of("%transition", row, size, k)) for k in range(size)]
        state, latent = code.row_of(sample["by_state"], row, x), code.row_of(sample["by_latent"], row, size)
        return [(k, code.address(state, k)) for k in range(x)] + [(x + k, code.address(latent, k)) for k in range(size)]

    def moved(self, sample: dict[str, str]) -> None:
        """Transition times covariances."""
        code, n, x = self.code, self.n, self.sizes.own
        for low, high in ((0, x), (x, n)):
            with code.loop(high, low) as i:
                row = self._transition(low == 0, code.integer("sub", i, low), sample)
                for first, count in parts(self.w):
                    pairs = ((number, self.column("covariance", k, first)) for k, number in row)
                    code.put(code.combined(code.zeros(count), pairs), self.at("moved", i, first))
                code.put(code.row(self.at("moved", i), self.wn), code.row_of(self.place["square"], i, self.wn))
                self._told(self.at("moved", i), i, sample)
        with code.loop(self.c) as j:
            for first, count in parts(self.w):
                values = code.row(self.noise("covariance", j, first), count)
                code.put(code.times(code.spread("%kept", j), values), self.noise("moved", j, first))
            self._told(self.noise("moved", j), code.integer("add", j, n), sample)

    def _told(self, row: str, state: str, sample: dict[str, str]) -> None:
        """What the gradient by the noise parameters wants of that."""
        code, size = self.code, self.sizes.latent
        if self.sizes.score:
            latents = code.read(code.address(row, self.sizes.own), size)
            code.put(latents, code.row_of(sample["latents"], state, size), size)
            noises = code.row(code.address(row, self.wn), self.wc)
            code.put(noises, code.row_of(sample["noises"], state, self.c), self.c)

    def predicted(self, sample: dict[str, str]) -> None:
        """Covariances at the next sample."""
        code, n, x, wn, size = self.code, self.n, self.sizes.own, self.wn, self.sizes.latent
        code.turned(self.place["square"], self.place["turned"], wn)
        bounds = sorted({0, x, n, min(padded(n // 2), n)})
        for low, high in zip(bounds[:-1], bounds[1:], strict=True):
            own = low < x
            with code.loop(high, low) as i:
                state = i if own else code.integer("sub", i, x)
                row = self._transition(own, state, sample)
                noise = code.row_of(sample["by_shock"] if own else "%noise_gain", state, size)
                for first, count in parts(padded(high)):  # up to the diagonal and a little further
                    turned, shocks = (code.address(self.place[name], first) for name in ("turned", "shocks"))
                    pairs = [(number, code.address(turned, k * wn)) for k, number in row]
                    pairs += [(code.address(noise, k), code.address(shocks, k * wn)) for k in range(size)]
                    code.put(code.combined(code.zeros(count), pairs), self.at("covariance", i, first))
                if self.sizes.slack and own:
                    to, slack = self.at("covariance", i), code.number("%slack", i)
                    square = code.new(f"fmul double {slack}, {slack}")
                    code.keep(code.new(f"fadd double {code.number(to, i)}, {square}"), to, i)
        with code.loop(n) as i:
            with code.loop(i) as j:  # what rounding left unlike would grow
                code.keep(code.number(self.at("covariance", i), j), self.at("covariance", j), i)
            with code.loop(self.c) as j:
                both = code.number(self.at("moved", i, wn), j), code.number("%kept", j)
                cross = code.new(f"fmul double {both[0]}, {both[1]}")
                code.keep(cross, self.at("covariance", i, wn), j)
                code.keep(cross, self.noise("covariance", j), i)
        with code.loop(self.c) as i:
            to = self.noise("covariance", i, wn)
            with code.loop(self.c) as j:
                both = code.number(self.noise("moved", i, wn), j), code.number("%kept", j)
                code.keep(code.new(f"fmul double {both[0]}, {both[1]}"), to, j)
            total = code.new(f"fadd double {code.number(to, i)}, {code.number('%fresh', i)}")
            code.keep(total, to, i)


@cache
def covariance_pass(sizes: Sizes) -> Program:
    """The pass; T samples, S = X + L + C states, A disturbances.

    Arguments of the function: derivatives ``by_state`` (T - 1, X, X), ``by_now``, ``by_then`` (T - 1, X, A),
    ``out_state`` (T, C, X); ``seen`` (T, C), one where a datum exists, else zero; ``white`` (T, C), variances of white
    noise, one where none exists; disturbances of latent states now, at the next sample, and of their noise then
    ``latent``, ``latent_then``, ``latent_noise`` (A, L padded); ``transition``, ``noise_gain`` (L, L); ``slack`` (X,);
    ``kept``, ``fresh``, ``stationary`` (C,), of residual noise; ``start`` (X + L, X + L), the covariance at first.
    Results, zeros at first: `Sizes.results`; see `kalman.Gains`. Then ``scratch``, the number of samples and of steps.
    """
    made = _Pass(sizes)
    code, n, x, a = made.code, made.n, sizes.own, sizes.disturbances
    results = sizes.results(1)
    made.begin()
    last = code.integer("sub", "%steps", 1)
    with code.loop("%samples") as t:
        step = code.least(t, last)
        sizes_of = {"by_state": x * x, "by_now": x * a, "by_then": x * a}
        sample = {name: code.row_of(f"%{name}", step, size) for name, size in sizes_of.items()}
        sample["out_state"] = code.row_of("%out_state", t, made.c * x)
        for name, shape in results.items():
            when = step if name in ("by_latent", "by_shock") else t
            sample[name] = code.row_of(f"%{name}", when, shape[1] * shape[2])
        for name in ("seen", "white"):
            sample[name] = code.row_of(f"%{name}", t, made.c)
        made.system(sample)
        if not sizes.score:
            with code.loop(x) as i:
                at, to = made.at("covariance", i), code.row_of(sample["spread"], i, made.s)
                code.put(code.row(at, made.wn), to, n)
                code.put(code.row(code.address(at, made.wn), made.wc), code.address(to, n), made.c)
        made.innovations(sample)
        with code.loop(n) as i:
            made.updated(i, code.row_of(sample["gain"], i, made.c))
        with code.loop(made.c) as j:
            made.updated(
                code.integer("add", j, made.wn), code.row_of(sample["gain"], code.integer("add", j, n), made.c)
            )
        made.moved(sample)
        made.predicted(sample)
    return code.program("covariances", (*GIVEN, *results, "scratch"), ("samples", "steps"), made.scratch)
