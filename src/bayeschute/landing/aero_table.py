"""Force coefficients of a canopy by angle of attack, a table for every draw: what other programs read."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayeschute.aero.airflow import CanopyFlow
from bayeschute.aero.terms import axial_coefficient, transverse_coefficient
from bayeschute.core.vectors import Vec3, dot
from bayeschute.dynamics.cluster_flight import with_parameters
from bayeschute.landing.campaign_plan import Parameters

Array = NDArray[np.float64]
ANGLES = np.deg2rad(np.arange(0.0, 41.0, 2.0))
COLUMNS = {
    "draw": ("1", "number of the draw of the parameters, from 0"),
    "alpha_T_deg": ("deg", "total angle of attack of the canopy"),
    "C_A_1": ("1", "axial force coefficient, positive for drag, mean over canopies"),
    "C_N_1": ("1", "normal force coefficient, positive where it restores, mean over canopies"),
    "C_Nr_1": ("1", "derivative of C_N with the transverse rate r l / (2 |V|), positive where it damps"),
}
"""Unit and meaning of every column."""


def aero_table(one: Parameters, first: int = 0, angles: Array = ANGLES) -> pd.DataFrame:
    """Coefficients of all draws.

    A canopy alone at its reference speed in sea-level air: no other canopy is near, and none closes in.

    Args:
        one: Draws of a model.
        first: Number of its first draw.
        angles: Total angles of attack (A,) [rad].

    Returns:
        Columns of `COLUMNS`, rows by draw and angle.
    """
    draws, count = len(one.theta), len(angles)
    theta = np.repeat(one.theta.T, count, axis=1)
    alpha = np.tile(angles, draws)
    numbers = with_parameters(one.base, one.structure, one.names, theta)
    n = one.structure.canopies
    axial, normal = _coefficients(one, numbers, alpha, 0.0)
    _, rated = _coefficients(one, numbers, alpha, 1e-4)
    return pd.DataFrame(
        {
            "draw": first + np.repeat(np.arange(draws), count),
            "alpha_T_deg": np.rad2deg(alpha),
            "C_A_1": axial.reshape(n, -1).mean(axis=0),
            "C_N_1": normal.reshape(n, -1).mean(axis=0),
            "C_Nr_1": ((rated - normal) / 1e-4).reshape(n, -1).mean(axis=0),
        }
    )


def _coefficients(one: Parameters, numbers: object, alpha: Array, rate: float) -> tuple[Array, Array]:
    """C_A and C_N (n, B) at angles (B,), the wind direction turning across the axis by `rate` in reduced units."""
    n = one.structure.canopies
    wide = np.ones((n, alpha.size))
    zero, sine, cosine = 0.0 * wide, np.sin(alpha) * wide, np.cos(alpha) * wide
    flow = CanopyFlow(
        axis=Vec3(zero, zero, wide), e=Vec3(sine, zero, zero), rate=Vec3(rate * wide, zero, zero),
        alpha_squared=alpha**2 * wide, cos_alpha=cosine, q=wide, q_ratio=wide, speed_ratio=zero, neighbours=(),
    )  # fmt: skip
    axial = axial_coefficient(one.structure.axial, numbers.axial, flow)  # type: ignore[attr-defined]
    across = transverse_coefficient(one.structure.transverse, numbers.transverse, flow)  # type: ignore[attr-defined]
    along = Vec3(-wide, zero, zero)
    return np.asarray(axial), np.asarray(jnp.broadcast_to(dot(across, along), wide.shape))
