"""Frequency and damping of the swing of a body under its parachute, from its log: window, spin, fit."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bayeschute.atmosphere.standard import pressure_altitude
from bayeschute.core.errors import Fault, InputError
from bayeschute.records.clean import clean
from bayeschute.swing.hanging import HangingMotion, hanging_motion
from bayeschute.swing.modal import SwingFit, fit_swing
from bayeschute.swing.steady_descent import ParachuteWindow, parachute_window

if TYPE_CHECKING:
    import xarray as xr

_FASTEST = 200.0  # rate beyond which samples are averaged [Hz]
_NEEDED = ("capsule_rate", "capsule_specific_force")


class HangingSwing(NamedTuple):
    """The swing of a hanging body.

    Attributes:
        window: Where the descent was looked at; `fit` begins `fit.start` after it.
        time: Of the motion (T,) [s].
        motion: Without its spin.
        fit: Frequency, damping and amplitude.
    """

    window: ParachuteWindow
    time: np.ndarray
    motion: HangingMotion
    fit: SwingFit


def _altitude(record: xr.Dataset) -> np.ndarray:
    if "altitude" in record:
        return np.asarray(record["altitude"].values, dtype=float)
    if "pressure" in record:
        return pressure_altitude(record["pressure"].values)
    if "capsule_position" in record:
        return np.asarray(-record["capsule_position"].values[:, 2], dtype=float)
    wanted = "altitude, pressure or capsule_position"
    raise InputError(Fault("hanging body", "a record of no altitude", wanted, "Or give the window."))


def hanging_swing(
    record: xr.Dataset,
    window: tuple[float, float] | None = None,
    *,
    band: tuple[float, float] | None = None,
    forcing: bool = True,
    settle: bool = True,
    seed: int = 0,
) -> HangingSwing:
    """Frequency and damping of a body's swing from its raw gyro and accelerometer.

    Args:
        record: As read, with ``capsule_rate`` and ``capsule_specific_force``; and ``altitude``, ``pressure`` or
            ``capsule_position`` where the window is to be found.
        window: First and last time of the descent [s]; found by `parachute_window` where none is given.
        band: Where to look for the swing [Hz]; see `fit_swing`.
        forcing: See `fit_swing`.
        settle: See `fit_swing`.
        seed: Of the draws.

    Returns:
        Window, motion, fit.

    Raises:
        InputError: If a variable is missing, no descent is found, or it is too short.
    """
    missing = [name for name in _NEEDED if name not in record]
    if missing:
        raise InputError([Fault("hanging body", f"a record without {name}", "that variable") for name in missing])
    time = record["time"].values.astype(float)
    if window is None:
        found = parachute_window(time, _altitude(record), record["capsule_specific_force"].values)
    else:
        found = ParachuteWindow(float(window[0]), float(window[1]), float("nan"), False)
    rate = min(1.0 / float(np.median(np.diff(time))), _FASTEST)
    uniform = clean(record[list(_NEEDED)], rate, window=(found.start, found.end))
    dt = float(uniform["time"][1] - uniform["time"][0])
    motion = hanging_motion(uniform["capsule_rate"].values, uniform["capsule_specific_force"].values, dt)
    fit = fit_swing(
        motion.rate, dt, nuisance=motion.misalignment, band=band, forcing=forcing, settle=settle, seed=seed
    )  # fmt: skip
    return HangingSwing(found, uniform["time"].values, motion, fit)
