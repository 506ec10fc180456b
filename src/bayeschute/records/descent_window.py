"""Where in a record a body hangs under its open parachute, for flights that tell no window: apogee, opening, ground.

Only what is surely no steady descent is cut: a climb before the highest point, stretches of a fall much faster (or
slower) than what comes after them, shocks of opening, and rest on the ground. A record without these is left whole.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.atmosphere.standard import SEA_LEVEL_DENSITY, STANDARD_GRAVITY, pressure_altitude, standard_density

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

_STEP = 0.5  # interval at which the descent is judged [s]
_MEDIAN = 15  # samples of the median of the rate of descent; a jump of the altitude is in fewer than half of them
_CLIMB = 30.0  # a rise before the highest point that is no error of the altitude [m]
_GROUND = 3.0  # altitudes this close to the last one are the ground, where they stay so [m]
_REST = 6.0  # for so long [s]
_AFTER = 20.0  # rates are compared with the median of so long after [s]
_FASTER, _SLOWER = 1.6, 0.5  # of that median: no steady descent
_LASTS = 2.5  # and for so long at least: what is shorter is an error of the record [s]
_SETTLES = 4.0  # left out after an opening [s]
_SHOCK = 3.0  # specific force of an opening or an impact [g]
_LEAST = 15.0  # shortest descent that is worth a window [s]


class DescentWindow(NamedTuple):
    """A descent under an open parachute.

    Attributes:
        start: First time used [s].
        end: Last time used [s].
        words: How it was found; empty where the record is used whole.
    """

    start: float
    end: float
    words: str


def descent_window(record: xr.Dataset, begins: bool = True) -> DescentWindow:
    """Find the steady descent of a record.

    Args:
        record: In SI, at its own times.
        begins: Whether its begin is looked for; not where the study says how much to leave out there.
    """
    time = record["time"].values.astype(float)
    whole = DescentWindow(float(time[0]), float(time[-1]), "")
    height = _height(record)
    seen = np.isfinite(height) if height is not None else np.zeros(time.size, bool)
    if height is None or seen.sum() < 20 or time[seen][-1] - time[seen][0] < 2.0 * _LEAST:
        return whole
    grid = np.arange(time[seen][0], time[seen][-1], _STEP)
    level = _medians(time[seen], height[seen], grid)
    words, start, end = [], whole.start, whole.end
    top = int(np.argmax(level))
    if begins and level[top] - level[: top + 1].min() > _CLIMB and grid[-1] - grid[top] > _LEAST:
        start = float(grid[top])
        words.append(f"highest point at {start:.1f} s")
    else:
        top = 0
    touchdown = _touchdown(level)
    if grid[-1] - grid[touchdown] > _REST:
        end = float(grid[touchdown]) - 1.0
        words.append(f"on the ground from {grid[touchdown]:.1f} s")
    force = record["capsule_specific_force"].values if "capsule_specific_force" in record else None
    opened = _opened(grid, level, top, touchdown, time, force) if begins else None
    if opened is not None and opened > start:
        start = opened + _SETTLES
        words.append(f"steady from {opened:.1f} s, {_SETTLES:g} s left out for the opening")
    if not words or end - start < _LEAST:
        return whole
    return DescentWindow(start, end, f"window {start:.1f} to {end:.1f} s, found in the record: {'; '.join(words)}")


def _height(record: xr.Dataset) -> Array | None:
    """Height over any datum (T,) [m]; None where the record tells none."""
    if "altitude" in record:
        return np.asarray(record["altitude"].values, np.float64)
    if "capsule_position" in record:
        return np.asarray(-record["capsule_position"].values[:, 2], np.float64)
    if "pressure" in record:
        return pressure_altitude(np.clip(record["pressure"].values, 900.0, 1.7e5))
    return None


def _medians(time: Array, height: Array, grid: Array) -> Array:
    """Medians about the times of a grid, bridged where there is no sample."""
    low, high = np.searchsorted(time, grid - _STEP), np.searchsorted(time, grid + _STEP)
    level = np.array([np.median(height[a:b]) if b > a else np.nan for a, b in zip(low, high, strict=True)])
    seen = np.isfinite(level)
    return np.asarray(np.interp(grid, grid[seen], level[seen]))


def _touchdown(level: Array) -> int:
    """Place from which on the height stays that of the end."""
    ground = float(np.median(level[-4:]))
    away = np.flatnonzero(np.abs(level - ground) > _GROUND)
    return int(away[-1]) if away.size else 0


def _opened(grid: Array, level: Array, first: int, last: int, time: Array, force: Array | None) -> float | None:
    """Time from which on the descent is steady; None where it always is [s]."""
    if last - first < _LEAST / _STEP:
        return None
    lag = round(1.0 / _STEP)
    slope = np.zeros_like(level)
    slope[lag:-lag] = (level[: -2 * lag] - level[2 * lag :]) / (2.0 * lag * _STEP)
    slope[:lag], slope[-lag:] = slope[lag], slope[-lag - 1]
    half = _MEDIAN // 2
    rate = np.array([np.median(slope[max(i - half, 0) : i + half + 1]) for i in range(slope.size)])
    rate = rate * np.sqrt(standard_density(np.clip(level, -4000.0, 30000.0)) / SEA_LEVEL_DENSITY)
    after, lasting, found = round(_AFTER / _STEP), round(_LASTS / _STEP), None
    unsteady = np.zeros(rate.size, bool)
    for i in range(first, max(last - after // 2, first)):
        usual = float(np.median(rate[i + 1 : min(i + 1 + after, last)]))
        unsteady[i] = not _SLOWER * usual <= rate[i] <= _FASTER * usual
    runs = np.flatnonzero(np.diff(np.concatenate([[0], unsteady.astype(int), [0]])))
    # A stretch begins a descent only if it is before its middle: thermals near the ground are no opening.
    for begin, stop in zip(runs[::2], runs[1::2], strict=True):
        if stop - begin >= lasting and (begin - first < 0.5 * (last - first)):
            found = float(grid[min(stop, grid.size - 1)])
    if force is not None:
        size = np.linalg.norm(force, axis=1) / STANDARD_GRAVITY
        middle = 0.5 * (grid[first] + grid[last])
        process_noise = time[(np.nan_to_num(size) > _SHOCK) & (time >= grid[first]) & (time < middle)]
        if process_noise.size:
            found = max(found or -np.inf, float(process_noise[-1]))
    return found
