"""Validation of a capsule's aerodynamic table for interpolation; free of JAX."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.errors import Fault

Array = NDArray[np.float64]

COEFFICIENTS = ("C_A", "C_Y", "C_N", "C_l", "C_m", "C_n")  # forces -C_A x + C_Y y - C_N z, then moments (6.3.3-11, -12)
MOST_ANGLES, MOST_ROLLS = 721, 72
_ACROSS = COEFFICIENTS[1:3] + COEFFICIENTS[4:]
_ROUNDING = 1e-6  # [rad] of angles, share of coefficients: rounding of a table written in decimals


def is_pole(angle: Array) -> NDArray[np.bool_]:
    """Which total angles of attack are on the axis, 0 or pi."""
    return np.asarray((np.abs(angle) < _ROUNDING) | (np.abs(angle - np.pi) < _ROUNDING))


def grid_faults(angle: Array, roll: Array, coefficients: Mapping[str, Array], where: str) -> list[Fault]:
    """Every fault of a table.

    Args:
        angle: Total angles of attack (K,) [rad].
        roll: Aerodynamic rolls (R,) [rad].
        coefficients: (K, R) each.
        where: The table, for messages.
    """
    angle, roll = np.asarray(angle, float), np.asarray(roll, float)
    faults = [*_angle_faults(angle, f"{where} total_angle"), *_roll_faults(roll, f"{where} roll")]
    for name, given in coefficients.items():
        values, place = np.asarray(given, float), f"{where} {name}"
        if name not in COEFFICIENTS:
            faults.append(Fault(place, "an unknown coefficient", f"one of {', '.join(COEFFICIENTS)}"))
        elif values.shape != (angle.size, roll.size):
            got = f"shape {values.shape}"
            faults.append(Fault(place, got, f"{angle.size} rows (total angles) of {roll.size} (rolls)"))
        elif not np.isfinite(values).all():
            faults.append(Fault(place, f"{int((~np.isfinite(values)).sum())} values that are no number", "numbers"))
        elif not faults:
            faults += _pole_faults(angle, values, name, place, roll.size)
    if not any(np.any(np.asarray(values) != 0.0) for values in coefficients.values()):
        faults.append(Fault(where, "no coefficient", f"one at least of {', '.join(COEFFICIENTS)} that is not zero"))
    return faults


def _angle_faults(angle: Array, where: str) -> list[Fault]:
    if angle.ndim != 1 or not np.isfinite(angle).all():
        return [Fault(where, "no list of angles", "finite angles")]
    inside = int((~is_pole(angle)).sum())
    if not 3 <= angle.size <= MOST_ANGLES or inside < 2:
        got = f"{angle.size} angles, {inside} of them off the axis"
        return [Fault(where, got, f"3 to {MOST_ANGLES} angles, two at least off the axis (0 and 180 deg)")]
    if (np.diff(angle) < _ROUNDING).any():
        first = int(np.flatnonzero(np.diff(angle) < _ROUNDING)[0])
        got = f"{np.rad2deg(angle[first]):g} deg followed by {np.rad2deg(angle[first + 1]):g} deg"
        return [Fault(where, got, "angles that increase")]
    if angle[0] < -_ROUNDING or angle[-1] > np.pi + _ROUNDING:
        got = f"{np.rad2deg(angle[0]):g} to {np.rad2deg(angle[-1]):g} deg"
        return [Fault(where, got, "angles within 0 and 180 deg")]
    return []


def _roll_faults(roll: Array, where: str) -> list[Fault]:
    wanted = (
        "a whole turn in even steps from 0 deg without its end (0, 45, ..., 315 deg), or 0 alone: all roll angles equal"
    )
    if roll.ndim != 1 or roll.size not in (1, *range(3, MOST_ROLLS + 1)) or not np.isfinite(roll).all():
        return [Fault(where, f"{roll.size} rolls", f"{wanted}; up to {MOST_ROLLS}")]
    if np.abs(roll - 2.0 * np.pi * np.arange(roll.size) / roll.size).max() > _ROUNDING:
        return [Fault(where, ", ".join(f"{v:g}" for v in np.rad2deg(roll[:12])) + " deg", wanted)]
    return []


def _pole_faults(angle: Array, values: Array, name: str, where: str, rolls: int) -> list[Fault]:
    """On the axis every roll is the same airflow; and a body of revolution has no force across it there."""
    faults = []
    allowed = _ROUNDING * np.max(np.abs(values), initial=0.0)
    for row in np.flatnonzero(is_pole(angle)):
        spread, at = np.ptp(values[row]), f"{where}, total angle {np.rad2deg(angle[row]):g} deg"
        if spread > allowed:
            got = f"{values[row].min():g} to {values[row].max():g}"
            faults.append(Fault(at, got, "one value at all rolls: on the axis they are the same airflow"))
        elif rolls == 1 and name in _ACROSS and abs(values[row, 0]) > allowed:
            faults.append(Fault(at, f"{values[row, 0]:g}", "0 on the axis of a body of revolution"))
    return faults
