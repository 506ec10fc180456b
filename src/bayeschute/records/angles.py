"""Airflow, proximity and cluster angles of recorded canopies (report 6.1-1..20), in NumPy.

The canopy's x axis points along the riser towards the capsule (6.3.3-8a), so that u = V.x is positive in descent;
section 6.1 points it the other way, hence the different signs of u and w here.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_LEAST_SINE = 1e-6  # below this sine of alpha_T its azimuth has no meaning


class Airflow(NamedTuple):
    """Airflow angles [rad] and their rates [rad/s], all (T, n).

    Attributes:
        beta: Sideslip (6.1-1).
        alpha: Angle of attack (6.1-2).
        alpha_T: Total angle of attack (6.1-3).
        phi_a: Azimuth of the flow about the axis (6.1-4); NaN where alpha_T vanishes.
        beta_rate: (6.1-6).
        alpha_rate: (6.1-7).
        alpha_T_rate: (6.1-8).
        phi_a_rate: (6.1-9), in axes that don't roll about the riser; NaN where alpha_T vanishes.
    """

    beta: Array
    alpha: Array
    alpha_T: Array  # noqa: N815
    phi_a: Array
    beta_rate: Array
    alpha_rate: Array
    alpha_T_rate: Array  # noqa: N815
    phi_a_rate: Array


def dot(a: Array, b: Array) -> Array:
    """Scalar product over the last axis."""
    return np.asarray(np.sum(a * b, axis=-1))


def unit(a: Array) -> Array:
    """Unit vectors over the last axis; NaN where the length is zero."""
    length = np.linalg.norm(a, axis=-1, keepdims=True)
    return np.asarray(a / np.where(length > 0.0, length, np.nan))


def across(a: Array, axis: Array) -> Array:
    """Part of `a` across the unit vector `axis`."""
    return np.asarray(a - dot(a, axis)[..., None] * axis)


def canopy_axes(x: Array) -> tuple[Array, Array]:
    """Axes y and z of canopies whose axis is `x` (T, n, 3): y as far east as it can be.

    Returns:
        y and z, same shape; under a vertical riser y is east and z south.
    """
    y = unit(across(np.broadcast_to([0.0, 1.0, 0.0], x.shape), x))
    return y, np.cross(x, y)


def airflow(velocity: Array, acceleration: Array, x: Array, x_dot: Array) -> Airflow:
    """Airflow angles and rates (6.1-1..9), by arctangents that stay accurate at small angles.

    Args:
        velocity: Velocity relative to the air (T, n, 3), NED [m/s].
        acceleration: Its rate of change [m/s^2].
        x: Canopy axes, unit.
        x_dot: Their rate of change [1/s].

    Returns:
        Angles and rates.
    """
    y, z = canopy_axes(x)
    u, v, w = dot(velocity, x), dot(velocity, y), dot(velocity, z)
    # y and z follow x without rolling: y_dot = -(x_dot . y) x.
    du = dot(acceleration, x) + dot(velocity, x_dot)
    dv = dot(acceleration, y) - dot(x_dot, y) * u
    dw = dot(acceleration, z) - dot(x_dot, z) * u
    squared = u**2 + v**2 + w**2
    s_squared, uw_squared = v**2 + w**2, u**2 + w**2
    s, uw = np.sqrt(s_squared), np.sqrt(uw_squared)
    seen = s > _LEAST_SINE * np.sqrt(squared)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = u * du + v * dv + w * dw
        s_dot = np.where(seen, (v * dv + w * dw) / s, np.hypot(dv, dw))
        return Airflow(
            beta=np.arctan2(v, uw),
            alpha=np.arctan2(w, u),
            alpha_T=np.arctan2(s, u),
            phi_a=np.where(seen, np.arctan2(v, w), np.nan),
            beta_rate=np.where(uw > 0.0, (dv - v * along / squared) / uw, np.nan),
            alpha_rate=np.where(uw > 0.0, (u * dw - w * du) / uw_squared, np.nan),
            alpha_T_rate=(u * s_dot - s * du) / squared,
            phi_a_rate=np.where(seen, (w * dv - v * dw) / s_squared, np.nan),
        )


def wind_axes(velocity: Array, x: Array) -> tuple[Array, Array]:
    """Unit vectors k, along the transverse flow, and j = k x x (6.3.3-8); NaN where alpha_T vanishes."""
    transverse = across(velocity, x)
    seen = np.linalg.norm(transverse, axis=-1) > _LEAST_SINE * np.linalg.norm(velocity, axis=-1)
    k = unit(np.where(seen[..., None], transverse, np.nan))
    return np.cross(k, x), k


class Proximity(NamedTuple):
    """The nearest other canopy of every canopy (6.1-10..13), all (T, n); NaN for a single canopy.

    Attributes:
        distance: D_prox, distance over reference length.
        closing: V_prox, rate of D_prox [1/s].
        angle: phi_prox [rad], from the transverse flow to the direction away from the other canopy, about the axis.
    """

    distance: Array
    closing: Array
    angle: Array


def proximity(position: Array, velocity: Array, air_velocity: Array, x: Array, reference_length: float) -> Proximity:
    """Distance, closing speed and angle of the nearest other canopy (6.1-10..13).

    Args:
        position: Canopies (T, n, 3) [m].
        velocity: Theirs [m/s].
        air_velocity: Velocity relative to the air [m/s].
        x: Canopy axes, unit.
        reference_length: D_o [m].

    Returns:
        Distance, closing speed, angle.
    """
    n = position.shape[1]
    if n == 1:
        nothing = np.full(position.shape[:2], np.nan)
        return Proximity(nothing, nothing, nothing)
    apart = position[:, :, None] - position[:, None]
    length = np.linalg.norm(apart, axis=-1)
    length[:, np.arange(n), np.arange(n)] = np.inf
    nearest = np.argmin(np.where(np.isnan(length), np.inf, length), axis=2)[..., None]
    distance = np.take_along_axis(length, nearest, axis=2)[..., 0]
    distance = np.where(np.isinf(distance), np.nan, distance)
    away = np.take_along_axis(apart, nearest[..., None], axis=2)[:, :, 0]
    opening = np.take_along_axis(velocity[:, :, None] - velocity[:, None], nearest[..., None], axis=2)[:, :, 0]
    j, k = wind_axes(air_velocity, x)
    with np.errstate(divide="ignore", invalid="ignore"):
        closing = dot(away, opening) / distance / reference_length
    return Proximity(distance / reference_length, closing, np.arctan2(dot(away, j), dot(away, k)))


def swing_angle(riser: Array) -> Array:
    """Angle of the mean riser off the vertical (6.1-16..18).

    Args:
        riser: Attach point to canopies (T, n, 3), NED [m].

    Returns:
        (T,) [rad].
    """
    mean = riser.mean(axis=1)
    return np.asarray(np.arctan2(np.hypot(mean[:, 0], mean[:, 1]), np.abs(mean[:, 2])))


def flyout_angle(riser: Array) -> Array:
    """Half the angle between the risers (6.1-19, -20), the mean over all pairs; zero for a single canopy.

    Args:
        riser: Attach point to canopies (T, n, 3) [m].

    Returns:
        (T,) [rad].
    """
    n, direction = riser.shape[1], unit(riser)
    pairs = [(direction[:, i], direction[:, j]) for i in range(n) for j in range(i + 1, n)]
    if not pairs:
        return np.zeros(riser.shape[0])
    half = [0.5 * np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), dot(a, b)) for a, b in pairs]
    return np.asarray(np.mean(half, axis=0))
