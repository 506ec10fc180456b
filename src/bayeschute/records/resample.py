"""Resampling of one channel to a uniform sampling rate, without filling gaps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bayeschute.records.record import Repair

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_FINE = 4  # at least so many points of the fine clock per new sample when averaging


@dataclass(frozen=True)
class Channel:
    """One instrument's series: a scalar, or the components that are valid or not together.

    Attributes:
        name: Variable, with the canopy where there are several (``canopy_position.1``).
        variable: Variable.
        canopy: Index of the canopy, from 0, or None.
        time: Times (T,) [s].
        values: Samples (T, C), SI.
        valid: Samples with all components present (T,).
        breaks: Times of shifts of level, across which nothing is interpolated [s].
    """

    name: str
    variable: str
    canopy: int | None
    time: Array
    values: Array
    valid: Mask
    breaks: tuple[float, ...] = ()


@dataclass(frozen=True)
class Grid:
    """The uniform clock.

    Attributes:
        time: Times (N,) [s].
        rate: [Hz].
        max_gap: Longest distance to interpolate across [s], or None for the default.
    """

    time: Array
    rate: float
    max_gap: float | None = None


def default_max_gap(native: float) -> float:
    """0.5 s or 1.5 sample intervals, whichever is longer [s]."""
    return max(0.5, 1.5 * native)


def same_sign(q: Array) -> Array:
    """Quaternions (T, 4) with signs chosen so that neighbours lie on the same half of the sphere."""
    if len(q) == 0:
        return q
    flips = np.where(np.sum(q[1:] * q[:-1], axis=1) < 0.0, -1.0, 1.0)
    return np.concatenate([q[:1], q[1:] * np.cumprod(flips)[:, None]])


def _slerp(a: Array, b: Array, share: Array) -> Array:
    """Unit quaternions between `a` and `b` (N, 4) along the great circle (Shoemake 1985)."""
    angle = np.arctan2(np.linalg.norm(b - a, axis=1), np.linalg.norm(b + a, axis=1)) * 2.0
    sine = np.sin(angle)
    small = sine < 1e-8
    safe = np.where(small, 1.0, sine)
    wa = np.where(small, 1.0 - share, np.sin((1.0 - share) * angle) / safe)
    wb = np.where(small, share, np.sin(share * angle) / safe)
    q = wa[:, None] * a + wb[:, None] * b
    return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))


@dataclass(frozen=True)
class _Samples:
    """Valid samples of a channel and where they may be joined.

    Attributes:
        t: Times (S,) [s].
        x: Values (S, C).
        joined: Whether sample i and the next may be joined (S - 1,).
        attitude: Whether the values are quaternions.
    """

    t: Array
    x: Array
    joined: Mask
    attitude: bool

    def at(self, where: Array) -> Array:
        """Values at times `where` (N,); NaN outside the samples and where they are not joined."""
        out = np.full((where.size, self.x.shape[1]), np.nan)
        if self.t.size == 0:
            return out
        near = 1e-6 * (np.median(np.diff(self.t)) if self.t.size > 1 else 1.0)
        right = np.clip(np.searchsorted(self.t, where), 0, self.t.size - 1)
        left = np.maximum(right - 1, 0)
        for candidate in (left, right):  # a sample at that very time needs no neighbour
            hit = np.abs(self.t[candidate] - where) <= near
            out[hit] = self.x[candidate[hit]]
        if self.t.size == 1:
            return out
        covered = (self.t[left] <= where) & (where <= self.t[right]) & self.joined[left.clip(max=self.t.size - 2)]
        inside = np.isnan(out[:, 0]) & covered
        a, b = left[inside], right[inside]
        share = (where[inside] - self.t[a]) / (self.t[b] - self.t[a])
        if self.attitude:
            out[inside] = _slerp(self.x[a], self.x[b], share)
        else:
            out[inside] = self.x[a] + share[:, None] * (self.x[b] - self.x[a])
        return out


def resample(channel: Channel, grid: Grid) -> tuple[Array, list[Repair]]:
    """Put a channel on a uniform clock.

    Args:
        channel: The series; only its valid samples count.
        grid: The clock.

    Returns:
        Values (N, C), NaN where nothing is known, and the list of gaps bridged and left open.
    """
    t, x = channel.time[channel.valid], channel.values[channel.valid]
    attitude = channel.variable == "capsule_attitude"
    if attitude:
        x = same_sign(x / np.linalg.norm(x, axis=1, keepdims=True))
    elif channel.variable == "longitude":
        x = np.unwrap(x, axis=0)
    native = float(np.median(np.diff(t))) if t.size > 1 else 1.0 / grid.rate
    max_gap = default_max_gap(native) if grid.max_gap is None else max(grid.max_gap, 1.5 * native)
    joined = np.diff(t) <= max_gap * (1.0 + 1e-9)
    for at in channel.breaks:
        joined[(t[:-1] < at) & (at < t[1:])] = False
    samples = _Samples(t, x, joined, attitude)
    values = samples.at(grid.time)
    notes = _mean_corrections(channel.name, t, joined, grid, native)
    if 1.0 / grid.rate > 2.0 * native:
        values = _averaged(samples, grid, native, values)
        detail = f"mean over {1.0 / grid.rate:.4g} s of samples {native:.4g} s apart"
        notes.append(_resampled(channel.name, grid, detail))
    elif native > 1.01 / grid.rate:
        detail = f"interpolated from samples {native:.4g} s apart: no new information"
        within = (t >= grid.time[0] - 0.5 / grid.rate) & (t <= grid.time[-1] + 0.5 / grid.rate)
        notes.append(replace(_resampled(channel.name, grid, detail), times=tuple(t[within].tolist())))
    if attitude:
        known = np.isfinite(values).all(axis=1)
        values[known] = same_sign(values[known] / np.linalg.norm(values[known], axis=1, keepdims=True))
    elif channel.variable == "longitude":
        values = np.mod(values + np.pi, 2.0 * np.pi) - np.pi
    return values, notes


def _resampled(name: str, grid: Grid, detail: str) -> Repair:
    return Repair("resampled", name, float(grid.time[0]), float(grid.time[-1]), grid.time.size, detail)


def _averaged(samples: _Samples, grid: Grid, native: float, plain: Array) -> Array:
    """Means over one new interval about each new time, where it is fully covered; else the plain interpolation.

    The mean of a part of the interval would be off by the motion, so it is not taken.
    """
    points = max(_FINE, int(np.ceil(1.0 / (grid.rate * native))))
    offset = ((np.arange(points) + 0.5) / points - 0.5) / grid.rate
    fine = samples.at((grid.time[:, None] + offset).ravel())
    mean = fine.reshape(grid.time.size, points, -1).mean(axis=1)
    return np.where(np.isfinite(mean), mean, plain)


def _mean_corrections(name: str, t: Array, joined: Mask, grid: Grid, native: float) -> list[Repair]:
    """Gaps inside the clock's span, bridged or left open, and ends that no sample covers."""
    first, last = float(grid.time[0]), float(grid.time[-1])
    low, high = np.searchsorted(t, [first, last])
    low, high = max(int(low) - 1, 0), min(int(high) + 1, t.size)
    inside, joined = t[low:high], joined[low : max(high - 1, low)]
    if inside.size == 0:
        return [Repair("gap", name, first, last, grid.time.size, "no valid sample")]
    notes = []
    edge = max(native, 1.0 / grid.rate)
    for a, b in ((first, float(inside[0])), (float(inside[-1]), last)):
        if b - a > edge:
            notes.append(Repair("gap", name, a, b, int(round((b - a) / native)), "no sample at the end of the window"))
    step = np.diff(inside)
    for i in np.flatnonzero((step > 1.5 * native) | ~joined):
        missing = max(int(round(step[i] / native)) - 1, 1)
        kind, detail = ("interpolated", "linear interpolation") if joined[i] else ("gap", "not filled")
        notes.append(Repair(kind, name, float(inside[i]), float(inside[i + 1]), missing, detail))
    return notes
