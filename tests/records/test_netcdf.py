"""Files that a child process tries first, and what is told of those that it can't read."""

from __future__ import annotations

import subprocess
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from bayeschute.core.errors import InputError
from bayeschute.records import netcdf
from bayeschute.records.netcdf import open_netcdf, said, try_netcdf


@pytest.fixture
def sound(tmp_path):
    path = tmp_path / "a.nc"
    made = xr.Dataset(
        {"x": ("time", np.arange(5.0))}, {"time": ("time", np.arange(5.0), {"units": "seconds since 2020-01-01"})}
    )
    made.to_netcdf(path, engine="h5netcdf")
    return path


def test_times_stay_numbers_and_values_are_loaded(sound):
    read = open_netcdf(sound)
    sound.unlink()
    np.testing.assert_array_equal(read["time"].values, np.arange(5.0))
    np.testing.assert_array_equal(read["x"].values, np.arange(5.0))


def test_only_files_of_others_are_tried_in_a_child(sound, monkeypatch):
    tried = []
    monkeypatch.setattr(netcdf, "try_netcdf", tried.append)
    open_netcdf(sound, trusted=True)
    assert tried == []
    open_netcdf(sound)
    assert tried == [sound]


def test_a_damaged_file_is_found_by_either(sound):
    whole = sound.read_bytes()
    sound.write_bytes(whole[: len(whole) // 2])
    for read in (try_netcdf, lambda path: open_netcdf(path, trusted=True)):
        with pytest.raises(InputError, match="can't be read") as told:
            read(sound)
        assert str(sound) in str(told.value) and "Copy it again" in str(told.value)


def test_a_variable_beyond_all_measure_is_refused_and_not_touched_by_the_child(sound, monkeypatch):
    monkeypatch.setattr(netcdf, "LARGEST_VALUES", 4)
    with pytest.raises(InputError, match="a variable of 5 values"):
        open_netcdf(sound, trusted=True)
    monkeypatch.setattr(netcdf, "LARGEST_VALUES", 5)
    assert open_netcdf(sound, trusted=True)["x"].size == 5


@pytest.mark.parametrize(
    ("code", "stderr", "words"),
    [
        (0, b"", None),
        (3, b"no h5py", None),
        (1, b"Traceback\nOSError: truncated\n", "(OSError: truncated)"),
        (1, b"  ", "(no message)"),
        (-11, b"said before", "(signal 11)"),
        (1, b"\xff" * 400, "\ufffd" * 150 + ")"),
    ],
)
def test_how_the_child_ended_is_told(monkeypatch, tmp_path, code, stderr, words):
    asked = []

    def run(command, **options):
        asked.append((command[3:], options["timeout"]))
        return SimpleNamespace(returncode=code, stderr=stderr)

    monkeypatch.setattr(subprocess, "run", run)
    path = tmp_path / "a.nc"
    if words is None:
        try_netcdf(path, 7.0)
    else:
        with pytest.raises(InputError) as told:
            try_netcdf(path, 7.0)
        assert words in str(told.value)
    assert asked == [([str(path), str(netcdf.LARGEST_VALUES)], 7.0)]


def test_a_child_without_end_is_given_up(monkeypatch, tmp_path):
    def run(command, **options):
        raise subprocess.TimeoutExpired(command, options["timeout"])

    monkeypatch.setattr(subprocess, "run", run)
    with pytest.raises(InputError, match="no end in 2.5 s"):
        try_netcdf(tmp_path / "a.nc", 2.5)


def test_words_of_other_libraries_are_one_short_line():
    assert said(OSError("a\n  b\tc")) == "OSError: a b c"
    assert said(ValueError("x" * 500)) == f"ValueError: {'x' * 120}"
