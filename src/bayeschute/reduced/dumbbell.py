"""The planar dumbbell: a capsule and n coincident canopies as two particles on a rigid line (report 6.3.1-1..12).

Axes of the plane: `along` (horizontal) and `down`. The swing angle theta is positive when the capsule is ahead of the
canopies, b_1 points from the canopies to the capsule, b_3 the way the canopies move when theta grows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import jax
import jax.numpy as jnp

from bayeschute.compiler.runge_kutta import Stepping, advanced
from bayeschute.core.vectors import Component
from bayeschute.dynamics.parameters import STANDARD_GRAVITY, Canopies
from bayeschute.reduced.planar import PlanarAero

DEVIATIONS = ("swing", "swing_rate", "velocity.along", "velocity.down")
CHANNELS = {"swing_angle": 1, "capsule_velocity": 2, "air_velocity": 2}
_BODY = ("capsule_mass", "length")
_AERO = ("C_A0", "C_Aalpha", "alpha_0", "C_Nalpha", "C_Nalphadot")


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Dumbbell:
    """Two particles on a rigid line.

    Attributes:
        capsule_mass: m_L [kg].
        length: L, from the canopies to the capsule [m].
        canopies: Numbers of one canopy; the enclosed air follows the density.
        gravity: [m/s^2].
        count: Number of coincident canopies (7.1: two becomes n in 6.3.1-8 and -9).
    """

    capsule_mass: Component
    length: Component
    canopies: Canopies
    gravity: Component = STANDARD_GRAVITY
    count: int = field(default=2, metadata={"static": True})

    def canopy_mass(self, density: Component) -> Component:
        """m_C, mass of all canopies with the air they enclose [kg]."""
        return self.count * (self.canopies.dry_mass + density * self.canopies.enclosed_volume)

    def canopy_weight(self) -> Component:
        """W_C, weight of all dry canopies [N]; the enclosed air is borne by the air around."""
        return self.count * self.canopies.dry_mass * self.gravity

    def weight(self) -> Component:
        """W_tot, weight of capsule and dry canopies [N]."""
        return self.capsule_mass * self.gravity + self.canopy_weight()


def axes(swing: Component) -> tuple[tuple[Component, Component], tuple[Component, Component]]:
    """b_1 and b_3 in (along, down)."""
    s, c = jnp.sin(swing), jnp.cos(swing)
    return (s, c), (-c, s)


def airflow(x: jax.Array, wind: Component, length: Component) -> tuple[Component, Component]:
    """Velocity of the canopies through the air along b_1 and b_3 [m/s].

    Args:
        x: State (6, ...).
        wind: Velocity of the air, along and down (2, ...) [m/s].
        length: L [m].
    """
    b1, b3 = axes(x[4])
    along, down = x[2] - wind[0], x[3] - wind[1]
    return along * b1[0] + down * b1[1], along * b3[0] + down * b3[1] + length * x[5]


def state_rate(x: jax.Array, model: Dumbbell, aero: PlanarAero, wind: Component, density: Component) -> jax.Array:
    """Rate of the state: capsule position (along, down), its velocity, theta, theta' (6.3.1-5, -7).

    Args:
        x: State (6, ...); SI. The canopies must move through the air.
        model: Masses and sizes, which broadcast over the batch axes.
        aero: Coefficients.
        wind: Velocity of the air, along and down (2, ...) [m/s].
        density: [kg/m^3].

    Returns:
        dx/dt, same shape.
    """
    m_L, m_C, L, g = model.capsule_mass, model.canopy_mass(density), model.length, model.gravity
    W_C = model.canopy_weight()
    b1, b3 = axes(x[4])
    u, w = airflow(x, wind, L)
    alpha, speed = jnp.arctan2(w, u), jnp.sqrt(u * u + w * w)
    q_area = 0.5 * density * speed * speed * model.count * model.canopies.area
    turning = x[5] if aero.rate == "pivot" else x[5] * u * model.canopies.length / (2.0 * speed * speed)
    A_x = q_area * aero.axial(alpha)
    A_z = -q_area * (aero.normal(alpha) + aero.C_Nalphadot * turning)
    swing_acceleration = -((m_C * g - W_C) * b1[0] - A_z) / (m_C * L)
    mass, R_L = m_C + m_L, L * m_C / (m_C + m_L)
    centre = (-A_x * b1[0] + A_z * b3[0]) / mass, (model.weight() - A_x * b1[1] + A_z * b3[1]) / mass
    a = [centre[i] - R_L * (swing_acceleration * b3[i] + x[5] * x[5] * b1[i]) for i in range(2)]
    return jnp.stack(jnp.broadcast_arrays(x[2], x[3], a[0], a[1], x[5], swing_acceleration))


def centre_velocity(x: jax.Array, model: Dumbbell, density: Component) -> tuple[jax.Array, jax.Array]:
    """Velocity of the centre of mass B*, along and down [m/s], of states (6, ...)."""
    m_C = model.canopy_mass(density)
    arm = model.length * m_C / (m_C + model.capsule_mass) * x[5]
    _, b3 = axes(x[4])
    return x[2] + arm * b3[0], x[3] + arm * b3[1]


def steady_speed(model: Dumbbell, aero: PlanarAero, density: Component) -> Component:
    """Airspeed of the steady descent at the trim angle [m/s]: n q S C_A = W_tot."""
    drag = model.count * density * model.canopies.area * aero.axial(aero.trim())
    return (2.0 * model.weight() / drag) ** 0.5


def steady_descent(model: Dumbbell, aero: PlanarAero, density: Component, side: float = 1.0) -> jax.Array:
    """State of the steady descent in still air: a glide at alpha = side * trim angle, theta = 0.

    Args:
        model: Masses and sizes.
        aero: Coefficients.
        density: [kg/m^3].
        side: 1.0 or -1.0, which of the two glides; 0.0 is the vertical descent at their airspeed, no equilibrium of a
            statically unstable canopy.

    Returns:
        State (6, ...).
    """
    speed, alpha = steady_speed(model, aero, density), side * aero.trim()
    zero = 0.0 * (speed + alpha)
    rows = zero, zero, -speed * jnp.sin(alpha), speed * jnp.cos(alpha), zero, zero
    return jnp.stack(jnp.broadcast_arrays(*rows))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class DumbbellInputs:
    """Inputs of the dumbbell at each sample: wind (T, 2), along and down [m/s]; density (T,) [kg/m^3]."""

    wind: Component
    density: Component


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class DumbbellFlight:
    """One flight of a dumbbell (a `FlightModel`); latent disturbances are errors of the wind, along and down.

    Attributes:
        base: Masses and sizes that are not parameters.
        aero: Coefficients that are not parameters.
        start: State at the first sample, before deviations (6,).
        record: Inputs at the samples.
        dt: Sample interval [s].
        names: Parameters, in the order of theta: fields of `PlanarAero`, ``capsule_mass`` or ``length``.
        channels: Outputs, of `CHANNELS`.
        stepping: How it goes through a sample.
    """

    base: Dumbbell
    aero: PlanarAero
    start: Component
    record: DumbbellInputs
    dt: Component
    names: tuple[str, ...] = field(default=(), metadata={"static": True})
    channels: tuple[str, ...] = field(default=("swing_angle", "air_velocity"), metadata={"static": True})
    stepping: Stepping = field(default=Stepping(2), metadata={"static": True})

    def inputs(self) -> DumbbellInputs:
        """The record's inputs."""
        return self.record

    def numbers(self, theta: jax.Array) -> tuple[Dumbbell, PlanarAero]:
        """Body and coefficients with these parameters."""
        return with_parameters(self.base, self.aero, self.names, theta)

    def initial(self, numbers: Any, start: jax.Array) -> jax.Array:
        """State at the first sample (6, ...); `start` follows `DEVIATIONS`."""
        first = jnp.reshape(jnp.asarray(self.start), (6, *(1,) * (start.ndim - 1)))
        zero = jnp.zeros_like(start[0])
        return first + jnp.stack([zero, zero, start[2], start[3], start[0], start[1]])

    def advance(
        self, x: jax.Array, numbers: Any, now: Any, then: Any, error_now: jax.Array, error_then: jax.Array
    ) -> jax.Array:
        """State one sample later; wind and density are linear between samples."""
        given = numbers, now, then, error_now, error_then
        return advanced(self.stepping, lambda state, share: self.rate(state, *given, share), x, self.dt)

    def rate(
        self, x: jax.Array, numbers: Any, now: Any, then: Any, error_now: Any, error_then: Any, share: Component
    ) -> jax.Array:
        """Rate of the state when this share of the sample has passed."""
        w0, w1 = now.wind + error_now, then.wind + error_then
        density = now.density + (then.density - now.density) * share
        model, aero = numbers
        return state_rate(x, model, aero, w0 + (w1 - w0) * share, density)

    def observe(self, x: jax.Array, numbers: Any, now: Any) -> jax.Array:
        """Outputs of `channels`, in order (C, ...): swing [rad], velocities of the capsule, along and down [m/s]."""
        rows = {"swing_angle": x[4:5], "capsule_velocity": x[2:4], "air_velocity": x[2:4] - now.wind}
        return jnp.concatenate([rows[channel] for channel in self.channels])


def with_parameters(
    base: Dumbbell, aero: PlanarAero, names: Sequence[str], theta: Component
) -> tuple[Dumbbell, PlanarAero]:
    """A dumbbell and its coefficients with some numbers replaced by `theta` (P, ...), SI.

    Raises:
        KeyError: If a name is no parameter of the dumbbell.
    """
    unknown = [name for name in names if name not in _BODY + _AERO]
    if unknown:
        raise KeyError(f"{unknown[0]!r} is no parameter of the dumbbell; known are {', '.join(_AERO + _BODY)}")
    values = {name: theta[i] for i, name in enumerate(names)}
    body = {name: value for name, value in values.items() if name in _BODY}
    return replace(base, **body), replace(aero, **{name: v for name, v in values.items() if name in _AERO})
