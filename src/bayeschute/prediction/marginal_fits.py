"""Parametric fits of the marginal posteriors: distribution family, constants and goodness of fit, by parameter.

The family is the first of ``FAMILIES`` whose Akaike criterion per independent draw lies within 2 of the least,
``AIC = 2 k - 2 n_e mean(log p)`` with k constants and n_e independent draws (Akaike, IEEE TAC 19 (1974) 716). Draws of
a Markov chain repeat themselves, so n_e is the effective number and not the number stored. A difference below 2 is no
evidence, so the chosen family need not have the smallest criterion. The Kolmogorov-Smirnov distance, the largest
difference between the distribution functions of the draws and of the family, is given as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize, special, stats

from bayeschute.core.errors import Fault, InputError

FAMILIES = ("normal", "lognormal", "truncated normal", "student-t")
QUANTILES = {"q00135": 0.00135, "q05": 0.05, "q50": 0.5, "q95": 0.95, "q99865": 0.99865}
NO_EVIDENCE = 2.0  # difference of the criterion that does not count
LEAST_DRAWS = 20

Vector = NDArray[np.float64]


class Marginal(NamedTuple):
    """A fitted family.

    Attributes:
        family: One of ``FAMILIES``, or "constant" where the draws do not vary.
        location: Mean of the parent normal or centre of the Student-t [unit]; "lognormal": mean of the logarithm [1].
        scale: Standard deviation of the parent normal or scale of the Student-t [unit]; "lognormal": of the logarithm.
        truncation_low: Lower truncation [unit], -inf where there is none.
        truncation_high: Upper truncation [unit], inf where there is none.
        degrees_of_freedom: Of the Student-t, inf for the others [1].
        aic: Criterion by which the family was chosen [1].
        runner_up: The best of the other families.
        runner_up_aic: Its criterion [1]; up to ``NO_EVIDENCE`` less than `aic`.
        ks_distance: Greatest distance between the two distributions [1].
    """

    family: str
    location: float
    scale: float
    truncation_low: float = -math.inf
    truncation_high: float = math.inf
    degrees_of_freedom: float = math.inf
    aic: float = math.nan
    runner_up: str = ""
    runner_up_aic: float = math.nan
    ks_distance: float = math.nan


def distribution(fit: Marginal) -> Any:
    """The frozen SciPy distribution of a fitted family (``cdf``, ``ppf``, ``rvs``)."""
    if fit.family == "lognormal":
        return stats.lognorm(s=fit.scale, scale=math.exp(fit.location))
    if fit.family == "student-t":
        return stats.t(df=fit.degrees_of_freedom, loc=fit.location, scale=fit.scale)
    if fit.family == "truncated normal":
        low = (fit.truncation_low - fit.location) / fit.scale
        high = (fit.truncation_high - fit.location) / fit.scale
        return stats.truncnorm(low, high, loc=fit.location, scale=fit.scale)
    return stats.norm(loc=fit.location, scale=fit.scale if fit.scale > 0 else 1e-300)


def _normal(x: Vector) -> tuple[Marginal, float, int]:
    """Closed-form normal fit: constants, mean log density, number of constants."""
    fit = Marginal("normal", float(x.mean()), float(x.std()))
    return fit, -0.5 * math.log(2 * math.pi * math.e * fit.scale**2), 2


def _lognormal(x: Vector) -> tuple[Marginal, float, int]:
    """Closed-form log-normal fit of positive draws."""
    log_x = np.log(x)
    fit = Marginal("lognormal", float(log_x.mean()), float(log_x.std()))
    return fit, -0.5 * math.log(2 * math.pi * math.e * fit.scale**2) - fit.location, 2


def _climb(density: Callable[[Vector], float], start: Vector, bounds: list[tuple[float, float]]) -> Vector:
    """The constants that make a mean log density greatest inside bounds."""
    found = optimize.minimize(lambda p: -density(p), start, method="L-BFGS-B", bounds=bounds)
    return np.asarray(found.x, dtype=float)


def _student(x: Vector) -> tuple[Marginal, float, int]:
    """Student-t fit by maximum likelihood in standardised coordinates."""
    mean, sd = float(x.mean()), float(x.std())
    z = (x - mean) / sd

    def density(p: Vector) -> float:
        centre, scale, freedom = p[0], math.exp(p[1]), math.exp(p[2])
        constant = special.gammaln((freedom + 1) / 2) - special.gammaln(freedom / 2)
        constant -= 0.5 * math.log(freedom * math.pi) + p[1]
        return float(constant - (freedom + 1) / 2 * np.log1p(((z - centre) / scale) ** 2 / freedom).mean())

    p = _climb(density, np.array([0.0, -0.2, math.log(6.0)]), [(-3, 3), (-4, 1), (math.log(1.1), math.log(300.0))])
    fit = Marginal("student-t", mean + sd * p[0], sd * math.exp(p[1]), degrees_of_freedom=math.exp(p[2]))
    return fit, density(p) - math.log(sd), 3


def _truncated(x: Vector, low: float, high: float) -> tuple[Marginal, float, int]:
    """Fit of a normal cut at known limits, by maximum likelihood in standardised coordinates."""
    mean, sd = float(x.mean()), float(x.std())
    z, z_low, z_high = (x - mean) / sd, (low - mean) / sd, (high - mean) / sd

    def density(p: Vector) -> float:
        scale = math.exp(p[1])
        a, b = (z_low - p[0]) / scale, (z_high - p[0]) / scale
        if a > 0:  # the same mass seen from the other side, where it does not cancel
            a, b = -b, -a
        inside = special.log_ndtr(b) + math.log1p(-math.exp(min(special.log_ndtr(a) - special.log_ndtr(b), -1e-15)))
        return float(-0.5 * math.log(2 * math.pi) - p[1] - 0.5 * (((z - p[0]) / scale) ** 2).mean() - inside)

    p = _climb(density, np.array([0.0, 0.0]), [(-15, 15), (-2, 3)])
    fit = Marginal("truncated normal", mean + sd * p[0], sd * math.exp(p[1]), low, high)
    return fit, density(p) - math.log(sd), 2


def fit_marginal(
    draws: ArrayLike, bounds: tuple[float, float] | None = None, effective: float | None = None
) -> Marginal:
    """Choose and fit the family of one parameter's draws.

    Args:
        draws: Draws of any shape [unit].
        bounds: Known limits of the parameter [unit]. Without them, and where all draws have one sign, zero is taken
            as the limit of the truncated normal.
        effective: Number of independent draws among them; all of them if None.

    Returns:
        The chosen family.

    Raises:
        InputError: If a draw is not finite, lies outside the bounds, or fewer than 20 are given.
    """
    x = np.asarray(draws, dtype=float).ravel()
    if x.size < LEAST_DRAWS or not np.isfinite(x).all():
        bad = int((~np.isfinite(x)).sum())
        raise InputError(Fault("fit_marginal draws", f"{x.size} draws, {bad} not finite", "20 or more finite draws"))
    if x.std() <= 1e-14 * max(abs(float(x.mean())), 1e-300):
        return Marginal("constant", float(x[0]), 0.0, ks_distance=0.0)
    low, high = bounds or (0.0 if x.min() > 0 else -math.inf, 0.0 if x.max() < 0 else math.inf)
    if x.min() < low or x.max() > high:
        raise InputError(Fault("fit_marginal bounds", f"draws in [{x.min()}, {x.max()}]", f"[{low}, {high}]"))
    candidates = [_normal(x)]
    if x.min() > 0:
        candidates.append(_lognormal(x))
    if math.isfinite(low) or math.isfinite(high):
        candidates.append(_truncated(x, low, high))
    candidates.append(_student(x))
    count = float(effective or x.size)
    scored = [(2.0 * k - 2.0 * count * log_density, fit) for fit, log_density, k in candidates]
    least = min(aic for aic, _ in scored)
    chosen = next(i for i, (aic, _) in enumerate(scored) if aic <= least + NO_EVIDENCE)
    aic, fit = scored.pop(chosen)
    other_aic, other = min(scored, key=lambda pair: pair[0])
    distance = float(stats.kstest(x, distribution(fit).cdf).statistic)
    return fit._replace(aic=aic, runner_up=other.family, runner_up_aic=other_aic, ks_distance=distance)
