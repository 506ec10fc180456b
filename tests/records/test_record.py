"""The record's schema: what is made is valid, what is wrong is named, what is written comes back."""

import json

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bayeschute.core.errors import InputError
from bayeschute.records.record import (
    QUANTITIES,
    VARIABLES,
    Repair,
    in_si,
    load_record,
    make_record,
    repairs,
    validate_record,
    with_repairs,
    write_record,
)

T = np.arange(20) * 0.1


def full(n=2):
    """A record with every variable."""
    sizes = {"time": T.size, "canopy": n, "axis": 3, "body_axis": 3, "quaternion": 4}
    rng = np.random.default_rng(0)
    known = {**VARIABLES, **QUANTITIES}
    return make_record(time=T, **{k: rng.standard_normal([sizes[d] for d in v.dims]) for k, v in known.items()})


def test_every_variable_has_its_unit_and_the_record_is_valid():
    ds = full()
    known = {**VARIABLES, **QUANTITIES}
    assert {name: ds[name].attrs["units"] for name in ds.data_vars} == {k: v.unit for k, v in known.items()}
    assert validate_record(ds, "x", known) == []
    assert ds["canopy"].values.tolist() == [1, 2]
    assert repairs(ds) == ()


def test_round_trip_through_netcdf(tmp_path):
    ds = full()
    ds["density"][3] = np.nan
    entry = Repair("spike", "altitude", 1.0, 1.5, 3, "leaves the motion and returns")
    slow = Repair("resampled", "density", 0.0, 1.5, 3, "interpolated", (0.1, 0.9, 1.4))
    ds = with_repairs(ds.assign_attrs(source="a test"), [entry, slow])
    back = load_record(write_record(ds, tmp_path / "r.nc"))
    xr.testing.assert_identical(back, ds)
    assert repairs(back) == (entry, slow)
    assert json.loads(back.attrs["repairs"])[0] == {
        "kind": "spike", "variable": "altitude", "start": 1.0, "end": 1.5, "count": 3,
        "detail": "leaves the motion and returns",
    }  # fmt: skip


@given(values=arrays(float, (12, 1, 3), elements=st.floats(-1e6, 1e6) | st.just(np.nan)))
@settings(max_examples=20, deadline=None)
def test_round_trip_keeps_every_bit_and_every_gap(values, tmp_path_factory):
    path = tmp_path_factory.mktemp("r") / "r.nc"
    ds = make_record(time=np.arange(12.0), canopy_position=values)
    np.testing.assert_array_equal(load_record(write_record(ds, path))["canopy_position"].values, values)


def test_damage_in_the_numbers_shows(tmp_path):
    path = write_record(make_record(time=T, altitude=np.linspace(123.25, 99, T.size)), tmp_path / "r.nc")
    data = bytearray(path.read_bytes())
    at = data.find(np.float64(123.25).tobytes())
    assert at > 0
    data[at + 6] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(InputError, match="can't be read"):
        load_record(path)


def test_units_are_converted():
    ds = make_record(time=T, altitude=np.linspace(1000, 900, T.size))
    ds["altitude"].attrs["units"] = "ft"
    assert in_si(ds)["altitude"].values[0] == pytest.approx(304.8)


@pytest.mark.parametrize(
    ("arrays", "word"),
    [
        ({"altitude": T}, "no time"),
        ({"time": T, "altitud": T}, "Did you mean 'altitude'"),
        ({"time": T, "altitude": T[:5]}, r"shape \(5,\)"),
        ({"time": T, "capsule_position": np.zeros((20, 2))}, "axis 3"),
        ({"time": np.zeros((3, 3)), "altitude": T}, "one dimension"),
    ],
)
def test_make_record_refuses(arrays, word):
    with pytest.raises(InputError, match=word):
        make_record(**arrays)


def broken(kind):
    ds = full()[["altitude", "capsule_position", "canopy_position"]]
    if kind == "unknown":
        return ds.assign(hight=ds["altitude"]), "unknown variable"
    if kind == "unit":
        ds["altitude"].attrs["units"] = "kg"
        return ds, "unit of m"
    if kind == "no unit":
        del ds["altitude"].attrs["units"]
        return ds, "no unit"
    if kind == "labels":
        return ds.assign_coords(axis=["up", "east", "down"]), "Label and order"
    if kind == "canopies":
        return ds.assign_coords(canopy=[2, 3]), "labels 1 to 2"
    if kind == "dims":
        return ds.rename(time="t").assign_coords(time=("t", T)), "no coordinate time"
    if kind == "infinite":
        ds["altitude"][3] = np.inf
        return ds, "1 infinite"
    if kind == "empty":
        ds["altitude"][:] = np.nan
        return ds, "no value at all"
    if kind == "text":
        return ds.assign(altitude=("time", ["a"] * 20, {"units": "m"})), "numbers"
    if kind == "time unit":
        ds["time"].attrs["units"] = "ms"
        return ds, "'ms'"
    if kind == "repeated time":
        return ds.assign_coords(time=("time", np.floor(T), {"units": "s"})), "repeated time at sample 1 "
    if kind == "backward time":
        return ds.assign_coords(time=("time", -T, {"units": "s"})), "19 in all"
    if kind == "far time":
        return ds.assign_coords(time=("time", T * 1e300, {"units": "s"})), "unit right"
    if kind == "repairs":
        return ds.assign_attrs(repairs="[{}]"), "JSON list"
    return ds.drop_vars(list(ds.data_vars)), "no variable"


KINDS = (
    "unknown", "unit", "no unit", "labels", "canopies", "dims", "infinite", "empty", "text", "time unit",
    "repeated time", "backward time", "far time", "repairs", "nothing",
)  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_fault_is_named(kind):
    ds, word = broken(kind)
    assert any(word in str(fault) for fault in validate_record(ds, "x.nc")), validate_record(ds, "x.nc")


def test_all_faults_come_at_once(tmp_path):
    ds = broken("unknown")[0]
    ds["altitude"].attrs["units"] = "kg"
    with pytest.raises(InputError) as caught:
        write_record(ds, tmp_path / "x.nc")
    assert len(caught.value.faults) == 2
    assert not (tmp_path / "x.nc").exists()


def test_missing_and_damaged_files(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_record(tmp_path / "none.nc")
    (tmp_path / "bad.nc").write_bytes(b"no netcdf at all")
    with pytest.raises(InputError, match="can't be read"):
        load_record(tmp_path / "bad.nc")
