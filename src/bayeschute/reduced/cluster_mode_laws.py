"""Flyout, maypole and breathing of a cluster of equal canopies (report 6.3.2): coefficients from what is measured.

Closed forms for floats, NumPy or JAX arrays. Masses and weights are those of one canopy unless stated otherwise: `mass`
with its enclosed air, `weight` dry. `q_area` is q S of one canopy [N].
"""

from __future__ import annotations

from math import pi
from typing import NamedTuple

from bayeschute.core.vectors import Component


class Canopy(NamedTuple):
    """One canopy on its line.

    Attributes:
        mass: m_c, with enclosed air [kg].
        weight: W_c, dry [N].
        length: L, from the capsule [m].
    """

    mass: Component
    weight: Component
    length: Component


def flyout_slope(canopy: Canopy, q_area: Component, period: Component, cos_trim: Component = 1.0) -> Component:
    """(C_Nalpha)_tot [1/rad] from the period of the flyout [s] (6.3.2-9, linearised about a trim angle)."""
    return (4.0 * pi**2 * canopy.mass * canopy.length / period**2 + canopy.weight * cos_trim) / q_area


def _cosine(canopy: Canopy, radius: Component) -> tuple[Component, Component]:
    """Sine and cosine of the flyout angle of a maypole, R = L sin(Phi)."""
    sine = radius / canopy.length
    return sine, (1.0 - sine * sine) ** 0.5


def maypole_normal_force(canopy: Canopy, radius: Component, turning: Component) -> Component:
    """Force q S C_N towards the axis [N] that keeps a canopy on its circle (6.3.2-21)."""
    sine, cosine = _cosine(canopy, radius)
    return canopy.mass * radius * turning**2 * cosine + canopy.weight * sine


def maypole_normal(canopy: Canopy, q_area: Component, radius: Component, turning: Component) -> Component:
    """(C_N)_tot from the radius [m] and the rate of turn [rad/s] of a maypole (6.3.2-22)."""
    return maypole_normal_force(canopy, radius, turning) / q_area


def maypole_q_area(
    canopy: Canopy, axial: Component, radius: Component, turning: Component, total_weight: Component, count: int = 2
) -> Component:
    """Load q S [N] of one canopy at which a maypole carries the weight (6.3.2-25 with 6.3.2-21)."""
    sine, cosine = _cosine(canopy, radius)
    lift = maypole_normal_force(canopy, radius, turning) * sine
    return (total_weight / count - lift) / (axial * cosine)


class Breathing(NamedTuple):
    """A cluster that descends at its terminal speed and breathes; all canopies equal.

    Attributes:
        mass: M, of everything with the enclosed air [kg].
        weight: W_tot, of capsule and dry canopies [N].
        speed: V, terminal speed at C_A0 [m/s].
        axial: C_A0.
    """

    mass: Component
    weight: Component
    speed: Component
    axial: Component


def breathing_axial_slope(cluster: Breathing, amplitude: Component, frequency: Component) -> Component:
    """C_Aeta from the amplitude of the descent rate [m/s] per unit of eta (6.3.2-28, -29, linearised).

    6.3.2-29 is used with drag against the motion and the mass of the enclosed air.
    """
    pull, omega = cluster.weight / cluster.mass, 2.0 * pi * frequency
    decay = 2.0 * pull / cluster.speed
    return amplitude * cluster.axial * (omega**2 + decay**2) ** 0.5 / pull
