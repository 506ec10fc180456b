"""Groups of a NetCDF file, read one by one."""

from __future__ import annotations

from pathlib import Path

import h5netcdf
import xarray as xr


def load_groups(path: Path, *names: str) -> tuple[xr.Dataset, ...]:
    """Some first-level groups of a file, in memory; an empty dataset for a group that the file does not have.

    The others stay unread: in ``posterior.nc`` the simulated records of all draws are a hundred times as large as the
    draws themselves.

    Args:
        path: The file.
        names: Of the groups.
    """
    with h5netcdf.File(path) as file:
        has = set(file.groups)
    return tuple(
        xr.load_dataset(path, group=name, engine="h5netcdf") if name in has else xr.Dataset() for name in names
    )
