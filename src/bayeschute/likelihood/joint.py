"""Joint density of the parameters, initial state and latent disturbances of one flight.

Besides the parameters theta (P,), the unknowns of a flight are its standardised initial deviations (`start`, (D,)) and
the standard normal white noise that drives the latent processes (`process_noise`, (T, L)):
``-log density = 1/2 |innovations|^2 + 1/2 |start|^2 + 1/2 |process noise|^2 + const``. The prior of theta is added
where flights are combined.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from bayeschute.compiler import compiled_model as kernel
from bayeschute.compiler import integrate
from bayeschute.compiler.integrate import FlightModel, Reached, Steps, outputs, trajectory
from bayeschute.core.array_library import library_of
from bayeschute.core.vectors import Component
from bayeschute.likelihood import disturbances as processes
from bayeschute.likelihood.disturbances import Latent
from bayeschute.likelihood.kalman import Gains, Seen, gains
from bayeschute.likelihood.noise import Noise, of_outputs, whiten
from bayeschute.likelihood.record_path import RecordPath


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

    def own(self, theta: Component) -> tuple[FlightData, Component, NDArray[np.intp]]:
        """The record with a model of the parameters (P, ...) that it has alone, these (K, ...), and their numbers (K,).

        Many flights fitted together have errors of their own, each of which moves one: none has to be asked of others.
        """
        model: Any = self.model
        if hasattr(model, "with_own_parameters"):
            alone, numbers = model.with_own_parameters()
            if alone is not model:
                rows = np.array(numbers, int)
                return replace(self, model=alone), theta[rows], rows
        return self, theta, np.arange(np.shape(theta)[0])

    def in_small_steps(self) -> FlightData:
        """The same record with a model in classical steps, which are shorter: for paths that jolt its risers."""
        model: Any = self.model
        return replace(self, model=replace(model, stepping=model.stepping.in_classical_steps()))

    def without_model(self) -> FlightData:
        """The record alone: what needs no model is compiled once for flights of any terms."""
        return replace(self, model=cast(FlightModel, None))

    def still(self) -> Unknowns:
        """Unknowns at their prior means."""
        return Unknowns(np.zeros(self.starts), np.zeros((self.samples, self.latent.size)))


class Unknowns(NamedTuple):
    """Standard normal unknowns of a flight: initial deviations (D, ...) and process noise (T, L, ...)."""

    start: Component
    process_noise: Component


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class NoiseParameters:
    """Noise hyperparameters, all positive.

    Attributes:
        noise: Measurement noise per channel.
        disturbance_parameters: Hyperparameters of every group of latent processes, in the order of `latent.KINDS`.
    """

    noise: Noise
    disturbance_parameters: tuple[Component, ...]

    def outputs(self, data: FlightData) -> Noise:
        """Measurement noise per output."""
        return of_outputs(self.noise, data.channel)

    def dynamics(self, data: FlightData) -> processes.Dynamics:
        """State-space model of the flight's latent processes."""
        return processes.dynamics(data.latent, self.disturbance_parameters, data.dt)

    def with_deviations(self, change: Callable[..., Component], *others: NoiseParameters) -> NoiseParameters:
        """The same with other standard deviations; time constants, frequencies and damping ratios stay.

        Args:
            change: From the standard deviations here, and those of the others in the same places, to the new ones.
            others: Noise parameters of the same form.
        """
        several = self, *others
        white = change(*(np.asarray(one.noise.white) for one in several))
        correlated = change(*(np.asarray(one.noise.correlated) for one in several))
        groups = tuple(
            np.concatenate([change(*(np.asarray(one, float)[:1] for one in group)), np.asarray(group[0], float)[1:]])
            for group in zip(*(one.disturbance_parameters for one in several), strict=True)
        )
        noise = replace(self.noise, white=white, correlated=correlated)
        return replace(self, noise=noise, disturbance_parameters=groups)


class LatentPath(NamedTuple):
    """Latent path: initial deviations and disturbances of a flight, and the trajectory about which it is linearised.

    The simulation of an unstable flight diverges from every trajectory that is not exact to the last digit. A flight
    with a record is therefore evaluated along a trajectory, step by step, as in multiple shooting.

    Attributes:
        start: Initial deviations (D, ...).
        error: Disturbances (T, A, ...).
        path: States (T, X, ...), which need not obey the equations of motion; None: those of the simulation.
    """

    start: Component
    error: Component
    path: Any = None


class Lifted(NamedTuple):
    """Unknowns of a flight together with its trajectory ("lifted" by the states as in multiple shooting).

    Attributes:
        unknowns: Standardised initial deviations and process noise.
        error: Disturbances from this process noise (T, A); before the first step under other noise parameters, those
            under the previous ones.
        path: States (T, X).
    """

    unknowns: Unknowns
    error: Component
    path: Component

    def latent_path(self, data: FlightData, trailing: int = 0) -> LatentPath:
        """The latent path, in physical units; arrays may have trailing axes."""
        scale = data.start_scale.reshape(-1, *(1,) * trailing)
        return LatentPath(scale * self.unknowns.start, self.error, self.path)


def latent_path_of(data: FlightData, hyper: NoiseParameters, unknowns: Unknowns) -> LatentPath:
    """Initial deviations and disturbances of standard unknowns."""
    scale = np.reshape(data.start_scale, (-1, *(1,) * (np.ndim(unknowns.start) - 1)))
    return LatentPath(scale * unknowns.start, processes.disturbances(hyper.dynamics(data), unknowns.process_noise))


# The simulation is compiled once per batch size: what is built on it is put together outside of compiled functions.
@jax.jit
def jax_states(
    data: FlightData, theta: jax.Array, latent_path: LatentPath, known: jax.Array | None = None
) -> jax.Array:
    """Simulated states (T, X, ...) by JAX alone, which can differentiate them."""
    return trajectory(data.model, theta, latent_path.start, latent_path.error, known)


def states(data: FlightData, theta: Component, latent_path: LatentPath, known: Component | None = None) -> Component:
    """Simulated states (T, X, ...), by machine code where `kernel.flight` has it, else by JAX.

    Args:
        data: The flight.
        theta: Parameters (P, ...).
        latent_path: Initial deviations and disturbances; its path is not used.
        known: States at the first samples (K, X, ...), from which the simulation continues.
    """
    data, theta, _ = data.own(theta)
    made = kernel.states(data.model, theta, latent_path.start, latent_path.error, known)
    return jax_states(data, theta, latent_path, known) if made is None else made


def moved(data: FlightData, path: Component, by: Component, theta: Component, change: Component) -> jax.Array:
    """A trajectory moved by a change of its states; a model with `retract` keeps stiff modes in balance.

    Args:
        data: The flight.
        path: States (T, X, ...).
        by: Their change.
        theta: Parameters there (P, ...).
        change: That of the parameters (P, ...), zero where they are held.
    """
    change = data.own(change)[1]
    data, theta, _ = data.own(theta)
    model: Any = data.model
    return model.retract(path, by, theta, change) if hasattr(model, "retract") else path + by


@jax.jit
def jax_stepped(data: FlightData, theta: jax.Array, latent_path: LatentPath) -> tuple[jax.Array, jax.Array]:
    """`stepped` by JAX alone, which can differentiate it."""
    made = integrate.reached(data.model, theta, latent_path.start, latent_path.error, latent_path.path)
    return compared(data, theta, latent_path.path), _defects(made, latent_path.path)


def _defects(made: Reached, path: Component) -> Component:
    """Continuity defects of the first state and all steps (T, X, ...)."""
    return library_of(made, path).concatenate([made.first[None], made.steps]) - path


def stepped(data: FlightData, theta: Component, latent_path: LatentPath) -> tuple[Component, Component]:
    """Residuals (T, C, ...) along a trajectory, and the continuity defects of its first state and all steps.

    Args:
        data: The flight.
        theta: Parameters (P, ...).
        latent_path: Initial deviations, disturbances, and the trajectory.

    Returns:
        The residuals, zero where no datum exists, and the defects (T, X, ...).
    """
    data, theta, _ = data.own(theta)
    made = kernel.reached(data.model, theta, latent_path.start, latent_path.error, latent_path.path)
    if made is None:
        return jax_stepped(data, theta, latent_path)
    return compared(data, theta, latent_path.path), _defects(made, latent_path.path)


_jax_outputs = jax.jit(outputs)


def compared(data: FlightData, theta: Component, x: Component) -> Component:
    """Data minus outputs of states (T, C, ...); zero where no datum exists."""
    return _less_outputs(data, outputs_of(data, theta, x))


def outputs_of(data: FlightData, theta: Component, x: Component) -> Component:
    """Outputs (T, C, ...) of states (T, X, ...), made like `states`."""
    data, theta, _ = data.own(theta)
    y = kernel.outputs(data.model, theta, x)
    return _jax_outputs(data.model, x, theta) if y is None else y


def _less_outputs(data: FlightData, y: Component) -> Component:
    """Data minus outputs (T, C, ...); zero where no datum exists."""
    library, extra = library_of(data, y), (1,) * (y.ndim - 2)
    observed, present = (library.reshape(a, (*a.shape, *extra)) for a in (data.observed, data.present))
    return library.where(present, observed - y, 0.0)


def residuals(data: FlightData, theta: Component, latent_path: LatentPath) -> jax.Array:
    """Data minus simulation (T, C, ...); zero where no datum exists."""
    return compared(data, theta, states(data, theta, latent_path))


@jax.jit
def _joint(data: FlightData, hyper: NoiseParameters, residual: jax.Array, unknowns: Unknowns) -> jax.Array:
    parts = (whiten(hyper.outputs(data), data.dt, data.present, residual), unknowns.start, unknowns.process_noise)
    axes = ((0, 1), (0,), (0, 1))
    return 0.5 * sum((jnp.sum(a**2, axis=ax) for a, ax in zip(parts, axes, strict=True)), jnp.zeros(()))


def cost(data: FlightData, hyper: NoiseParameters, theta: Component, unknowns: Unknowns) -> jax.Array:
    """Minus the joint log density of one flight up to terms in `hyper`, batch axes kept."""
    return _joint(data, hyper, residuals(data, theta, latent_path_of(data, hyper, unknowns)), unknowns)


class Linear(NamedTuple):
    """A flight linearised at (theta, latent path), along the trajectory.

    Attributes:
        residual: Data minus outputs, zero where no datum exists (T, C).
        defects: Continuity defects of the first state and every step: end of the step minus the next state (T, X).
        latent_path: The latent path.
        steps: Derivatives of all steps and outputs.
        parameters: Numbers of the parameters by which there are derivatives, K of all P (K,).
    """

    residual: Component
    defects: Component
    latent_path: LatentPath
    steps: Steps
    parameters: Component

    def without_theta(self) -> Linear:
        """The same without derivatives by theta, K = 0: cheaper for fixed parameters."""
        none = {name: getattr(self.steps, name)[..., :0] for name in _BY_PARAMETERS}
        return self._replace(steps=self.steps._replace(**none), parameters=self.parameters[:0])


_BY_PARAMETERS = ("first_theta", "by_theta", "out_theta")
"""Fields of `Steps` whose last axis is the parameters."""


@jax.jit
def _along_by_jax(data: FlightData, theta: jax.Array, latent_path: LatentPath) -> tuple[jax.Array, Reached, Steps]:
    return integrate.along_path(data.model, theta, latent_path.start, latent_path.error, latent_path.path)


def linearise(data: FlightData, theta: Component, latent_path: LatentPath, by_theta: bool = True) -> Linear:
    """Residuals, defects and exact derivatives of all steps, made like `states`.

    Args:
        data: The record.
        theta: Parameters (P,).
        latent_path: Where.
        by_theta: Whether derivatives by the parameters are wanted: cheaper without, K = 0.

    Returns:
        The flight, with derivatives by the K parameters that its model has (`FlightData.own`).
    """
    data, theta, parameters = data.own(theta)
    if latent_path.path is None:
        latent_path = latent_path._replace(path=states(data, theta, latent_path))
    made = kernel.along_path(data.model, theta, latent_path.start, latent_path.error, latent_path.path, by_theta)
    y, reached, steps = _along_by_jax(data, theta, latent_path) if made is None else made
    found = Linear(_less_outputs(data, y), _defects(reached, latent_path.path), latent_path, steps, parameters)
    return found if by_theta else found.without_theta()


def filter_gains(data: FlightData, hyper: NoiseParameters, linear: Linear, slack: Component | None = None) -> Gains:
    """Covariance pass of the filter of a linearised flight.

    Args:
        data: The record.
        hyper: Noise parameters.
        linear: The flight linearised.
        slack: Standard deviations of the states' defects (X,); None: none are left.
    """
    steps, latent, noise = linear.without_theta().steps, hyper.dynamics(data), hyper.outputs(data)
    return gains(steps, data.start_scale, latent, noise, data.dt, data.present, slack)


def as_seen(linear: Linear) -> Seen:
    """The linear model's data and their derivatives, 1 + K columns.

    The first: the data relative to the undisturbed, linearised flight at theta (residuals plus the contribution of
    start and disturbances to the trajectory); then the derivatives of the outputs by theta.
    """
    steps, library = linear.steps, library_of(linear)
    known = linear.defects - disturbed(steps, linear.latent_path)
    by_theta = library.concatenate([steps.first_theta[None], steps.by_theta])
    return Seen(
        library.concatenate([linear.residual[..., None], steps.out_theta], axis=2),
        library.concatenate([known[..., None], -by_theta], axis=2),
    )


def disturbed(steps: Steps, latent_path: LatentPath) -> Component:
    """Linear contribution of start and disturbances to the first state and to every step (T, X, ...)."""
    library = library_of(steps, latent_path)
    start, error = library.asarray(latent_path.start), library.asarray(latent_path.error)
    wide = error.reshape(*error.shape[:2], -1)
    first = steps.first_start @ start.reshape(len(start), -1)
    made = library.concatenate([first[None], steps.by_now @ wide[:-1] + steps.by_then @ wide[1:]])
    return made.reshape(*made.shape[:2], *start.shape[1:])
