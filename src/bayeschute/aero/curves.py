"""Force coefficients of a canopy as curves: C_A(alpha), C_N(alpha), damping by rate, and the force between canopies.

Coefficients enter a curve linearly, so a curve is a matrix of regressors (points, terms) times the coefficients. The
matrix comes from the very terms that regression and simulator use (`bayeschute.aero.terms`), evaluated where a curve is
usually measured: in steady planar airflow. The canopy is alone, at the reference speed in sea-level air and without any
rate, unless `Setting` says otherwise. A neighbour stands beside the pitch plane, so that its push has no part in C_N.
What each curve is: `bayeschute.aero.curve_names`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from bayeschute.aero.airflow import CanopyFlow, Neighbour
from bayeschute.aero.curve_names import CURVES
from bayeschute.aero.terms import axial_term, transverse_term
from bayeschute.core.vectors import Component, Vec3, dot


@dataclass(frozen=True)
class Setting:
    """Where a curve is evaluated, beside what it is over.

    Attributes:
        distance: D_prox of one neighbour, beside the pitch plane [1]; None: the canopy is alone.
        speed: Airspeed over the reference speed, in sea-level air [1].
        saturation: Angle of attack at which its powers in terms level off [rad]; None: nowhere.
    """

    distance: float | None = None
    speed: float = 1.0
    saturation: float | None = None


def regressors(
    name: str,
    axial: Sequence[str],
    transverse: Sequence[str],
    grid: Float[np.ndarray, " K"],
    setting: Setting = Setting(),
) -> Float[np.ndarray, "K P"]:
    """The derivative of a curve by every coefficient, at every point.

    Args:
        name: One of `CURVES`.
        axial: Terms of the axial force coefficient.
        transverse: Terms of the transverse force coefficient.
        grid: Angles of attack from 0 [rad], or D_prox [1] for ``proximity``.
        setting: The rest of the airflow.

    Returns:
        Regressors; columns: axial terms, then transverse ones. Zero where a term has no part in the curve.

    Raises:
        KeyError: If there is no such curve.
    """
    if name not in CURVES:
        raise KeyError(name)
    over = np.asarray(grid, np.float64)
    zero = np.zeros((over.size, len(axial)))
    if name == "C_A":
        flow = _planar(over, 0.0, setting)
        columns = [axial_term(term, flow) for term in axial]
        return np.hstack([_columns(columns, over.size), np.zeros((over.size, len(transverse)))])
    if name == "proximity":
        flow = _facing(over, setting)
        away = flow.neighbours[0].away
        columns = [dot(transverse_term(term, flow), away) for term in transverse]
        return np.hstack([zero, _columns(columns, over.size)])
    # A term's rate is that across the axis, r = cos(alpha) alpha_dot; the curve is by alpha_dot.
    still, moving = _planar(over, 0.0, setting), _planar(over, np.cos(over), setting)
    columns = []
    for term in transverse:
        here = -transverse_term(term, still).z  # restoring: against the airflow across the axis
        columns.append(here if name == "C_N" else -transverse_term(term, moving).z - here)
    return np.hstack([zero, _columns(columns, over.size)])


def _columns(parts: Sequence[Component], points: int) -> Float[np.ndarray, "K P"]:
    return np.array([np.asarray(p)[0] for p in parts]).reshape(len(parts), points).T


def _constant(value: float, like: Component) -> Component:
    return np.zeros_like(like) + value


def _planar(alpha: Component, rate: Component, setting: Setting) -> CanopyFlow:
    """One canopy, axis along x, airflow turned by alpha towards z; a neighbour, if any, along y."""
    a = np.asarray(alpha)[None]
    zero = np.zeros_like(a)
    near = () if setting.distance is None else (Neighbour(Vec3(zero, zero + 1.0, zero), zero + setting.distance, zero),)
    q_ratio = setting.speed**2
    return CanopyFlow(
        axis=Vec3(zero + 1.0, zero, zero),
        e=Vec3(zero, zero, np.sin(a)),
        rate=Vec3(zero, zero, zero + rate),
        alpha_squared=a * a,
        cos_alpha=np.cos(a),
        q=_constant(q_ratio, a),
        q_ratio=_constant(q_ratio, a),
        speed_ratio=_constant(setting.speed - 1.0, a),
        neighbours=near or (Neighbour(Vec3(zero, zero, zero), zero + np.inf, zero),),
        saturation=setting.saturation,
    )


def _facing(distance: Component, setting: Setting) -> CanopyFlow:
    """One canopy in flow along its axis, another beside it at every distance."""
    d = np.asarray(distance)[None]
    zero = np.zeros_like(d)
    made = _planar(np.zeros_like(d[0]), 0.0, setting)
    return CanopyFlow(**{**made.__dict__, "neighbours": (Neighbour(Vec3(zero, zero + 1.0, zero), d, zero),)})
