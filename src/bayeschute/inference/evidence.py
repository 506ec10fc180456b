"""Noise parameters by their evidence: the Laplace approximation of the marginal likelihood, maximised.

Along its course a flight is linear, so the filter's likelihood integrates start and disturbances out exactly; theta is
integrated out by Laplace's method at the point of linearisation. The sum is maximised over the logarithms of the noise
parameters under log-normal priors.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize
from jax.flatten_util import ravel_pytree
from numpy.typing import NDArray

from bayeschute.air.vector import Component
from bayeschute.inference.priors import Prior, working
from bayeschute.inference.statespace import innovations
from bayeschute.inference.target import FlightData, Hyper, Linear, as_series, filter_gains

Array = NDArray[np.float64]


@dataclass(frozen=True)
class HyperPrior:
    """Log-normal priors of the noise parameters: medians, and one standard deviation of the logarithm for all."""

    median: Hyper
    log_sd: float = 0.7


def to_vector(hyper: Hyper) -> Array:
    """Logarithms of all noise parameters in one vector (V,)."""
    return np.asarray(ravel_pytree(jax.tree.map(lambda a: jnp.log(jnp.asarray(a, float)), hyper))[0])


def from_vector(vector: Component, like: Hyper) -> Hyper:
    """The inverse of `to_vector`, in the form of another set of noise parameters."""
    unravel = ravel_pytree(jax.tree.map(lambda a: jnp.asarray(a, float), like))[1]
    return jax.tree.map(jnp.exp, unravel(jnp.asarray(vector)))


@jax.jit
def _objective(
    vector: jax.Array, median: Hyper, log_sd: float, flights: tuple, linear: tuple, prior_scale: jax.Array
) -> jax.Array:
    """Minus the log evidence and the log prior at the logarithms of the noise parameters, up to a constant."""
    hyper = from_vector(vector, median)
    middle = ravel_pytree(jax.tree.map(jnp.log, median))[0]
    value, matrix = 0.5 * jnp.sum(((vector - middle) / log_sd) ** 2), jnp.diag(1.0 / prior_scale**2)
    for flight, lin in zip(flights, linear, strict=True):
        made, series = filter_gains(flight, hyper, lin), as_series(lin)
        unit = innovations(made, series).reshape(-1, series.shape[2])
        value = value + 0.5 * unit[:, 0] @ unit[:, 0] + made.log_determinant
        matrix = matrix + unit[:, 1:].T @ unit[:, 1:]
    return value + 0.5 * jnp.linalg.slogdet(matrix)[1]


_gradient = jax.jit(jax.value_and_grad(_objective))


def _function(
    flights: Sequence[FlightData], linear: Sequence[Linear], priors: Sequence[Prior], prior: HyperPrior
) -> Callable[[Array], tuple[float, Array]]:
    """The objective and its gradient as a function of the vector alone."""
    median = jax.tree.map(lambda a: jnp.asarray(a, float), prior.median)
    fixed = (median, prior.log_sd, tuple(flights), tuple(linear), working(priors)[1])

    def objective(vector: Array) -> tuple[float, Array]:
        value, gradient = _gradient(jnp.asarray(vector), *fixed)
        if not np.isfinite(value):
            return 1e300, np.zeros_like(vector)
        return float(value), np.asarray(gradient)

    return objective


def maximise(
    flights: Sequence[FlightData],
    linear: Sequence[Linear],
    priors: Sequence[Prior],
    hyper: Hyper,
    prior: HyperPrior,
    most: int = 60,
) -> tuple[Hyper, float]:
    """Noise parameters of greatest evidence at a linearisation.

    Args:
        flights: Records.
        linear: Their linearisations at an optimum.
        priors: Priors of theta.
        hyper: Where to start.
        prior: Priors of the noise parameters.
        most: Most iterations of L-BFGS.

    Returns:
        The noise parameters and minus the log evidence up to a constant.

    Raises:
        FloatingPointError: If the evidence is not finite anywhere.
    """
    middle = to_vector(prior.median)
    bounds = [(m - 5.0 * prior.log_sd, m + 5.0 * prior.log_sd) for m in middle]
    found = scipy.optimize.minimize(
        _function(flights, linear, priors, prior),
        to_vector(hyper),
        jac=True,
        method="L-BFGS-B",
        bounds=bounds,
        options={"maxiter": most, "ftol": 1e-7},
    )
    if not found.fun < 1e299:
        raise FloatingPointError("the evidence is not finite at the optimum: a simulation beside it fails")
    return jax.tree.map(np.asarray, from_vector(found.x, prior.median)), float(found.fun)


def law_covariance(
    flights: Sequence[FlightData],
    linear: Sequence[Linear],
    priors: Sequence[Prior],
    hyper: Hyper,
    prior: HyperPrior,
) -> Array:
    """Laplace covariance of the logarithms of all noise parameters, by differences of the gradient.

    Args:
        flights: Records.
        linear: Their linearisations at an optimum.
        priors: Priors of theta.
        hyper: Noise parameters of greatest evidence.
        prior: Priors of the noise parameters.

    Returns:
        (V, V), in the order of `to_vector`; never wider than the prior.
    """
    objective, at, step = _function(flights, linear, priors, prior), to_vector(hyper), 0.05
    rows = [(objective(at + step * e)[1] - objective(at - step * e)[1]) / (2.0 * step) for e in np.eye(at.size)]
    values, vectors = np.linalg.eigh(0.5 * (np.array(rows) + np.array(rows).T))
    return np.asarray((vectors / np.maximum(values, 1.0 / prior.log_sd**2)) @ vectors.T)
