"""Noise variance for the noise ceiling, and signal-to-noise ratio, from the data of a regression.

An irrelevant regressor lowers the mean squared error by sigma^2/N with white noise, and by that times the number of
correlated samples with colored noise. The noise floor by global Fourier smoothing contains only the white part; with
it, every candidate of a pool is selected. So the default level is the variance of the residuals times their integrated
autocorrelation time (`memory` in the code).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.errors import Fault, InputError
from bayeschute.records.smoothing import SHORTEST, fourier_smooth
from bayeschute.regression.equation_error import fit
from bayeschute.regression.orthogonal import select
from bayeschute.regression.problem import group_variance, positive
from bayeschute.regression.stacked import Stack

SOURCES = ("colored", "smoothing", "given", "variance")
LARGEST = 30  # terms of the model whose residuals are looked at first
_PASSES = 6


class NoiseLevel(NamedTuple):
    """How large the noise is that a term must beat.

    Attributes:
        variance: sigma^2 that the ceiling multiplies; for colored noise the variance times the memory
            [unit of z, squared].
        sd: Standard deviation of the noise itself [unit of z].
        memory: Integrated autocorrelation time of the noise [samples]; 1 where it is taken as white.
        source: One of `SOURCES`.
    """

    variance: float
    sd: float
    memory: float
    source: str


class SeriesNoise(NamedTuple):
    """Signal and white noise of a response by global Fourier smoothing, mean over its series.

    Attributes:
        sd: Standard deviation of the white noise [unit of z].
        about_mean: rms(signal - mean)/sd.
        with_mean: rms(signal)/sd.
    """

    sd: float
    about_mean: float
    with_mean: float


def series_noise(stack: Stack, dt: float) -> SeriesNoise:
    """Split every series of a response into signal and white noise (report, 6.3.5).

    Args:
        stack: The regression; the longest stretch without a gap of each series is used.
        dt: Sample interval [s].

    Returns:
        Means over the series: of the noise's variance, and of the ratios.

    Raises:
        InputError: If no series has a stretch of 40 samples without a gap.
    """
    found = []
    for series in np.unique(stack.blocks):
        z = stack.z[stack.blocks == series]
        run = longest_run(np.isfinite(z))
        if run.stop - run.start >= 2 * SHORTEST:
            found.append(fourier_smooth(z[run], dt))
    if not found:
        wanted = f"a stretch of {2 * SHORTEST} samples without a gap"
        do = "Use a longer window or a record with fewer dropouts."
        raise InputError(Fault("equation error", "no such stretch", wanted, do))
    return SeriesNoise(
        float(np.sqrt(np.mean([s.noise_sd**2 for s in found]))),
        float(np.mean([s.snr for s in found])),
        float(np.mean([s.snr_with_mean for s in found])),
    )


def longest_run(present: NDArray[np.bool_]) -> slice:
    """The longest stretch without a gap; empty if there is none."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], present.astype(int), [0]])))
    starts, stops = edges[::2], edges[1::2]
    if not starts.size:
        return slice(0, 0)
    best = int(np.argmax(stops - starts))
    return slice(int(starts[best]), int(stops[best]))


def noise_level(
    stack: Stack,
    names: Sequence[str],
    dt: float,
    *,
    source: str = "colored",
    sigma: float | None = None,
    factor: float = 1.0,
    penalty_factor: float = 2.0,
    forced: Sequence[int] = (),
) -> NoiseLevel:
    """The noise level by one of four rules.

    ``"colored"``: residual variance times memory, of the whole pool where it has at most `LARGEST` candidates; of a
    larger pool, whose full fit would swallow slow noise, first of the model of that many terms, then of the one that is
    kept under the ceiling so found, until the two agree. ``"smoothing"``: what global Fourier smoothing takes for white
    noise. ``"given"``: `sigma` squared. ``"variance"``: that of the response about its mean, when nothing else is
    known.

    Args:
        stack: The regression.
        names: Candidates.
        dt: Sample interval [s].
        source: One of `SOURCES`.
        sigma: For ``"given"`` [unit of z].
        factor: The ceiling as a multiple of the level, for ``"colored"`` with a large pool.
        penalty_factor: f of the predicted squared error, likewise.
        forced: Columns kept whatever they pay, likewise.

    Returns:
        The level.

    Raises:
        InputError: For an unknown source, a sigma that is missing or not above 0, or a response without noise.
    """
    if source not in SOURCES:
        raise InputError(Fault("noise level", repr(source), "one of " + ", ".join(map(repr, SOURCES))))
    if source == "colored":
        return _colored(stack, names, factor, penalty_factor, tuple(forced))
    if source == "given":
        if sigma is None:
            raise InputError(Fault("noise level 'given'", "no sigma", "sigma as a number"))
        sd = sigma
    elif source == "smoothing":
        sd = series_noise(stack, dt).sd
    else:
        used = np.isfinite(stack.z)
        sd = float(np.sqrt(group_variance(stack.z[used], stack.components[used])))
    positive(f"noise level {source!r}", sd)
    return NoiseLevel(float(sd) ** 2, float(sd), 1.0, source)


def _colored(stack: Stack, names: Sequence[str], factor: float, penalty: float, forced: tuple[int, ...]) -> NoiseLevel:
    most = min(LARGEST, int(np.isfinite(stack.z).sum()) // 3)
    path = select(
        stack.X,
        stack.z,
        list(names),
        sigma_max2=np.finfo(float).tiny,
        max_terms=max(most, len(forced), 1),
        forced=forced,
    )
    positive("noise level 'colored': mean square of the response", path.mean_square)
    n, level = len(path.order), NoiseLevel(0.0, 0.0, 1.0, "colored")
    for _ in range(_PASSES):
        kept = list(path.order[:n])
        fitted = fit(stack.X[:, kept], stack.z, blocks=stack.blocks, groups=stack.groups, components=stack.components)
        memory = max(fitted.autocorrelation_time, 1.0)
        level = NoiseLevel(fitted.rms**2 * memory, fitted.rms, memory, "colored")
        positive("noise level 'colored': variance of the residuals", level.variance)
        again = max(path.at(factor * level.variance).n, 1) if len(names) > LARGEST else n
        if again == n:
            break
        n = again
    return level
