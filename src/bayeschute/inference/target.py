"""The joint density of parameters, initial states and latent disturbances, as one vector of standardised residuals.

Unknowns are the parameters theta (P,), shared by all flights, and per flight ``u`` (U,): deviations of the initial
state, then knots of the latent disturbances. ``-log density = 1/2 |s|^2 + const`` with s = (innovations of the data, u
under its prior); the prior of theta is added where flights are put together.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import jax
import jax.numpy as jnp

from bayeschute.air.vector import Component
from bayeschute.dynamics.integrate import FlightModel, jacobian, outputs, trajectory
from bayeschute.inference import latent as processes
from bayeschute.inference.latent import Latent
from bayeschute.inference.noise import Noise, log_determinant, whiten


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class FlightData:
    """A record ready to be fitted.

    Attributes:
        model: The flight's model.
        observed: Data in the order of the model's outputs (T, C).
        present: Which data exist (T, C).
        weights: Interpolation weights of the knots (T, K).
        spacing: Distance of the knots [s].
        dt: Sample interval [s].
        start_scale: Prior standard deviations of the initial deviations (D,).
        channel: Channel of every output, by number (C entries).
        group: Entry of `Hyper.latent_sd` for every latent process (A entries).
    """

    model: FlightModel
    observed: Component
    present: Component
    weights: Component
    spacing: Component
    dt: Component
    start_scale: Component
    channel: tuple[int, ...] = field(metadata={"static": True})
    group: tuple[int, ...] = field(metadata={"static": True})

    @property
    def starts(self) -> int:
        """Number of initial deviations."""
        return int(self.start_scale.shape[0])

    @property
    def unknowns(self) -> int:
        """Length of u."""
        return self.starts + int(self.weights.shape[1]) * len(self.group)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Hyper:
    """Noise parameters.

    Attributes:
        noise: Residual noise per channel.
        latent_sd: Standard deviation per group of latent processes (G,).
        latent_time_constant: Their e-folding times (G,) [s].
    """

    noise: Noise
    latent_sd: Component
    latent_time_constant: Component

    def outputs(self, data: FlightData) -> Noise:
        """Residual noise per output."""
        return jax.tree.map(lambda a: jnp.asarray(a)[jnp.array(data.channel)], self.noise)

    def latent(self, data: FlightData) -> Latent:
        """Every latent process."""
        group = jnp.array(data.group)
        return Latent(jnp.asarray(self.latent_sd)[group], jnp.asarray(self.latent_time_constant)[group])


def split(data: FlightData, u: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Initial deviations (D, ...) and knots (K, A, ...) of `u` (U, ...)."""
    return u[: data.starts], u[data.starts :].reshape(-1, len(data.group), *u.shape[1:])


def sample_error(data: FlightData, knots: jax.Array) -> jax.Array:
    """Latent disturbances at every sample (T, A, ...) from knots (K, A, ...)."""
    return jnp.tensordot(data.weights, knots, axes=1)


def states(data: FlightData, theta: jax.Array, u: jax.Array) -> jax.Array:
    """Simulated states (T, X, ...)."""
    start, knots = split(data, u)
    return trajectory(data.model, theta, start, sample_error(data, knots))


def residuals(data: FlightData, theta: jax.Array, u: jax.Array) -> jax.Array:
    """Data minus simulation (T, C, ...); zero where no datum exists."""
    y = outputs(data.model, states(data, theta, u), theta)
    extra = (1,) * (y.ndim - 2)
    observed, present = (a.reshape(*a.shape, *extra) for a in (data.observed, data.present))
    return jnp.where(present, observed - y, 0.0)


def standardised(data: FlightData, hyper: Hyper, residual: jax.Array, u: jax.Array) -> jax.Array:
    """The vector s (N, ...): innovations, then u under its prior."""
    innovations = whiten(hyper.outputs(data), data.dt, data.present, residual)
    start, knots = split(data, u)
    extra = (1,) * (u.ndim - 1)
    scaled = processes.whiten(hyper.latent(data), data.spacing, knots)
    parts = [innovations, start / data.start_scale.reshape(-1, *extra), scaled]
    lead = u.shape[1:]
    return jnp.concatenate([p.reshape(-1, *lead) for p in parts])


def log_normaliser(data: FlightData, hyper: Hyper) -> jax.Array:
    """What `1/2 |s|^2` leaves out of minus the log density of data and u, up to constants of u's prior."""
    knots = int(data.weights.shape[1])
    prior = jnp.sum(jnp.log(data.start_scale)) + processes.log_determinant(hyper.latent(data), data.spacing, knots)
    return log_determinant(hyper.outputs(data), data.dt, data.present) + prior


class Linear(NamedTuple):
    """A flight linearised at (theta, u): residuals (T, C), their derivatives by (theta, u) (T, C, P + U), and u."""

    residual: jax.Array
    derivative: jax.Array
    u: jax.Array


@jax.jit
def linearise(data: FlightData, theta: jax.Array, u: jax.Array) -> Linear:
    """Residuals and exact derivatives at (theta, u)."""
    start, knots = split(data, u)
    y, by = jacobian(data.model, theta, start, sample_error(data, knots), data.weights)
    residual = jnp.where(data.present, data.observed - y, 0.0)
    return Linear(residual, jnp.where(data.present[:, :, None], -by, 0.0), u)


def standardised_linear(data: FlightData, hyper: Hyper, linear: Linear) -> tuple[jax.Array, jax.Array]:
    """Standardised residuals s (N,) and their derivatives (N, P + U) of a linearised flight."""
    s = standardised(data, hyper, linear.residual, linear.u)
    parameters = linear.derivative.shape[2] - linear.u.shape[0]
    unit = jnp.concatenate([jnp.zeros((linear.u.shape[0], parameters)), jnp.eye(linear.u.shape[0])], axis=1)
    return s, standardised(data, hyper, linear.derivative, unit)


@jax.jit
def cost(data: FlightData, hyper: Hyper, theta: jax.Array, u: jax.Array) -> jax.Array:
    """``1/2 |s|^2`` of one flight, batch axes kept."""
    return 0.5 * jnp.sum(standardised(data, hyper, residuals(data, theta, u), u) ** 2, axis=0)


@jax.jit
def normal_equations(data: FlightData, hyper: Hyper, linear: Linear) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Gauss-Newton matrix (P + U, P + U), gradient (P + U,) and cost of one flight."""
    s, by = standardised_linear(data, hyper, linear)
    return by.T @ by, by.T @ s, 0.5 * s @ s
