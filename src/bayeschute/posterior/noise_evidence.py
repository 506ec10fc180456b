"""Empirical Bayes for the noise parameters: maximisation of the Laplace approximation of the evidence.

A flight linearised along its trajectory has an exact filter likelihood, with start and disturbances integrated out;
theta is integrated out by Laplace's method at the point of linearisation. The sum is maximised over the logarithms of
the noise parameters under log-normal priors.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import jax
import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from bayeschute.core.numerics import processors
from bayeschute.likelihood.disturbances import KINDS
from bayeschute.likelihood.joint import FlightData, Linear, NoiseParameters, as_seen
from bayeschute.likelihood.kalman import MeanCorrection
from bayeschute.likelihood.kalman_gradient import evidence_score
from bayeschute.likelihood.kalman_gradient import from_vector as from_vector
from bayeschute.likelihood.kalman_gradient import to_vector as to_vector
from bayeschute.likelihood.priors import Prior, precision

Array = NDArray[np.float64]
Evidence = Callable[[Array], tuple[float, Array]]
"""Minus a log evidence and its gradient (V,) at the logarithms of the noise parameters (V,): see `function_of`."""
_FARTHEST = 5.0  # standard deviations of its prior that a noise parameter may be away from the median
_DETUNED = 2.0  # frequency of an oscillator over its median, or the other way round, at most
_DAMPED = 0.3  # greatest damping ratio of an oscillator, or twice its median
_MOST_PRIOR = 0.95  # largest share of the prior in a precision; beyond it what data tell is lost in rounding
_TOLD = 0.1  # along axes with a smaller standard deviation the skewness is negligible


@dataclass(frozen=True)
class NoisePrior:
    """Log-normal priors of the noise parameters: medians, and one standard deviation of the logarithm for all.

    Attributes:
        median: Of every noise parameter.
        log_sd: Of the logarithms.
        longest: Groups of drifts, and the longest time constant that is sought of each [s].
    """

    median: NoiseParameters
    log_sd: float = 0.7
    longest: tuple[tuple[int, float], ...] = ()

    def limits(self) -> tuple[Array, Array]:
        """Least and greatest logarithms of the noise parameters that are sought (V,), in the order of `to_vector`.

        An oscillator is near the frequency that is believed, and lightly damped. Else what breathes may end as a slow
        force on every canopy, which stands for the terms between canopies that a model then lacks.
        """
        middle = to_vector(self.median)
        low, high = middle - _FARTHEST * self.log_sd, middle + _FARTHEST * self.log_sd
        place = len(middle) - sum(len(one) for one in self.median.disturbance_parameters)
        longest = dict(self.longest)
        for group, one in enumerate(self.median.disturbance_parameters):
            if group in longest:
                high[place + 1] = np.log(longest[group])
            if len(one) == KINDS["oscillator"]:
                low[place + 1], high[place + 1] = middle[place + 1] + np.log([1.0 / _DETUNED, _DETUNED])
                high[place + 2] = np.log(max(_DAMPED, 2.0 * one[2]))
            place += len(one)
        return low, high


def function_of(
    flights: Sequence[FlightData],
    linear: Sequence[Linear],
    priors: Sequence[Prior],
    prior: NoisePrior,
    mean_corrections: Sequence[MeanCorrection] | None = None,
) -> Evidence:
    """Minus the log evidence, up to a constant, and its gradient, as a function of the noise parameters' logarithms.

    Args:
        flights: Records.
        linear: Their linearisations at an optimum.
        priors: Priors of theta.
        prior: Priors of the noise parameters.
        mean_corrections: See `posterior.marginal`, per flight; none where None.

    Returns:
        From (V,), in the order of `to_vector`, to value and gradient (V,); 1e300 and zeros where it is not finite.
    """
    median = jax.tree.map(lambda a: np.asarray(a, float), prior.median)
    seen = tuple(as_seen(lin) for lin in linear)
    if mean_corrections is not None:
        seen = tuple(s.less(mean_correction) for s, mean_correction in zip(seen, mean_corrections, strict=True))
    told = tuple(data.told()[data.told() > 0] - 1 for data in seen)
    seen = tuple(data.some(np.array([0, *(own + 1)])) for data, own in zip(seen, told, strict=True))
    columns = tuple(np.asarray(one.parameters)[own] for one, own in zip(linear, told, strict=True))
    before = precision(priors)

    def objective(vector: Array) -> tuple[float, Array]:
        given = vector, median, prior.log_sd, tuple(flights), tuple(linear), seen, columns, before
        try:
            value, gradient = evidence_score(*given)
        except np.linalg.LinAlgError:  # the noise is so far off that rounding makes a covariance indefinite
            value = np.inf
        return (value, gradient) if np.isfinite(value) else (1e300, np.zeros_like(vector))

    return objective


def scales(evidence: Evidence, hyper: NoiseParameters, prior: NoisePrior) -> Array:
    """How far the logarithms of the noise parameters may move, each alone, until the evidence tells.

    Args:
        evidence: From `function_of`.
        hyper: Where.
        prior: Priors of the noise parameters; their standard deviation is the most.

    Returns:
        Inverse roots of the curvatures' sizes (V,).
    """
    curvature = np.diag(_curvature(evidence, to_vector(hyper)))
    return np.asarray(1.0 / np.sqrt(np.maximum(np.abs(curvature), 1.0 / prior.log_sd**2)))


def _curvature(evidence: Evidence, at: Array, step: float = 1e-3) -> Array:
    """Derivatives of the gradient (V, V). That is exact, so a short step to one side will do."""
    with ThreadPoolExecutor(processors()) as pool:
        rows = list(pool.map(lambda x: evidence(x)[1], [at, *(at + step * np.eye(at.size))]))
    return (np.array(rows[1:]) - rows[0]) / step


def maximise(
    evidence: Evidence, hyper: NoiseParameters, prior: NoisePrior, most: int = 60, scale: Array | None = None
) -> tuple[NoiseParameters, float]:
    """Noise parameters of greatest evidence at a linearisation.

    A record of thousands of samples knows a sensor's noise a hundred times as well as a disturbance's correlation time.
    In coordinates of like scale L-BFGS takes twenty steps there; on the logarithms themselves, sixty end far off.

    Args:
        evidence: From `function_of`.
        hyper: Where to start.
        prior: Priors of the noise parameters.
        most: Most iterations of L-BFGS.
        scale: Of its coordinates (V,), from `scales`; those at the start where None.

    Returns:
        The noise parameters and minus the log evidence up to a constant.

    Raises:
        FloatingPointError: If the evidence is not finite anywhere.
    """
    unit = scales(evidence, hyper, prior) if scale is None else scale
    low, high = prior.limits()

    def scaled(z: Array) -> tuple[float, Array]:
        value, gradient = evidence(unit * z)
        return value, unit * gradient

    found = scipy.optimize.minimize(
        scaled,
        np.clip(to_vector(hyper), low, high) / unit,
        jac=True,
        method="L-BFGS-B",
        bounds=list(zip(low / unit, high / unit, strict=True)),
        options={"maxiter": most, "ftol": 1e-7},
    )
    if not found.fun < 1e299:
        raise FloatingPointError("the evidence is not finite at the optimum: a simulation beside it fails")
    return jax.tree.map(np.asarray, from_vector(unit * found.x, prior.median)), float(found.fun)


def noise_parameter_covariance(
    evidence: Evidence, hyper: NoiseParameters, prior: NoisePrior, slope: Array, known_before: Array
) -> Array:
    """Laplace covariance of the logarithms of all noise parameters, by differences of the gradient.

    That is the gradient for held parameters; those follow the noise parameters by `slope` S, which takes ``S' S`` off
    the curvature. What is left may be a small difference of large numbers. But data only add information to the priors:
    with the priors' share K of the parameters' precision I, the Schur complement of the data's share is positive, so
    what is left is at least the prior precision of the noise parameters and ``S' ((I - K)^-1 - I) S``. So no parameter
    follows the noise parameters farther than its prior lets it.

    Args:
        evidence: From `function_of`.
        hyper: Noise parameters of greatest evidence.
        prior: Priors of the noise parameters.
        slope: From `noise_effect.noise_parameter_slope` (P, V).
        known_before: Prior precision of the parameters in the same standard coordinates (P, P).

    Returns:
        (V, V), in the order of `to_vector`; never wider than the prior.
    """
    curvature = _curvature(evidence, to_vector(hyper))
    share, axes = np.linalg.eigh(known_before)
    share = np.clip(share, 0.0, _MOST_PRIOR)
    along = np.sqrt(share / (1.0 - share))[:, None] * (axes.T @ slope)
    least = np.eye(len(curvature)) / prior.log_sd**2 + along.T @ along
    values, vectors = np.linalg.eigh(0.5 * (curvature + curvature.T) - slope.T @ slope - least)
    return np.asarray(np.linalg.inv(least + (vectors * np.maximum(values, 0.0)) @ vectors.T))


def mean_less_mode(evidence: Evidence, hyper: NoiseParameters, covariance: Array) -> Array:
    """Mean minus mode of the logarithms of the noise parameters, from the skewness of their posterior.

    A record of a few correlation times bounds a variance or a time constant better from below than from above, so their
    posterior is skewed, and parameters that depend on them are biased if they are fixed at their mode. With
    third derivatives T and covariance S, the difference is ``-1/2 S (T : S)`` (Lindley 1980); ``T : S`` is the sum of
    second differences of the gradient, one standard deviation to either side along the axes of S. An axis at whose ends
    the evidence is not finite is left out.

    Args:
        evidence: From `function_of`.
        hyper: Noise parameters of greatest evidence.
        covariance: From `noise_parameter_covariance` (V, V).

    Returns:
        (V,), along no axis more than a standard deviation.
    """
    at = to_vector(hyper)
    values, vectors = np.linalg.eigh(covariance)
    sd = np.sqrt(values)
    axes = (vectors * sd).T[sd > _TOLD]
    with ThreadPoolExecutor(processors()) as pool:
        (_, middle), *ends = pool.map(evidence, [at, *(at + axes), *(at - axes)])
    both = zip(ends[: len(axes)], ends[len(axes) :], strict=True)
    pairs = [(up[1], down[1]) for up, down in both if max(up[0], down[0]) < 1e299]
    bent = np.sum([up for up, _ in pairs] + [down for _, down in pairs], axis=0) - 2.0 * len(pairs) * middle
    moved = -0.5 * sd * (vectors.T @ bent)  # in standard deviations along every axis
    return np.asarray(vectors @ (sd * np.clip(moved, -1.0, 1.0)))
