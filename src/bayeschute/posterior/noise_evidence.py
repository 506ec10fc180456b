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
import jax.numpy as jnp
import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from bayeschute.core.numerics import processors
from bayeschute.likelihood.joint import FlightData, Linear, NoiseParameters, as_seen
from bayeschute.likelihood.kalman import MeanCorrection
from bayeschute.likelihood.kalman_gradient import evidence_score
from bayeschute.likelihood.kalman_gradient import from_vector as from_vector
from bayeschute.likelihood.kalman_gradient import to_vector as to_vector
from bayeschute.likelihood.priors import Prior, precision

Array = NDArray[np.float64]
_seen = jax.jit(as_seen)
_TOLD = 0.1  # along axes with a smaller standard deviation the skewness is negligible


@dataclass(frozen=True)
class NoisePrior:
    """Log-normal priors of the noise parameters: medians, and one standard deviation of the logarithm for all."""

    median: NoiseParameters
    log_sd: float = 0.7


def function_of(
    flights: Sequence[FlightData],
    linear: Sequence[Linear],
    priors: Sequence[Prior],
    prior: NoisePrior,
    mean_corrections: Sequence[MeanCorrection] | None = None,
) -> Callable[[Array], tuple[float, Array]]:
    """Minus the log evidence, up to a constant, and its gradient, as a function of the noise parameters' logarithms.

    Args:
        flights: Records.
        linear: Their linearisations at an optimum.
        priors: Priors of theta.
        prior: Priors of the noise parameters.
        mean_corrections: As in `maximise`.

    Returns:
        From (V,), in the order of `to_vector`, to value and gradient (V,); 1e300 and zeros where it is not finite.
    """
    median = jax.tree.map(lambda a: jnp.asarray(a, float), prior.median)
    seen = tuple(_seen(lin) for lin in linear)
    if mean_corrections is not None:
        seen = tuple(s.less(mean_correction) for s, mean_correction in zip(seen, mean_corrections, strict=True))
    fixed = (median, prior.log_sd, tuple(flights), tuple(linear), seen, precision(priors))

    def objective(vector: Array) -> tuple[float, Array]:
        value, gradient = evidence_score(jnp.asarray(vector), *fixed)
        if not np.isfinite(value):
            return 1e300, np.zeros_like(vector)
        return float(value), np.asarray(gradient)

    return objective


def maximise(
    flights: Sequence[FlightData],
    linear: Sequence[Linear],
    priors: Sequence[Prior],
    hyper: NoiseParameters,
    prior: NoisePrior,
    most: int = 60,
    mean_corrections: Sequence[MeanCorrection] | None = None,
) -> tuple[NoiseParameters, float]:
    """Noise parameters of greatest evidence at a linearisation.

    Args:
        flights: Records.
        linear: Their linearisations at an optimum.
        priors: Priors of theta.
        hyper: Where to start.
        prior: Priors of the noise parameters.
        most: Most iterations of L-BFGS.
        mean_corrections: See `posterior.marginal`, per flight; none where None.

    Returns:
        The noise parameters and minus the log evidence up to a constant.

    Raises:
        FloatingPointError: If the evidence is not finite anywhere.
    """
    middle = to_vector(prior.median)
    bounds = [(m - 5.0 * prior.log_sd, m + 5.0 * prior.log_sd) for m in middle]
    found = scipy.optimize.minimize(
        function_of(flights, linear, priors, prior, mean_corrections),
        to_vector(hyper),
        jac=True,
        method="L-BFGS-B",
        bounds=bounds,
        options={"maxiter": most, "ftol": 1e-7},
    )
    if not found.fun < 1e299:
        raise FloatingPointError("the evidence is not finite at the optimum: a simulation beside it fails")
    return jax.tree.map(np.asarray, from_vector(found.x, prior.median)), float(found.fun)


def noise_parameter_covariance(
    flights: Sequence[FlightData],
    linear: Sequence[Linear],
    priors: Sequence[Prior],
    hyper: NoiseParameters,
    prior: NoisePrior,
    slope: Array,
    mean_corrections: Sequence[MeanCorrection] | None = None,
) -> Array:
    """Laplace covariance of the logarithms of all noise parameters, by differences of the gradient.

    The gradient is exact, so a short step to one side will do. It is that for held parameters; those follow the noise
    parameters by `slope`, which takes ``slope' slope`` off the curvature.

    Args:
        flights: Records.
        linear: Their linearisations at an optimum.
        priors: Priors of theta.
        hyper: Noise parameters of greatest evidence.
        prior: Priors of the noise parameters.
        slope: From `noise_effect.noise_parameter_slope` (P, V).
        mean_corrections: As in `maximise`.

    Returns:
        (V, V), in the order of `to_vector`; never wider than the prior.
    """
    objective, at, step = function_of(flights, linear, priors, prior, mean_corrections), to_vector(hyper), 1e-3
    with ThreadPoolExecutor(processors()) as pool:
        rows = list(pool.map(lambda x: objective(x)[1], [at, *(at + step * np.eye(at.size))]))
    curvature = (np.array(rows[1:]) - rows[0]) / step
    values, vectors = np.linalg.eigh(0.5 * (curvature + curvature.T) - slope.T @ slope)
    return np.asarray((vectors / np.maximum(values, 1.0 / prior.log_sd**2)) @ vectors.T)


def mean_less_mode(
    flights: Sequence[FlightData],
    linear: Sequence[Linear],
    priors: Sequence[Prior],
    hyper: NoiseParameters,
    prior: NoisePrior,
    covariance: Array,
    mean_corrections: Sequence[MeanCorrection] | None = None,
) -> Array:
    """Mean minus mode of the logarithms of the noise parameters, from the skewness of their posterior.

    A record of a few correlation times bounds a variance or a time constant better from below than from above, so their
    posterior is skewed, and parameters that depend on them are biased if they are fixed at their mode. With
    third derivatives T and covariance S, the difference is ``-1/2 S (T : S)`` (Lindley 1980); ``T : S`` is the sum of
    second differences of the gradient, one standard deviation to either side along the axes of S. An axis at whose ends
    the evidence is not finite is left out.

    Args:
        flights: Records.
        linear: Their linearisations at an optimum.
        priors: Priors of theta.
        hyper: Noise parameters of greatest evidence.
        prior: Priors of the noise parameters.
        covariance: From `noise_parameter_covariance` (V, V).
        mean_corrections: As in `maximise`.

    Returns:
        (V,), along no axis more than a standard deviation.
    """
    objective, at = function_of(flights, linear, priors, prior, mean_corrections), to_vector(hyper)
    values, vectors = np.linalg.eigh(covariance)
    sd = np.sqrt(values)
    axes = (vectors * sd).T[sd > _TOLD]
    with ThreadPoolExecutor(processors()) as pool:
        (_, middle), *ends = pool.map(objective, [at, *(at + axes), *(at - axes)])
    both = zip(ends[: len(axes)], ends[len(axes) :], strict=True)
    pairs = [(up[1], down[1]) for up, down in both if max(up[0], down[0]) < 1e299]
    bent = np.sum([up for up, _ in pairs] + [down for _, down in pairs], axis=0) - 2.0 * len(pairs) * middle
    moved = -0.5 * sd * (vectors.T @ bent)  # in standard deviations along every axis
    return np.asarray(vectors @ (sd * np.clip(moved, -1.0, 1.0)))
