"""Covariance of least-squares estimates under colored (autocorrelated) residuals.

``Cov = (X'X)^-1 [X' R X] (X'X)^-1`` (report, 6.3.5 and its reference 16), R Toeplitz in each time series, from the
biased autocorrelation of the residuals, cut at a tenth of the series and tapered by Parzen's window: both are positive
sequences, so R is positive. It is applied by FFT. Fitting removes part of the slow noise from the residuals; that part
is computed from R itself and restored (a few fixed-point iterations).

Rows are grouped into time series by `blocks` (a record, a canopy, a vector component); rows with a NaN are gaps and
keep their place in time. Series of one group are simultaneous, and their cross-correlation is included.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.fft import irfft, next_fast_len, rfft

from bayeschute.core.errors import Fault, InputError
from bayeschute.regression.problem import out_of_range
from bayeschute.regression.series import Labels, Series, time_series


@dataclass(frozen=True)
class ColoredNoise:
    """Noise statistics estimated from the residuals.

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
        bias_passes: Iterations that restore the noise removed by fitting; 0 scales by N/(N - p) only.

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
    lags = _lags(parts, max_lag_fraction, pool)
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
        """Spectral matrix over frequencies, (f, m, m), with negative eigenvalues (rounding, gaps) set to zero."""
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


def _lags(parts: Sequence[Series], fraction: float, pool: bool) -> list[int]:
    """Last lag of each series; one for all that are pooled."""
    if not pool:
        return [_last_lag(s.length, s.length, fraction) for s in parts]
    if len({len(s.rows) for s in parts}) > 1:
        raise InputError(Fault("pool", "groups with unlike numbers of components", "like groups", "Set pool=False."))
    longest = max(s.length for s in parts)
    return [max(_last_lag(longest, s.length, fraction) for s in parts)] * len(parts)


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
    """Sums over time of R - (I - QQ')R(I - QQ') at each lag: covariance removed from the residuals by fitting."""
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
