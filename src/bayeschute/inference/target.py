"""The joint density of parameters, initial state and latent disturbances of one flight.

Unknowns beside the parameters theta (P,) are, per flight, a standard normal start (D,) and standard normal shocks
(T, L) of the latent processes. ``-log density = 1/2 |innovations|^2 + 1/2 |start|^2 + 1/2 |shocks|^2 + const``; the
prior of theta is added where flights are put together.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import jax
import jax.numpy as jnp

from bayeschute.air.vector import Component
from bayeschute.dynamics.integrate import FlightModel, Steps, outputs, step_jacobians, trajectory
from bayeschute.dynamics.kernel import flight as kernel
from bayeschute.inference import latent as processes
from bayeschute.inference.latent import Latent
from bayeschute.inference.noise import Noise, whiten
from bayeschute.inference.record_path import RecordPath
from bayeschute.inference.statespace import Gains, Seen, gains


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class FlightData:
    """A record ready to be fitted.

    Attributes:
        model: The flight's model.
        observed: Data in the order of the model's outputs (T, C).
        present: Which data exist (T, C).
        dt: Sample interval [s].
        start_scale: Prior standard deviations of the initial deviations (D,).
        channel: Channel of every output, by number (C entries).
        latent: Processes of the latent disturbances.
        path: States as the record shows them; None for a model that is begun by a simulation.
    """

    model: FlightModel
    observed: Component
    present: Component
    dt: Component
    start_scale: Component
    channel: tuple[int, ...] = field(metadata={"static": True})
    latent: Latent = field(metadata={"static": True})
    path: RecordPath | None = None

    @property
    def starts(self) -> int:
        """Number of initial deviations."""
        return int(self.start_scale.shape[0])

    @property
    def samples(self) -> int:
        """Number of samples."""
        return int(self.observed.shape[0])

    def still(self) -> Unknowns:
        """Unknowns at their prior means."""
        return Unknowns(jnp.zeros(self.starts), jnp.zeros((self.samples, self.latent.size)))


class Unknowns(NamedTuple):
    """Standard normal unknowns of a flight: start (D, ...) and shocks of the latent processes (T, L, ...)."""

    start: Component
    shocks: Component


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Hyper:
    """Noise parameters, all positive.

    Attributes:
        noise: Residual noise per channel.
        laws: Parameters of every group of latent processes, in the order of `latent.KINDS`.
    """

    noise: Noise
    laws: tuple[Component, ...]

    def outputs(self, data: FlightData) -> Noise:
        """Residual noise per output."""
        return jax.tree.map(lambda a: jnp.asarray(a)[jnp.array(data.channel)], self.noise)

    def dynamics(self, data: FlightData) -> processes.Dynamics:
        """State-space model of the flight's latent processes."""
        return processes.dynamics(data.latent, self.laws, data.dt)


class Course(NamedTuple):
    """What drives a flight beside its parameters: initial deviations (D, ...) and disturbances (T, A, ...)."""

    start: Component
    error: Component


@jax.jit
def course(data: FlightData, hyper: Hyper, unknowns: Unknowns) -> Course:
    """Initial deviations and disturbances of standard unknowns."""
    scale = jnp.reshape(data.start_scale, (-1, *(1,) * (unknowns.start.ndim - 1)))
    return Course(scale * unknowns.start, processes.disturbances(hyper.dynamics(data), unknowns.shocks))


# The simulation is compiled once per batch size: what is built on it is put together outside of compiled functions.
@jax.jit
def jax_states(data: FlightData, theta: jax.Array, driven: Course) -> jax.Array:
    """Simulated states (T, X, ...) by JAX alone, which can differentiate them."""
    return trajectory(data.model, theta, driven.start, driven.error)


def states(data: FlightData, theta: Component, driven: Course) -> jax.Array:
    """Simulated states (T, X, ...), by machine code where `kernel.flight` has it, else by JAX."""
    made = kernel.states(data.model, theta, driven.start, driven.error)
    return jax_states(data, theta, driven) if made is None else made


@jax.jit
def compared(data: FlightData, theta: jax.Array, x: jax.Array) -> jax.Array:
    """Data minus outputs of states (T, C, ...); zero where no datum exists."""
    y = outputs(data.model, x, theta)
    extra = (1,) * (y.ndim - 2)
    observed, present = (jnp.reshape(a, (*a.shape, *extra)) for a in (data.observed, data.present))
    return jnp.where(present, observed - y, 0.0)


def residuals(data: FlightData, theta: Component, driven: Course) -> jax.Array:
    """Data minus simulation (T, C, ...); zero where no datum exists."""
    return compared(data, theta, states(data, theta, driven))


@jax.jit
def _joint(data: FlightData, hyper: Hyper, residual: jax.Array, unknowns: Unknowns) -> jax.Array:
    parts = (whiten(hyper.outputs(data), data.dt, data.present, residual), unknowns.start, unknowns.shocks)
    axes = ((0, 1), (0,), (0, 1))
    return 0.5 * sum((jnp.sum(a**2, axis=ax) for a, ax in zip(parts, axes, strict=True)), jnp.zeros(()))


def cost(data: FlightData, hyper: Hyper, theta: Component, unknowns: Unknowns) -> jax.Array:
    """Minus the joint log density of one flight up to terms in `hyper`, batch axes kept."""
    return _joint(data, hyper, residuals(data, theta, course(data, hyper, unknowns)), unknowns)


class Linear(NamedTuple):
    """A flight linearised at (theta, course): residuals (T, C) there, and the derivatives of all steps."""

    residual: Component
    driven: Course
    steps: Steps


@jax.jit
def _steps(data: FlightData, theta: jax.Array, driven: Course) -> tuple[jax.Array, Steps]:
    return step_jacobians(data.model, theta, driven.start, driven.error)


def linearise(data: FlightData, theta: Component, driven: Course) -> Linear:
    """Residuals and exact derivatives of all steps at (theta, course), made like `states`."""
    made = kernel.steps(data.model, theta, driven.start, driven.error)
    y, steps = _steps(data, theta, driven) if made is None else made
    return Linear(jnp.where(data.present, data.observed - y, 0.0), driven, steps)


def filter_gains(data: FlightData, hyper: Hyper, linear: Linear) -> Gains:
    """Covariance pass of the filter of a linearised flight."""
    return gains(
        linear.steps, data.start_scale, hyper.dynamics(data), hyper.outputs(data), data.dt, jnp.asarray(data.present)
    )


def as_seen(linear: Linear, defects: Component | None = None) -> Seen:
    """The linear model's data and their derivatives, 1 + P columns.

    The first: what the data would be about the undisturbed, linearised flight at theta (residual plus the response to
    start and disturbances that lies in it); then the derivatives of the outputs by theta.

    Args:
        linear: The flight linearised.
        defects: By how much the first state and every step lead beside the path that it is linearised along (T, X);
            None: it is a flight.
    """
    steps, start, error = linear.steps, jnp.asarray(linear.driven.start), jnp.asarray(linear.driven.error)
    rest = (steps.by_now @ error[:-1, :, None] + steps.by_then @ error[1:, :, None])[..., 0]
    known = -jnp.concatenate([(steps.first_start @ start)[None], rest])
    known = known if defects is None else known + defects
    by_theta = jnp.concatenate([steps.first_theta[None], steps.by_theta])
    return Seen(
        jnp.concatenate([linear.residual[..., None], steps.out_theta], axis=2),
        jnp.concatenate([known[..., None], -by_theta], axis=2),
    )
