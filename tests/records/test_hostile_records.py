"""Damaged Parquet and NetCDF records: told, or read as they are; never a traceback and never other values."""

from __future__ import annotations

import datetime
import random
from decimal import Decimal
from time import perf_counter

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from bayeschute.core.errors import InputError
from bayeschute.records import netcdf
from bayeschute.records.read import ColumnSpec, read_record
from bayeschute.records.record import make_record, write_record

ROWS = 100
TIME = 0.1 * np.arange(ROWS)
ALTITUDE = 1000.0 - 5.0 * TIME
COLUMNS = {"time": ColumnSpec("t", "s"), "altitude": ColumnSpec("h", "km")}
SECONDS = 20.0  # a hung NetCDF reader is given up after 15


def _parquet(path, names=("t", "h"), **changed):
    arrays = {"t": TIME, "h": 1e-3 * ALTITUDE} | changed
    table = pa.Table.from_arrays([pa.array(arrays[name]) for name in ("t", "h", *changed.keys() - {"t", "h"})], names)
    pq.write_table(table, path, compression="none", use_dictionary=False, write_page_checksum=True)
    return path


def _same(value):
    return [value] * ROWS


@pytest.mark.parametrize(
    ("changed", "word"),
    [
        ({"h": [[x] for x in ALTITUDE]}, "text"), ({"h": [[] for _ in TIME]}, "text"), ({"h": _same({"a": 1.0})}, "text"),
        ({"h": _same(None)}, "no value"), ({"h": _same(True)}, "bool"), ({"h": [True, None] * (ROWS // 2)}, "text"),
        ({"h": _same("x")}, "text"), ({"h": _same(b"\xff")}, "text"), ({"h": _same(datetime.date(2020, 1, 1))}, "text"),
        ({"h": _same(datetime.datetime(2020, 1, 1))}, "datetime"), ({"h": _same(float("inf"))}, "infinite"),
        ({"h": _same(1e308)}, "too large"), ({"h": _same(Decimal("1e70"))}, None), ({"h": _same(1e-308)}, None),
        ({"h": _same("1.5")}, None), ({"h": _same(Decimal("1.5"))}, None), ({"h": [None, 1.5] * (ROWS // 2)}, None),
        ({"t": TIME[::-1]}, "backward"), ({"t": 0.0 * TIME}, "repeated"), ({"t": _same(None)}, "no value"),
        ({"t": 1e300 * TIME}, "unit right"), ({"t": [None, 1.0] * (ROWS // 2)}, "no finite time"),
        ({"t": [datetime.timedelta(seconds=i) for i in range(ROWS)]}, "timedelta"),
    ],
)  # fmt: skip
def test_columns_of_other_types_and_sizes(tmp_path, changed, word):
    path = _parquet(tmp_path / "r.parquet", **changed)
    if word is not None:
        with pytest.raises(InputError, match=word):
            read_record(path, COLUMNS)
        return
    wanted = [np.nan if value is None else float(value) for value in changed["h"]]
    np.testing.assert_allclose(read_record(path, COLUMNS)["altitude"], 1e3 * np.array(wanted))


@pytest.mark.parametrize("names", [("t", "h", "h"), ("t", "t", "h"), ("", "\x1b[31mh", "t")])
def test_columns_twice_or_of_odd_names(tmp_path, names):
    with pytest.raises(InputError, match="twice|lacks"):
        read_record(_parquet(tmp_path / "r.parquet", names, other=TIME), COLUMNS)


@pytest.mark.parametrize("content", [b"", b"t,h\n0,1\n1,2\n", b"PAR1", b"PAR1" + bytes(40) + b"PAR1"])
@pytest.mark.parametrize("name", ["r.parquet", "r.nc"])
def test_files_of_another_kind(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match="empty file|can't be read"):
        read_record(tmp_path / name, COLUMNS)


@pytest.mark.parametrize("rows", [0, 1])
def test_too_few_rows(tmp_path, rows):
    pq.write_table(pa.table({"t": TIME[:rows], "h": ALTITUDE[:rows]}), tmp_path / "r.parquet")
    with pytest.raises(InputError, match="rows"):
        read_record(tmp_path / "r.parquet", COLUMNS)


def _damaged(raw: bytes, rng: random.Random) -> bytes:
    made, at = bytearray(raw), rng.randrange(len(raw))
    kind = rng.choice(["cut", "flip", "flip", "zero", "hole", "put in"])
    if kind == "cut":
        del made[at:]
    elif kind == "flip":
        for _ in range(rng.choice([1, 1, 4])):
            made[rng.randrange(len(raw))] ^= 1 << rng.randrange(8)
    elif kind == "zero":
        made[at : at + 300] = bytes(len(made[at : at + 300]))
    elif kind == "hole":
        del made[at : at + rng.randrange(1, 200)]
    else:
        made[at:at] = rng.randbytes(rng.randrange(1, 9))
    return bytes(made)


def _damage_is_told_or_harmless(path, number, seed):
    """Whether each of so many damaged copies is refused or gives the same record; both must happen."""
    raw, sound, told = path.read_bytes(), read_record(path, COLUMNS), 0
    for k in range(number):
        path.write_bytes(_damaged(raw, random.Random(f"{seed} {k}")))
        began = perf_counter()
        try:
            read = read_record(path, COLUMNS)
        except InputError as error:
            told += 1
            assert str(path) in str(error) or "[columns" in str(error)
        except Exception as error:
            raise AssertionError(f"input {k} ended in a traceback") from error
        else:
            np.testing.assert_array_equal(read["altitude"], sound["altitude"], err_msg=f"input {k}")
            np.testing.assert_array_equal(read["time"], sound["time"], err_msg=f"input {k}")
        assert perf_counter() - began < SECONDS, f"input {k} took too long"
    assert 0 < told < number


def test_damaged_bytes_of_parquet(tmp_path):
    """Checksums of pages, where a file has them, tell what changed; nothing else would in a file without compression."""
    _damage_is_told_or_harmless(_parquet(tmp_path / "r.parquet"), 80, seed=1)


@pytest.mark.slow
def test_damaged_bytes_of_many_records(tmp_path, stored):
    _damage_is_told_or_harmless(_parquet(tmp_path / "r.parquet"), 5000, seed=2)
    _damage_is_told_or_harmless(stored, 200, seed=2)


@pytest.fixture
def stored(tmp_path):
    return write_record(make_record(time=TIME, altitude=ALTITUDE, descent_rate=0.0 * TIME + 5.0), tmp_path / "r.nc")


def test_damaged_bytes_of_netcdf(stored):
    _damage_is_told_or_harmless(stored, 10, seed=3)


_REPAIR = '[{"kind": "gap", "variable": "altitude", "start": %s, "end": 1, "count": 1, "detail": %s}]'


@pytest.mark.parametrize(
    ("name", "key", "value", "word"),
    [
        ("time", "units", [1.0, 2.0], "time units"), ("time", "units", 1, "time units"), ("time", "units", "days", "'s'"),
        ("altitude", "units", [1.0, 2.0], "no unit"), ("altitude", "units", "(" * 3000, "unit of m"),
        ("altitude", "units", "9**9**9**9 m", "unit of m"), ("altitude", "scale_factor", np.nan, "no value"),
        ("altitude", "scale_factor", "x", "can't be read"), ("altitude", "scale_factor", np.inf, "infinite"),
        ("altitude", "scale_factor", 1e304, None), ("altitude", "coordinates", 5, "can't be read"),
        ("/", "coordinates", "altitude", "a coordinate"), ("altitude", "coordinates", "descent_rate", "a coordinate"),
        ("/", "repairs", 5, "list of repairs"), ("/", "repairs", "[" * 9000, "list of repairs"),
        ("/", "repairs", _REPAIR % ('"x"', '""'), "list of repairs"), ("/", "repairs", _REPAIR % ("null", '""'), "list of repairs"),
        ("/", "repairs", _REPAIR % ("0", "{}"), "list of repairs"), ("/", "repairs", _REPAIR % ("0.5", '"a"'), None),
    ],
)  # fmt: skip
def test_attributes_of_netcdf(stored, monkeypatch, name, key, value, word):
    monkeypatch.setattr(netcdf, "try_netcdf", lambda path: None)  # the file is whole: no process to try it in
    with h5py.File(stored, "r+") as file:
        file[name].attrs[key] = value
    if word is None:
        assert np.isfinite(read_record(stored)["altitude"]).all()
        return
    with pytest.raises(InputError, match=word):
        read_record(stored)


def test_values_of_netcdf_that_their_unit_makes_infinite(tmp_path, monkeypatch):
    """They were infinite in the record without a word."""
    monkeypatch.setattr(netcdf, "try_netcdf", lambda path: None)
    record = make_record(time=TIME, altitude=0.0 * TIME + 1e307)
    record["altitude"].attrs["units"] = "km"
    with pytest.raises(InputError, match="infinite values in m.*unit right"):
        read_record(write_record(record, tmp_path / "r.nc"))
