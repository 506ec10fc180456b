"""Score tests of errors of a record or of its vehicle, at the optimum of a fit (Rao 1948; METHODS 9).

Parameters and latent disturbances adapt to an error of the record or of the vehicle, and statistics of innovations
hardly show it: of virtual flights whose capsule was 5 % heavier than the fit was told they flagged two of ten. The
score test asks for the error itself: the slope of the marginal log density by its size, at no error, over the standard
deviation of that slope given that the parameters adapt. It is the most powerful test of a small error, and one Newton
step estimates the size, all without a fit. The slope of the squared innovations alone would mislead: at the optimum
that of the log determinant balances it (on set R of another program density seemed to be off by 10 standard errors, by
both together by 0.7). So flights are brought to their conditional modes with a little of the error. And the mean over
start and disturbances is not that at their mode: what corrects it (`posterior.marginal.Linearisation.mean_correction`)
contributes up to 7 standard deviations to a slope (set Q), here with the correction held as it is at the optimum.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from bayeschute.core.numerics import processors
from bayeschute.likelihood.joint import FlightData, NoiseParameters, as_seen, stepped
from bayeschute.likelihood.kalman import innovations
from bayeschute.posterior.along_record.conditional_mode import approached
from bayeschute.posterior.marginal import Linearisation, Marginal

Array = NDArray[np.float64]
_SHARE = 0.5  # of the standard error that it would have if nothing else were unknown, by which an error is tried
_LEAST = 1e-12  # of a response's squares that the parameters leave, below which nothing can be told


class Alternative(NamedTuple):
    """An error of a record or of its vehicle that a fit takes not to be there.

    Attributes:
        what: Of what, in words.
        unit: Of its size.
        changed: The flight's data corrected by an error of a size.
        of_data: Whether only what the model is compared with is corrected, not what it simulates.
    """

    what: str
    unit: str
    changed: Callable[[float], FlightData]
    of_data: bool = False


class Score(NamedTuple):
    """The test of an alternative.

    Attributes:
        what: Of what it is an error.
        unit: Of the next two.
        estimate: Of its size, by one Newton step.
        se: Its standard error, the parameters unknown as well.
        moves: By how much the parameter that it moves most would differ with it [posterior standard deviations].
    """

    what: str
    unit: str
    estimate: float
    se: float
    moves: float

    @property
    def p(self) -> float:
        """Probability of so large an estimate, either way, where there is no error."""
        return float(2.0 * norm.sf(abs(self.estimate) / self.se))


def scores(marginal: Marginal, index: int, alternatives: Sequence[Alternative]) -> list[Score]:
    """Score tests of alternatives for one flight of a fit.

    Args:
        marginal: The marginal posterior about its mode.
        index: Of the flight.
        alternatives: For that flight.

    Returns:
        Those of which the record tells anything, in the same order; without those whose flights are not finite.
    """
    flight, along = marginal.flights[index], marginal.along[index]
    covariance = np.asarray(marginal.scale) @ np.asarray(marginal.scale).T
    unit, own = np.asarray(along.unit), along.parameters
    residual, by_theta = unit[..., 0].ravel(), unit[..., 1:].reshape(-1, np.size(own))
    mean = np.asarray(innovations(along.gains, *as_seen(along.linear).column(0))).ravel() - residual
    here = stepped(flight, along.theta, along.at.latent_path(flight))
    cost, roots = _cost(flight, marginal.hyper, along)

    def one(alternative: Alternative) -> Score | None:
        response = _response(flight, along, here, alternative)
        squares, shared = float(response @ response), by_theta.T @ response
        adapted = covariance[:, own] @ shared
        told = squares - float(shared @ adapted[own])
        if not np.isfinite(told) or told <= _LEAST * squares:
            return None
        slope = float(response @ residual)
        if not alternative.of_data:
            size = _SHARE * squares**-0.5
            there, others = _cost(alternative.changed(size), marginal.hyper, along)
            by_covariances = _information(roots, others) / size**2
            slope = 0.5 * (squares + by_covariances) * size - (there - cost) / size - float(response @ mean)
            told += by_covariances
        estimate = slope / told
        moves = float(np.max(np.abs(adapted * estimate) / np.sqrt(np.diag(covariance))))
        made = Score(alternative.what, alternative.unit, estimate, told**-0.5, moves)
        return made if np.isfinite(estimate) else None

    with ThreadPoolExecutor(processors()) as pool:
        return [made for made in pool.map(one, alternatives) if made is not None]


def _response(flight: FlightData, along: Linearisation, here: tuple, alternative: Alternative) -> Array:
    """Change (N,) of the standardised predictions of every datum by an error of size one along the path.

    Args:
        flight: The record.
        along: About its conditional mode.
        here: Residuals and defects along its path.
        alternative: The error.
    """
    there = stepped(alternative.changed(1.0), along.theta, along.at.latent_path(flight))
    series, inputs = (np.asarray(a)[..., None] - np.asarray(b)[..., None] for a, b in zip(here, there, strict=True))
    return np.asarray(innovations(along.gains, series, inputs)).ravel()


def _information(roots: Array, others: Array) -> float:
    """Fisher's, in a change of the innovations' covariances by sample, from their factors (T, C, C)."""
    change = np.linalg.solve(roots, others)
    return 0.5 * float(np.sum((change @ np.swapaxes(change, 1, 2) - np.eye(roots.shape[1])) ** 2))


def _cost(flight: FlightData, hyper: NoiseParameters, along: Linearisation) -> tuple[float, Array]:
    """Minus the marginal log density of a flight by Laplace's approximation, and factors of the covariances (T, C, C).

    Up to a constant; as of `beyond_linear.laplace.at` without what is the same with and without a small error.
    """
    (made,) = approached([flight], hyper, np.asarray(along.theta), [along.at])
    unit = np.asarray(innovations(made.gains, *as_seen(made.linear).column(0)))
    return 0.5 * float(np.sum(unit**2)) + float(made.gains.log_determinant), np.asarray(made.gains.root)
