"""The linear pendulum and its pivot point (report 6.3.1-17..33), forward and inverse; floats, NumPy or JAX arrays.

The axial force carries the weight, so that n q S = W_tot/C_A, and angles are deviations from the trimmed descent.
"""

from __future__ import annotations

from typing import NamedTuple

from bayeschute.core.vectors import Component
from bayeschute.reduced.dumbbell import Dumbbell


class Pendulum(NamedTuple):
    """Parameters of the linear pendulum from a dumbbell.

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
        """m_C g - W_C, weight of the enclosed air [N]."""
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
