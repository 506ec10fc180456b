"""Calibration of predicted amplitude and frequency of the modes of a cluster (pendulum, scissors), flight by flight.

The pendulum mode is measured by the swing angle, the scissors mode (canopies moving apart and together) by the flyout
angle. The coverage of a band is a share of samples; here it is a share of flights: those whose true amplitude (or
frequency) of a mode lies inside its predicted interval.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayeschute.calibration.scores import inside

Array = NDArray[np.float64]
MODES = {"pendulum": "swing_angle", "scissors": "flyout_angle"}
"""The quantity that a mode shows in."""


def content(values: Mapping[str, Array], dt: float) -> dict[str, Array]:
    """Amplitude and frequency of the modes in a stretch of a flight.

    Args:
        values: Quantities by name, (..., T) each: angles [rad], ``descent_rate`` [m/s]; those that are missing are left
            out.
        dt: Time between samples [s].

    Returns:
        Per mode (...): ``amplitude``, root two times the rms about the mean [rad], and ``frequency``, rms rate over rms
        about the mean [Hz]; ``mean descent rate`` [m/s]. An angle of no sign goes round twice while a planar swing goes
        round once.
    """
    made: dict[str, Array] = {}
    for mode, name in MODES.items():
        if name not in values:
            continue
        moved = values[name] - values[name].mean(axis=-1, keepdims=True)
        size = np.sqrt(np.mean(moved**2, axis=-1))
        rate = np.sqrt(np.mean(np.gradient(moved, dt, axis=-1) ** 2, axis=-1))
        made[f"{mode} amplitude"] = np.sqrt(2.0) * size
        with np.errstate(invalid="ignore", divide="ignore"):  # a constant series has no frequency
            made[f"{mode} frequency"] = rate / size / (2.0 * np.pi)
    if "descent_rate" in values:
        made["mean descent rate"] = values["descent_rate"].mean(axis=-1)
    return made


def score_modes(draws: Mapping[str, Array], truth: Mapping[str, Array], dt: float) -> dict[str, dict[str, Any]]:
    """Score amplitude and frequency of the modes in a flight.

    Args:
        draws: Quantities by name, (S, T) each; draws that failed are not finite and left out.
        truth: The same of the truth, (T,) each; a quantity whose truth has gaps is left out.
        dt: Time between samples [s].

    Returns:
        As `content` names them: ``truth``, ``mean`` and ``sd`` of the draws, ``inside`` by `scores.LEVELS`, and
        ``pit``, the share of draws below the truth. What is not finite of the truth is left out; where that of every
        draw is not finite the truth counts as outside, and mean, sd and pit are None.
    """
    names = [name for name in truth if name in draws and np.isfinite(truth[name]).all()]
    true, drawn = content({n: truth[n] for n in names}, dt), content({n: draws[n] for n in names}, dt)
    return score_values(drawn, {name: float(value) for name, value in true.items()})


def score_values(drawn: Mapping[str, Array], true: Mapping[str, float]) -> dict[str, dict[str, Any]]:
    """Score draws of single values of a flight.

    Args:
        drawn: Draws by name (S,); those that are not finite are left out.
        true: True values by name.

    Returns:
        As `score_modes`.
    """
    made = {}
    for name, value in true.items():
        known = drawn[name][np.isfinite(drawn[name])]
        if np.isfinite(value):
            made[name] = {
                "truth": float(value),
                "mean": float(known.mean()) if known.size else None,
                "sd": float(known.std()) if known.size else None,
                "inside": inside(known, float(value)),
                "pit": float(np.mean(known < value)) if known.size else None,
            }
    return made
