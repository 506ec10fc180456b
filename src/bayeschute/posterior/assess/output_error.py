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
from bayeschute.likelihood.priors import Prior, factor, values_and_sds
from bayeschute.posterior.joint_mode import Optimum
from bayeschute.posterior.sampling.protocol import Draws
from bayeschute.posterior.sampling.sampler_checks import ROUNDING
from bayeschute.regression.colored_errors import residual_noise

Array = NDArray[np.float64]


class Bounds(NamedTuple):
    """Covariances of the estimates in working coordinates, initial states eliminated.

    Attributes:
        theta: Estimates (P,).
        raw_factor: Lower factor of the Cramer-Rao bound under white noise (P, P).
        corrected_factor: Of the same under colored residuals (P, P).
        memory: Integrated autocorrelation time of the residuals per flight [samples]; 1 for white noise.
    """

    theta: Array
    raw_factor: Array
    corrected_factor: Array
    memory: tuple[float, ...]

    @property
    def raw(self) -> Array:
        """Cramer-Rao bound under white noise (P, P)."""
        return self.raw_factor @ self.raw_factor.T

    @property
    def corrected(self) -> Array:
        """The same under colored residuals (P, P)."""
        return self.corrected_factor @ self.corrected_factor.T


class Row(NamedTuple):
    """One line of the table: estimate and standard errors in the parameter's unit, NaN where they are not known."""

    parameter: str
    estimate: float
    raw_sd: float
    corrected_sd: float
    unit: str


@jax.jit
def _sensitivities(flight: FlightData, linear: Linear) -> jax.Array:
    """Derivatives of the outputs by the flight's parameters and standard start (T, C, K + D)."""
    p, d = linear.steps.out_theta.shape[2], flight.start_scale.shape[0]
    start = jnp.concatenate([jnp.zeros((d, p)), jnp.diag(jnp.asarray(flight.start_scale))], axis=1)
    error = jnp.asarray(linear.latent_path.error)
    theta = jnp.concatenate([jnp.eye(p), jnp.zeros((p, d))], axis=1)
    return response(linear.steps, start, jnp.zeros((*error.shape, p + d)), theta)


def _noise_sd(flight: FlightData, hyper: NoiseParameters) -> Array:
    """Standard deviation of every output's residual noise (C,)."""
    noise = hyper.outputs(flight)
    return np.hypot(np.asarray(noise.white), np.asarray(noise.correlated))


class _Told(NamedTuple):
    """What a flight tells of its own unknowns.

    Attributes:
        triangle: R of the factors Q R of the sensitivities, in standard deviations of the noise (Q, Q); Q = K + D.
        middle: Autocovariance of the residuals as the columns of the factor Q see it (Q, Q).
        memory: Integrated autocorrelation time of the residuals [samples].
    """

    triangle: Array
    middle: Array
    memory: float


def _told(
    flight: FlightData, linear: Linear, hyper: NoiseParameters, prior_factor: Array, taper: str, share: float
) -> _Told:
    """Of the K parameters that the flight has and D initial deviations, whose prior has this factor (K + D, P + D)."""
    sd, present = _noise_sd(flight, hyper), np.asarray(flight.present, bool)
    samples, outputs = present.shape
    design = np.moveaxis(np.asarray(_sensitivities(flight, linear)) / sd[:, None], 1, 0)
    rows = design.reshape(samples * outputs, -1)[present.T.ravel()]
    # What fitting took out of the residuals lies in the directions that the data move more than the prior holds.
    left, size, _ = scipy.linalg.svd(rows @ prior_factor, full_matrices=False)
    noise = residual_noise(
        np.where(present, np.asarray(linear.residual) / sd, np.nan).T.ravel(),
        blocks=np.repeat(np.arange(outputs), samples),
        groups=np.zeros(samples * outputs, int),
        time=np.tile(np.arange(float(samples)), outputs),
        Q=left[:, size > 1.0],
        max_lag_fraction=share,
        taper=taper,
    )
    unit, triangle = scipy.linalg.qr(rows, mode="economic")
    return _Told(triangle, noise.quadratic(unit), noise.integrated_time)


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
    held = scipy.linalg.block_diag(scipy.linalg.solve_triangular(root, np.eye(p), lower=True), np.eye(size - p))
    told, triangles, at = list[_Told](), list[Array](), p
    for flight, linear in zip(flights, optimum.linear(flights), strict=True):
        prior_factor = scipy.linalg.block_diag(root[linear.parameters], np.eye(flight.starts))
        told.append(_told(flight, linear, hyper, prior_factor, taper, max_lag_fraction))
        wide = np.zeros((len(told[-1].triangle), size))
        wide[:, np.r_[linear.parameters, at : at + flight.starts]] = told[-1].triangle
        triangles.append(wide)
        at += flight.starts
    # Sensitivities of a flight that diverges grow through the record: information squares them beyond all digits.
    unit, triangle = scipy.linalg.qr(np.concatenate([*triangles, held]), mode="economic")
    *parts, rest = np.split(unit, np.cumsum([len(one) for one in triangles]))
    middle = rest.T @ rest + sum(part.T @ one.middle @ part for one, part in zip(told, parts, strict=True))
    value, vector = np.linalg.eigh(middle)
    back = scipy.linalg.solve_triangular(triangle, np.eye(size))[:p]
    spread = back @ (vector * np.sqrt(np.maximum(value, 0.0)))
    raw, corrected = (np.asarray(np.linalg.qr(one.T, mode="r")).T for one in (back, spread))
    return Bounds(np.asarray(optimum.theta), raw, corrected, tuple(one.memory for one in told))


def table(made: Bounds, priors: Sequence[Prior]) -> list[Row]:
    """The table of estimates (table 7.1-2 of the report): parameter, estimate, raw and corrected standard error.

    A parameter whose working coordinate is its logarithm has its standard errors by the delta method. The sensitivities
    of an unstable flight may grow beyond all digits: standard errors below the rounding of the estimate are not known.
    """
    (estimates, raw), (_, corrected) = (values_and_sds(priors, made.theta, c) for c in (made.raw, made.corrected))
    raw, corrected = (np.where(sd > ROUNDING * np.abs(estimates), sd, np.nan) for sd in (raw, corrected))
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
    theta = made.theta + z @ made.corrected_factor.T
    xi = np.einsum("pq,cdq->cdp", np.linalg.inv(scale), theta - centre)
    density: Array = -0.5 * np.einsum("cdp,cdp->cd", z, z)
    return Draws(xi, density, notes=("normal draws with the sandwich covariance; no sampler ran",))
