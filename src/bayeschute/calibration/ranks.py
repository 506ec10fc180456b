"""Rank statistics of simulation-based calibration, with simultaneous confidence bands of their distribution.

If truths are drawn from the prior and posteriors are right, the rank of a truth among L independent draws is uniform on
0..L (Cook, Gelman and Rubin 2006; Talts et al. 2018). The empirical distribution of N ranks is compared with the
uniform one by simultaneous bands, whose pointwise width is chosen so that the whole curve stays inside with the given
probability (Saeilynoja, Buerkner and Vehtari 2022).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom

from bayeschute.core.random import stream

Array = NDArray[np.float64]
_SIMULATED = 4000  # samples of ranks behind the band's width


def rank(draws: Array, truth: float, levels: int) -> int:
    """Rank of a truth among evenly spaced draws.

    Args:
        draws: Draws of one chain or of chains end to end (S,).
        truth: The value they are drawn about.
        levels: L; keep it below the effective sample size, so that the draws used are nearly independent.

    Returns:
        How many of L draws lie below the truth, 0..L.

    Raises:
        ValueError: If there are fewer than L draws.
    """
    if draws.size < levels:
        raise ValueError(f"{draws.size} draws for {levels} levels of rank")
    picked = draws[np.linspace(0, draws.size - 1, levels).astype(int)]
    return int(np.sum(picked < truth))


@dataclass(frozen=True)
class EcdfTest:
    """Whether ranks are uniform.

    Attributes:
        at: Shares of the ranks' range (K,).
        ecdf: Share of ranks up to there (K,).
        low: Lower edge of the simultaneous band (K,).
        high: Upper edge (K,).
        value: Least two-sided pointwise probability of the curve.
        bound: Least that a uniform sample keeps to with the band's probability.
    """

    at: Array
    ecdf: Array
    low: Array
    high: Array
    value: float
    bound: float

    @property
    def passed(self) -> bool:
        """Whether the whole curve lies inside the band."""
        return self.value >= self.bound


def _pointwise(counts: NDArray[np.int64], n: int, at: Array) -> Array:
    """Two-sided probability of each count (..., K) under the binomial with shares `at`."""
    low, high = binom.cdf(counts, n, at), binom.sf(counts - 1, n, at)
    return np.minimum(1.0, 2.0 * np.minimum(low, high))


@lru_cache(maxsize=32)
def _bound(n: int, levels: int, probability: float) -> float:
    """Least pointwise probability that samples of n uniform ranks keep to with the given probability."""
    rng, at = stream(0, "uniform ranks", n, levels), np.arange(1, levels + 1) / (levels + 1)
    drawn = rng.multinomial(n, np.full(levels + 1, 1.0 / (levels + 1)), size=_SIMULATED)
    worst = _pointwise(np.cumsum(drawn, axis=1)[:, :-1], n, at).min(axis=1)
    return float(np.quantile(worst, 1.0 - probability, method="lower"))


def uniform(ranks: NDArray[np.int64], levels: int, probability: float = 0.95, tests: int = 1) -> EcdfTest:
    """Compare ranks with the uniform distribution.

    Args:
        ranks: 0..L each (N,).
        levels: L.
        probability: With which a uniform sample lies inside the band as a whole.
        tests: Number of quantities tested together; the band of each is widened by Sidak's rule so that all of
            them are inside with that probability.

    Returns:
        The comparison.

    Raises:
        ValueError: If a rank is outside 0..L, or there is none.
    """
    ranks = np.asarray(ranks)
    if not ranks.size or ranks.min() < 0 or ranks.max() > levels:
        raise ValueError(f"ranks must be 0 to {levels}, at least one")
    n, at = ranks.size, np.arange(1, levels + 1) / (levels + 1)
    counts = np.cumsum(np.bincount(ranks, minlength=levels + 1))[:-1]
    bound = _bound(n, levels, probability ** (1.0 / tests))
    low, high = binom.ppf(bound / 2.0, n, at) / n, binom.isf(bound / 2.0, n, at) / n
    return EcdfTest(at, counts / n, low, high, float(_pointwise(counts, n, at).min()), bound)
