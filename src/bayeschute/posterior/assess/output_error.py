"""Classical output error: estimates with Cramer-Rao bounds, raw and corrected for colored residuals.

With no latent disturbances and white residual noise the MAP is the output-error estimate (maximum likelihood with
priors). Its raw covariance is the inverse information ``M^-1``, ``M = sum S' R^-1 S + P``, S the sensitivities of the
outputs to parameters and initial state, P the priors' precision. Residuals that remember make that too small; the
corrected covariance is ``M^-1 (sum_ij S_i' R^-1 Rvv(i - j) R^-1 S_j + P) M^-1`` with the residuals' autocovariance Rvv
(Morelli and Klein 1997). The form of the table is that of the report's table 7.1-2.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bayeschute.core.errors import Fault, InputError
from bayeschute.likelihood.joint import FlightData, Linear, NoiseParameters
from bayeschute.likelihood.kalman import response
from bayeschute.likelihood.priors import Prior, factor, precision, values_and_sds
from bayeschute.posterior.joint_mode import Optimum
from bayeschute.posterior.sampling.protocol import Draws
from bayeschute.regression.colored_errors import residual_noise

Array = NDArray[np.float64]


class Bounds(NamedTuple):
    """Covariances of the estimates in working coordinates, initial states eliminated.

    Attributes:
        theta: Estimates (P,).
        raw: Cramer-Rao bound under white noise (P, P).
        corrected: The same under colored residuals (P, P).
        memory: Integrated autocorrelation time of the residuals per flight [samples]; 1 for white noise.
    """

    theta: Array
    raw: Array
    corrected: Array
    memory: tuple[float, ...]


class Row(NamedTuple):
    """One line of the table: estimate and standard errors in the parameter's unit."""

    parameter: str
    estimate: float
    raw_sd: float
    corrected_sd: float
    unit: str


@jax.jit
def _sensitivities(flight: FlightData, linear: Linear) -> jax.Array:
    """Derivatives of the outputs by parameters and standard start (T, C, P + D)."""
    p, d = linear.steps.out_theta.shape[2], flight.start_scale.shape[0]
    start = jnp.concatenate([jnp.zeros((d, p)), jnp.diag(jnp.asarray(flight.start_scale))], axis=1)
    error = jnp.asarray(linear.latent_path.error)
    theta = jnp.concatenate([jnp.eye(p), jnp.zeros((p, d))], axis=1)
    return response(linear.steps, start, jnp.zeros((*error.shape, p + d)), theta)


def _noise_sd(flight: FlightData, hyper: NoiseParameters) -> Array:
    """Standard deviation of every output's residual noise (C,)."""
    noise = hyper.outputs(flight)
    return np.hypot(np.asarray(noise.white), np.asarray(noise.correlated))


def _meat(
    residual: Array, design: Array, present: NDArray[np.bool_], prior_factor: Array, taper: str, share: float
) -> tuple[Array, float]:
    """``S' R^-1 Rvv R^-1 S`` of one flight from scaled residuals (T, C) and sensitivities (T, C, Q), and the memory."""
    samples, outputs = present.shape
    used = present.T.ravel()
    rows = np.moveaxis(design, 1, 0).reshape(samples * outputs, -1)[used]
    # What fitting took out of the residuals lies in the directions that the data move more than the prior holds.
    left, size, _ = scipy.linalg.svd(rows @ prior_factor, full_matrices=False)
    noise = residual_noise(
        np.where(present, residual, np.nan).T.ravel(),
        blocks=np.repeat(np.arange(outputs), samples),
        groups=np.zeros(samples * outputs, int),
        time=np.tile(np.arange(float(samples)), outputs),
        Q=left[:, size > 1.0],
        max_lag_fraction=share,
        taper=taper,
    )
    return noise.quadratic(rows), noise.integrated_time


def bounds(
    flights: Sequence[FlightData],
    hyper: NoiseParameters,
    priors: Sequence[Prior],
    optimum: Optimum,
    taper: str = "parzen",
    max_lag_fraction: float = 0.1,
) -> Bounds:
    """Cramer-Rao bounds at an optimum.

    Args:
        flights: Records, fitted without latent disturbances.
        hyper: Noise parameters; the total variance of every output counts.
        priors: Priors of the parameters; wide ones give the classical bounds.
        optimum: The optimum.
        taper: Window of the autocovariance, ``"parzen"`` or ``"bartlett"``.
        max_lag_fraction: Lags are cut at this share of a record.

    Returns:
        The bounds.

    Raises:
        InputError: If a flight has latent disturbances, which would take up the residuals, or for an unknown taper.
    """
    if any(flight.latent.size for flight in flights):
        wanted = "flights without latent disturbances"
        raise InputError(Fault("output error", "latent disturbances", wanted, "Use [noise] model = 'sandwich'."))
    root, p = factor(priors), len(priors)
    size = p + sum(flight.starts for flight in flights)
    information = scipy.linalg.block_diag(precision(priors), np.eye(size - p))
    middle, memory = information.copy(), []
    at = p
    for flight, linear in zip(flights, optimum.linear(flights), strict=True):
        sd, present = _noise_sd(flight, hyper), np.asarray(flight.present, bool)
        design = np.where(present[..., None], np.asarray(_sensitivities(flight, linear)) / sd[:, None], 0.0)
        own = np.concatenate([np.arange(p), np.arange(at, at + flight.starts)])
        at += flight.starts
        residual = np.asarray(linear.residual) / sd
        prior_factor = scipy.linalg.block_diag(root, np.eye(flight.starts))
        quadratic, remembered = _meat(residual, design, present, prior_factor, taper, max_lag_fraction)
        information[np.ix_(own, own)] += np.einsum("tcp,tcq->pq", design, design)
        middle[np.ix_(own, own)] += quadratic
        memory.append(remembered)
    inverse = scipy.linalg.inv(information)
    corrected = inverse @ middle @ inverse
    return Bounds(np.asarray(optimum.theta), inverse[:p, :p], 0.5 * (corrected + corrected.T)[:p, :p], tuple(memory))


def table(made: Bounds, priors: Sequence[Prior]) -> list[Row]:
    """The table of estimates (table 7.1-2 of the report): parameter, estimate, raw and corrected standard error.

    A parameter whose working coordinate is its logarithm has its standard errors by the delta method.
    """
    (estimates, raw), (_, corrected) = (values_and_sds(priors, made.theta, c) for c in (made.raw, made.corrected))
    return [
        Row(p.name, float(e), float(r), float(c), p.unit)
        for p, e, r, c in zip(priors, estimates, raw, corrected, strict=True)
    ]


def gaussian_draws(
    made: Bounds, centre: Array, scale: Array, chains: int, draws: int, rng: np.random.Generator
) -> Draws:
    """Independent normal draws with the corrected covariance, in the standard coordinates of a marginal posterior.

    Args:
        made: The bounds.
        centre: Where the standard coordinates have their origin (P,).
        scale: Their factor (P, P): ``theta = centre + scale @ xi``.
        chains: Chains.
        draws: Draws per chain.
        rng: Source of randomness.
    """
    z = rng.standard_normal((chains, draws, made.theta.size))
    theta = made.theta + z @ np.linalg.cholesky(made.corrected).T
    xi = np.einsum("pq,cdq->cdp", np.linalg.inv(scale), theta - centre)
    density: Array = -0.5 * np.einsum("cdp,cdp->cd", z, z)
    return Draws(xi, density, notes=("normal draws with the sandwich covariance; no sampler ran",))
