"""Profile posterior and profile likelihood: one parameter fixed at value after value, the others optimised.

At each value the other parameters solve a least-squares problem with a small polynomial added: Gauss-Newton with
Jacobians by differences, all values and all columns in batches of simulations. The prior of the parameter itself is
constant along the search, so one profile gives both the posterior and, without that prior, the likelihood.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.linalg
import scipy.stats
from numpy.typing import NDArray

from bayeschute.likelihood.priors import Prior, values
from bayeschute.posterior.marginal import Marginal, in_batches, projected_residuals

Array = NDArray[np.float64]
OFFSETS = (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0)
_STEP = 1e-3  # of differences, in posterior standard deviations
_SHARES = (1.0, 0.5, 0.25)


class Profile(NamedTuple):
    """The profile of one parameter; K values.

    Attributes:
        parameter: Its name.
        value: Values at which it was fixed (K,), in its unit.
        working: The same in the working coordinate (K,).
        log_density: Greatest marginal log density there (K,), less the greatest of the profile; NaN where the
            simulation fails.
        log_likelihood: The same without the parameter's own prior, the priors of the others kept.
        others: Parameters there (K, P), in their units.
        left: Largest last step of another parameter over its standard deviation (K,).
    """

    parameter: str
    value: Array
    working: Array
    log_density: Array
    log_likelihood: Array
    others: Array
    left: Array


def profile(
    marginal: Marginal, priors: Sequence[Prior], parameter: int, offsets: Sequence[float] = OFFSETS, rounds: int = 3
) -> Profile:
    """Profile one parameter.

    Args:
        marginal: The posterior.
        priors: Priors of the parameters.
        parameter: Its number.
        offsets: Values at which to fix it, from the centre of the posterior in standard deviations; increasing.
        rounds: Gauss-Newton steps of the other parameters.

    Returns:
        The profile.
    """
    scale, centre = np.asarray(marginal.scale), np.asarray(marginal.centre)
    row = scale[parameter]
    sd = float(np.linalg.norm(row))
    # xi on the plane where the parameter is held: row . xi = offset sd; the other directions are `free`.
    xi = np.outer(row / sd, offsets)
    free = scipy.linalg.null_space(row[None])
    cost, left = _costs(marginal, xi), np.zeros(len(offsets))
    for _ in range(rounds if free.shape[1] else 0):
        step = _steps(marginal, xi, free)
        wanted = np.isfinite(step).all(axis=0) & np.isfinite(cost)
        step = np.where(wanted, step, 0.0)
        left = np.full(len(offsets), np.inf)
        for share in _SHARES:
            there = xi + share * free @ step
            new = _costs(marginal, there)
            better = (new <= cost) & np.isinf(left) & wanted
            xi, cost = np.where(better, there, xi), np.where(better, new, cost)
            left = np.where(better, share * np.abs(step).max(axis=0, initial=0.0), left)
            if not (np.isinf(left) & wanted).any():
                break
        left = np.where(np.isinf(left) & wanted & (np.abs(step).max(axis=0) < 1e-6), 0.0, left)
    theta = centre + (scale @ xi).T
    z = (theta[:, parameter] - priors[parameter].centre) / priors[parameter].scale
    density, likelihood = -cost, -cost + 0.5 * z**2
    return Profile(
        priors[parameter].name,
        values(priors, theta)[:, parameter],
        theta[:, parameter],
        density - np.nanmax(density),
        likelihood - np.nanmax(likelihood),
        values(priors, theta),
        left,
    )


def _residuals(marginal: Marginal, xi: Array) -> Array:
    return np.asarray(in_batches(lambda part: projected_residuals(marginal, part), xi))


def _costs(marginal: Marginal, xi: Array) -> Array:
    """Minus the log density (K,) at (P, K); NaN where a simulation fails."""
    correction = np.asarray(marginal.correction.at(xi))
    return np.asarray(0.5 * np.sum(_residuals(marginal, xi) ** 2, axis=0) + correction)


def _steps(marginal: Marginal, xi: Array, free: Array) -> Array:
    """Gauss-Newton steps (F, K) along the free directions (P, F); NaN where a simulation fails."""
    count, directions = xi.shape[1], free.shape[1]
    moved = np.concatenate([np.zeros((len(free), 1)), _STEP * free], axis=1)
    points = (xi[:, :, None] + moved[:, None, :]).reshape(len(xi), -1)
    residual = _residuals(marginal, points).reshape(-1, count, 1 + directions)
    here, by = residual[..., 0], (residual[..., 1:] - residual[..., :1]) / _STEP
    slope, curvature = (np.asarray(a) for a in marginal.correction)
    steps = np.full((directions, count), np.nan)
    for k in range(count):
        if np.isfinite(by[:, k]).all():
            gradient = by[:, k].T @ here[:, k] + free.T @ (slope + curvature @ xi[:, k])
            matrix = by[:, k].T @ by[:, k] + free.T @ curvature @ free
            values, vectors = np.linalg.eigh(matrix)
            steps[:, k] = -vectors @ ((vectors.T @ gradient) / np.maximum(values, 0.1))
    return steps


class Interval(NamedTuple):
    """A likelihood interval in the parameter's unit; an end that the record does not bound within the profile is None.

    Attributes:
        low: Lower end.
        high: Upper end.
        drop: Fall of the log likelihood at the ends.
    """

    low: float | None
    high: float | None
    drop: float


def likelihood_interval(made: Profile, level: float = 0.9) -> Interval:
    """Where the profile likelihood has fallen by half the chi-squared quantile of `level`, linear in between.

    Args:
        made: The profile.
        level: Level of the interval were the likelihood Gaussian.
    """
    drop = 0.5 * float(scipy.stats.chi2.ppf(level, 1))
    whole = np.isfinite(made.log_likelihood)
    value, height = made.value[whole], made.log_likelihood[whole]
    top = int(np.argmax(height))

    def end(places: NDArray[np.intp]) -> float | None:
        for inner, outer in zip(places, places[1:], strict=False):
            if height[outer] < -drop:
                # A parabola's square root is straight: interpolate in the signed root of the fall.
                a, b, wanted = np.sqrt(-height[inner]), np.sqrt(-height[outer]), np.sqrt(drop)
                return float(value[inner] + (value[outer] - value[inner]) * (wanted - a) / (b - a))
        return None

    return Interval(end(np.arange(top, -1, -1)), end(np.arange(top, value.size)), drop)
