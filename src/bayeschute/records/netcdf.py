"""NetCDF files of unknown origin: tried in a child process first, as damaged ones can hang or kill the HDF5 library."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from bayeschute.core.errors import Fault, InputError

if TYPE_CHECKING:
    import xarray as xr

LARGEST_VALUES = 50_000_000  # numbers in one variable; more is taken for a damaged file
PATIENCE = 15.0  # for the child process [s]

# Everything that is read later is touched once: attributes and values of every object. 3: no h5py to try it with.
_TRIAL = """
import sys
try:
    import h5py
except ImportError:
    sys.exit(3)
def touch(name, thing):
    list(thing.attrs.items())
    if isinstance(thing, h5py.Dataset) and thing.size is not None and thing.size <= int(sys.argv[2]):
        thing[()]
with h5py.File(sys.argv[1], "r") as file:
    touch("/", file)
    file.visititems(touch)
"""


def said(error: BaseException) -> str:
    """What another library said of a file: kind and message on one line, cut short."""
    return f"{type(error).__name__}: {' '.join(str(error).split())[:120]}"


def try_netcdf(path: Path, patience: float = PATIENCE) -> None:
    """Read a file once in a child process.

    Args:
        path: The file.
        patience: Time after which a read counts as hung [s].

    Raises:
        InputError: If the child fails, dies or doesn't come to an end.
    """
    command = [sys.executable, "-c", _TRIAL, str(path), str(LARGEST_VALUES)]
    place, wanted, advice = str(path), "a NetCDF-4 file", "Copy it again."
    if not sys.executable:
        return
    try:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=patience, check=False)
    except subprocess.TimeoutExpired as error:
        got = f"a file whose reading came to no end in {patience:g} s"
        raise InputError(Fault(place, got, wanted, advice)) from error
    if done.returncode in (0, 3):
        return
    last = (done.stderr.decode("utf-8", "replace").strip().splitlines() or ["no message"])[-1]
    how = f"signal {-done.returncode}" if done.returncode < 0 else last[:150]
    raise InputError(Fault(place, f"a file that can't be read ({how})", wanted, advice))


def open_netcdf(path: Path, trusted: bool = False) -> xr.Dataset:
    """A NetCDF file's contents, loaded, times left as numbers.

    Args:
        path: The file.
        trusted: Whether the file was written here, so that it need not be tried in a child process.

    Returns:
        The contents.

    Raises:
        InputError: If the file can't be read.
    """
    if not trusted:
        try_netcdf(path)
    import h5py
    import xarray as xr

    try:
        with h5py.File(path, "r") as file:  # what is damaged stops here: the clean-up of h5netcdf would print
            list(file.attrs.items())
        with xr.open_dataset(path, engine="h5netcdf", decode_times=False, decode_timedelta=False) as ds:
            most = max((v.size for v in ds.variables.values()), default=0)
            if most > LARGEST_VALUES:
                got = f"a variable of {most} values"
                raise InputError(Fault(str(path), got, f"at most {LARGEST_VALUES}", "The file may be damaged."))
            return ds.load()
    except InputError:
        raise
    except Exception as error:  # HDF5, h5netcdf and xarray raise many kinds on damaged files
        got = f"a file that can't be read ({said(error)})"
        raise InputError(Fault(str(path), got, "a NetCDF-4 file", "Copy it again.")) from error
