"""White noise of a record's channels, told by the record itself."""

from __future__ import annotations

from math import comb

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayeschute.records.angles import unit
from bayeschute.records.plausibility.evidence import continuous

Array = NDArray[np.float64]
_ORDER = 4  # of the differences: what a cluster does between samples has next to no part in them
_FEWEST = 50  # samples that tell a scatter
_CHANNELS = ("canopy_position", "capsule_velocity", "riser_tension", "canopy_velocity", "swing_angle", "descent_rate")


def scatter(x: Array) -> float:
    """Standard deviation of the white part of a series, from the median of its fourth differences.

    Args:
        x: At even times (T,); NaN where nothing was recorded.

    Returns:
        In the unit of the series; NaN of fewer than 50 samples.
    """
    known = x[np.isfinite(x)]
    if known.size < _FEWEST:
        return np.nan
    return float(np.median(np.abs(np.diff(known, _ORDER))) / 0.6745 / np.sqrt(comb(2 * _ORDER, _ORDER)))


def scatter_of_channels(record: xr.Dataset) -> dict[str, float]:
    """White noise of the channels that can be fitted, the median over their components, in SI.

    Positions of canopies are relative to the capsule, as they are fitted; an attitude's is a rotation about any axis.

    Args:
        record: As read.

    Returns:
        By channel; none of channels that tell no scatter (rounded to few steps, or short).
    """
    series = {name: record[name].values for name in _CHANNELS if name in record}
    if "canopy_position" in series and "capsule_position" in record:
        series["canopy_position"] = series["canopy_position"] - record["capsule_position"].values[:, None]
    found = {}
    for name, values in series.items():
        each = [one for one in map(scatter, values.reshape(len(values), -1).T) if np.isfinite(one)]
        found[name] = float(np.median(each)) if each else np.nan
    if "capsule_attitude" in record:
        parts = [scatter(x) for x in continuous(unit(record["capsule_attitude"].values)).T]
        found["capsule_attitude"] = float(2.0 * np.sqrt(np.sum(np.square(parts)) / 3.0))
    return {name: value for name, value in found.items() if np.isfinite(value) and value > 0.0}
