"""Prescribed canopy forces that follow from geometry alone, for cases 6, 7, 9 and 10."""

from __future__ import annotations

import jax.numpy as jnp

from bayeschute.aero.airflow import CanopyFlow, axis_rate, squared_angle
from bayeschute.core.vectors import Vec3, dot, norm, perpendicular
from bayeschute.dynamics.cluster import Air, RiserGeometry
from bayeschute.dynamics.parameters import Cluster


def spring(flow: CanopyFlow, geo: RiserGeometry, model: Cluster, air: Air) -> Vec3:
    """Force P (C_A n - C_Na (theta - theta_0) u - C_Nad n_dot), with P, an area times a dynamic pressure, given.

    Here n is the riser's direction, theta its lean off the vertical, u the direction in which theta grows.
    ``axial = (P, C_A)``, ``transverse = (C_Na, theta_0, C_Nad)``: [N], [-]; [1/rad], [rad], [s/rad].
    """
    (load, C_A), (slope, trim, damping) = model.axial, model.transverse
    zero = 0.0 * flow.cos_alpha
    outward = perpendicular(Vec3(zero, zero, zero + 1.0), flow.axis)  # of length sin(theta)
    sine = norm(outward, 1e-12)
    lean = jnp.sqrt(squared_angle(dot(outward, outward), flow.axis.z) + 1e-24)
    turning = -axis_rate(geo.direction, geo.across, geo.length)
    return (geo.direction * C_A - outward * (slope * (lean - trim) / sine) - turning * damping) * load
