"""Noise parameters by their evidence: the Laplace approximation of the marginal likelihood, maximised.

Around an optimum residuals are linear in (theta, u), so the evidence is Gaussian and exact for the linearised flight;
it is maximised over the logarithms of the noise parameters under log-normal priors, the unknowns integrated out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from bayeschute.inference.noise import Noise
from bayeschute.inference.priors import Prior, working
from bayeschute.inference.target import FlightData, Hyper, Linear, log_normaliser, standardised_linear


@dataclass(frozen=True)
class HyperPrior:
    """Log-normal priors of the noise parameters: medians, and one standard deviation of the logarithm for all."""

    median: Hyper
    log_sd: float = 0.7


def to_vector(hyper: Hyper) -> NDArray[np.float64]:
    """Logarithms of all noise parameters in one vector."""
    return np.concatenate([np.log(np.atleast_1d(np.asarray(leaf))) for leaf in jax.tree.leaves(hyper)])


def from_vector(vector: jax.Array, channels: int, groups: int) -> Hyper:
    """The inverse of `to_vector`."""
    e = jnp.exp(vector)
    white, correlated, tau = (e[i * channels : (i + 1) * channels] for i in range(3))
    rest = e[3 * channels :]
    return Hyper(Noise(white, correlated, tau), rest[:groups], rest[groups:])


@partial(jax.jit, static_argnames=("channels", "groups"))
def _objective(
    vector: jax.Array,
    centre: jax.Array,
    log_sd: float,
    flights: tuple[FlightData, ...],
    linear: tuple[Linear, ...],
    prior_z: jax.Array,
    prior_scale: jax.Array,
    channels: int,
    groups: int,
) -> jax.Array:
    """Minus the log evidence and the log prior at the logarithms of the noise parameters, up to a constant."""
    hyper = from_vector(vector, channels, groups)
    p = prior_z.shape[0]
    matrix, gradient = jnp.diag(1.0 / prior_scale**2), prior_z / prior_scale
    value = 0.5 * jnp.sum(((vector - centre) / log_sd) ** 2)
    for flight, lin in zip(flights, linear, strict=True):
        s, by = standardised_linear(flight, hyper, lin)
        a_u = by[:, p:]
        factor = jnp.linalg.cholesky(a_u.T @ a_u)
        g_u = jax.scipy.linalg.solve_triangular(factor, a_u.T @ s, lower=True)
        c_u = jax.scipy.linalg.solve_triangular(factor, a_u.T @ by[:, :p], lower=True)
        matrix = matrix + by[:, :p].T @ by[:, :p] - c_u.T @ c_u
        gradient = gradient + by[:, :p].T @ s - c_u.T @ g_u
        value = value + 0.5 * (s @ s - g_u @ g_u) + jnp.sum(jnp.log(jnp.diag(factor))) + log_normaliser(flight, hyper)
    factor = jnp.linalg.cholesky(matrix)
    half = jax.scipy.linalg.solve_triangular(factor, gradient, lower=True)
    return value - 0.5 * half @ half + jnp.sum(jnp.log(jnp.diag(factor)))


_gradient = jax.jit(jax.value_and_grad(_objective), static_argnames=("channels", "groups"))


def maximise(
    flights: Sequence[FlightData],
    linear: Sequence[Linear],
    priors: Sequence[Prior],
    theta: NDArray[np.float64],
    hyper: Hyper,
    prior: HyperPrior,
    most: int = 60,
) -> tuple[Hyper, float]:
    """Noise parameters of greatest evidence at a linearisation.

    Args:
        flights: Records.
        linear: Their linearisations at (theta, u).
        priors: Priors of theta.
        theta: Where the flights were linearised (P,).
        hyper: Where to start.
        prior: Priors of the noise parameters.
        most: Most iterations of L-BFGS.

    Returns:
        The noise parameters and minus the log evidence up to a constant.
    """
    centre, scale = working(priors)
    channels, groups = int(np.size(hyper.noise.white)), int(np.size(hyper.latent_sd))
    middle = to_vector(prior.median)
    fixed = (middle, prior.log_sd, tuple(flights), tuple(linear), (theta - centre) / scale, scale)

    def objective(vector: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        value, gradient = _gradient(vector, *fixed, channels=channels, groups=groups)
        if not np.isfinite(value):
            return 1e300, np.zeros_like(vector)
        return float(value), np.asarray(gradient)

    bounds = [(m - 5.0 * prior.log_sd, m + 5.0 * prior.log_sd) for m in middle]
    found = scipy.optimize.minimize(
        objective, to_vector(hyper), jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": most, "ftol": 1e-7}
    )
    if not found.fun < 1e299:
        raise FloatingPointError("the evidence is not finite at the optimum: a simulation beside it fails")
    return jax.tree.map(np.asarray, from_vector(jnp.asarray(found.x), channels, groups)), float(found.fun)


def latent_covariance(
    flights: Sequence[FlightData],
    linear: Sequence[Linear],
    priors: Sequence[Prior],
    theta: NDArray[np.float64],
    hyper: Hyper,
    prior: HyperPrior,
) -> NDArray[np.float64]:
    """Laplace covariance of the logarithms of the latent disturbances' parameters, by differences of the gradient.

    Args:
        flights: Records.
        linear: Their linearisations at (theta, u).
        priors: Priors of theta.
        theta: Where the flights were linearised (P,).
        hyper: Noise parameters of greatest evidence.
        prior: Priors of the noise parameters.

    Returns:
        (2 G, 2 G): standard deviations of all groups, then time constants; never wider than the prior.
    """
    centre, scale = working(priors)
    channels, groups = int(np.size(hyper.noise.white)), int(np.size(hyper.latent_sd))
    fixed = (to_vector(prior.median), prior.log_sd, tuple(flights), tuple(linear), (theta - centre) / scale, scale)
    at, step, free = to_vector(hyper), 0.05, 2 * groups

    def gradient(vector: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(_gradient(vector, *fixed, channels=channels, groups=groups)[1])[-free:]

    rows = [(gradient(at + step * e) - gradient(at - step * e)) / (2.0 * step) for e in np.eye(at.size)[-free:]]
    values, vectors = np.linalg.eigh(0.5 * (np.array(rows) + np.array(rows).T))
    return np.asarray((vectors / np.maximum(values, 1.0 / prior.log_sd**2)) @ vectors.T)
