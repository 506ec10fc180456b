"""Rates of the angle of attack and of sideslip of a body in an airflow (report 6.3.3-10, -13), finite everywhere."""

from __future__ import annotations

import math

import jax.numpy as jnp

from bayeschute.core.vectors import Component, Vec3

_LEAST_COSINE = math.cos(math.radians(80.0))  # of the sideslip angle: exact below, finite beyond


def angle_rates(along: Vec3, turning: Vec3) -> tuple[Component, Component]:
    """Rates of alpha = atan2(w, u) and beta = asin(v/V) [rad/s].

    At sideslip of 90 degrees, flow along the body's y axis, alpha is undefined. Beyond 80 degrees the divisor is held,
    so that both rates stay finite and continuous.

    Args:
        along: Unit vector of the velocity relative to the air, body axes.
        turning: Its rate as seen in the body, body axes [1/s].

    Returns:
        The rates of alpha and beta.
    """
    cosine_squared = jnp.maximum(along.x * along.x + along.z * along.z, _LEAST_COSINE**2)
    alpha_rate = (along.x * turning.z - along.z * turning.x) / cosine_squared
    return alpha_rate, turning.y / jnp.sqrt(cosine_squared)
