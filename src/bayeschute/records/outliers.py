"""Outlier detection: values out of range, stuck values, spikes and level shifts.

Detection is robust (Hampel 1974) and works on steps between valid samples, not on levels: the predicted step is the
median rate of the steps before or after; what exceeds it is an outlier if it is large both against the channel's own
scatter and against what the vehicle can do. A level that shifts stays as it is, without the samples beside the shift.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from bayeschute.records.record import QUANTITIES, VARIABLES, Repair
from bayeschute.records.resample import Channel

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SIGMAS = 8.0  # steps beyond this many robust standard deviations are outliers, if they also exceed the floors below
_NEIGHBOURS = 7  # samples on either side of a step that predict it
_FORESIGHT, _MOST_NEIGHBOURS = 2.0, 200  # before a gap: so long a stretch [s], but at most so many samples
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


# Sized by what a body under a parachute can do: some metres, and a rate that varies by metres per second in a gap.
SMOOTH = {
    "capsule_position": Scale(5.0, 4.0),
    "canopy_position": Scale(1.0, 6.0),
    "altitude": Scale(5.0, 2.0),
    "latitude": Scale(20.0 / _EARTH_RADIUS, 5.0 / _EARTH_RADIUS),
    "longitude": Scale(20.0 / _EARTH_RADIUS, 5.0 / _EARTH_RADIUS),
    "capsule_velocity": Scale(3.0, 5.0),
    "canopy_velocity": Scale(3.0, 6.0),
    "descent_rate": Scale(3.0, 5.0),
    "pressure": Scale(100.0, 50.0),
    "temperature": Scale(2.0, 0.5),
    "density": Scale(0.01, 0.005),
    "wind": Scale(5.0, 2.0),
}
# Snatch loads and spin are real there: only lone samples far outside their neighbourhood are dropped.
ROUGH = {"capsule_rate": 2.0, "capsule_specific_force": 50.0, "riser_tension": 0.0}


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


def _nanmedian(windows: NDArray) -> Array:
    """Medians of rows; NaN where a row has no number."""
    out = np.full(windows.shape[0], np.nan)
    some = np.isfinite(windows).any(axis=1)
    out[some] = np.nanmedian(windows[some], axis=1)
    return out


def _moving_median(x: Array, half: int) -> Array:
    """Median of every element and `half` more on either side."""
    return _nanmedian(sliding_window_view(np.pad(x, half, constant_values=np.nan), 2 * half + 1))


def _rates(x: Array, t: Array, n: int) -> tuple[Array, Array]:
    """Median rates over the n samples before and after every step (S,), from differences over half of them."""
    lag = (n + 1) // 2
    pairs = n - lag + 1
    empty = np.full(n + 1, np.nan)
    slopes = np.concatenate([empty, (x[lag:] - x[:-lag]) / (t[lag:] - t[:-lag]), empty])
    medians = _nanmedian(sliding_window_view(slopes, pairs))  # medians[j + n + 1]: pairs that start at j and later
    steps = np.arange(x.size - 1)
    before = medians[np.clip(steps - lag - pairs + 1 + n + 1, 0, medians.size - 1)]
    after = medians[np.clip(steps + 1 + n + 1, 0, medians.size - 1)]
    return np.where(np.isnan(before), after, before), np.where(np.isnan(after), before, after)


def _excess(x: Array, t: Array) -> tuple[Array, Array]:
    """Part of every step that neither side foretells (S,), and the standard deviation to be expected of it (S,)."""
    step, dt = np.diff(x), np.diff(t)
    usual = float(np.median(dt))
    before, after = _rates(x, t, min(_NEIGHBOURS, x.size - 1))
    reach = np.full(dt.size, float(_NEIGHBOURS))
    gap = dt > 1.5 * usual
    if gap.any():  # far ahead only a longer past foretells
        n = min(int(np.clip(np.ceil(_FORESIGHT / usual), _NEIGHBOURS, _MOST_NEIGHBOURS)), x.size - 1)
        farther = _rates(x, t, n)
        before, after = np.where(gap, farther[0], before), np.where(gap, farther[1], after)
        reach[gap] = n
    low, high = np.minimum(before, after) * dt, np.maximum(before, after) * dt
    beyond = np.where(step > high, step - high, np.where(step < low, step - low, 0.0))
    off = np.abs(step - _moving_median(step / dt, _NEIGHBOURS) * dt) / np.maximum(dt / usual, 1.0)
    scatter = _SD_PER_MAD * np.fmax(_moving_median(off, _AROUND), np.nanmedian(off))
    return np.nan_to_num(beyond), scatter * np.hypot(1.0, dt / (reach * usual))  # of the step and of the rate foretold


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
    scatter = np.array([np.median(_excess(c, t)[1]) for c in x.T])
    for a, b in _runs(same):
        if b - a + 1 < 3:
            continue
        m = max(b - a + 1, _NEIGHBOURS)
        sides = [(max(a - m, 0), a), (b + 2, min(b + 2 + m, at.size - 1))]
        slopes = [np.abs((x[j] - x[i]) / (t[j] - t[i])) for i, j in sides if j - i >= _NEIGHBOURS]
        moved = (np.min(slopes, axis=0) if slopes else np.zeros(x.shape[1])) * (t[b + 1] - t[a])
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
        beyond, scatter = _excess(x[:, c], t)
        least = scale.step + scale.rate * np.maximum(dt - usual, 0.0)
        limit = np.maximum(_SIGMAS * scatter, least)
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
        off = np.abs(x - _moving_median(x, 2))
        local = _moving_median(off, _AROUND)
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
        found += _listed(
            "stuck", channel, stuck, "repeats the sample before: stuck, or at rest at the end of the record"
        )
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
