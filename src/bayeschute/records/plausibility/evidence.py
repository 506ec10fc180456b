"""A flight as the plausibility laws use it: all channels on one coarse clock, and the vehicle's nominal numbers.

Pure NumPy. Nothing is cleaned, since cleaning would hide mistakes: laws use statistics that outliers don't move.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bayeschute.records.foreign.attitudes import of_matrix
from bayeschute.records.foreign.conventions import USUAL, Conventions

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

_MOST = 8000  # samples that laws look at
_BRIDGE = 3.0  # gaps are bridged up to so many sample intervals
_KEPT = 0.9  # share of samples, the smallest ones, that make a spread
CHANNELS = {  # of the evidence, by variable of the record
    "position": "capsule_position",
    "velocity": "capsule_velocity",
    "attitude": "capsule_attitude",
    "rate": "capsule_rate",
    "force": "capsule_specific_force",
    "canopies": "canopy_position",
    "canopy_velocity": "canopy_velocity",
    "tension": "riser_tension",
    "wind": "wind",
    "density": "density",
    "altitude": "altitude",
    "pressure": "pressure",
    "temperature": "temperature",
    "descent_rate": "descent_rate",
}


@dataclass(frozen=True)
class Nominal:
    """What is known of a vehicle before its record is looked at; SI. NaN where a number is not known.

    Attributes:
        mass: Of the capsule [kg].
        attach_b: Attach point of the risers from the centre of mass, body axes (3,) [m].
        inertia: Moments about the centre of mass (3,) [kg m^2].
        capsule_length: Reference length of the capsule [m].
        capsule_area: Reference area of the capsule [m^2].
        capsule_drag: Its drag coefficient.
        canopies: How many.
        area: Reference area of one canopy [m^2].
        diameter: Reference length of one canopy [m].
        dry_mass: Of one canopy [kg].
        volume: Enclosed by one canopy [m^3].
        riser_length: Unstretched [m].
        stiffness: Of one riser [N/m].
    """

    mass: float
    attach_b: Array
    inertia: Array
    capsule_length: float
    capsule_area: float
    capsule_drag: float
    canopies: int
    area: float
    diameter: float
    dry_mass: float
    volume: float
    riser_length: float
    stiffness: float


@dataclass(frozen=True)
class Evidence:
    """Channels of a record on one clock; None where a channel isn't recorded, NaN where a sample is missing.

    Attributes:
        time: (T,) [s].
        position: NED (T, 3) [m].
        velocity: NED (T, 3) [m/s].
        attitude: Quaternion from NED to body, scalar first, as recorded (T, 4).
        rate: Body axes (T, 3) [rad/s].
        force: Specific force, body axes (T, 3) [m/s^2].
        canopies: NED (T, n, 3) [m].
        canopy_velocity: NED (T, n, 3) [m/s].
        tension: (T, n) [N].
        wind: Recorded, NED (T, 3) [m/s].
        density: (T,) [kg/m^3].
        altitude: (T,) [m].
        pressure: (T,) [Pa].
        temperature: (T,) [K].
        descent_rate: (T,) [m/s].
        profile: Wind of the profile at the capsule, NED (T, 3) [m/s].
        shear: Wind of the profile at the canopies less that at the capsule, NED (T, 3) [m/s].
        vehicle: None: a point mass.
        aloft: Wind by altitude [m], NED [m/s], that `profile` and `shear` are of.
        body_turn: Quaternion (4,) from the body axes of the file to the vehicle's, by which the attitude was multiplied
            from the right when it was read; None: those of the file are the vehicle's.
    """

    time: Array
    position: Array | None = None
    velocity: Array | None = None
    attitude: Array | None = None
    rate: Array | None = None
    force: Array | None = None
    canopies: Array | None = None
    canopy_velocity: Array | None = None
    tension: Array | None = None
    wind: Array | None = None
    density: Array | None = None
    altitude: Array | None = None
    pressure: Array | None = None
    temperature: Array | None = None
    descent_rate: Array | None = None
    profile: Array | None = None
    shear: Array | None = None
    vehicle: Nominal | None = None
    aloft: Callable[[Array], Array] | None = None
    body_turn: Array | None = None

    @property
    def step(self) -> float:
        """Sample interval [s]."""
        return float(self.time[1] - self.time[0])

    def samples(self, seconds: float, least: int = 2) -> int:
        """Samples that span a time [s]; at most a tenth of all, so that a clock in a wrong unit still has laws."""
        return int(np.clip(round(seconds / self.step), least, max(least, self.time.size // 10)))

    def height(self) -> Array | None:
        """Altitude above the sea (T,) [m]: recorded, or else minus the position downward."""
        if self.altitude is not None:
            return self.altitude
        return None if self.position is None else -self.position[:, 2]

    def with_winds(self) -> Evidence:
        """The same with the wind by altitude at the heights that its positions say; as it is where there is none."""
        height = self.height()
        if self.aloft is None or height is None:
            return self
        here = self.aloft(height)
        above = height * 0.0
        if self.canopies is not None and self.position is not None:
            above = self.position[:, 2] - mean(self.canopies, 1)[:, 2]
        aloft = np.nan_to_num(self.aloft(height + np.nan_to_num(above, nan=0.0)) - here)
        return replace(self, profile=here, shear=aloft)


def evidence_of(
    record: xr.Dataset,
    vehicle: Nominal | None = None,
    window: tuple[float, float] | None = None,
    profile: Callable[[Array], Array] | None = None,
    body_axes: str | None = None,
) -> Evidence:
    """A record as its laws see it.

    Args:
        record: A valid record in SI, as read.
        vehicle: Nominal numbers; None: a point mass.
        window: First and last time looked at [s]; None: all.
        profile: Wind by altitude [m], NED [m/s]; None: none.
        body_axes: With which the file was read, as in `Conventions`; None: none.
    """
    time: Array = np.asarray(record["time"].values, np.float64)
    start, end = window or (float(time[0]), float(time[-1]))
    found: dict[str, Any] = {}
    arrays = {key: np.asarray(record[name].values, np.float64) for key, name in CHANNELS.items() if name in record}
    own = [_interval(time, a) for key, a in arrays.items() if key in ("position", "velocity", "altitude")]
    step = max([float(np.median(np.diff(time))), *own, (end - start) / _MOST])
    grid = np.asarray(start + step * np.arange(max(int((end - start) / step + 1e-6) + 1, 2)), np.float64)
    for key, values in arrays.items():
        laid = on_clock(time, values, grid)
        if np.isfinite(laid).any():
            found[key] = laid
    turn = None if body_axes in (None, USUAL.body_axes) else of_matrix(Conventions(body_axes=str(body_axes)).body().T)
    made = Evidence(time=grid, vehicle=vehicle, body_turn=turn, **found)
    return replace(made, aloft=profile).with_winds()


def _interval(time: Array, values: Array) -> float:
    """Median interval of a channel's own samples [s]."""
    seen = np.isfinite(values.reshape(time.size, -1)).any(axis=1)
    return float(np.median(np.diff(time[seen]))) if seen.sum() > 2 else 0.0


def on_clock(time: Array, values: Array, grid: Array) -> Array:
    """Values (T, ...) at other times, linearly; NaN in gaps and beyond the ends.

    Quaternions come out as they are: their signs are made continuous first where `values` has four components.
    """
    flat = values.reshape(time.size, -1)
    if values.ndim == 2 and values.shape[1] == 4:
        flat = continuous(flat)
    out = np.full((grid.size, flat.shape[1]), np.nan)
    for j in range(flat.shape[1]):
        seen = np.isfinite(flat[:, j])
        if seen.sum() < 3:
            continue
        t, x = time[seen], flat[seen, j]
        bridge = _BRIDGE * max(float(np.median(np.diff(t))), float(grid[1] - grid[0]))
        after = np.clip(np.searchsorted(t, grid), 1, t.size - 1)
        near = (t[after] - t[after - 1] <= bridge) & (grid >= t[0] - 1e-9) & (grid <= t[-1] + 1e-9)
        out[near, j] = _level(t, x, grid[near], float(grid[1] - grid[0]))
    return out.reshape(grid.size, *values.shape[1:])


def _level(t: Array, x: Array, at: Array, step: float) -> Array:
    """Values at times, or means about them where samples are closer than the step: noise must not be aliased."""
    if np.median(np.diff(t)) > 0.75 * step:
        return np.asarray(np.interp(at, t, x))
    total = np.concatenate([[0.0], np.cumsum(0.5 * (x[1:] + x[:-1]) * np.diff(t))])
    low, high = np.maximum(at - 0.5 * step, t[0]), np.minimum(at + 0.5 * step, t[-1])
    return np.asarray((np.interp(high, t, total) - np.interp(low, t, total)) / np.maximum(high - low, 1e-12))


def continuous(q: Array) -> Array:
    """Quaternions (T, 4) whose signs go on from sample to sample; gaps stay gaps, norms stay."""
    made, seen = q.copy(), np.isfinite(q).all(axis=1)
    x = made[seen]
    if len(x) > 1:
        flips = np.where(np.sum(x[1:] * x[:-1], axis=1) < 0.0, -1.0, 1.0)
        made[seen] = x * np.concatenate([[1.0], np.cumprod(flips)])[:, None]
    return made


def mean(x: Array, axis: int) -> Array:
    """Mean over an axis, NaN where any part is missing."""
    return np.asarray(x.mean(axis=axis))


def spread(x: Array) -> float:
    """Root mean square of the smaller nine tenths of the finite values; NaN where there are none."""
    size = np.sort(np.abs(x[np.isfinite(x)]))
    kept = size[: max(int(_KEPT * size.size), 1)]
    return float(np.sqrt(np.mean(kept**2))) if size.size else np.nan


def typical(x: Array) -> float:
    """Median of the finite values; NaN where there are none."""
    seen = x[np.isfinite(x)]
    return float(np.median(seen)) if seen.size else np.nan


def boxcar(x: Array, samples: int) -> Array:
    """Means over windows of so many intervals, ends weighted by a half (T - samples, ...); NaN where one is missing."""
    flat = x.reshape(x.shape[0], -1)
    middle = 0.5 * (flat[1:] + flat[:-1])
    gone = np.isnan(middle)
    total = np.cumsum(np.concatenate([np.zeros((1, flat.shape[1])), np.where(gone, 0.0, middle)]), axis=0)
    lost = np.cumsum(np.concatenate([np.zeros((1, flat.shape[1]), int), gone]), axis=0)
    means = (total[samples:] - total[:-samples]) / samples
    means[lost[samples:] > lost[:-samples]] = np.nan
    return np.asarray(means.reshape(-1, *x.shape[1:]))


def smoothed(x: Array, samples: int) -> Array:
    """Means over windows of the finite values (T - samples, ...); NaN where fewer than half are."""
    seen = np.isfinite(x)
    share = boxcar(seen.astype(float), samples)
    total = boxcar(np.where(seen, x, 0.0), samples)
    return np.where(share >= 0.5, total / np.maximum(share, 0.5), np.nan)


def slope(x: Array, samples: int, step: float) -> Array:
    """Differences over so many samples per time (T - samples, ...)."""
    return np.asarray((x[samples:] - x[:-samples]) / (samples * step))


def turned(q: Array, v_b: Array) -> Array:
    """Earth components of vectors given in body axes, by quaternions of any norm (T, 4), (T, 3) or (3,) -> (T, 3)."""
    unit = q / np.linalg.norm(q, axis=-1, keepdims=True)
    w, u = unit[:, :1], unit[:, 1:]
    twice = 2.0 * np.cross(u, np.broadcast_to(v_b, u.shape))
    return np.asarray(v_b + w * twice + np.cross(u, twice))


def conjugate(q: Array) -> Array:
    """The opposite rotation (..., 4)."""
    return np.asarray(q * np.array([1.0, -1.0, -1.0, -1.0]))
