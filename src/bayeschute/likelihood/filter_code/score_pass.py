"""The adjoint pass of the gradient by the noise parameters as machine code: `kalman_gradient.slope`."""

from __future__ import annotations

from functools import cache

from bayeschute.compiler.emit import Program
from bayeschute.compiler.sections import Memory
from bayeschute.likelihood.filter_code.mean_passes import SYSTEM, MeanSizes
from bayeschute.likelihood.filter_code.rows import RowCode, padded, parts

Pairs = list[tuple[str, str]]


class _Adjoint:
    """The code under construction: adjoints ``z`` of covariances (S, S) and ``r`` of means (S, K), sample by sample."""

    def __init__(self, sizes: MeanSizes) -> None:
        self.sizes, self.code, memory = sizes, RowCode(), Memory(1)
        self.x, self.latent, self.c, self.columns, *_ = sizes
        self.n, self.s = sizes.body, sizes.states
        self.w, self.k, self.wc, self.wl, self.wn = (
            padded(a) for a in (self.s, self.columns, self.c, self.latent, self.n)
        )
        room = {
            "z": self.w * self.w, "r": self.s * self.k, "transition": self.n * self.wn, "left": self.n * self.w,
            "back": self.s * self.k, "back_turned": self.k * self.w, "by_way": self.latent * self.w,
            "way_r": self.latent * self.k, "pulled": self.c * self.w, "g": self.c * self.k,
            "g_turned": self.k * self.wc, "d": self.c * self.wc, "mixed": self.wc, "half": self.c * (self.w + self.wc),
            "push": self.w * self.w, "push_turned": self.w * self.w, "sums": self.latent * 2 * self.wl, "row": self.wc,
        }  # fmt: skip
        self.place = {name: self.code.address("%scratch", memory.take(padded(size))) for name, size in room.items()}
        for name, size in room.items():
            self.code.emptied(size, self.place[name])
        for j in range(self.latent):
            row = self.code.read(self.code.address("%transition", j * self.latent), self.latent)
            self.code.put(row, self.at("transition", self.x + j, self.wn, self.x), self.latent)
        self.scratch = memory.size + self.w

    def at(self, name: str, row: str | int, stride: int, column: str | int = 0) -> str:
        """Address in a matrix."""
        return self.code.row_of(self.place[name], row, stride, column)

    def noise(self, output: str) -> str:
        """Number of the state of an output's residual noise."""
        return self.code.integer("add", output, self.n)

    def number_times(self, left: str, stride: int, name: str, wide: int, first: int, rows: range) -> Pairs:
        """A column of numbers, `stride` apart, each times a row of a matrix."""
        pairs = []
        for place, k in enumerate(rows):
            number = self.code.address(left, place * stride)
            pairs.append((number, self.at(name, k, wide, first)))
        return pairs

    def by_parts(self, sample: dict[str, str]) -> None:
        """What the next step adds to the derivatives by the matrices that the noise parameters make."""
        code, x, w, k, wl = self.code, self.x, self.w, self.k, self.wl
        for name, source, wide in (("by_way", "z", w), ("way_r", "r", k)):
            with code.loop(self.latent) as i:
                for first, count in parts(wide):
                    row = code.row(self.at(source, code.integer("add", i, x), wide, first), count)
                    way = code.address(sample["way"], i)
                    row = code.combined(row, self.number_times(way, self.latent, source, wide, first, range(x)))
                    code.put(row, self.at(name, i, wide, first))
        with code.loop(self.latent) as i:
            to, by_way, way_r = self.at("sums", i, 2 * wl), self.at("by_way", i, w), self.at("way_r", i, k)
            size, both = self.latent, self.latent + self.c
            row = code.gathered(code.row(to, wl), by_way, sample["latents"], self.s, size, size)
            code.put(code.gathered(row, way_r, sample["means"], self.columns, both, size, "fsub"), to)
            row = code.plus(code.row(code.address(to, wl), wl), code.read(code.address(by_way, x), size))
            code.put(code.gathered(row, by_way, sample["way"], x, size, size), code.address(to, wl))
        with code.loop(self.c) as j:
            z, r = self.at("z", self.noise(j), w), self.at("r", self.noise(j), k)
            means = code.address(sample["means"], self.latent)
            row = code.gathered(code.zeros(self.wc), z, sample["noises"], self.s, self.c, self.c)
            row = code.gathered(row, r, means, self.columns, self.latent + self.c, self.c, "fsub")
            code.put(row, self.place["row"])
            self.add("%kept_slope", j, code.number(self.place["row"], j))
            self.add("%drift", j, code.number(z, self.noise(j)))

    def add(self, base: str, index: str, number: str) -> None:
        """Add to a number in memory."""
        code = self.code
        code.keep(code.new(f"fadd double {code.number(base, index)}, {number}"), base, index)

    def back(self, sample: dict[str, str]) -> None:
        """Both adjoints taken back over the transition."""
        code, x, n, w, k, latent = self.code, self.x, self.n, self.w, self.k, self.latent
        with code.loop(x) as i:
            code.copied(x, code.row_of(sample["by_state"], i, x), self.at("transition", i, self.wn))
            code.copied(latent, code.row_of(sample["by_latent"], i, latent), self.at("transition", i, self.wn, x))
        for name, source, wide in (("left", "z", w), ("back", "r", k)):
            for low, high, rows in ((0, x, range(x)), (x, n, range(n))):
                with code.loop(high, low) as i:
                    column = code.address(self.place["transition"], i)
                    for first, count in parts(wide):
                        pairs = self.number_times(column, self.wn, source, wide, first, rows)
                        code.put(code.combined(code.zeros(count), pairs), self.at(name, i, wide, first))
        with code.loop(self.c) as j:
            row = code.times(code.spread("%kept", j), code.row(self.at("r", self.noise(j), k), k))
            code.put(row, self.at("back", self.noise(j), k))
        with code.loop(self.s) as i:
            code.copied(self.columns, self.at("back", i, k), code.address(self.place["back_turned"], i), w)
        with code.loop(n) as i:
            left, to = self.at("left", i, w), self.at("push", i, w)
            for first, count in parts(self.wn):
                pairs = self.number_times(left, 1, "transition", self.wn, first, range(n))
                code.put(code.combined(code.zeros(count), pairs), code.address(to, first))
        with code.loop(n) as i:
            with code.loop(code.integer("add", i, 1)) as j:
                one, other = code.number(self.at("push", i, w), j), code.number(self.at("push", j, w), i)
                half = code.new(f"fmul double {code.scalar(0.5)}, {code.new(f'fadd double {one}, {other}')}")
                code.keep(half, self.at("z", i, w), j)
                code.keep(half, self.at("z", j, w), i)
            with code.loop(self.c) as j:
                both = code.number(self.at("left", i, w), self.noise(j)), code.number("%kept", j)
                cross = code.new(f"fmul double {both[0]}, {both[1]}")
                code.keep(cross, self.at("z", i, w), self.noise(j))
                code.keep(cross, self.at("z", self.noise(j), w), i)
        with code.loop(self.c) as i, code.loop(self.c) as j:
            kept = code.new(f"fmul double {code.number('%kept', i)}, {code.number('%kept', j)}")
            at = self.at("z", self.noise(i), w)
            code.keep(code.new(f"fmul double {code.number(at, self.noise(j))}, {kept}"), at, self.noise(j))

    def seen(self, sample: dict[str, str]) -> None:
        """Both taken back over the sample's data, and the derivatives by white noise."""
        code, x, c, w, k, wc = self.code, self.x, self.c, self.w, self.k, self.wc
        for name, source, wide in (("pulled", "z", w), ("g", "back", k)):
            with code.loop(c) as j:
                for first, count in parts(wide):
                    pairs = self.number_times(code.address(sample["gain"], j), c, source, wide, first, range(self.s))
                    code.put(code.combined(code.zeros(count), pairs), self.at(name, j, wide, first))
        with code.loop(c) as j:
            code.copied(self.columns, self.at("g", j, k), code.address(self.place["g_turned"], j), wc)
        with code.loop(c) as j:
            row = code.read(code.row_of(sample["inner"], j, c), c)
            weighted = code.row_of(sample["weighted"], j, self.columns)
            row = code.gathered(row, self.at("pulled", j, w), sample["gain"], self.s, c, c)
            pairs = self.number_times(weighted, 1, "g_turned", wc, 0, range(self.columns))
            mixed = code.combined(code.zeros(wc), pairs)
            code.put(row, self.place["row"])
            code.put(mixed, self.place["mixed"])
            twice = code.new(f"fmul double {code.scalar(2.0)}, {code.number(self.place['mixed'], j)}")
            own = code.new(f"fadd double {code.number(self.place['row'], j)}, {twice}")
            here = code.new(f"fmul double {code.scalar(0.5)}, {code.number(sample['seen'], j)}")
            self.add("%white", j, code.new(f"fmul double {here}, {own}"))
            code.put(code.plus(mixed, code.times(code.constant(0.5), row)), self.at("d", j, wc))
        with code.loop(c) as j:
            wide, weighted = w + wc, code.row_of(sample["weighted"], j, self.columns)
            to, d = self.at("half", j, wide), self.at("d", j, wc)
            for first, count in parts(w):
                row = code.times(code.constant(-1.0), code.row(self.at("pulled", j, w, first), count))
                pairs = self.number_times(weighted, 1, "back_turned", w, first, range(self.columns))
                code.put(code.combined(row, pairs, "fsub"), code.address(to, first))
            row = code.gathered(code.read(to, x), d, sample["output"], c, x, x)
            code.put(row, to, x)
            with code.loop(c) as i:
                product = code.new(f"fmul double {code.number(d, i)}, {code.number(sample['seen'], i)}")
                self.add(to, self.noise(i), product)
        with code.loop(x) as i:
            for first, count in parts(w):
                pairs = self.number_times(code.address(sample["output"], i), x, "half", w + wc, first, range(c))
                code.put(code.combined(code.zeros(count), pairs), self.at("push", i, w, first))
        code.emptied((self.s - x) * w, self.at("push", x, w))
        with code.loop(c) as j:
            row = code.times(code.spread(sample["seen"], j), code.row(self.at("half", j, w + wc), w))
            code.put(row, self.at("push", self.noise(j), w))
        code.turned(self.place["push"], self.place["push_turned"], w)
        with code.loop(self.s * w // 4) as block:
            at = code.integer("mul", block, 4)
            total = code.plus([code.load(self.place["push"], at)], [code.load(self.place["push_turned"], at)])
            code.store(code.plus([code.load(self.place["z"], at)], total)[0], self.place["z"], at)
        with code.loop(c) as j:  # e = w - g, in place of g
            to = self.at("g", j, k)
            row = code.read(code.row_of(sample["weighted"], j, self.columns), self.columns)
            code.put(code.plus(row, code.row(to, k), "fsub"), to)
        code.copied(self.s * k, self.place["back"], self.place["r"])
        with code.loop(x) as i:
            to = self.at("r", i, k)
            pairs = self.number_times(code.address(sample["output"], i), x, "g", k, 0, range(c))
            code.put(code.combined(code.row(to, k), pairs), to)
        with code.loop(c) as j:
            to = self.at("r", self.noise(j), k)
            row = code.times(code.spread(sample["seen"], j), code.row(self.at("g", j, k), k))
            code.put(code.plus(code.row(to, k), row), to)


@cache
def score_pass(sizes: MeanSizes) -> Program:
    """The pass, for K columns of series.

    Arguments of the function: `SYSTEM`; ``inner`` (T, C, C), ``S^-1`` less the squares of the weighted innovations;
    ``weighted`` (T, C, K); ``latents`` (T, S, L) and ``noises`` (T, S, C) from the covariance pass; ``means``
    (T, K, L + C), filtered means of latent states and residual noise; ``way`` (T - 1, X, L), by which processes enter
    the own states; results, zeros at first, ``latent``, ``noise_gain_slope`` (L, L), ``kept_slope``, ``drift``,
    ``white`` (C,), sums of `kalman_gradient.slope`, and ``adjoint`` (S, S), of the covariance at the first sample;
    ``scratch``; then the number of samples and of steps.
    """
    made = _Adjoint(sizes)
    code, x, c, s, latent, columns = made.code, made.x, made.c, made.s, made.latent, made.columns
    final, last = (code.integer("sub", count, 1) for count in ("%samples", "%steps"))
    with code.loop("%samples") as from_end:
        t = code.integer("sub", final, from_end)
        step = code.least(t, last)
        by_step = {"by_state": x * x, "by_latent": x * latent, "way": x * latent}
        by_sample = {
            "output": c * x, "seen": c, "gain": s * c, "inner": c * c, "weighted": c * columns, "latents": s * latent,
            "noises": s * c, "means": columns * (latent + c),
        }  # fmt: skip
        sample = {name: code.row_of(f"%{name}", step, size) for name, size in by_step.items()}
        sample |= {name: code.row_of(f"%{name}", t, size) for name, size in by_sample.items()}
        made.by_parts(sample)
        made.back(sample)
        made.seen(sample)
    with code.loop(latent) as i:
        for name, first in (("%latent", 0), ("%noise_gain_slope", made.wl)):
            row = code.row(made.at("sums", i, 2 * made.wl, first), made.wl)
            code.put(row, code.row_of(name, i, latent), latent)
    with code.loop(s) as i:
        code.put(code.row(made.at("z", i, made.w), made.w), code.row_of("%adjoint", i, s), s)
    given = (*SYSTEM, "inner", "weighted", "latents", "noises", "means", "way")
    results = ("latent", "noise_gain_slope", "kept_slope", "drift", "white", "adjoint")
    return code.program("score", (*given, *results, "scratch"), ("samples", "steps"), made.scratch)
