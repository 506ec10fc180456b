"""The best trajectory that a fit found for a record, and its residuals, whether or not the fit converged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BestPath:
    """A trajectory, its record and the residuals.

    Attributes:
        flight: Name of the record.
        time: (T,) [s].
        outputs: Names (C entries), a channel and its part: ``capsule_velocity.east``.
        residual: Data less the flight (T, C), SI; NaN where nothing was recorded.
        noise: Expected standard deviation of the sensor's noise (C,), SI.
        defect: Size of the largest defect of each step (T-1,), in standard deviations allowed; 0 where the flight
            obeys the equations of motion.
    """

    flight: str
    time: Array
    outputs: tuple[str, ...]
    residual: Array
    noise: Array
    defect: Array

    def rms(self) -> Array:
        """Root mean square of the residuals of every output (C,); NaN where nothing was recorded."""
        known = np.isfinite(self.residual)
        count = known.sum(axis=0)
        total = np.sum(np.where(known, self.residual, 0.0) ** 2, axis=0)
        return np.where(count > 0, np.sqrt(total / np.maximum(count, 1)), np.nan)
