import numpy as np
import pytest
import xarray as xr

from bayeschute.core.netcdf_groups import load_groups


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
