"""Winds of landings from arrays of statistics."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from bayeschute.study.landing_campaign.campaign_climatology import ClimatologyTable
from bayeschute.study.schema.schema_faults import validated


def wind_climatology(
    altitude: ArrayLike,
    north: ArrayLike,
    east: ArrayLike,
    north_sd: ArrayLike,
    east_sd: ArrayLike,
    *,
    length: float,
    correlation: ArrayLike | None = None,
) -> ClimatologyTable:
    """Mean and scatter of the wind by altitude, for `Posterior.land`; air moves *towards* north and east.

    Every landing has a wind of its own: normal at every altitude, correlated by exp(-d / length) over a distance d.

    Args:
        altitude: Geometric altitude, increasing (K,) [m].
        north: Mean velocity of the air to the north (K,) [m/s].
        east: To the east (K,) [m/s].
        north_sd: Standard deviation of the velocity to the north (K,) [m/s].
        east_sd: To the east (K,) [m/s].
        length: Of correlation in altitude [m].
        correlation: Of the velocities to the north and east (K,) [1]; 0 where None.

    Raises:
        InputError: With every fault.

    Example:
        >>> import bayeschute as bc
        >>> june = bc.wind_climatology([0.0, 2000.0], [3.0, 6.0], [1.0, -2.0], [2.0, 4.0], [2.0, 5.0], length=1500.0)
        >>> june.north_sd
        (2.0, 4.0)
    """
    columns = {"north": north, "east": east, "north_sd": north_sd, "east_sd": east_sd}
    said: dict[str, object] = {"altitude": _written(altitude, "m"), "length": f"{float(length)!r} m"}
    said |= {name: _written(values, "m/s") for name, values in columns.items()}
    if correlation is not None:
        said["correlation"] = np.asarray(correlation, float).ravel().tolist()
    return validated(ClimatologyTable, "wind_climatology", said)


def _written(values: ArrayLike, unit: str) -> list[str]:
    """Numbers as a campaign file has them."""
    return [f"{value!r} {unit}" for value in np.asarray(values, float).ravel().tolist()]
