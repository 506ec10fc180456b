"""Simulated motions of the planar dumbbell, in batches, and their features."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayeschute.compiler.integrate import trajectory_compiled
from bayeschute.core.vectors import Component
from bayeschute.dynamics.parameters import Canopies
from bayeschute.reduced.dumbbell import (
    Dumbbell,
    DumbbellFlight,
    DumbbellInputs,
    airflow,
    centre_velocity,
    state_rate,
    with_parameters,
)
from bayeschute.reduced.planar import PlanarAero
from bayeschute.verification.sets import ParameterSet

Array = NDArray[np.float64]

STEP = 0.1  # [s]; the fastest pole of the dumbbell is near 1 1/s
CYCLING = 0.05  # [rad]; below it a swing counts as decayed


class Motion(NamedTuple):
    """Motions of a dumbbell; arrays (T, ...) with the batch axes of what was varied.

    Attributes:
        time: (T,) [s].
        swing: Theta [rad].
        swing_rate: [rad/s].
        alpha: Angle of attack of the canopies [rad].
        alpha_rate: [rad/s]; without the contribution of a changing wind.
        descent_rate: Of the centre of mass [m/s].
        drift: Its horizontal velocity, along the plane [m/s].
    """

    time: Array
    swing: Array
    swing_rate: Array
    alpha: Array
    alpha_rate: Array
    descent_rate: Array
    drift: Array

    def between(self, start: float, end: float = np.inf) -> Motion:
        """The part from `start` to `end` [s]."""
        use = (self.time >= start) & (self.time <= end)
        return Motion(*(values[use] for values in self))


class Cycle(NamedTuple):
    """A steady oscillation: amplitude of the swing [rad], frequency [Hz], mean descent rate [m/s]."""

    amplitude: float
    frequency: float
    descent_rate: float


def dumbbell(numbers: ParameterSet) -> Dumbbell:
    """The dumbbell of a parameter set: its two canopies coincide."""
    canopies = Canopies(
        numbers.area, numbers.reference_length, numbers.reference_speed, numbers.dry_mass, numbers.enclosed_volume
    )
    return Dumbbell(numbers.capsule_mass, numbers.length, canopies, numbers.gravity, 2)


@jax.jit
def _read(
    states: jax.Array, wind: jax.Array, model: Dumbbell, aero: PlanarAero, density: Component
) -> tuple[jax.Array, ...]:
    x = jnp.moveaxis(states, 1, 0)
    u, w = airflow(x, wind, model.length)
    rate = state_rate(x, model, aero, wind, density)
    _, (u_dot, w_dot) = jax.jvp(lambda s: airflow(s, wind, model.length), (x,), (rate,))
    alpha_rate = (u * w_dot - w * u_dot) / (u * u + w * w)
    drift, descent = centre_velocity(x, model, density)
    return jnp.arctan2(w, u), alpha_rate, descent, drift


def fly(
    model: Dumbbell,
    aero: PlanarAero,
    density: float,
    start: ArrayLike,
    duration: float,
    varied: Mapping[str, ArrayLike] | None = None,
    wind: ArrayLike | None = None,
) -> tuple[Motion, Array]:
    """Fly dumbbells, several at once.

    Args:
        model: Masses and sizes.
        aero: Coefficients.
        density: Of the air, constant [kg/m^3].
        start: State at time zero, (6,) or (6, B).
        duration: [s].
        varied: Parameters by name that differ over the batch (B,), SI (`DumbbellFlight.names`).
        wind: Wind along the plane at the samples, (T,) or (T, B) [m/s]; still air if not given.

    Returns:
        The motions, and the states (T, 6, ...).
    """
    begin = np.asarray(start, float)
    samples = int(round(duration / STEP)) + 1
    names = tuple(varied or ())
    gusts = np.zeros(samples) if wind is None else np.asarray(wind, float)
    batch = np.broadcast_shapes(begin.shape[1:], gusts.shape[1:], *(np.shape(v) for v in (varied or {}).values()))
    theta = np.array([np.broadcast_to(v, batch) for v in (varied or {}).values()]).reshape(len(names), *batch)
    flight = DumbbellFlight(
        model, aero, np.zeros(6), DumbbellInputs(np.zeros((samples, 2)), np.full(samples, density)), STEP, names
    )
    widened = np.broadcast_to(begin.reshape(6, *begin.shape[1:], *(1,) * (len(batch) - begin.ndim + 1)), (6, *batch))
    deviation = np.stack([widened[4], widened[5], widened[2], widened[3]])
    level = np.broadcast_to(
        gusts.reshape(samples, *gusts.shape[1:], *(1,) * (len(batch) - gusts.ndim + 1)), (samples, *batch)
    )
    error = np.stack([level, np.zeros_like(level)], axis=1)
    states = trajectory_compiled(flight, theta, deviation, error)
    body, coefficients = with_parameters(model, aero, names, theta)
    read = _read(states, np.moveaxis(error, 1, 0), body, coefficients, density)
    alpha, alpha_rate, descent, drift = (np.asarray(v, dtype=float) for v in read)
    x = np.asarray(states, dtype=float)
    time = np.asarray(np.arange(samples) * STEP, dtype=float)
    return Motion(time, x[:, 4], x[:, 5], alpha, alpha_rate, descent, drift), x


def amplitude(motion: Motion) -> Array:
    """Half the range of the swing [rad] of every motion."""
    return np.asarray(np.ptp(motion.swing, axis=0) / 2.0, dtype=float)


def cycle(motion: Motion) -> Cycle | None:
    """The oscillation of one motion, over its whole cycles; None if the swing has decayed.

    Args:
        motion: One motion, without batch axes, after its transient.
    """
    if amplitude(motion) < CYCLING:
        return None
    middle = motion.swing - (motion.swing.max() + motion.swing.min()) / 2.0
    up = np.flatnonzero((middle[:-1] < 0.0) & (middle[1:] >= 0.0))
    if len(up) < 3:
        return None
    share = -middle[up] / (middle[up + 1] - middle[up])
    crossing = motion.time[up] + share * (motion.time[up + 1] - motion.time[up])
    frequency = (len(up) - 1) / (crossing[-1] - crossing[0])
    grid = np.linspace(crossing[0], crossing[-1], 64 * (len(up) - 1) + 1)
    mean = np.interp(grid[:-1], motion.time, motion.descent_rate).mean()
    return Cycle(float(amplitude(motion)), float(frequency), float(mean))


def ending(motion: Motion, trim: float, window: float = 60.0) -> str:
    """How one motion ends: ``"limit cycle"``, ``"glide"`` or ``"vertical descent"``.

    Args:
        motion: One motion, without batch axes.
        trim: Trim angle of the canopies [rad]; zero for statically stable ones.
        window: Length of the end that is looked at [s].
    """
    last = motion.between(motion.time[-1] - window)
    if amplitude(last) >= CYCLING:
        return "limit cycle"
    return "glide" if trim > 0.0 and abs(last.alpha.mean()) > 0.5 * trim else "vertical descent"
