import errno
import subprocess
import sys

import numpy as np
import pytest
import xarray as xr

from bayeschute.core.netcdf_files import load_groups, write_netcdf


@pytest.fixture
def file(tmp_path):
    groups = {f"/{name}": xr.Dataset({"x": ("t", np.arange(3.0) + i)}) for i, name in enumerate(("a", "b", "c"))}
    xr.DataTree.from_dict(groups).to_netcdf(tmp_path / "x.nc", engine="h5netcdf")
    return tmp_path / "x.nc"


def test_groups_come_in_the_order_asked_for_and_in_memory(file):
    c, a = load_groups(file, "c", "a")
    file.unlink()
    assert c["x"].values.tolist() == [2.0, 3.0, 4.0] and a["x"].values.tolist() == [0.0, 1.0, 2.0]


def test_a_group_that_is_not_there_is_empty(file):
    none, b = load_groups(file, "d", "b")
    assert not none.variables and b["x"].values[0] == 1.0


def test_what_is_no_netcdf_is_told_by_the_library(tmp_path):
    (tmp_path / "x.nc").write_bytes(b"no netcdf")
    with pytest.raises(OSError, match="signature"):
        load_groups(tmp_path / "x.nc", "a")


def test_a_file_is_written_as_xarray_writes_it(tmp_path):
    data = xr.Dataset({"x": ("t", np.arange(4.0), {"units": "m"})}, attrs={"title": "a"})
    write_netcdf(data, tmp_path / "a.nc", encoding={"x": {"fletcher32": True}})
    xr.testing.assert_identical(xr.load_dataset(tmp_path / "a.nc", engine="h5netcdf"), data)
    tree = xr.DataTree.from_dict({"/one": data, "/one/two": data})
    write_netcdf(tree, tmp_path / "b.nc")
    with xr.open_datatree(tmp_path / "b.nc", engine="h5netcdf") as back:
        xr.testing.assert_identical(back.load(), tree)


@pytest.mark.skipif(sys.platform == "win32", reason="needs limits of processes")
def test_a_file_that_finds_no_room_is_an_error_of_the_system_and_not_the_end_of_the_process(tmp_path):
    """HDF5 itself, which can't close a file then, had ended in a segmentation fault."""
    program = (
        "import resource, sys, numpy as np, xarray as xr; from pathlib import Path\n"
        "from bayeschute.core.netcdf_files import write_netcdf\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))\n"
        "data = xr.Dataset({'x': ('t', np.random.default_rng(0).standard_normal(100_000))})\n"
        "try:\n    write_netcdf(data, Path(sys.argv[1]))\nexcept OSError as error:\n    print(error.errno)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path / "a.nc")], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout.strip()) == (0, str(errno.EFBIG)), done.stderr[-500:]
