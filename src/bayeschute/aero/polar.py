"""Canopy forces in the report's polar form: coefficients along the axes of each canopy's own wind frame.

The frame (6.3.3-8) has x towards the attach point, z along the component of the airflow perpendicular to x, y = z cross
x. It is singular where that component vanishes, which is why `bayeschute.aero.terms` does not use it; here the axes are
regularised, so that the transverse force is zero there and gradients are finite.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp

from bayeschute.aero.airflow import CanopyFlow
from bayeschute.core.vectors import Component, Vec3, cross, dot, norm

_LEAST_SINE = 1e-9  # keeps the unit vector across the axis finite where there is none


class WindAxes(NamedTuple):
    """Axes of the wind frame across the canopy axis, NED components: y (`side`) and z (`normal`)."""

    side: Vec3
    normal: Vec3


def wind_axes(flow: CanopyFlow) -> WindAxes:
    """The wind frames of all canopies (6.3.3-8): z along the airflow across the axis, y = z cross x."""
    normal = flow.e / norm(flow.e, _LEAST_SINE)
    return WindAxes(cross(normal, flow.axis), normal)


def angle_rates(flow: CanopyFlow) -> tuple[Component, Component]:
    """Rates alpha_T_dot and phi_a_dot sin(alpha_T), both times l/(2|V|) (Table 7.3-1; 6.1-3, 6.1-9)."""
    axes = wind_axes(flow)
    return dot(flow.rate, axes.normal) / flow.cos_alpha, dot(flow.rate, axes.side)


def polar_coefficient(flow: CanopyFlow, axial: Component, side: Component, normal: Component) -> Vec3:
    """Force coefficient -C_A x + C_Y y - C_N z of every canopy, NED components (6.3.3-5).

    Args:
        flow: Airflow, arrays (canopy, ...).
        axial: C_A, positive for drag.
        side: C_Y.
        normal: C_N, positive where it restores.
    """
    axes = wind_axes(flow)
    return axes.side * side - axes.normal * normal - flow.axis * axial


def drag_coefficient(flow: CanopyFlow, drag: Component) -> Vec3:
    """Force coefficient -C_D w of a canopy that only drags: C_A = C_D cos(alpha_T), C_N = C_D sin(alpha_T)."""
    return -(flow.e + flow.axis * flow.cos_alpha) * drag


class PitchPlane(NamedTuple):
    """Coefficients of the planar set of Table 7.1-2.

    Attributes:
        C_A0: Axial coefficient at the trim angle.
        C_Aalpha: Its slope there [1/rad].
        alpha_0: Trim angle of attack [rad].
        C_Nalpha: Slope of the normal coefficient there [1/rad].
        C_Nalphadot: Its derivative with the rate of the angle of attack [s/rad].
    """

    C_A0: Component
    C_Aalpha: Component
    alpha_0: Component
    C_Nalpha: Component
    C_Nalphadot: Component

    def axial(self, flow: CanopyFlow) -> Component:
        """C_A of the angle of attack (6.3.1-10)."""
        return self.C_A0 + 0.5 * self.C_Aalpha * self.alpha_0 * (flow.alpha_squared / self.alpha_0**2 - 1.0)

    def normal(self, flow: CanopyFlow, length: Component, speed: Component) -> Component:
        """C_N of the angle of attack and its rate (6.3.1-11, -12).

        Args:
            flow: Airflow.
            length: Reference length l of the flow [m].
            speed: Reference speed V_o of the flow [m/s].
        """
        alpha = jnp.sqrt(flow.alpha_squared + _LEAST_SINE**2)
        per_second = 2.0 * speed * (1.0 + flow.speed_ratio) / length
        static = self.C_Nalpha / (2.0 * self.alpha_0**2) * (alpha**3 - self.alpha_0**2 * alpha)
        return static + self.C_Nalphadot * angle_rates(flow)[0] * per_second
