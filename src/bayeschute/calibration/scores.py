"""Scores of bands against a truth: coverage, width, interval score, CRPS, PIT (Gneiting and Raftery 2007)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
LEVELS = (0.5, 0.8, 0.9, 0.95, 0.99)
"""Nominal probabilities of central intervals."""


class BandScore(NamedTuple):
    """Averages over samples. Where every draw failed nothing is held, and all but the coverage is None.

    Attributes:
        coverage: Share of samples inside the central interval, by `LEVELS`.
        width: Mean width of those intervals, in the quantity's unit.
        interval_score: Mean width plus 2/alpha times the distance by which a truth outside misses, by `LEVELS`.
        crps: Mean continuous ranked probability score.
        pit: Share of draws below the truth, ten quantiles of it over the samples (0.05, 0.15 .. 0.95).
    """

    coverage: tuple[float, ...]
    width: tuple[float, ...] | None
    interval_score: tuple[float, ...] | None
    crps: float | None
    pit: tuple[float, ...] | None


def crps(draws: Array, truth: Array) -> Array:
    """Continuous ranked probability score ``E|X - y| - 1/2 E|X - X'|`` of each sample.

    Args:
        draws: (S, T).
        truth: (T,).

    Returns:
        (T,), in the quantity's unit; for one draw the absolute error.
    """
    count, ordered = len(draws), np.sort(draws, axis=0)
    weights = (2.0 * np.arange(1, count + 1) - count - 1.0) / count**2
    return np.asarray(np.mean(np.abs(draws - truth), axis=0) - weights @ ordered)


def score(draws: Array, truth: Array) -> BandScore:
    """Score draws of a series against its truth.

    Args:
        draws: (S, T); draws that failed are NaN throughout and left out.
        truth: (T,); samples that are NaN are left out.

    Raises:
        ValueError: If no sample is left.
    """
    draws, known = draws[np.isfinite(draws).all(axis=1)], np.isfinite(truth)
    draws, truth = draws[:, known], truth[known]
    if not truth.size:
        raise ValueError("nothing to score: no truth is known")
    if not draws.size:
        return BandScore((0.0,) * len(LEVELS), None, None, None, None)
    coverage, width, missed = [], [], []
    for level in LEVELS:
        low, high = np.quantile(draws, [0.5 - level / 2.0, 0.5 + level / 2.0], axis=0)
        coverage.append(float(np.mean((truth >= low) & (truth <= high))))
        width.append(float(np.mean(high - low)))
        outside = np.maximum(low - truth, 0.0) + np.maximum(truth - high, 0.0)
        missed.append(float(np.mean(high - low + 2.0 / (1.0 - level) * outside)))
    pit = np.quantile(np.mean(draws < truth, axis=0), np.arange(0.05, 1.0, 0.1))
    return BandScore(
        tuple(coverage), tuple(width), tuple(missed), float(np.mean(crps(draws, truth))), tuple(map(float, pit))
    )


def inside(draws: Array, truth: float) -> tuple[bool, ...]:
    """Whether a truth lies inside the central interval of draws (S,), by `LEVELS`; it does not where there are none."""
    if not draws.size:
        return (False,) * len(LEVELS)
    edges = [np.quantile(draws, [0.5 - level / 2.0, 0.5 + level / 2.0]) for level in LEVELS]
    return tuple(bool(low <= truth <= high) for low, high in edges)


def standard_error(share: float, count: int, spread: float | None = None) -> float:
    """Standard error of a mean share over replicates.

    Args:
        share: The mean.
        count: Replicates.
        spread: Standard deviation over replicates where every one is a share itself; None: each is 0 or 1.
    """
    if spread is not None:
        return float(spread / np.sqrt(count))
    pulled = (share * count + 2.0) / (count + 4.0)  # Agresti and Coull: not zero where all are inside
    return float(np.sqrt(pulled * (1.0 - pulled) / count))
