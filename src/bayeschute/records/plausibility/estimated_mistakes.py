"""Mistakes of estimated size: clock offsets, a rotated heading, gains, masses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from bayeschute.atmosphere.standard import STANDARD_GRAVITY
from bayeschute.records.plausibility.evidence import Array, Evidence, boxcar, slope, smoothed, spread, turned, typical
from bayeschute.records.plausibility.mistake import (
    Mistake,
    of_vehicle,
    other_heights,
    scaled,
    turned_attitude,
    turned_axes,
)
from bayeschute.records.plausibility.vehicle_laws import air, attached

Score = Callable[[Evidence], float]

_DOUBT = 0.4  # of a mistake with a number that fits the record
_FARTHEST = 8.0  # clocks are apart by less [s]
_LEVELS = 3000.0  # the wind profile's altitudes are off by less [m]
_SWINGS = 30.0  # several periods of a swing [s]
_SHIFTED = {
    "canopy positions are": ("canopies",),
    "capsule velocities are": ("velocity",),
    "canopy velocities are": ("canopy_velocity",),
    "canopy positions and velocities are": ("canopies", "canopy_velocity"),
    "the attitude is": ("attitude",),
    "angular rates and specific forces are": ("rate", "force"),
    "the attitude, angular rates and specific forces are": ("attitude", "rate", "force"),
    "load cells are": ("tension",),
}


def estimated_mistakes(e: Evidence, score: Score) -> list[Mistake]:
    """Mistakes of the size that explains a record best.

    Args:
        e: The evidence.
        score: Of evidence; smaller where more laws hold.
    """
    found = [*_shifts(e, score), _heading(e), _wind_heading(e), _wind_level(e), *_gains(e)]
    return [mistake for mistake in found if mistake is not None]


def later(e: Evidence, names: tuple[str, ...], seconds: float) -> Evidence | None:
    """Evidence with some channels taken so much later on their clock [s]; None where one is missing."""
    made: dict[str, Any] = {}
    for name in names:
        values = getattr(e, name)
        if values is None:
            continue
        flat = values.reshape(len(values), -1)
        at = e.time + seconds
        moved = np.stack([np.interp(at, e.time, column, left=np.nan, right=np.nan) for column in flat.T], axis=1)
        made[name] = moved.reshape(values.shape)
    return replace(e, **made) if len(made) == len(names) else None


def _shifts(e: Evidence, score: Score) -> list[Mistake]:
    """Channels whose clock is ahead or behind."""
    found = []
    for words, names in _SHIFTED.items():
        if any(getattr(e, name) is None for name in names) or e.step > 1.0:
            continue

        def at(seconds: float, names: tuple[str, ...] = names) -> float:
            moved = later(e, names, seconds)
            return np.inf if moved is None else score(moved)

        coarse = np.arange(-_FARTHEST, _FARTHEST + 0.1, 0.5)
        best = float(coarse[np.argmin([at(x) for x in coarse])])
        fine = best + np.array([-0.4, -0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3, 0.4])
        best = float(fine[np.argmin([at(x) for x in fine])])
        if abs(best) < max(0.15, 0.5 * e.step):
            continue
        side = "late" if best > 0.0 else "early"
        found.append(
            Mistake(
                f"{words} {abs(best):.1f} s {side} on the clock of the others",
                f"Give those columns a time of their own, or shift them by {-best:+.1f} s.",
                partial(later, names=names, seconds=best),
                _DOUBT,
            )
        )
    return found


def _angle(a: Array, b: Array) -> float:
    """Turn about the vertical that takes the horizontal parts of `a` onto those of `b` best [rad]."""
    x, y = a[:, 0] + 1j * a[:, 1], b[:, 0] + 1j * b[:, 1]
    seen = np.isfinite(x) & np.isfinite(y)
    return float(np.angle(np.vdot(x[seen], y[seen]))) if seen.sum() > 20 else 0.0


def _heading(e: Evidence) -> Mistake | None:
    """The attitude's north is not that of positions: magnetic, or of a grid."""
    if e.attitude is None or e.force is None or e.velocity is None:
        return None
    k = e.samples(2.0)
    shown = slope(e.velocity, k, e.step)
    said = boxcar(turned(e.attitude, e.force), k)
    angle = _angle(said, shown)
    if abs(angle) < np.deg2rad(3.0):
        return None
    undo = turned_attitude(np.array([np.cos(0.5 * angle), 0.0, 0.0, np.sin(0.5 * angle)]))
    words = f"the heading of the attitude is off by {np.rad2deg(-angle):.0f} deg: magnetic north, or another grid"
    return Mistake(words, f"Turn it about the vertical by {np.rad2deg(angle):.0f} deg.", undo, _DOUBT)


def _over_swings(e: Evidence) -> int:
    """Samples over which a capsule goes where the wind goes, at most half of all."""
    return min(max(round(_SWINGS / e.step), 2), e.time.size // 2)


def _wind_heading(e: Evidence) -> Mistake | None:
    """The wind's north is not that of positions."""
    wind = air(e)
    if wind is None or e.velocity is None:
        return None
    k = _over_swings(e)
    angle = _angle(smoothed(wind, k), smoothed(e.velocity, k))
    if abs(angle) < np.deg2rad(10.0):
        return None
    c, s = np.cos(angle), np.sin(angle)
    undo = partial(turned_axes, names=("wind",), matrix=np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))
    words = f"the wind is turned by {np.rad2deg(-angle):.0f} deg: another north"
    return Mistake(words, f"Turn it by {np.rad2deg(angle):.0f} deg.", undo, _DOUBT + 0.2)


def _wind_level(e: Evidence) -> Mistake | None:
    """Altitudes of the wind profile are above another level than those of the record."""
    aloft, height = e.aloft, e.height()
    shown = e.wind if e.wind is not None else e.velocity
    if aloft is None or height is None or shown is None:
        return None
    k = _over_swings(e)
    seen = smoothed(shown, k)[:, :2]

    def apart(level: float) -> float:
        return spread(seen - smoothed(aloft(height + level), k)[:, :2])

    if np.isnan(apart(0.0)):
        return None
    coarse = np.arange(-_LEVELS, _LEVELS + 1.0, 50.0)
    fine = coarse[np.argmin([apart(x) for x in coarse])] + np.arange(-40.0, 41.0, 10.0)
    best = float(fine[np.argmin([apart(x) for x in fine])])
    if abs(best) < 50.0:
        return None
    side = "high" if best > 0.0 else "low"
    level = "another level" if best > 0.0 else "the ground, or another level"
    words = f"altitudes of the wind profile are {abs(best):.0f} m too {side}: above {level}, read as above the sea"
    do = f"Give altitudes above the sea: {-best:+.0f} m from those given."
    return Mistake(words, do, partial(other_heights, read=partial(np.add, best)), _DOUBT)


def _gains(e: Evidence) -> list[Mistake | None]:
    """Gains of load cells, and the mass they speak for; the length of the risers that is seen."""
    found: list[Mistake | None] = []
    v = e.vehicle
    if v is not None and e.tension is not None and e.force is not None:
        pulled = typical(e.tension.sum(axis=1)) / typical(np.linalg.norm(e.force, axis=1))
        if np.isfinite(pulled) and pulled > 0.0:
            words = f"part of the payload is missing in the capsule's mass: load cells say {pulled:.4g} kg"
            if pulled < v.mass:
                words = f"the capsule's mass is too great: load cells say {pulled:.4g} kg"
            mass = Mistake(words, "Check the mass.", of_vehicle(lambda _: {"mass": pulled}), _DOUBT)
            gain = v.mass * STANDARD_GRAVITY / typical(e.tension.sum(axis=1))
            cells = Mistake(
                f"the gain of the load cells is off: {1.0 / gain:.3g} of the weight",
                "Check unit and gain of the load cells.",
                partial(scaled, names=("tension",), factor=gain),
                _DOUBT,
            )
            found += [mass, cells]
    if v is not None and (apart := attached(e)) is not None:
        length = typical(np.linalg.norm(apart, axis=2))
        if np.isfinite(length):
            found.append(
                Mistake(
                    f"the risers are {length:.3g} m long, not {v.riser_length:.3g} m",
                    "Check their length, suspension lines included.",
                    of_vehicle(lambda _: {"riser_length": length}),
                    _DOUBT,
                )
            )
    return found
