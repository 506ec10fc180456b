"""Diagnostics of corrected draws: Pareto k of their importance ratios, and R-hat.

Delayed acceptance is asymptotically exact whatever its surrogate, but where the surrogate's tails are too thin the
chain sticks, and finite draws don't show what they miss. The diagnostic is the importance ratios exact/surrogate at the
surrogate's proposals: the shape k of their upper tail (Vehtari, Simpson, Gelman, Yao and Gabry 2024) is 0.7 or more
where their mean, and with it the correction, can't be trusted.
"""

from __future__ import annotations

from typing import NamedTuple

import arviz_stats
import numpy as np
import xarray as xr
from arviz_stats.base import array_stats
from numpy.typing import ArrayLike
from scipy.stats import chi2

from bayeschute.posterior.sampling.protocol import Array, Draws

MOST_K = 0.7
MOST_RHAT = 1.01
FEWEST = 400.0
"""Effective draws, in bulk and tails, of every parameter that a run wants."""
ROUNDING = 1e-12
"""Of a parameter's size: a smaller standard deviation is none."""
_EQUAL = 0.05  # spread of log ratios up to which weights are all but the same: they cost less than 0.1 % of the draws
_LEAST = 25  # ratios of which a tail can be fitted: ArviZ takes a fifth of few, and wants five
_SLOW = 0.9  # of the bound on R-hat less one; what is added for the noise parameters moves it a little
_MANY = 2.0  # times `FEWEST`: draws of which that many effective ones are asked for
_FLAT = 1e-6  # standard deviations along an axis on which draws don't vary, each parameter's being one
_FALSE_ALARM = 1e-3  # chance that independent draws, as many as there are, are refused by R-hat


def pareto_k(log_ratio: Array) -> float:
    """Shape of the generalised Pareto distribution of the largest importance ratios.

    Args:
        log_ratio: Log ratios exact/surrogate up to a constant, any shape; not finite where a simulation failed, which
            is a weight of zero.

    Returns:
        The shape k; 0 where all ratios are all but equal, infinity where too few are finite or all of the tail is one
        value, as of a walk that sticks.
    """
    good = np.ravel(log_ratio)[np.isfinite(np.ravel(log_ratio))]
    if good.size < _LEAST:
        return float(np.inf)
    if np.ptp(good) < _EQUAL:
        return 0.0
    # ArviZ takes log likelihoods, whose negatives are the log weights of leaving one out.
    try:
        return float(array_stats.psislw(-good)[1])
    except ValueError:  # the tail has no width
        return float(np.inf)


class Rhat(NamedTuple):
    """The largest R-hat of draws, and its bound.

    Attributes:
        largest: Largest R-hat of any parameter [1]; not a number where one never moved.
        bound: See `rhat_bound` [1].
    """

    largest: float
    bound: float

    @property
    def passed(self) -> bool:
        """Whether the chains agree."""
        return self.largest < self.bound


def judge_rhat(each: ArrayLike, chains: int, draws: int) -> Rhat:
    """The convergence criterion by R-hat, for draws of a sampler and for the posterior of a run.

    Args:
        each: R-hat of each parameter (P,) [1], rank-normalised and split.
        chains: Number of chains.
        draws: Draws per chain.
    """
    rhat = np.ravel(np.asarray(each, dtype=float))
    return Rhat(float(np.max(rhat)), rhat_bound(chains, draws, rhat.size))


def rhat_of(xi: Array) -> Array:
    """R-hat of each parameter of draws (chain, draw, P); not a number where a parameter never moved."""
    names = ("chain", "draw", "parameter")
    return np.asarray(arviz_stats.rhat(xr.DataArray(xi, dims=names)), dtype=float)


def rhat_bound(chains: int, draws: int, parameters: int) -> float:
    """1.01, or for few draws the value that independent draws exceed with probability 0.001.

    The squared split R-hat of independent draws is about ``1 + (c / (2 chains - 1) - 1) / (draws / 2)``, c chi-squared
    with ``2 chains - 1`` degrees of freedom; the largest over ranks and folded ranks of all parameters counts.
    """
    degrees = 2 * chains - 1
    spread = float(chi2.isf(_FALSE_ALARM / (2 * parameters), degrees)) / degrees
    return max(MOST_RHAT, float(np.sqrt(1.0 + 2.0 * max(spread - 1.0, 0.0) / draws)))


def slowness(draws: Draws, scale: Array) -> float:
    """How many times as long a walk by delayed acceptance would have to be for its chains to agree, and to tell enough.

    What R-hat exceeds one by falls as one over the length of a walk (Vehtari et al. 2021: its square is one plus the
    inverse of the effective draws of a chain, nearly). Effective draws are asked for where there are several times as
    many draws as `FEWEST`.

    Args:
        draws: As of `why_not_trusted`.
        scale: From standard coordinates to parameters (P, P).

    Returns:
        At most one where a walk will do; zero where proposals don't cover the density, which no length makes good.
    """
    if not pareto_k(draws.stats["log_ratio"]) < MOST_K:
        return 0.0
    chains, length, _ = draws.xi.shape
    rhat = judge_rhat(rhat_of(draws.xi), chains, length)
    apart = float(np.nan_to_num((rhat.largest - 1.0) / (_SLOW * (rhat.bound - 1.0)), nan=0.0))
    few = FEWEST / (_SLOW * least_effective(draws.xi @ scale.T)) if chains * length >= _MANY * FEWEST else 0.0
    return max(apart, few)


def directions(theta: Array) -> int:
    """In how many directions draws (chain, draw, P) vary, beyond what rounding makes of one place: P of a posterior."""
    flat = theta.reshape(-1, theta.shape[-1])
    away, sd = flat - flat.mean(axis=0), flat.std(axis=0)
    moved = sd > ROUNDING * np.abs(flat).max(axis=0)
    return int(np.linalg.matrix_rank(away[:, moved] / sd[moved], tol=_FLAT * np.sqrt(len(flat)))) if moved.any() else 0


def effective_draws(theta: Array, method: str = "bulk") -> Array:
    """Effective number of draws (chain, draw, P) of each parameter (P,); NaN of one that never moved."""
    rows = xr.DataArray(theta, dims=("chain", "draw", "parameter"))
    return np.asarray(arviz_stats.ess(rows, method=method), dtype=float)


def least_effective(theta: Array) -> float:
    """Fewest effective draws, in bulk or tails, of any parameter of draws (chain, draw, P) that moved."""
    sizes = np.concatenate([effective_draws(theta, method) for method in ("bulk", "tail")])
    return float(np.nanmin(sizes)) if np.isfinite(sizes).any() else float(np.inf)


def why_not_trusted(draws: Draws) -> str:
    """Why draws by delayed acceptance are not reliable, in words; empty if they are.

    Args:
        draws: Of `delayed_acceptance.corrected`, with ``log_ratio`` among their numbers.
    """
    reasons = []
    k = pareto_k(draws.stats["log_ratio"])
    if not k < MOST_K:
        reasons.append(f"Pareto k of the ratios exact/surrogate is {k:.2f}, not below {MOST_K}")
    rhat = judge_rhat(rhat_of(draws.xi), *draws.xi.shape[:2])
    if not rhat.passed:
        reasons.append(f"R-hat is {rhat.largest:.3f}, not below {rhat.bound:.3g}")
    return "; ".join(reasons)
