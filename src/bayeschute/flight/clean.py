"""Cleaning of a record: what a sensor can't have meant is dropped, the rest is put on a uniform clock.

Detection is robust (Hampel 1974) and works on steps between valid samples, not on levels: the step foretold is the
median rate of the steps before or after; what exceeds it is an outlier if it is large both against the channel's own
scatter and against what the vehicle can do. Nothing is invented: a level that shifts stays as it is, without the
samples beside the shift, and everything done is listed in the attribute ``repairs``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from bayeschute.errors import Fault, InputError
from bayeschute.flight.record import QUANTITIES, VARIABLES, Repair, make_record, repairs, with_repairs
from bayeschute.flight.resample import Grid, resample

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["Channel", "channels", "clean", "find_faulty", "repairs"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SIGMAS = 8.0  # steps beyond this many robust standard deviations are outliers, if they also exceed the floors below
_NEIGHBOURS = 7  # steps on either side that foretell a step
_BURST = 5  # at most so many samples between two opposite steps are a burst of outliers, not a level
_AROUND = 30  # steps on either side whose scatter counts, beside that of the whole channel
_SD_PER_MAD = 1.4826  # of a normal distribution
_LONGEST_STEP = 30.0  # steps across longer gaps are not judged [s]
_ROUNDS = 4  # passes: an outlier may hide its neighbour
_EARTH_RADIUS = 6.371e6  # [m]


@dataclass(frozen=True)
class Scale:
    """What a step of a smooth channel may exceed its foretold size by, whatever the scatter.

    Attributes:
        step: Between neighbouring samples, unit of the variable.
        rate: More for every second of a gap, unit of the variable per second.
    """

    step: float
    rate: float


# Sized by what a body under a parachute can do: some metres, and some metres per second that vary within a gap.
SMOOTH = {
    "capsule_position": Scale(5.0, 2.0),
    "canopy_position": Scale(1.0, 2.0),
    "altitude": Scale(5.0, 2.0),
    "latitude": Scale(20.0 / _EARTH_RADIUS, 5.0 / _EARTH_RADIUS),
    "longitude": Scale(20.0 / _EARTH_RADIUS, 5.0 / _EARTH_RADIUS),
    "capsule_velocity": Scale(3.0, 5.0),
    "descent_rate": Scale(3.0, 5.0),
    "pressure": Scale(100.0, 50.0),
    "temperature": Scale(2.0, 0.5),
    "density": Scale(0.01, 0.005),
    "wind": Scale(5.0, 2.0),
}
# Snatch loads and spin are real there: only lone samples far outside their neighbourhood are dropped.
ROUGH = {"capsule_rate": 2.0, "capsule_specific_force": 50.0, "riser_tension": 0.0}


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


def channels(record: xr.Dataset) -> list[Channel]:
    """The channels of a record."""
    time, out = record["time"].values.astype(float), []
    for variable in map(str, record.data_vars):
        values = record[variable].values.astype(float)
        dims = VARIABLES[variable].dims if variable in VARIABLES else QUANTITIES[variable].dims
        several = range(values.shape[1]) if "canopy" in dims else [None]
        for canopy in several:
            here = values if canopy is None else values[:, canopy]
            here = here.reshape(time.size, -1)
            name = variable if canopy is None else f"{variable}.{canopy + 1}"
            out.append(Channel(name, variable, canopy, time, here, np.isfinite(here).all(axis=1)))
    return out


def _runs(mask: Mask) -> list[tuple[int, int]]:
    """First and last index of every run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _listed(kind: str, channel: Channel, where: Mask, detail: str) -> list[Repair]:
    """One repair for every run of samples, counted among the channel's valid samples."""
    at = np.flatnonzero(channel.valid)
    found = _runs(where[at])
    t = channel.time[at]
    return [Repair(kind, channel.name, float(t[a]), float(t[b]), b - a + 1, detail) for a, b in found]


def _dropped(channel: Channel, where: Mask) -> Channel:
    return replace(channel, valid=channel.valid & ~where)


def _out_of_range(channel: Channel) -> tuple[Channel, list[Repair]]:
    """Drop values that can't be: outside the variable's range, or no rotation."""
    variable = VARIABLES.get(channel.variable) or QUANTITIES[channel.variable]
    wrong = ((channel.values < variable.least) | (channel.values > variable.most)).any(axis=1)
    detail = f"outside {variable.least:g} to {variable.most:g} {variable.unit}"
    if channel.variable == "capsule_attitude":
        wrong = np.abs(np.linalg.norm(channel.values, axis=1) - 1.0) > 0.05
        detail = "length of the quaternion differs from 1 by more than 5 %"
    wrong &= channel.valid
    return _dropped(channel, wrong), _listed("out_of_range", channel, wrong, detail)


def _medians(rate: Array) -> tuple[Array, Array, Array]:
    """Medians of the rates before, after and around each step (S,); NaN where there is none."""
    n = min(_NEIGHBOURS, max(rate.size - 1, 1))
    padded = np.concatenate([np.full(n, np.nan), rate, np.full(n, np.nan)])
    windows = sliding_window_view(padded, n)  # windows[i] = the n steps before step i
    both = sliding_window_view(padded, 2 * n + 1)
    with np.errstate(all="ignore"):
        return _nanmedian(windows[: rate.size]), _nanmedian(windows[n + 1 :]), _nanmedian(both)


def _nanmedian(windows: NDArray) -> Array:
    out = np.full(windows.shape[0], np.nan)
    some = np.isfinite(windows).any(axis=1)
    out[some] = np.nanmedian(windows[some], axis=1)
    return out


def _excess(x: Array, dt: Array) -> tuple[Array, Array]:
    """Part of every step that neither side foretells (S,), and the scatter of steps of the usual length there (S,)."""
    step, usual = np.diff(x), float(np.median(dt))
    before, after, around = _medians(step / dt)
    before, after = np.where(np.isnan(before), after, before), np.where(np.isnan(after), before, after)
    low, high = np.minimum(before, after) * dt, np.maximum(before, after) * dt
    beyond = np.where(step > high, step - high, np.where(step < low, step - low, 0.0))
    off = np.abs(step - around * dt) / np.sqrt(dt / usual)
    local = _nanmedian(sliding_window_view(np.pad(off, _AROUND, constant_values=np.nan), 2 * _AROUND + 1))
    return np.nan_to_num(beyond), _SD_PER_MAD * np.fmax(local, np.nanmedian(off))


def _stuck(channel: Channel) -> Mask:
    """Repeats of one value while the channel should have moved: all but the first."""
    at = np.flatnonzero(channel.valid)
    wrong = np.zeros(channel.valid.size, bool)
    if at.size < 4 * _NEIGHBOURS:
        return wrong
    x, t = channel.values[at], channel.time[at]
    same = (np.diff(x, axis=0) == 0.0).all(axis=1)
    if channel.variable not in SMOOTH:
        noisy = same.mean() < 0.05
        for a, b in _runs(same):
            wrong[at[a + 1 : b + 2]] = noisy and b - a + 1 >= 8
        return wrong
    scale = SMOOTH[channel.variable]
    moving = ~same
    rate = np.where(moving[:, None], np.diff(x, axis=0), np.nan) / np.diff(t)[:, None]
    scatter = np.array([np.median(_excess(c, np.diff(t))[1]) for c in x.T])
    for a, b in _runs(same):
        if b - a + 1 < 3:
            continue
        sides = np.concatenate([rate[max(a - _NEIGHBOURS, 0) : a], rate[b + 1 : b + 1 + _NEIGHBOURS]])
        typical = np.nan_to_num(_nanmedian(sides.T)) if len(sides) else np.zeros(x.shape[1])
        moved = np.abs(typical) * (t[b + 1] - t[a])
        if (moved > np.maximum(scale.step, _SIGMAS * scatter)).any():
            wrong[at[a + 1 : b + 2]] = True
    return wrong


def _smooth_outliers(channel: Channel, scale: Scale) -> tuple[Mask, list[tuple[int, int, str]]]:
    """Outliers of a smooth channel: samples to drop as spikes, and shifts of level (index before, after, detail)."""
    at = np.flatnonzero(channel.valid)
    spikes: Mask = np.zeros(channel.valid.size, bool)
    if at.size < 2 * _NEIGHBOURS:
        return spikes, []
    x, t = channel.values[at], channel.time[at]
    if channel.variable == "longitude":
        x = np.unwrap(x, axis=0)
    dt = np.diff(t)
    usual = float(np.median(dt))
    sizes = np.zeros((dt.size, x.shape[1]))
    for c in range(x.shape[1]):
        beyond, scatter = _excess(x[:, c], dt)
        least = scale.step + scale.rate * np.maximum(dt - usual, 0.0)
        limit = np.maximum(_SIGMAS * scatter * np.sqrt(np.maximum(dt / usual, 1.0)), least)
        sizes[:, c] = np.where((np.abs(beyond) > limit) & (dt < _LONGEST_STEP), beyond, 0.0)
    steps = np.flatnonzero(sizes.any(axis=1))
    shifts: list[tuple[int, int, Array]] = []
    i = 0
    while i < steps.size:
        k, first = int(steps[i]), sizes[steps[i]]
        close = [j for j in range(i + 1, steps.size) if steps[j] - k <= _BURST]
        back = next((j for j in close if first @ sizes[steps[j]] < -0.25 * first @ first), None)
        if back is not None:
            spikes[at[k + 1 : steps[back] + 1]] = True
            i = back
        elif shifts and shifts[-1][1] == at[k]:  # one shift in several steps
            shifts[-1] = (shifts[-1][0], int(at[k + 1]), shifts[-1][2] + first)
        else:
            shifts.append((int(at[k]), int(at[k + 1]), first))
        i += 1
    unit = VARIABLES[channel.variable].unit
    detail = "level shifts by {} {} beyond the motion; not corrected"
    return spikes, [(a, b, detail.format(", ".join(f"{v:+.4g}" for v in size), unit)) for a, b, size in shifts]


def _rough_spikes(channel: Channel, floor: float) -> Mask:
    """Lone samples (one or two) far outside their neighbourhood in a rough channel."""
    at = np.flatnonzero(channel.valid)
    wrong = np.zeros(channel.valid.size, bool)
    if at.size < 4 * _NEIGHBOURS:
        return wrong
    far = np.zeros(at.size, bool)
    for x in channel.values[at].T:
        off = np.abs(x - _nanmedian(sliding_window_view(np.pad(x, 2, constant_values=np.nan), 5)))
        local = _nanmedian(sliding_window_view(np.pad(off, _AROUND, constant_values=np.nan), 2 * _AROUND + 1))
        spread = np.quantile(x, 0.95) - np.quantile(x, 0.05)
        far |= off > np.maximum(_SIGMAS * _SD_PER_MAD * local, max(floor, 0.5 * spread))
    runs = _runs(far)
    for i, (a, b) in enumerate(runs):  # a load that rings is real: its samples are not alone
        apart = all(abs(a - c) > _NEIGHBOURS for c, _ in runs[max(i - 1, 0) : i] + runs[i + 1 : i + 2])
        wrong[at[a : b + 1]] = apart and b - a < 2
    return wrong


def find_faulty(channel: Channel) -> tuple[Channel, list[Repair]]:
    """Drop what a channel can't have meant.

    Args:
        channel: The series.

    Returns:
        The series with fewer valid samples, and what was dropped and why. On either side of a shift of level one
        sample is dropped; the level itself is left alone.
    """
    channel, found = _out_of_range(channel)
    if channel.variable in SMOOTH or channel.variable in ROUGH:
        stuck = _stuck(channel)
        found += _listed("stuck", channel, stuck, "repeats the sample before while the motion goes on")
        channel = _dropped(channel, stuck)
    if channel.variable in ROUGH:
        wrong = _rough_spikes(channel, ROUGH[channel.variable])
        found += _listed("spike", channel, wrong, "lone sample far from its neighbours")
        return _dropped(channel, wrong), found
    if channel.variable not in SMOOTH:
        return channel, found
    scale = SMOOTH[channel.variable]
    for _ in range(_ROUNDS):
        spikes, shifts = _smooth_outliers(channel, scale)
        if not spikes.any():
            break
        found += _listed("spike", channel, spikes, "leaves the motion and returns")
        channel = _dropped(channel, spikes)
    beside = np.zeros(channel.valid.size, bool)
    for a, b, detail in shifts:
        count = int(channel.valid[a : b + 1].sum())
        found.append(Repair("level_shift", channel.name, float(channel.time[a]), float(channel.time[b]), count, detail))
        beside[a : b + 1] = True
    breaks = tuple(0.5 * float(channel.time[a] + channel.time[b]) for a, b, _ in shifts)
    return replace(_dropped(channel, beside), breaks=breaks), found


def clean(
    record: xr.Dataset,
    rate_hz: float,
    window: tuple[float, float] | None = None,
    skip_first: float = 0.0,
    max_gap: float | None = None,
) -> xr.Dataset:
    """Drop outliers, then put every channel on one uniform clock.

    Between valid samples no further apart than `max_gap` the value is interpolated linearly (attitudes along the great
    circle); elsewhere it is NaN. Where the rate falls by more than a factor of two, each value is the mean over one new
    sample interval. The motion of each channel is judged over the whole record, before the window is cut.

    Args:
        record: A valid record in SI (`read_record`, `load_record`).
        rate_hz: New sampling rate [Hz].
        window: First and last time wanted [s]; the whole record where none is given.
        skip_first: Leave out so much after the start of the window [s], e.g. the transient after release.
        max_gap: Longest distance of samples to interpolate across [s]; 0.5 s or 1.5 of the channel's own sample
            intervals, whichever is longer, where none is given.

    Returns:
        The record at the uniform rate, same variables; attribute ``repairs`` lists what was done.

    Raises:
        InputError: If the rate, the window or the gap is unfit, or fewer than 10 samples remain.
    """
    time = record["time"].values.astype(float)
    grid = _grid(time, rate_hz, window, skip_first, max_gap)
    done: list[Repair] = []
    if skip_first > 0.0:
        start = grid[0] - skip_first
        skipped = int(((time >= start) & (time < grid[0])).sum())
        done.append(Repair("skipped", "", float(start), float(grid[0]), skipped, "left out as asked (skip_first)"))
    arrays: dict[str, Array] = {}
    for channel in channels(record):
        kept, found = find_faulty(channel)
        values, filled = resample(kept, Grid(grid, rate_hz, max_gap))
        done += [r for r in found if r.end >= grid[0] and r.start <= grid[-1]] + filled
        shape = (grid.size, *record[channel.variable].shape[1:])
        out = arrays.setdefault(channel.variable, np.full(shape, np.nan))
        target = out if channel.canopy is None else out[:, channel.canopy]
        target[...] = values.reshape(target.shape)
    cleaned = make_record(time=grid, **arrays)
    cleaned.attrs = {**record.attrs, "repairs": record.attrs.get("repairs", "[]")}
    return with_repairs(cleaned, done)


def _grid(
    time: Array, rate_hz: float, window: tuple[float, float] | None, skip_first: float, max_gap: float | None
) -> Array:
    """The uniform clock (N,) [s]."""
    faults = []
    if not (np.isfinite(rate_hz) and rate_hz > 0.0):
        raise InputError(Fault("cleaning, rate", f"{rate_hz} Hz", "a positive rate"))
    if not (np.isfinite(skip_first) and skip_first >= 0.0):
        faults.append(Fault("cleaning, skip_first", f"{skip_first} s", "zero or more"))
    if max_gap is not None and not max_gap >= 0.0:
        faults.append(Fault("cleaning, max_gap", f"{max_gap} s", "zero or more"))
    start, end = window if window is not None else (float(time[0]), float(time[-1]))
    if not start < end:
        faults.append(Fault("cleaning, window", f"{start} to {end} s", "an end after the start"))
    if faults:
        raise InputError(faults)
    start, end = max(start, float(time[0])) + skip_first, min(end, float(time[-1]))
    count = int(np.floor(max(end - start, 0.0) * rate_hz + 1e-6)) + 1
    if not 10 <= count <= 5_000_000:
        got = f"{count} samples at {rate_hz:g} Hz from {start:g} to {end:g} s"
        raise InputError(Fault("cleaning", got, "10 to 5000000", "Change the window, skip_first or the rate."))
    return start + np.arange(count) / rate_hz
