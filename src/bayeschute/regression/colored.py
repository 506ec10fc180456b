"""Residuals that remember: covariance of least squares under colored residuals, and the block bootstrap as its check.

``Cov = (X'X)^-1 [X' R X] (X'X)^-1`` (report, 6.3.5 and its reference 16), R Toeplitz in each time series, from the
biased autocorrelation of the residuals, cut at a tenth of the series and tapered by Parzen's window: both are positive
sequences, so R is positive. It is applied by FFT. Fitting removes part of the slow noise from the residuals; that part
is computed from R itself and put back (a few fixed-point passes).

Rows are grouped into time series by `blocks` (a record, a canopy, a vector component); rows with a NaN are gaps and
keep their place in time. Series of one group happen at the same times, and their cross-correlation counts too.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.fft import irfft, next_fast_len, rfft

from bayeschute.errors import Fault, InputError
from bayeschute.regression.orthogonal import Selection, out_of_range, read_problem, row_labels, select

Labels = Sequence[Hashable] | np.ndarray | None


class Series(NamedTuple):
    """Time series of one group, on a common uniform grid of times.

    Attributes:
        rows: For each component its rows, counted among the rows in use.
        places: For each component the grid places of these rows.
        length: Number of grid places from the first row in use to the last.
    """

    rows: tuple[Int[np.ndarray, " n"], ...]
    places: tuple[Int[np.ndarray, " n"], ...]
    length: int

    def on_grid(self, values: Float[np.ndarray, "N k"]) -> Float[np.ndarray, "m L k"]:
        """Rows laid on the grid, zeros in the gaps."""
        out = np.zeros((len(self.rows), self.length, values.shape[1]))
        for i, (rows, places) in enumerate(zip(self.rows, self.places, strict=True)):
            out[i, places] = values[rows]
        return out


@dataclass(frozen=True)
class ColoredNoise:
    """What the residuals say about the noise.

    Attributes:
        series: The time series.
        covariance: For each series the cross-covariances of its components, tapered, lags -K..K [unit of z, squared],
            (m, m, 2K + 1); entry (i, j, K + k) belongs to component i at t and j at t + k.
        integrated_time: Integrated autocorrelation time, all series together [samples]; 1 for white noise.
        dof: Equivalent degrees of freedom of the spectra, ``2 L / sum w^2`` summed over series; what the variances
            of estimates may be trusted to.
    """

    series: tuple[Series, ...]
    covariance: tuple[Float[np.ndarray, "m m lags"], ...]
    integrated_time: float
    dof: float

    def quadratic(self, U: Float[np.ndarray, "N p"]) -> Float[np.ndarray, "p p"]:
        """U' R U for columns over the rows in use."""
        total = np.zeros((U.shape[1], U.shape[1]))
        for series, covariance in zip(self.series, self.covariance, strict=True):
            total += _Transform(series, covariance.shape[2] // 2).quadratic(series.on_grid(U), covariance)
        return (total + total.T) / 2.0


class Bootstrap(NamedTuple):
    """Estimates over moving-block replicates.

    Attributes:
        estimates: One row per replicate, (B, p).
        covariance: Their covariance, (p, p).
        se: Their standard deviations, (p,).
        block_length: Length of the blocks, longest series [samples].
    """

    estimates: Float[np.ndarray, "B p"]
    covariance: Float[np.ndarray, "p p"]
    se: Float[np.ndarray, " p"]
    block_length: int


class SelectionFrequency(NamedTuple):
    """How often terms and structures are selected over moving-block replicates.

    Attributes:
        names: All candidates.
        frequency: Share of replicates that keep each candidate, (p,).
        structures: Different sets of terms (in the order of the candidates) and their shares, most frequent first.
        sigma_max2: Further values of sigma_max^2 tried, (G,).
        by_sigma_max: Share of replicates that keep each candidate under each of them, (G, p).
        replicates: Number of replicates.
    """

    names: tuple[str, ...]
    frequency: Float[np.ndarray, " p"]
    structures: tuple[tuple[tuple[str, ...], float], ...]
    sigma_max2: Float[np.ndarray, " G"]
    by_sigma_max: Float[np.ndarray, "G p"]
    replicates: int


def time_series(
    used: Bool[np.ndarray, " N"],
    *,
    blocks: Labels = None,
    groups: Labels = None,
    time: Float[np.ndarray, " N"] | None = None,
) -> tuple[Series, ...]:
    """Sort rows into time series on uniform grids.

    Args:
        used: Rows in use; the others are gaps.
        blocks: Time series of each row; rows of one series stand in order of time. None: one series.
        groups: Label of each row; series with the same label are simultaneous components. None: none are.
        time: Time of each row [s]; uniform apart from gaps. None: every row of a series, used or not, is one step.

    Returns:
        One entry per group.

    Raises:
        InputError: For labels of the wrong length, a series in two groups, simultaneous series of unequal length
            without times, or times that don't rise on a uniform grid.
    """
    N = used.size
    block = row_labels(blocks, N, "blocks")
    group = block if groups is None else row_labels(groups, N, "groups")
    owner: dict[int, list[int]] = {}
    for b in range(int(block.max(initial=0)) + 1):
        inside = np.unique(group[block == b])
        if inside.size != 1:
            raise InputError(Fault("groups", f"block {b} in {inside.size} groups", "each block in one group"))
        owner.setdefault(int(inside[0]), []).append(b)
    number = np.cumsum(used) - 1
    found = []
    for members in owner.values():
        everywhere = [np.flatnonzero(block == b) for b in members]
        places = _places(everywhere, None if time is None else np.asarray(time, dtype=np.float64))
        keep = [used[rows] for rows in everywhere]
        present = [p[k] for p, k in zip(places, keep, strict=True)]
        filled = np.concatenate(present)
        first, last = (int(filled.min()), int(filled.max())) if filled.size else (0, 0)
        found.append(
            Series(
                rows=tuple(number[r[k]] for r, k in zip(everywhere, keep, strict=True)),
                places=tuple(p - first for p in present),
                length=last - first + 1,
            )
        )
    return tuple(found)


def residual_noise(
    residual: Float[np.ndarray, " N"],
    *,
    blocks: Labels = None,
    groups: Labels = None,
    time: Float[np.ndarray, " N"] | None = None,
    Q: Float[np.ndarray, "n p"] | None = None,
    max_lag_fraction: float = 0.1,
    taper: str = "parzen",
    pool: bool = False,
    bias_passes: int = 3,
) -> ColoredNoise:
    """Autocovariance of residuals, made positive.

    Args:
        residual: Residuals, NaN in gaps, (N,).
        blocks: As in `time_series`.
        groups: As in `time_series`.
        time: As in `time_series` [s].
        Q: Orthonormal basis of the regressors over the rows in use, so that what fitting removed can be put back.
        max_lag_fraction: Lags are cut at this share of each series.
        taper: ``"parzen"`` or ``"bartlett"``.
        pool: One autocovariance for all series instead of one each; for short series with like noise.
        bias_passes: Passes that put back what fitting removed; 0 scales by N/(N - p) only.

    Returns:
        The noise model.

    Raises:
        InputError: As `time_series`; for an unknown taper, a share outside (0, 1), or series of unlike make-up pooled.
    """
    e = np.asarray(residual, dtype=np.float64)
    used = ~np.isnan(e)
    e = e[used]
    if not e.size or out_of_range(max(1.0, float(np.max(np.abs(e))))):
        raise InputError(Fault("residual", "no number, or one infinite or too large", "finite residuals, NaN in gaps"))
    if not 0.0 < max_lag_fraction < 1.0:
        raise InputError(Fault("max_lag_fraction", repr(max_lag_fraction), "a share between 0 and 1"))
    parts = time_series(used, blocks=blocks, groups=groups, time=time)
    if pool and len({len(s.rows) for s in parts}) > 1:
        raise InputError(Fault("pool", "groups with unlike numbers of components", "like groups", "Set pool=False."))
    longest = max(s.length for s in parts)
    lags = [_last_lag(longest if pool else s.length, s.length, max_lag_fraction) for s in parts]
    if pool:
        lags = [max(lags)] * len(parts)
    transforms = [_Transform(s, K) for s, K in zip(parts, lags, strict=True)]
    counts = [t.correlate(t.mask, t.mask) for t in transforms]
    laid = [s.on_grid(e[:, None]) for s in parts]
    observed = [t.correlate(x, x) for t, x in zip(transforms, laid, strict=True)]
    passes = 0 if Q is None else bias_passes
    scale = e.size / (e.size - Q.shape[1]) if Q is not None and not passes and e.size > Q.shape[1] else 1.0
    grids = [] if Q is None else [s.on_grid(Q) for s in parts]
    added = [np.zeros_like(x) for x in observed]
    for remaining in range(passes, -1, -1):
        sums = [o + a for o, a in zip(observed, added, strict=True)]
        covariance = [scale * c for c in _normalised(sums, counts, parts, taper, pool)]
        if remaining:
            added = _removed_by_fit(transforms, grids, covariance)
    return ColoredNoise(
        parts, tuple(covariance), _integrated_time(parts, covariance), _spectral_dof(parts, lags, taper)
    )


def block_bootstrap(
    X: Float[np.ndarray, "N p"],
    z: Float[np.ndarray, " N"],
    *,
    rng: np.random.Generator,
    blocks: Labels = None,
    groups: Labels = None,
    time: Float[np.ndarray, " N"] | None = None,
    replicates: int = 400,
    block_length: int | None = None,
    kind: str = "residual",
) -> Bootstrap:
    """Moving-block bootstrap of least squares (circular blocks within each series).

    Args:
        X: Regressors, (N, p).
        z: Response, (N,).
        rng: Source of randomness.
        blocks: As in `time_series`.
        groups: As in `time_series`; simultaneous components are drawn together.
        time: As in `time_series` [s].
        replicates: Number of replicates.
        block_length: Length of the blocks [samples]; None: a tenth of each series, as the lags of `residual_noise`.
        kind: ``"residual"`` keeps X and moves blocks of residuals (matches the covariance above); ``"pairs"`` moves
            blocks of rows.

    Returns:
        The replicate estimates.

    Raises:
        InputError: As `time_series` and `read_problem`; for dependent columns or values out of range.
    """
    problem = read_problem(X, z, None, "bootstrap")
    parts = time_series(problem.used, blocks=blocks, groups=groups, time=time)
    _check_bootstrap(kind, replicates, block_length)
    estimates = np.empty((replicates, problem.X.shape[1]))
    for b, (columns, response) in enumerate(
        _replicates(problem.X, problem.z, parts, rng, replicates, block_length, kind)
    ):
        estimates[b] = np.linalg.lstsq(columns, response, rcond=None)[0]
    covariance = np.atleast_2d(np.cov(estimates, rowvar=False))
    longest = max(_block_length(s, block_length) for s in parts)
    return Bootstrap(estimates, covariance, np.sqrt(np.diag(covariance)), longest)


def selection_frequency(
    X: Float[np.ndarray, "N p"],
    z: Float[np.ndarray, " N"],
    base: Selection,
    *,
    rng: np.random.Generator,
    blocks: Labels = None,
    groups: Labels = None,
    time: Float[np.ndarray, " N"] | None = None,
    replicates: int = 200,
    block_length: int | None = None,
    kind: str = "pairs",
    sigma_max2: Sequence[float] = (),
    max_terms: int = 60,
) -> SelectionFrequency:
    """How often terms are selected when the record is redrawn in blocks; sigma_max^2 and f are those of `base`.

    ``"pairs"`` redraws rows and assumes no model, but repeats the noise that the record already holds, so that it
    keeps somewhat more terms than new records would. ``"residual"`` adds redrawn residuals to the selected model, so
    that terms it left out are taken as absent.

    Args:
        X: All candidates, (N, p).
        z: Response, (N,).
        base: Selection on the record itself.
        rng: Source of randomness.
        blocks: As in `time_series`.
        groups: As in `time_series`.
        time: As in `time_series` [s].
        replicates: Number of replicates.
        block_length: As in `block_bootstrap` [samples].
        kind: ``"pairs"`` or ``"residual"``.
        sigma_max2: Further values to judge each replicate's path by [unit of z, squared].
        max_terms: Longest path in a replicate.

    Returns:
        Frequencies of terms and structures.

    Raises:
        InputError: As `block_bootstrap`.
    """
    problem = read_problem(X, z, base.names, "selection frequency")
    parts = time_series(problem.used, blocks=blocks, groups=groups, time=time)
    _check_bootstrap(kind, replicates, block_length)
    p, grid = problem.X.shape[1], np.asarray(sigma_max2, dtype=np.float64)
    kept, by_grid, found = np.zeros(p), np.zeros((grid.size, p)), Counter[tuple[int, ...]]()
    model = list(base.selected)
    for columns, response in _replicates(problem.X, problem.z, parts, rng, replicates, block_length, kind, model):
        path = select(
            columns,
            response,
            base.names,
            sigma_max2=base.ceiling.value,
            penalty_factor=base.penalty_factor,
            max_terms=max(max_terms, base.forced),
            forced=base.order[: base.forced],
        )
        kept[list(path.selected)] += 1.0
        found[tuple(sorted(path.selected))] += 1
        for g, value in enumerate(grid):
            by_grid[g, list(path.order[: path.at(value).n])] += 1.0
    shares = tuple((tuple(base.names[j] for j in chosen), n / replicates) for chosen, n in found.most_common())
    return SelectionFrequency(base.names, kept / replicates, shares, grid, by_grid / replicates, replicates)


class _Transform:
    """FFT on the padded grid of one series: lags -K..K don't wrap."""

    def __init__(self, series: Series, last_lag: int) -> None:
        self.K = last_lag
        self.n = next_fast_len(series.length + last_lag, real=True)
        self.length = series.length
        self.mask = np.zeros((len(series.rows), series.length, 1))
        for i, places in enumerate(series.places):
            self.mask[i, places] = 1.0

    def forward(self, x: np.ndarray) -> np.ndarray:
        return np.asarray(rfft(x, self.n, axis=1))

    def correlate(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """sum_t a_i(t) . b_j(t + k): (m, m, 2K + 1) from two (m, L, c)."""
        both = np.einsum("ifc,jfc->ijf", self.forward(a).conj(), self.forward(b))
        lags = irfft(both, self.n, axis=2)
        return np.concatenate([lags[:, :, self.n - self.K :], lags[:, :, : self.K + 1]], axis=2)

    def spectrum(self, covariance: np.ndarray) -> np.ndarray:
        """Spectral matrix over frequencies, (f, m, m), what rounding or gaps made negative set to zero."""
        m = covariance.shape[0]
        wrapped = np.zeros((m, m, self.n))
        wrapped[:, :, : self.K + 1] = covariance[:, :, self.K :]
        if self.K:
            wrapped[:, :, self.n - self.K :] = covariance[:, :, : self.K]
        S = np.moveaxis(rfft(wrapped, axis=2), 2, 0)
        if m == 1:
            return np.maximum(S.real, 0.0).astype(complex)
        values, vectors = np.linalg.eigh((S + np.conj(np.swapaxes(S, 1, 2))) / 2.0)
        return np.asarray((vectors * np.maximum(values, 0.0)[:, None, :]) @ np.conj(np.swapaxes(vectors, 1, 2)))

    def applied(self, U: np.ndarray, covariance: np.ndarray) -> np.ndarray:
        """R U in the places of the mask, (m, L, p)."""
        out = irfft(np.einsum("fij,jfp->ifp", self.spectrum(covariance).conj(), self.forward(U)), self.n, axis=1)
        return np.asarray(out[:, : self.length]) * self.mask

    def quadratic(self, U: np.ndarray, covariance: np.ndarray) -> np.ndarray:
        return np.einsum("ilp,ilq->pq", U, self.applied(U, covariance))


def _places(everywhere: list[np.ndarray], time: np.ndarray | None) -> list[np.ndarray]:
    if time is None:
        if len({rows.size for rows in everywhere}) > 1:
            sizes = [int(rows.size) for rows in everywhere]
            raise InputError(
                Fault("groups", f"series of {sizes} rows", "simultaneous series of one length", "Give time.")
            )
        return [np.arange(rows.size) for rows in everywhere]
    t = [time[rows] for rows in everywhere]
    steps = np.concatenate([np.diff(part) for part in t])
    if not all(np.isfinite(part).all() for part in t) or (steps <= 0.0).any():
        raise InputError(Fault("time", "missing or falling times within a block", "rising times", "Sort the rows."))
    dt = float(np.median(steps)) if steps.size else 1.0
    start = min(float(part[0]) for part in t)
    exact = [(part - start) / dt for part in t]
    places = [np.rint(x).astype(np.intp) for x in exact]
    off = max(float(np.max(np.abs(x - p))) for x, p in zip(exact, places, strict=True))
    if off > 0.25 or any((np.diff(p) == 0).any() for p in places):
        raise InputError(Fault("time", f"times off a uniform grid by {off:.2g} steps", "uniform times", "Resample."))
    rows = max(p.size for p in places)
    if max(int(p[-1]) for p in places) > 1000 * rows + 1000:
        raise InputError(Fault("time", "a series that is almost all gap", "denser series", "Split it into blocks."))
    return places


def _last_lag(basis: int, length: int, fraction: float) -> int:
    return int(min(max(1, int(fraction * basis)), max(length - 1, 0)))


def _window(K: int, taper: str) -> np.ndarray:
    k = np.abs(np.arange(-K, K + 1)) / (K + 1)
    if taper == "bartlett":
        return 1.0 - k
    if taper == "parzen":
        return np.where(k < 0.5, 1.0 - 6.0 * k**2 * (1.0 - k), 2.0 * (1.0 - k) ** 3)
    raise InputError(Fault("taper", repr(taper), "'parzen' or 'bartlett'"))


def _normalised(
    sums: list[np.ndarray], counts: list[np.ndarray], parts: tuple[Series, ...], taper: str, pool: bool
) -> list[np.ndarray]:
    """Sums of products per pair of samples, times the biased estimate's (1 - |k|/L), times the taper."""
    if pool:
        sums = [np.asarray(sum(sums))] * len(sums)
        counts = [np.asarray(sum(counts))] * len(counts)
    longest = max(s.length for s in parts)
    out = []
    for s, c, series in zip(sums, counts, parts, strict=True):
        K = s.shape[2] // 2
        pairs = np.rint(c)
        fall = 1.0 - np.abs(np.arange(-K, K + 1)) / (longest if pool else series.length)
        out.append(np.where(pairs > 0.5, s / np.maximum(pairs, 1.0), 0.0) * fall * _window(K, taper))
    return out


def _removed_by_fit(
    transforms: list[_Transform], grids: list[np.ndarray], covariance: list[np.ndarray]
) -> list[np.ndarray]:
    """Sums over time of R - (I - QQ')R(I - QQ') at each lag: what fitting took out of the residual's products."""
    applied = [t.applied(q, c) for t, q, c in zip(transforms, grids, covariance, strict=True)]
    M = np.asarray(sum(np.einsum("ilp,ilq->pq", q, y) for q, y in zip(grids, applied, strict=True)))
    return [
        t.correlate(q, y) + t.correlate(y, q) - t.correlate(q @ M, q)
        for t, q, y in zip(transforms, grids, applied, strict=True)
    ]


def _integrated_time(parts: tuple[Series, ...], covariance: list[np.ndarray]) -> float:
    whole = zero = 0.0
    for series, c in zip(parts, covariance, strict=True):
        for i, rows in enumerate(series.rows):
            whole += rows.size * max(float(c[i, i].sum()), 0.0)
            zero += rows.size * float(c[i, i, c.shape[2] // 2])
    return whole / zero if zero > 0.0 else 1.0


def _spectral_dof(parts: tuple[Series, ...], lags: list[int], taper: str) -> float:
    return float(
        sum(
            2.0 * rows.size / np.sum(_window(K, taper) ** 2)
            for s, K in zip(parts, lags, strict=True)
            for rows in s.rows
        )
    )


def _check_bootstrap(kind: str, replicates: int, block_length: int | None) -> None:
    if kind not in ("residual", "pairs"):
        raise InputError(Fault("bootstrap kind", repr(kind), "'residual' or 'pairs'"))
    if replicates < 2 or (block_length is not None and block_length < 1):
        got = f"{replicates} replicates, block length {block_length}"
        raise InputError(Fault("bootstrap", got, "at least 2 replicates and blocks of at least 1 sample"))


def _block_length(series: Series, block_length: int | None) -> int:
    return min(block_length or max(1, int(np.ceil(series.length / 10))), series.length)


def _replicates(
    X: np.ndarray,
    z: np.ndarray,
    parts: tuple[Series, ...],
    rng: np.random.Generator,
    replicates: int,
    block_length: int | None,
    kind: str,
    model: list[int] | None = None,
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    if kind == "residual":
        columns = X if model is None else X[:, model]
        estimate, _, rank, _ = np.linalg.lstsq(columns, z, rcond=None)
        if rank < columns.shape[1] or columns.shape[1] >= z.size:
            raise InputError(Fault("bootstrap", "columns that depend on each other", "independent columns"))
        smooth = columns @ estimate
        rest = (z - smooth) * np.sqrt(z.size / (z.size - columns.shape[1]))
    for _ in range(replicates):
        source = np.empty(z.size, dtype=np.intp)
        for series in parts:
            _redraw(series, _block_length(series, block_length), rng, source)
        yield (X, smooth + rest[source]) if kind == "residual" else (X[source], z[source])


def _redraw(series: Series, block_length: int, rng: np.random.Generator, source: np.ndarray) -> None:
    """For each row the row that it is replaced by: circular blocks over the places where no component is missing."""
    full = np.ones(series.length, dtype=bool)
    row_at = np.full((len(series.rows), series.length), -1)
    for i, (rows, places) in enumerate(zip(series.rows, series.places, strict=True)):
        row_at[i, places] = rows
        full &= row_at[i] >= 0
    valid = np.flatnonzero(full)
    if valid.size == 0:
        raise InputError(Fault("bootstrap", "a group whose series are never complete at one time", "common times"))
    starts = rng.integers(valid.size, size=-(-series.length // block_length))
    drawn = valid[(starts[:, None] + np.arange(block_length)) % valid.size].ravel()[: series.length]
    for i, (rows, places) in enumerate(zip(series.rows, series.places, strict=True)):
        source[rows] = row_at[i, drawn[places]]
