"""Detection of the steady descent under the open parachute in a log, from altitude and accelerometer.

No number of a vehicle is needed. Touchdown is where the altitude stops changing; before it, as far back as the
equivalent airspeed of the descent stays near that of the seconds after, lies the descent under the last parachute to
open. The accelerometer sharpens both ends: the impact ends it, and an opening shock begins it anew.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.atmosphere.standard import SEA_LEVEL_DENSITY, STANDARD_GRAVITY, standard_density
from bayeschute.core.errors import Fault, InputError
from bayeschute.records.differentiate import savitzky_golay

Array = NDArray[np.float64]

_GRID = 0.1  # interval at which the descent rate is judged [s]
_MEDIAN = 0.5  # window that takes spikes out of the altitude [s]
_SMOOTHING = 2.0  # window that differentiates it [s]
_GROUND = 3.0  # the body has landed where altitude stays this close to its last [m]
_REACH = (1.0, 6.0)  # seconds before touchdown that give the final rate [s]
_SLOWER, _FASTER = 0.4, 1.7  # bounds of the rate over the median of what comes after
_AFTER = 20.0  # so long after [s]
_EXCURSION = 1.0  # time out of bounds that ends the search [s]
_SHOCK = 3.0  # specific force of an opening or an impact [g]
_PAUSE = 0.5  # left out around shocks and touchdown [s]


class ParachuteWindow(NamedTuple):
    """A descent under an open parachute.

    Attributes:
        start: [s].
        end: [s].
        descent_rate: Median over it [m/s].
        landed: Whether the log goes on after the descent.
    """

    start: float
    end: float
    descent_rate: float
    landed: bool


def _smooth(time: Array, altitude: Array) -> tuple[Array, Array]:
    """Times `_GRID` apart and medians of the altitude there, bridged where there are none."""
    good = np.isfinite(altitude)
    if good.sum() < 20 or time[good][-1] - time[good][0] < 4.0 * _SMOOTHING:
        got = f"{int(good.sum())} altitudes"
        raise InputError(Fault("parachute window", got, f"at least 20 over {4.0 * _SMOOTHING:g} s"))
    t, h = time[good], altitude[good]
    grid = np.arange(t[0], t[-1], _GRID)
    low, high = np.searchsorted(t, grid - _MEDIAN / 2.0), np.searchsorted(t, grid + _MEDIAN / 2.0)
    level = np.array([np.median(h[a:b]) if b > a else np.nan for a, b in zip(low, high, strict=True)])
    seen = np.isfinite(level)
    return grid, np.interp(grid, grid[seen], level[seen])


def _back_from(rate: Array, last: int, final: float) -> int:
    """First place from which on, up to `last`, the rate never leaves its bounds for longer than `_EXCURSION`."""
    longest, after, out, first = int(round(_EXCURSION / _GRID)), int(round(_AFTER / _GRID)), 0, last
    for i in range(last, -1, -1):
        known = rate[i + 1 : min(i + after, last) + 1]
        usual = float(np.median(known)) if known.size >= longest else final
        if _SLOWER * usual <= rate[i] <= _FASTER * usual:
            out, first = 0, i
        else:
            out += 1
            if out > longest:
                break
    return first


def parachute_window(time: Array, altitude: Array, specific_force_b: Array | None = None) -> ParachuteWindow:
    """Find the descent under the last parachute to open.

    Args:
        time: Of all series (T,), rising [s].
        altitude: (T,) [m]; NaN where missing. Spikes (an ejection charge blows into the barometer) do no harm.
        specific_force_b: (T, 3) [m/s^2], or None.

    Returns:
        The window.

    Raises:
        InputError: If the log is too short or shows no descent.
    """
    time, altitude = np.asarray(time, dtype=float), np.asarray(altitude, dtype=float)
    grid, level = _smooth(time, altitude)
    window = 2 * int(round(_SMOOTHING / _GRID / 2.0)) + 1
    rate = -savitzky_golay(level, _GRID, window, 1, 1)
    ground = float(np.median(level[-5:]))
    away = np.flatnonzero(np.abs(level - ground) > _GROUND)
    touchdown = int(away[-1]) if away.size else 0
    landed = bool(grid[-1] - grid[touchdown] > _SMOOTHING)
    equivalent = rate * np.sqrt(standard_density(np.clip(level, -4000.0, 30000.0)) / SEA_LEVEL_DENSITY)
    near, far = (int(round(s / _GRID)) for s in _REACH)
    final = float(np.median(equivalent[max(touchdown - far, 0) : max(touchdown - near, 1)]))
    if not final > 0.0:
        raise InputError(Fault("parachute window", "no descent before the end of the log", "a log of a descent"))
    first = _back_from(equivalent, max(touchdown - near, 0), final)
    start, end = float(grid[first]), float(grid[touchdown]) - _PAUSE
    if specific_force_b is not None:
        start, end = _between_shocks(time, np.asarray(specific_force_b, dtype=float), start, end)
    if end - start < _REACH[1]:
        got = f"a steady descent of {max(end - start, 0.0):.1f} s"
        raise InputError(Fault("parachute window", got, f"at least {_REACH[1]:g} s"))
    here = (grid >= start) & (grid <= end)
    return ParachuteWindow(start, end, float(np.median(rate[here])), landed)


def _between_shocks(time: Array, force: Array, start: float, end: float) -> tuple[float, float]:
    """The window cut at opening shocks in its first half (and 2 s before) and at an impact about its end."""
    size = np.linalg.norm(force, axis=1) / STANDARD_GRAVITY
    shocks = time[np.isfinite(size) & (np.nan_to_num(size) > _SHOCK)]
    middle = 0.5 * (start + end)
    openings = shocks[(shocks > start - _SMOOTHING) & (shocks < middle)]
    impacts = shocks[(shocks > max(end - _SMOOTHING, middle)) & (shocks < end + _SMOOTHING)]
    return (
        max(start, float(openings[-1]) + _PAUSE) if openings.size else start,
        min(end, float(impacts[0]) - _PAUSE) if impacts.size else end,
    )
