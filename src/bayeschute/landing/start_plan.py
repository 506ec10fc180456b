"""Initial states of landings: a cluster in steady descent with random lean, turn and tilt."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from bayeschute.core.vectors import Quaternion, Vec3
from bayeschute.dynamics.cluster import Air
from bayeschute.dynamics.initial_state import Start, initial_state
from bayeschute.landing.landing_model import LandingFlight

Array = NDArray[np.float64]
Spread = tuple[float, float]
"""Mean and standard deviation."""
SIZE = 16
"""Standard normal numbers of one start."""


@dataclass(frozen=True)
class StartPlan:
    """What starts are drawn from: pairs are means and standard deviations.

    Attributes:
        altitude: Of the capsule [m].
        swing: Angle of the cluster off the vertical, to any side unless `azimuth` is given [rad].
        azimuth: Of that lean from north [rad]; None: any.
        swing_rate: Rate of that angle [rad/s].
        cone_rate: Rate across it [rad/s].
        flyout: Angle of each riser off the cluster's axis [rad].
        turn_rate: Of the canopies about the cluster's axis [rad/s].
        tilt: Of the capsule off the cluster's axis, about both its lateral axes: standard deviation [rad].
        body_rate: Of the capsule about each axis: standard deviation [rad/s].
        speed: Through the air over the steady speed of the draw [1]; 1 is a steady descent.
        horizontal: Velocity over that of the wind, to the side of `azimuth` or any [m/s]: what a release leaves.
    """

    altitude: Spread
    swing: Spread = (0.0, 0.0)
    azimuth: float | None = None
    swing_rate: Spread = (0.0, 0.0)
    cone_rate: Spread = (0.0, 0.0)
    flyout: Spread = (0.15, 0.0)
    turn_rate: Spread = (0.0, 0.0)
    tilt: float = 0.0
    body_rate: float = 0.0
    speed: Spread = (1.0, 0.0)
    horizontal: Spread = (0.0, 0.0)

    def altitudes(self, u: Array) -> Array:
        """Altitudes of starts (SIZE, B) [m]."""
        return self.altitude[0] + self.altitude[1] * u[0]

    def highest(self) -> float:
        """Altitude above which next to no start lies [m]."""
        return self.altitude[0] + 6.0 * self.altitude[1]


def begin(plan: StartPlan, model: LandingFlight, theta: Array, u: Array, wind: Array) -> Array:
    """States at the start.

    Args:
        plan: What they are drawn from.
        model: The cluster.
        theta: Parameters (P, B), working coordinates.
        u: Standard normal numbers (SIZE, B).
        wind: At the start (3, B), NED [m/s].

    Returns:
        (X, B), risers at the stretch that starts no transient of theirs.
    """
    n, count = model.structure.canopies, u.shape[1]

    def drawn(of: Spread, i: int) -> Array:
        return of[0] + of[1] * u[i]

    swing = drawn(plan.swing, 1)
    azimuth = np.full(count, plan.azimuth) if plan.azimuth is not None else 2.0 * np.pi * ndtr(u[2])
    c, s = np.cos(azimuth), np.sin(azimuth)
    level = np.stack([c, s, 0.0 * c])
    aside = np.stack([-s, c, 0.0 * c])
    down = np.array([0.0, 0.0, 1.0])[:, None]
    axis = np.sin(swing) * level - np.cos(swing) * down
    lean = np.cos(swing) * level + np.sin(swing) * down
    first = 2.0 * np.pi * ndtr(u[5])
    turns = first + 2.0 * np.pi * np.arange(n)[:, None] / n
    outward = np.cos(turns) * lean[:, None] + np.sin(turns) * aside[:, None]
    around = np.cos(turns) * aside[:, None] - np.sin(turns) * lean[:, None]
    flyout = np.abs(drawn(plan.flyout, 6)) if n > 1 else np.zeros(count)
    direction = np.cos(flyout) * axis[:, None] + np.sin(flyout) * outward
    moving = lean * drawn(plan.swing_rate, 3) + aside * drawn(plan.cone_rate, 4)
    turning = moving[:, None] + np.sin(flyout) * drawn(plan.turn_rate, 7) * around
    turning -= direction * (direction * turning).sum(axis=0)
    place = np.stack([np.zeros(count), np.zeros(count), -plan.altitudes(u)])
    speed = drawn(plan.speed, 8) * np.asarray(steady_speed(model, theta, place))
    velocity = wind + speed * down + drawn(plan.horizontal, 9) * level
    attitude = _turned(_upright(axis), 2.0 * np.pi * ndtr(u[10]), plan.tilt * u[11:13])
    start = Start(place.T, velocity.T, attitude.T, plan.body_rate * u[13:16].T, np.moveaxis(direction, 2, 0),
                  np.moveaxis(turning, 2, 0))  # fmt: skip
    return np.asarray(_placed(model, theta.T, start, wind.T)).T


@jax.jit
def steady_speed(model: LandingFlight, theta: jax.Array, place: jax.Array) -> jax.Array:
    """Speed of a steady vertical descent by the weight and the axial force along the axis (B,) [m/s]."""
    numbers, n = model.numbers(theta), model.structure.canopies
    weight = (numbers.capsule.mass + n * numbers.canopies.dry_mass) * model.base.gravity
    axial = jnp.maximum(jnp.mean(jnp.atleast_2d(numbers.axial[0]), axis=0), 0.1)
    drag = n * numbers.canopies.area * axial
    return jnp.sqrt(2.0 * weight / (model.density_at(-place[2]) * drag)) + jnp.zeros(place.shape[1])


@jax.jit
def _placed(model: LandingFlight, theta: jax.Array, start: Start, wind: jax.Array) -> jax.Array:
    """States (B, X) of starts (B, ...)."""

    def one(theta: jax.Array, start: Start, wind: jax.Array) -> jax.Array:
        n = model.structure.canopies
        zero, density = jnp.zeros(()), model.density_at(-start.position[2])
        still = Vec3(zero, zero, zero)
        air = Air(Vec3(wind[0], wind[1], wind[2]), still, density, jnp.ones(n), still)
        held = jnp.zeros((2, 3, n)), jnp.zeros(9 + 4 * n)
        return initial_state(start, *held, model.numbers(theta), model.structure, air)

    return jax.vmap(one)(theta, start, wind)


def _upright(axis: Array) -> Quaternion:
    """Attitudes (B), NED to body, with the body's x axis along axes (3, B), by the shortest turn from upright."""
    w, x, y = 1.0 - axis[2], axis[1], -axis[0]  # 1 + up . axis, up x axis
    return Quaternion(w - y, x, w + y, x).normalised()  # after the quarter turn that lifts body x


def _turned(q: Quaternion, roll: Array, tilt: Array) -> Array:
    """Quaternions (4, B) of attitudes followed by a roll about body x and small tilts (2, B) about y and z [rad]."""
    rolled = q.times(Quaternion(np.cos(0.5 * roll), np.sin(0.5 * roll), 0.0, 0.0))
    return np.asarray(rolled.times(Quaternion(1.0, 0.0, 0.5 * tilt[0], 0.5 * tilt[1])).normalised().stack())
