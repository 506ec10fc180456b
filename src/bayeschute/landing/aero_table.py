"""Force coefficients of a canopy by angle of attack, a table for every draw, for other programs."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayeschute.aero.curve_names import CURVES
from bayeschute.aero.curves import Setting, regressors
from bayeschute.dynamics.cluster_flight import with_parameters
from bayeschute.landing.campaign_plan import Parameters

Array = NDArray[np.float64]
ANGLES = np.deg2rad(np.arange(0.0, 41.0, 2.0))
_CURVES = ("C_A", "C_N", "C_N_rate")
COLUMNS = {
    "draw": ("1", "number of the draw of the parameters, from 0"),
    "alpha_T_deg": ("deg", "total angle of attack of the canopy"),
} | {f"{curve}_1": ("1", f"{CURVES[curve].words}, mean over canopies") for curve in _CURVES}
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
    structure, draws = one.structure, len(one.theta)
    numbers = with_parameters(one.base, structure, one.names, one.theta.T)
    each = [np.broadcast_to(value, (structure.canopies, draws)) for value in (*numbers.axial, *numbers.transverse)]
    mean = np.array(each).mean(axis=1)  # (terms, draws): curves are linear in the coefficients
    alone = Setting(saturation=structure.saturation)
    curves = {f"{c}_1": regressors(c, structure.axial, structure.transverse, angles, alone) @ mean for c in _CURVES}
    return pd.DataFrame(
        {"draw": first + np.repeat(np.arange(draws), len(angles)), "alpha_T_deg": np.rad2deg(np.tile(angles, draws))}
        | {name: values.T.ravel() for name, values in curves.items()}
    )
