"""Cleaning of a record: outliers are dropped (`bayeschute.records.outliers`), the rest is resampled uniformly.

No data are invented, and every change is listed in the attribute ``repairs``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.errors import Fault, InputError
from bayeschute.records.outliers import find_faulty
from bayeschute.records.record import QUANTITIES, VARIABLES, Repair, make_record, repairs, with_repairs
from bayeschute.records.resample import Channel, Grid, resample

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["channels", "clean", "repairs"]

Array = NDArray[np.float64]


def channels(record: xr.Dataset) -> list[Channel]:
    """The channels of a record.

    Raises:
        InputError: On a variable that is not of the schema.
    """
    time, known = record["time"].values.astype(float), {**VARIABLES, **QUANTITIES}
    out: list[Channel] = []
    for variable in map(str, record.data_vars):
        if variable not in known:
            raise InputError(Fault(f"record {variable}", "an unknown variable", "one of the schema", "Leave it out."))
        dims = known[variable].dims
        values = record[variable].transpose(*dims).values.astype(float)
        several = range(values.shape[1]) if "canopy" in dims else [None]
        for canopy in several:
            here = values if canopy is None else values[:, canopy]
            here = here.reshape(time.size, -1)
            name = variable if canopy is None else f"{variable}.{canopy + 1}"
            out.append(Channel(name, variable, canopy, time, here, np.isfinite(here).all(axis=1)))
    return out


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
        dims = (VARIABLES.get(channel.variable) or QUANTITIES[channel.variable]).dims
        shape = (grid.size, *(record.sizes[d] for d in dims[1:]))
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
