"""Airflow of a canopy as vectors, without the singular axis of the report's angles (6.1-1..13, 6.3.3-8)."""

from __future__ import annotations

from dataclasses import dataclass, field

import jax

from bayeschute.core.array_library import library_of
from bayeschute.core.vectors import Component, Vec3, dot, norm, perpendicular


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class CanopyFlow:
    """Explanatory variables of the aerodynamic terms of canopies; arrays (canopy, ...).

    Attributes:
        axis: Canopy axis x, from the canopy to its attach point (6.3.3-8a), NED components.
        e: Transverse part of the wind direction, V_perp/|V|: length sin(alpha_T), along k.
        rate: Transverse rate of the wind direction relative to the riser, times l/(2|V|).
        alpha_squared: Total angle of attack, squared [rad^2]; smooth through zero.
        cos_alpha: Cosine of the total angle of attack.
        q: Dynamic pressure [Pa].
        q_ratio: Dynamic pressure over that at the reference speed in sea-level air.
        speed_ratio: |V|/V_o - 1.
        neighbours: The other canopies, one entry each.
        saturation: Total angle of attack at which its powers in terms level off [rad]; None: nowhere.
    """

    axis: Vec3
    e: Vec3
    rate: Vec3
    alpha_squared: Component
    cos_alpha: Component
    q: Component
    q_ratio: Component
    speed_ratio: Component
    neighbours: tuple[Neighbour, ...]
    saturation: float | None = field(default=None, metadata={"static": True})


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Neighbour:
    """One other canopy as seen by each canopy (6.1-10..13).

    Attributes:
        away: Unit vector from the other canopy to this one, its part across the canopy axis (P c).
        distance: D_prox, the distance over the reference length (6.1-11).
        closing: V_prox, the rate of D_prox [1/s] (6.1-12).
    """

    away: Vec3
    distance: Component
    closing: Component


def squared_angle(sin_squared: Component, cosine: Component) -> Component:
    """Angle squared from its sine squared and cosine, smooth through zero [rad^2]."""
    library, small = library_of(sin_squared, cosine), sin_squared < 1e-8
    sine = library.sqrt(library.where(small, 1e-8, sin_squared))  # at 180 deg: true to 1e-4 rad, gradient finite
    near_zero = sin_squared * (1.0 + sin_squared / 3.0)
    return library.where(small & (cosine > 0.0), near_zero, library.arctan2(sine, cosine) ** 2)


def axis_rate(n: Vec3, v_across: Vec3, length: Component) -> Vec3:
    """Rate of the canopy axis x = -n [1/s] from the relative velocity of canopy and attach point."""
    return -perpendicular(v_across, n) / length


def riser_rate(axis: Vec3, x_dot: Vec3, cos_alpha: Component) -> Vec3:
    """Pivot-point rate ``-cos(alpha_T) x_dot`` [1/s], perpendicular to the axis."""
    return -perpendicular(x_dot, axis) * cos_alpha


def wind_direction_rate(w: Vec3, air_acceleration: Vec3, speed: Component) -> Vec3:
    """Rate of the unit vector of the relative wind, ``(I - w w^T)(a - dW/dt)/|V|`` [1/s]."""
    return perpendicular(air_acceleration, w) / speed


def neighbours(
    position: Vec3, velocity: Vec3, axis: Vec3, reference_length: Component, n: int
) -> tuple[Neighbour, ...]:
    """Every other canopy of each canopy; the canopies lie on the leading axis of each component.

    Args:
        position: Canopy positions (canopy, ...) [m].
        velocity: Canopy velocities (canopy, ...) [m/s].
        axis: Canopy axes, unit.
        reference_length: l [m].
        n: Number of canopies.
    """
    found = []
    for shift in range(1, n):
        apart = position - position.map(lambda c, s=shift: library_of(c).roll(c, s, axis=0))
        opening = velocity - velocity.map(lambda c, s=shift: library_of(c).roll(c, s, axis=0))
        distance = norm(apart, 1e-6)
        away = apart / distance
        found.append(
            Neighbour(perpendicular(away, axis), distance / reference_length, dot(away, opening) / reference_length)
        )
    return tuple(found)
