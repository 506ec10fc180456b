"""Flyout, maypole and breathing of a cluster of equal canopies (report 6.3.2), forward and inverse.

Closed forms for floats, NumPy or JAX arrays. Masses and weights are those of one canopy unless stated otherwise: `mass`
with its enclosed air, `weight` dry. `q_area` is q S of one canopy [N].
"""

from __future__ import annotations

from math import pi
from typing import NamedTuple

import jax
import jax.numpy as jnp

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


def flyout_period(canopy: Canopy, q_area: Component, normal_slope: Component, cos_trim: Component = 1.0) -> Component:
    """Period of the flyout [s] from the total slope of C_N [1/rad] (6.3.2-8, linearised about a trim angle).

    Args:
        canopy: One canopy.
        q_area: q S [N].
        normal_slope: (C_Nalpha)_tot [1/rad].
        cos_trim: Cosine of the flyout angle about which the canopies move; 1.0 as printed.
    """
    stiffness = q_area * normal_slope - canopy.weight * cos_trim
    return 2.0 * pi * (canopy.mass * canopy.length / stiffness) ** 0.5


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


def maypole_turning(canopy: Canopy, q_area: Component, radius: Component, normal: Component) -> Component:
    """Rate of turn of a maypole [rad/s] from its radius [m] and (C_N)_tot (6.3.2-23)."""
    sine, cosine = _cosine(canopy, radius)
    return ((q_area * normal - canopy.weight * sine) / (canopy.mass * radius * cosine)) ** 0.5


def maypole_q_area(
    canopy: Canopy, axial: Component, radius: Component, turning: Component, total_weight: Component, count: int = 2
) -> Component:
    """Load q S [N] of one canopy at which a maypole carries the weight (6.3.2-25 with 6.3.2-21)."""
    sine, cosine = _cosine(canopy, radius)
    lift = maypole_normal_force(canopy, radius, turning) * sine
    return (total_weight / count - lift) / (axial * cosine)


def maypole_balance(
    canopy: Canopy, q_area: Component, axial: Component, radius: Component, total_weight: Component, count: int = 2
) -> Component:
    """(C_N)_tot of a maypole from its radius [m] and q S [N], by the balance of weight (6.3.2-26)."""
    sine, cosine = _cosine(canopy, radius)
    return (total_weight - count * q_area * axial * cosine) / (count * q_area * sine)


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


def breathing_rate(
    x: jax.Array, cluster: Breathing, stiffness: Component, damping: Component, axial_slope: Component
) -> jax.Array:
    """Rate of eta, eta' and the descent rate w [m/s] (6.3.2-27..29, corrected as in `breathing_axial_slope`).

    Args:
        x: State (3, ...).
        cluster: The cluster.
        stiffness: omega_n^2 [1/s^2].
        damping: d [1/s].
        axial_slope: C_Aeta.
    """
    eta, eta_rate, w = x[0], x[1], x[2]
    drag = (1.0 + axial_slope / cluster.axial * eta) * w * jnp.abs(w) / cluster.speed**2
    return jnp.stack(
        jnp.broadcast_arrays(
            eta_rate, -damping * eta_rate - stiffness * eta, cluster.weight / cluster.mass * (1.0 - drag)
        )
    )
