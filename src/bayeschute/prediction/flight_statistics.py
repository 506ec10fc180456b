"""Statistics of every simulated flight: final value, maximum and mean over the window.

The end of the record may be far above the ground: it is no landing.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from bayeschute.prediction import bands

Array = NDArray[np.float64]

STATISTICS = {
    "final": "at the last sample of the record",
    "maximum": "maximum over the scored window: the part of the record that was not fitted, or all of it",
    "mean": "mean over the scored window: the part of the record that was not fitted, or all of it",
}
"""Statistics that a requirement may refer to, and their meaning."""

REDUCTIONS: dict[str, Callable[[Array], Array]] = {
    "final": lambda values: values[:, -1],
    "maximum": lambda values: values.max(axis=1),
    "mean": lambda values: values.mean(axis=1),
}
"""Each statistic of values over the window (draw, T): (draw,)."""

UNITS = bands.UNITS | {"horizontal_speed": "m/s"}
"""Unit by quantity."""

MEANINGS = {
    "swing_angle": "angle of the mean riser direction from the vertical",
    "flyout_angle": "half of the angle between two risers, mean over pairs",
    "descent_rate": "vertical speed of the capsule, positive down",
    "sea_level_descent_rate": "descent rate times the square root of air density over that at sea level",
    "horizontal_speed": "horizontal speed of the capsule over the ground",
}
"""What a quantity is, by name."""


def flight_statistics(prediction: bands.Prediction, counted: NDArray[np.bool_]) -> dict[str, dict[str, Array]]:
    """Statistics of every draw of a flight.

    Args:
        prediction: Draws of the flight.
        counted: Samples of the window (T,), its last the last of the record.

    Returns:
        Statistic of `STATISTICS` to quantity to values (draw,) [unit of `UNITS`], NaN where a simulation failed. The
        horizontal speed is known at the last sample only.
    """
    found: dict[str, dict[str, Array]] = {name: {} for name in STATISTICS}
    for name, values in prediction.draws.items():
        for statistic, reduced in REDUCTIONS.items():
            found[statistic][name] = reduced(values[:, counted])
    found["final"]["horizontal_speed"] = np.hypot(prediction.last[:, 0], prediction.last[:, 1])
    return found
