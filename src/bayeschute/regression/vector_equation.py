"""Vector equation error: regressors and data of a canopy's force along a reconstructed record, without an azimuth.

The terms are those of `bayeschute.aero.terms`, evaluated along the record exactly as the simulator evaluates them at a
state, so the selected structure goes into the simulator unchanged. The axial coefficient is a scalar regression, the
transverse one a vector regression: both components across the canopy axis at once (PHYSICS 3).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayeschute.aero.airflow import CanopyFlow, neighbours, squared_angle
from bayeschute.aero.terms import axial_term, transverse_term
from bayeschute.atmosphere.standard import SEA_LEVEL_DENSITY
from bayeschute.core.vectors import Vec3, dot
from bayeschute.regression.stacked import Stack, stack_components

Array = NDArray[np.float64]


def flow_along(
    record: xr.Dataset, made: xr.Dataset, length: float, speed: float, saturation: float | None = None
) -> CanopyFlow:
    """The airflow of every canopy along a record.

    Args:
        record: Uniform record with ``canopy_position``.
        made: What `bayeschute.records.reconstruct` made of it.
        length: Reference length l [m].
        speed: Reference speed V_o [m/s].
        saturation: As of `CanopyFlow` [rad].

    Returns:
        The flow, arrays (canopy, T); the rate is the riser's.
    """

    def vectors(values: Any) -> Vec3:
        return Vec3(*np.moveaxis(np.asarray(values), (0, 1, 2), (2, 1, 0)))  # (T, canopy, 3) -> 3 of (canopy, T)

    axis = -vectors(made["riser_direction"].values)
    airspeed = made["airspeed"].values.T
    w = vectors(made["air_velocity"].values) / airspeed
    cosine = dot(w, axis)
    e = w - axis * cosine
    x_dot = -vectors(made["riser_direction_rate"].values)
    reference = 0.5 * SEA_LEVEL_DENSITY * speed**2
    position, velocity = vectors(record["canopy_position"].values), vectors(made["canopy_velocity"].values)
    q = made["dynamic_pressure"].values.T
    return CanopyFlow(
        axis=axis,
        e=e,
        rate=-x_dot * (cosine * length / (2.0 * airspeed)),
        alpha_squared=squared_angle(dot(e, e), cosine),
        cos_alpha=cosine,
        q=q,
        q_ratio=q / reference,
        speed_ratio=airspeed / speed - 1.0,
        neighbours=neighbours(position, velocity, axis, length, airspeed.shape[0]),
        saturation=saturation,
    )


def _across(axis: Vec3) -> tuple[Array, Array]:
    """Two unit vectors across the canopy axes, (3, canopy, T): nearest to north, and x cross that."""
    x = np.stack([np.asarray(c) for c in (axis.x, axis.y, axis.z)])
    first = np.array([1.0, 0.0, 0.0])[:, None, None] - x * x[:1]
    first /= np.linalg.norm(first, axis=0)
    return first, np.cross(x, first, axis=0)


def axial_problem(names: Sequence[str], flow: CanopyFlow, made: xr.Dataset, canopy: int) -> Stack:
    """Regressors and data of the axial coefficient of one canopy (from 0)."""
    columns = [np.broadcast_to(np.asarray(axial_term(name, flow)), flow.q.shape)[canopy] for name in names]
    x = np.stack(columns, axis=1)[:, None, :]
    return stack_components(x, made["C_A"].values[:, canopy, None])


def transverse_problem(names: Sequence[str], flow: CanopyFlow, made: xr.Dataset, canopy: int) -> Stack:
    """Regressors and data of the transverse coefficient of one canopy (from 0), two components stacked."""
    first, second = _across(flow.axis)

    def components(vector: Array) -> Array:
        return np.stack([np.sum(vector * b[:, canopy], axis=0) for b in (first, second)], axis=1)

    columns = []
    for name in names:
        term = transverse_term(name, flow)
        columns.append(components(np.stack([np.asarray(c)[canopy] for c in (term.x, term.y, term.z)])))
    return stack_components(np.stack(columns, axis=2), components(made["c_t"].values[:, canopy].T))
