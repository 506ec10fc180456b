"""The linear pendulum and its pivot point (report 6.3.1-17..33), forward and inverse; floats, NumPy or JAX arrays.

The axial force carries the weight, so that n q S = W_tot/C_A, and angles are deviations from the trimmed descent.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from bayeschute.air.vector import Component
from bayeschute.dynamics.dumbbell import Dumbbell

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(48)


class Pendulum(NamedTuple):
    """What the linear pendulum needs of a dumbbell.

    Attributes:
        weight: W_tot, of capsule and dry canopies [N].
        canopy_weight: W_C, of all dry canopies [N].
        canopy_mass: m_C, of all canopies with enclosed air [kg].
        length: L [m].
        gravity: [m/s^2].
        axial: C_A at trim.
    """

    weight: Component
    canopy_weight: Component
    canopy_mass: Component
    length: Component
    gravity: Component
    axial: Component

    @property
    def inertia(self) -> Component:
        """m_C L [kg m]."""
        return self.canopy_mass * self.length

    @property
    def air_weight(self) -> Component:
        """m_C g - W_C, what the enclosed air would weigh [N]."""
        return self.canopy_mass * self.gravity - self.canopy_weight

    @property
    def force(self) -> Component:
        """Load n q S = W_tot/C_A [N]."""
        return self.weight / self.axial


def pendulum(model: Dumbbell, density: Component, axial: Component) -> Pendulum:
    """The pendulum of a dumbbell in air of a density [kg/m^3], with C_A at trim."""
    return Pendulum(
        model.weight(), model.canopy_weight(), model.canopy_mass(density), model.length, model.gravity, axial
    )


def natural_frequency(p: Pendulum, normal_slope: Component) -> Component:
    """omega_n [rad/s] from C_Nalpha [1/rad] (6.3.1-24)."""
    return ((p.air_weight + p.force * normal_slope) / p.inertia) ** 0.5


def normal_slope(p: Pendulum, omega_n: Component) -> Component:
    """C_Nalpha [1/rad] from omega_n [rad/s]: 6.3.1-24 inverted."""
    return (omega_n**2 * p.inertia - p.air_weight) / p.force


def pivot_distance(p: Pendulum, normal_slope: Component) -> Component:
    """L_L, from the capsule to the pivot point [m] (6.3.1-33)."""
    share = p.canopy_mass * p.gravity * p.axial / (p.air_weight * p.axial + p.weight * normal_slope)
    return share * p.length


def normal_slope_of_pivot(p: Pendulum, distance: Component) -> Component:
    """C_Nalpha [1/rad] from L_L [m]: 6.3.1-33 inverted."""
    share = distance / p.length
    return p.axial * (p.canopy_mass * p.gravity / share - p.air_weight) / p.weight


def induced_damping(p: Pendulum, normal_slope: Component, speed: Component) -> Component:
    """C_Nalpha L_C/V [s/rad], what the canopies' own motion adds to the damping (6.3.1-17).

    Its negative is the C_Nalphadot below which the trimmed descent is unstable.
    """
    return normal_slope * (p.length - pivot_distance(p, normal_slope)) / speed


def decay_rate(p: Pendulum, damping: Component) -> Component:
    """Decay rate b [1/s] from the total damping (C_Nalphadot)_tot [s/rad] (6.3.1-23); negative: the swing grows."""
    return p.force * damping / (2.0 * p.inertia)


def total_damping(p: Pendulum, decay: Component) -> Component:
    """(C_Nalphadot)_tot [s/rad] from b [1/s]: 6.3.1-23 inverted."""
    return 2.0 * p.inertia * decay / p.force


def damped_frequency(omega_n: Component, decay: Component) -> Component:
    """omega_d [rad/s] of an underdamped swing (6.3.1-26)."""
    return (omega_n**2 - decay**2) ** 0.5


def undamped_frequency(omega_d: Component, decay: Component) -> Component:
    """omega_n [rad/s] from what is observed: 6.3.1-26 inverted."""
    return (omega_d**2 + decay**2) ** 0.5


def decay_of_peaks(first: Component, last: Component, time: Component) -> Component:
    """Decay rate b [1/s] from two peaks on the same side, `time` [s] apart (6.3.1-25)."""
    return jnp.log(first / last) / time


def swing(time: Component, omega_n: Component, decay: Component, angle: Component, rate: Component = 0.0) -> Component:
    """Theta(t) [rad] (6.3.1-25..28), continued to critical and overdamped motion.

    Args:
        time: [s].
        omega_n: Natural frequency [rad/s].
        decay: b [1/s].
        angle: Theta at time zero [rad].
        rate: Its rate at time zero [rad/s].
    """
    square = omega_n**2 - decay**2
    size = jnp.sqrt(jnp.maximum(jnp.abs(square), 1e-30)) * time
    near = jnp.abs(square) * time**2 < 1e-8
    cosine = jnp.where(near, 1.0 - square * time**2 / 2.0, jnp.where(square > 0.0, jnp.cos(size), jnp.cosh(size)))
    quotient = jnp.where(square > 0.0, jnp.sin(size), jnp.sinh(size)) / jnp.where(near, 1.0, size)
    sine = time * jnp.where(near, 1.0 - square * time**2 / 6.0, quotient)
    return jnp.exp(-decay * time) * (angle * cosine + (rate + decay * angle) * sine)


def large_period(p: Pendulum, normal_slope: Component, amplitude: Component) -> jax.Array:
    """Period [s] of the undamped 6.3.1-20 at any amplitude [rad] below pi, by its energy integral.

    With C_Nalpha = 0 it is 4 K(sin(amplitude/2)) sqrt(m_C L/(m_C g - W_C)).
    """
    a = jnp.asarray(amplitude)[..., None]
    phase = jnp.pi / 4.0 * (_NODES + 1.0)
    angle = a * jnp.sin(phase)
    # cos(angle) - cos(a), a^2 - angle^2: products keep both exact near the turning point.
    gravity = 2.0 * jnp.sin(0.5 * (a + angle)) * jnp.sin(0.5 * (a - angle))
    spring = 0.5 * (a - angle) * (a + angle)
    air_weight, force = (jnp.asarray(v)[..., None] for v in (p.air_weight, p.force * normal_slope))
    speed = jnp.sqrt(2.0 * (air_weight * gravity + force * spring) / jnp.asarray(p.inertia)[..., None])
    return 4.0 * jnp.sum(jnp.pi / 4.0 * _WEIGHTS * a * jnp.cos(phase) / speed, axis=-1)
