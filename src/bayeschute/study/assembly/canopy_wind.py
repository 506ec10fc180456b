"""Wind difference between capsule and canopies in a fit, from a wind profile by altitude.

The recorded wind is that at the capsule, and canopies fly some 70 m above it. A profile gives the change of the wind up
to the canopies: the wind at altitude h is the recorded wind plus ``profile(h) - profile(altitude of the capsule)``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayeschute.dynamics.cluster_flight import ClusterFlight
from bayeschute.likelihood.channels import filled
from bayeschute.likelihood.joint import FlightData
from bayeschute.records.record import VARIABLES, Repair, with_repairs
from bayeschute.study.assembly import assemble
from bayeschute.study.schema.wind_schema import ProfileTable

Array = NDArray[np.float64]


def with_wind(record: xr.Dataset, table: ProfileTable) -> xr.Dataset:
    """A record with the profile's wind at the capsule, where no wind is recorded.

    Args:
        record: With ``capsule_position``.
        table: The profile.
    """
    if "wind" in record or "capsule_position" not in record:
        return record
    variable, time = VARIABLES["wind"], record["time"].values
    values = assemble.wind_profile(table).at(_capsule_altitude(record))
    attributes = {"units": variable.unit, "long_name": variable.meaning}
    note = Repair("derived", "wind", float(time[0]), float(time[-1]), time.size, "wind by altitude of the study")
    return with_repairs(record.assign(wind=(variable.dims, values, attributes)), [note])


def canopy_wind(record: xr.Dataset, table: ProfileTable) -> Array:
    """Wind of the canopies less that of the capsule (T, n, 3), NED [m/s].

    Args:
        record: With ``capsule_position`` and ``canopy_position``.
        table: The profile.
    """
    profile, capsule = assemble.wind_profile(table), _capsule_altitude(record)
    aloft = _origin(record) - filled(record["canopy_position"].values, "canopy_position")[..., 2]
    return profile.at(aloft) - profile.at(capsule)[:, None]


def by_altitude(data: FlightData, record: xr.Dataset, table: ProfileTable) -> FlightData:
    """A cluster's data in which the wind at every body is that at its altitude.

    Args:
        data: From `bayeschute.likelihood.channels.cluster_data`.
        record: The record they are of.
        table: The profile.
    """
    profile, model = assemble.wind_profile(table), data.model
    assert isinstance(model, ClusterFlight)
    given = replace(model.record, wind=np.asarray(model.record.wind) - profile.at(_capsule_altitude(record)))
    return replace(data, model=replace(model, record=given, wind_field=profile.field(_origin(record))))


def _origin(record: xr.Dataset) -> float:
    """Altitude of the origin of positions [m]; 0 where no altitude is recorded."""
    if "altitude" not in record:
        return 0.0
    apart = record["altitude"].values + record["capsule_position"].values[:, 2]
    return float(np.median(apart[np.isfinite(apart)])) if np.isfinite(apart).any() else 0.0


def _capsule_altitude(record: xr.Dataset) -> Array:
    """Altitude of the capsule (T,) [m]."""
    return np.asarray(_origin(record) - filled(record["capsule_position"].values, "capsule_position")[:, 2])
