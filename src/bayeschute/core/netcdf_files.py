"""NetCDF files: their groups are read one by one, and they are written from memory."""

from __future__ import annotations

import sys
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

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


def write_netcdf(data: xr.Dataset | xr.DataTree, path: Path, **options: Any) -> None:
    """Write a file, made whole in memory first: HDF5 that can't end a file on a full disk ends the process.

    Args:
        data: What is written.
        path: The file.
        options: Of `xarray`'s ``to_netcdf``.

    Raises:
        OSError: If the disk is full, or the file can't be written.
    """
    with _no_lock_of_a_cluster():
        path.write_bytes(data.to_netcdf(None, engine="h5netcdf", **options))


def _no_lock_of_a_cluster() -> AbstractContextManager[Any]:
    """A worker of a Dask cluster would ask its scheduler for a lock by the file's name, which memory has none of."""
    dask = sys.modules.get("dask")
    return nullcontext() if dask is None else dask.config.set(scheduler="synchronous")
