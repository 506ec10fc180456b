"""The door for measured flights: good files in any format give one record, bad ones give every fault and no traceback."""

import gzip
import os
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from bayeschute.core.errors import InputError
from bayeschute.records.foreign.conventions import Conventions
from bayeschute.records.netcdf import try_netcdf
from bayeschute.records.read import ColumnSpec, read_record
from bayeschute.records.record import load_record, make_record, repairs, write_record

N = 40
T = np.arange(N) * 0.5
COLUMNS = {
    "time": ColumnSpec("t", "s"),
    "altitude": ColumnSpec("alt", "ft"),
    "temperature": ColumnSpec("temp", "degC"),
}


def frame():
    return pd.DataFrame({"t": T, "alt": 3000 - 40 * T, "temp": 10 + 0.1 * T, "note": "x"})


def text(table=None):
    return (frame() if table is None else table).to_csv(index=False)


def faults(path, columns=None, **kwargs):
    with pytest.raises(InputError) as caught:
        read_record(path, COLUMNS if columns is None else columns, **kwargs)
    return [str(fault) for fault in caught.value.faults]


def save(tmp_path, content, name="log.csv"):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize("name", ["log.csv", "log.csv.gz", "LOG.CSV", "log.parquet"])
def test_every_format_gives_the_same_record(tmp_path, name):
    path = tmp_path / name
    frame().to_parquet(path) if name.endswith("parquet") else frame().to_csv(path, index=False, compression="infer")
    ds = read_record(path, COLUMNS)
    np.testing.assert_allclose(ds["time"], T)
    np.testing.assert_allclose(ds["altitude"], (3000 - 40 * T) * 0.3048)
    np.testing.assert_allclose(ds["temperature"], 283.15 + 0.1 * T)
    assert ds["altitude"].attrs["units"] == "m"


@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_other_delimiters_byte_order_marks_and_line_ends(tmp_path, delimiter):
    content = "\ufeff" + text().replace(",", delimiter).replace("\n", "\r\n") + "\r\n"
    np.testing.assert_allclose(read_record(save(tmp_path, content), COLUMNS)["altitude"][1], 2980 * 0.3048)


def test_netcdf_needs_no_map(tmp_path):
    ds = make_record(time=T, altitude=3000 - T)
    write_record(ds, tmp_path / "r.nc")
    xr.testing.assert_identical(read_record(tmp_path / "r.nc"), ds)


def test_components_land_in_their_places(tmp_path):
    names = [f"canopy_position.{i}.{a}" for i in (1, 2) for a in ("north", "east", "down")]
    names += [f"capsule_attitude.{q}" for q in "wxyz"] + ["riser_tension.1", "riser_tension.2"]
    names += ["wind.east", "wind.north"]
    table = pd.DataFrame({"t": T, **{n: float(i) + T for i, n in enumerate(names)}})
    units = {"canopy_position": "m", "capsule_attitude": "", "riser_tension": "lbf", "wind": "kt"}
    columns = {"time": ColumnSpec("t", "s"), **{n: ColumnSpec(n, units[n.split(".")[0]]) for n in names}}
    ds = read_record(save(tmp_path, text(table)), columns)
    np.testing.assert_allclose(ds["canopy_position"][0].values, [[0, 1, 2], [3, 4, 5]])
    np.testing.assert_allclose(ds["capsule_attitude"][0].values, [6, 7, 8, 9])
    np.testing.assert_allclose(ds["riser_tension"][0].values, np.array([10, 11]) * 4.4482216152605)
    np.testing.assert_allclose(ds["wind"][0].values, np.array([13, 12, 0]) * 1852 / 3600)
    assert [(r.kind, r.variable) for r in repairs(ds)] == [("assumed", "wind")]


def test_velocities_of_canopies_in_other_axes_and_of_one_canopy_only(tmp_path):
    """ENU and upward columns, feet per second; the second canopy carries no instrument; and what a map may not say."""
    names = [f"canopy_velocity.1.{a}" for a in ("east", "north", "up")]
    table = pd.DataFrame({"t": T, **{n: float(i + 1) + T for i, n in enumerate(names)}})
    columns = {"time": ColumnSpec("t", "s"), **{n: ColumnSpec(n, "ft/s") for n in names}}
    lacks = tuple(f"canopy_velocity.2.{a}" for a in ("north", "east", "down"))
    path = save(tmp_path, text(table))
    found = read_record(path, columns, conventions=Conventions(lacks=lacks))["canopy_velocity"]
    assert found.dims == ("time", "canopy", "axis") and found.attrs["units"] == "m/s"
    np.testing.assert_allclose(found[0, 0].values, 0.3048 * np.array([2.0, 1.0, -3.0]))
    assert np.isnan(found[:, 1].values).all()
    turned = {f"canopy_velocity.1.{a}": columns[n] for a, n in zip("xyz", names, strict=True)} | {
        "time": columns["time"]
    }
    alone = read_record(path, turned, conventions=Conventions(axes="ENU"))["canopy_velocity"]
    np.testing.assert_array_equal(alone[:, 0].values, found[:, 0].values)
    for bad, words in (
        ({"canopy_velocity.1.up": ColumnSpec(names[2], "m")}, "a unit of m/s"),
        ({"canopy_velocity.north": ColumnSpec(names[1], "m/s")}, "canopy_velocity.<number>.<north|east|down>"),
        ({"canopy_speed.1.north": ColumnSpec(names[1], "m/s")}, "Did you mean 'canopy_velocity'"),
        ({"canopy_velocity.2.north": ColumnSpec(names[1], "m/s")}, "no canopy_velocity.2.east"),
    ):
        with pytest.raises(InputError) as error:
            read_record(path, columns | bad)
        assert words in str(error.value)


def test_missing_values_stay_missing(tmp_path):
    table = frame()
    table.loc[3:5, "alt"] = np.nan
    content = text(table).replace("2900.0", "NaN").replace("2880.0", "null") + "\n\n"
    ds = read_record(save(tmp_path, content), COLUMNS)
    assert np.flatnonzero(np.isnan(ds["altitude"].values)).tolist() == [3, 4, 5, 6]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", ["an empty file"]),
        (b"\n \n", ["an empty file"]),
        (os.urandom(0) + bytes(range(256)) * 20, ["binary data"]),
        ("t,alt,temp\n0,1,2\n".encode("utf-16"), ["binary data"]),
        (text().encode() + b"20.0,\xff\xfe,3,x\n", ["not UTF-8 (first in row 42)"]),
        ("t,alt,temp\n", ["no rows"]),
        ("t,alt,temp\n0,1,2\n1,2,3\n", ["2 rows", "at least 10"]),
        ("hello\nworld\n", ["column 't', which", "The columns are hello"]),
        (text() + "20.0,1\n", ["2 fields in row 42", "4 fields as in the header"]),
        (text()[:-14], ["fields in row 41"]),
        (text().replace("t,alt", "alt,alt"), ["column 'alt' 2 times"]),
        ('t,alt,temp\n"0,1,2\n', ["text that is no table", "at least"]),
    ],
)
def test_files_that_are_no_table(tmp_path, content, words):
    found = "\n".join(faults(save(tmp_path, content)))
    assert any(word in found for word in words), found


def test_cut_gzip_and_gzip_that_is_none(tmp_path):
    packed = gzip.compress(text().encode())
    assert "can't be read" in faults(save(tmp_path, packed[:-20], "a.csv.gz"))[0]
    assert "can't be read" in faults(save(tmp_path, text(), "b.csv.gz"))[0]
    assert "can't be read" in faults(save(tmp_path, b"PAR1 nonsense", "c.parquet"))[0]


def test_missing_files_and_strange_names(tmp_path):
    save(tmp_path, text(), "flight_1.csv")
    assert "Did you mean 'flight_1.csv'" in faults(tmp_path / "flight_2.csv")[0]
    assert "does not exist either" in faults(tmp_path / "no" / "flight_2.csv")[0]
    assert ".csv, .csv.gz, .parquet, .nc" in faults(save(tmp_path, text(), "log.xlsx"))[0]
    (tmp_path / "folder.csv").mkdir()
    assert "no such file" in faults(tmp_path / "folder.csv")[0]


def corrupted(kind):
    table = frame()
    if kind == "text":
        table["alt"] = table["alt"].astype(object)
        table.loc[4, "alt"], table.loc[9, "alt"] = "ERR", "ERR"
        return table, ["column 'alt': got text 'ERR' in row 6 (2 such rows)"]
    if kind == "decimal comma":
        table["alt"] = [f"{v:.1f}".replace(".", "'") for v in table["alt"]]
        return table, ["40 such rows"]
    if kind == "boolean":
        table["alt"] = True
        return table, ["values of type bool"]
    if kind == "infinite":
        table.loc[7, "alt"] = np.inf
        return table, ["an infinite value in row 9 (1 such rows)"]
    if kind == "huge":
        table["temp"] = "1e999"
        return table, ["an infinite value in row 2 (40 such rows)"]
    if kind == "empty":
        table["alt"] = np.nan
        return table, ["column 'alt': got no value at all"]
    if kind == "repeated":
        table.loc[5, "t"] = table.loc[4, "t"]
        return table, ["repeated time at row 7 (2 then 2 s; 1 in all)"]
    if kind == "backward":
        table.loc[[8, 9], "t"] = table.loc[[9, 8], "t"].to_numpy()
        return table, ["time running backward at row 11 (4.5 then 4 s; 1 in all)"]
    if kind == "no time":
        table.loc[12, "t"] = np.nan
        return table, ["no finite time in row 14 (1 in all)"]
    table["t"] = table["t"] * 1e15
    return table, ["Is the unit right?"]


KINDS = ("text", "decimal comma", "boolean", "infinite", "huge", "empty", "repeated", "backward", "no time", "far")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_every_kind_of_bad_value_is_named_with_its_row(tmp_path, kind, suffix):
    table, words = corrupted(kind)
    path = tmp_path / f"log.{suffix}"
    if suffix == "csv":
        table.to_csv(path, index=False)
    else:
        table.astype({c: str for c in table if table[c].dtype == object}).to_parquet(path)
        words = [w.replace("row 6", "row 5").replace("row 9", "row 8").replace("row 2 ", "row 1 ") for w in words]
        words = [w.replace("row 7", "row 6").replace("row 11", "row 10").replace("row 14", "row 13") for w in words]
    found = "\n".join(faults(path))
    assert all(word in found for word in words), found


def test_all_faults_of_a_file_come_at_once(tmp_path):
    table = corrupted("text")[0]
    table.loc[5, "t"] = table.loc[4, "t"]
    columns = {**COLUMNS, "pressure": ColumnSpec("pres", "hPa"), "density": ColumnSpec("temp", "ft")}
    found = faults(save(tmp_path, text(table)), columns)
    assert len(found) == 4, found
    for word in ("'ERR'", "repeated time", "column 'pres', which", "[columns.density] unit"):
        assert any(word in line for line in found), word


def test_missing_columns_are_named_with_the_nearest(tmp_path):
    (line,) = faults(save(tmp_path, text()), {**COLUMNS, "pressure": ColumnSpec("Temp", "hPa")})
    assert "Did you mean 'temp'" in line and "The columns are t, alt, temp, note." in line


@pytest.mark.parametrize(
    ("extra", "word"),
    [
        ({"altitud": ColumnSpec("alt", "m")}, "Did you mean 'altitude'"),
        ({"altitude.up": ColumnSpec("alt", "m")}, "a key like altitude."),
        ({"capsule_position": ColumnSpec("alt", "m")}, "capsule_position.<north|east|down>"),
        ({"capsule_position.sideways": ColumnSpec("alt", "m")}, "one of north, east, down"),
        ({"canopy_position.0.down": ColumnSpec("alt", "m")}, "a number from 1"),
        ({"canopy_position.x.down": ColumnSpec("alt", "m")}, "a number from 1"),
        ({"canopy_position.99999999999999999999.down": ColumnSpec("alt", "m")}, "a number from 1"),
        ({"canopy_position.2.down": ColumnSpec("alt", "m")}, "no canopy_position.1.north"),
        ({"capsule_velocity.north": ColumnSpec("alt", "m/s")}, "no capsule_velocity.down"),
        ({"wind.north": ColumnSpec("alt", "m/s")}, "no wind.east"),
        ({"altitude": ColumnSpec("alt", "kg")}, "a unit of m"),
        ({"altitude": ColumnSpec("alt", "")}, "a unit of m"),
        ({"altitude": ColumnSpec("alt", "bananas")}, "a unit of m"),
        ({"latitude": ColumnSpec("alt", "1")}, "a unit of rad"),
    ],
)
def test_bad_maps_are_refused(tmp_path, extra, word):
    found = "\n".join(faults(save(tmp_path, text()), {**COLUMNS, **extra}))
    assert word in found, found


def test_maps_without_time_or_quantity_and_unequal_canopies(tmp_path):
    path = save(tmp_path, text())
    assert "no time" in faults(path, {"altitude": ColumnSpec("alt", "m")})[0]
    assert "no quantity" in faults(path, {"time": ColumnSpec("t", "s")})[0]
    unequal = {f"riser_tension.{i}": ColumnSpec("alt", "N") for i in (1, 2)}
    unequal |= {f"canopy_position.1.{a}": ColumnSpec("alt", "m") for a in ("north", "east", "down")}
    assert "the same number of canopies" in "".join(faults(path, {"time": ColumnSpec("t", "s"), **unequal}))


@pytest.mark.parametrize(
    ("window", "word"),
    [
        ((0.0, 100.0), "a record from 0 to 19.5 s"),
        ((-10.0, 15.0), "a record from 0 to 19.5 s"),
        ((15.0, 5.0), "a finite end after a finite start"),
        ((0.0, float("nan")), "a finite end after a finite start"),
        ((5.0, 6.0), "3 rows in 5 to 6 s"),
    ],
)
def test_windows_that_the_record_does_not_hold(tmp_path, window, word):
    (line,) = faults(save(tmp_path, text()), window=window)
    assert word in line


def test_a_window_inside_the_record_is_not_cut(tmp_path):
    assert read_record(save(tmp_path, text()), COLUMNS, window=(5.0, 15.0)).sizes["time"] == N


def test_netcdf_outside_the_schema(tmp_path):
    good = make_record(time=T, altitude=3000 - T)
    good.assign(hight=good["altitude"]).to_netcdf(tmp_path / "a.nc", engine="h5netcdf")
    assert "an unknown variable" in faults(tmp_path / "a.nc")[0]
    write_record(good, tmp_path / "b.nc")
    assert "a record from 0" in faults(tmp_path / "b.nc", window=(0.0, 99.0))[0]
    assert "can't be read" in faults(save(tmp_path, b"\x89HDF\r\n\x1a\n" + bytes(500), "c.nc"))[0]
    truth = make_record(time=T, altitude=3000 - T, flyout_angle=0 * T)
    write_record(truth, tmp_path / "d.nc")
    assert "flyout_angle" in faults(tmp_path / "d.nc")[0]
    assert "flyout_angle" in load_record(tmp_path / "d.nc")


def test_a_netcdf_file_that_hangs_the_library_is_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr("bayeschute.records.netcdf._TRIAL", "import time; time.sleep(60)")
    with pytest.raises(InputError, match="no end in 0.5 s"):
        try_netcdf(save(tmp_path, b"x", "a.nc"), 0.5)
    monkeypatch.setattr("bayeschute.records.netcdf._TRIAL", "import os; os.abort()")
    with pytest.raises(InputError, match="signal 6"):
        try_netcdf(save(tmp_path, b"x", "a.nc"))


@pytest.mark.parametrize("seed", range(4))
def test_mutated_files_give_a_record_or_faults_and_nothing_else(tmp_path, seed):
    rng = np.random.default_rng(seed)
    path = tmp_path / "a.parquet"
    frame().to_parquet(path)
    sources = {"a.csv": text().encode(), "a.csv.gz": gzip.compress(text().encode()), "a.parquet": path.read_bytes()}
    junk = [b"nan", b"inf", b'"', b"1e999", b"\xff", b"\0", b"abc", b"9" * 400, b";", b"True", b"\r", b"1_0", b"\n"]
    for name, source in sources.items():
        for _ in range(60):
            data = bytearray(source)
            for _ in range(rng.integers(1, 4)):
                at = int(rng.integers(0, len(data)))
                kind = rng.integers(0, 4)
                if kind == 0:
                    data[at] = rng.integers(0, 256)
                elif kind == 1:
                    del data[at : at + int(rng.integers(1, 30))]
                elif kind == 2:
                    data[at:at] = junk[rng.integers(0, len(junk))]
                else:
                    del data[at + 1 :]
            try:
                ds = read_record(save(tmp_path, bytes(data), name), COLUMNS)
            except InputError as error:
                assert all(str(fault) for fault in error.faults)
            else:
                assert (np.diff(ds["time"]) > 0).all() and not np.isinf(ds["altitude"]).any()


def test_the_door_opens_without_jax_scipy_or_matplotlib():
    code = (
        "import sys, bayeschute.records.read; "
        "sys.exit(any(m in sys.modules for m in ('jax', 'scipy', 'matplotlib', 'xarray', 'pandas')))"
    )
    assert subprocess.run([sys.executable, "-c", code], env={**os.environ}, check=False).returncode == 0
