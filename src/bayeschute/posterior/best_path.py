"""The best flight that a fit found of a record, and what it leaves of the data, whether or not the fit came to rest."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BestPath:
    """A flight beside its record.

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


def as_arrays(paths: Iterable[BestPath]) -> dict[str, NDArray[np.generic]]:
    """Paths as arrays for one ``.npz`` file, see `from_arrays`."""
    return {
        f"{i}.{one.name}": np.asarray(getattr(path, one.name)) for i, path in enumerate(paths) for one in fields(path)
    }


def from_arrays(arrays: Mapping[str, NDArray[np.generic]]) -> tuple[BestPath, ...]:
    """Paths as `as_arrays` took them.

    Raises:
        KeyError: If an array of a path is not there.
    """
    made = []
    for i in range(sum(name.endswith(".flight") for name in arrays)):
        numbers = (np.asarray(arrays[f"{i}.{name}"], float) for name in ("time", "residual", "noise", "defect"))
        time, residual, noise, defect = numbers
        outputs = tuple(map(str, arrays[f"{i}.outputs"]))
        made.append(BestPath(str(arrays[f"{i}.flight"]), time, outputs, residual, noise, defect))
    return tuple(made)
