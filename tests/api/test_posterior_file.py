"""A stored posterior: whole or refused, readable by others, and never written outside its own folder."""

from __future__ import annotations

import json
import random
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from bayeschute.api import posterior_file
from bayeschute.api.posterior_file import posterior_of_run, read_posterior, write_posterior
from bayeschute.core.errors import InputError
from bayeschute.study.load import load_study
from bayeschute.study.study import study_hash


@pytest.fixture(scope="module")
def content(finished, descents):
    return posterior_of_run(finished.folder, load_study(descents.study))


@pytest.fixture(scope="module")
def stored(content, tmp_path_factory):
    return write_posterior(tmp_path_factory.mktemp("stored") / "sondes.nc", *content)


def test_what_was_written_is_read(content, stored):
    study, data, files = read_posterior(stored)
    assert study == content[0] and files == content[2]
    assert set(data.children) == set(content[1].children)
    for name, node in content[1].children.items():
        xr.testing.assert_identical(data[name].to_dataset(), node.to_dataset())


@pytest.mark.parametrize("given", [".", "posterior.nc"])
def test_a_run_is_read_by_its_folder_or_its_draws(content, finished, given):
    study, data, files = read_posterior(finished.folder / given)
    assert study_hash(study) == study_hash(content[0]) and files == content[2]
    for name, node in content[1].children.items():
        xr.testing.assert_identical(data[name].to_dataset(), node.to_dataset())


def test_a_run_that_was_not_fitted_and_a_folder_without_one_are_told(finished, tmp_path):
    with pytest.raises(InputError, match="a folder that holds no run"):
        read_posterior(tmp_path)
    run = tmp_path / "run"
    shutil.copytree(finished.folder, run)
    (run / "posterior.nc").unlink()
    with pytest.raises(InputError, match=r"no posterior\.nc.*--resume"):
        read_posterior(run)
    (run / "posterior.nc").write_bytes((finished.folder / "posterior.nc").read_bytes()[:-2000])
    with pytest.raises(InputError, match="can't be read"):
        read_posterior(run)


def test_a_stored_posterior_is_itself_whatever_its_name_and_the_files_beside_it(content, finished, tmp_path):
    shutil.copy(finished.folder / "study.toml", tmp_path)
    path = write_posterior(tmp_path / "posterior.nc", *content)
    assert read_posterior(path)[2] == content[2]
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(InputError, match="checksum"):
        read_posterior(path)


def _cut(raw: bytearray, rng: random.Random) -> bytearray:
    return raw[: rng.randrange(len(raw))]


def _flipped(raw: bytearray, rng: random.Random) -> bytearray:
    for _ in range(rng.choice([1, 1, 4])):
        raw[rng.randrange(rng.choice([len(raw), 4096]))] ^= 1 << rng.randrange(8)
    return raw


def _zeroed(raw: bytearray, rng: random.Random) -> bytearray:
    first, length = rng.randrange(len(raw)), rng.randrange(1, 5000)
    raw[first : first + length] = bytes(len(raw[first : first + length]))
    return raw


def _lengthened(raw: bytearray, rng: random.Random) -> bytearray:
    first = rng.randrange(len(raw) + 1)
    raw[first:first] = rng.randbytes(rng.randrange(1, 9))
    return raw


@pytest.mark.parametrize("damage", [_cut, _flipped, _zeroed, _lengthened])
def test_damage_is_told_wherever_it_is(stored, tmp_path, damage):
    """Of bytes cut off, flipped, zeroed or put in at random none goes by; before the checksum, a third changed draws."""
    raw, path, rng = stored.read_bytes(), tmp_path / "damaged.nc", random.Random(20)
    for _ in range(25):
        made = bytes(damage(bytearray(raw), rng))
        if made == raw:
            continue
        path.write_bytes(made)
        with pytest.raises(InputError, match="checksum") as told:
            read_posterior(path)
        assert str(path) in str(told.value) and "fit again" in str(told.value)


def test_a_file_that_another_program_wrote_anew_is_told(stored, tmp_path):
    with xr.open_datatree(stored, engine="h5netcdf") as tree:
        tree.load().to_netcdf(tmp_path / "again.nc", engine="h5netcdf")
    with pytest.raises(InputError, match="changed by another program"):
        read_posterior(tmp_path / "again.nc")


@pytest.mark.parametrize(
    "name", ["../outside.json", "/outside.json", "fit/../../outside.json", "fit\\..\\outside.json"]
)
def test_a_posterior_names_no_file_outside_its_folder(content, tmp_path, name):
    study, data, files = content
    path = write_posterior(tmp_path / "x.nc", study, data, {**files, name: b"{}"})
    with pytest.raises(InputError, match="outside.json.*not ours"):
        read_posterior(path)


def test_another_format_is_told_with_the_version_that_wrote_it(content, tmp_path, monkeypatch):
    monkeypatch.setattr(posterior_file, "ARTEFACT_VERSION", 2)
    path = write_posterior(tmp_path / "x.nc", *content)
    monkeypatch.undo()
    with pytest.raises(InputError, match="format 2 of version .* Use the version that wrote it"):
        read_posterior(path)


def test_a_sealed_file_that_is_no_posterior_is_told(tmp_path, monkeypatch, content):
    """Its checksum is right, its content is not."""
    monkeypatch.setattr(posterior_file, "_STUDY", "something")
    path: Path = write_posterior(tmp_path / "x.nc", *content)
    monkeypatch.undo()
    with pytest.raises(InputError, match="without what a posterior has"):
        read_posterior(path)


def test_readers_of_netcdf_pass_the_checksum_over(stored):
    import h5netcdf

    with h5netcdf.File(stored, "r") as file:
        names = [one.attrs["name"] for one in file["bayeschute"].variables.values()]
        header = next(v for v in file["bayeschute"].variables.values() if v.attrs["name"] == "study")
        assert "study" in names and "version" in json.loads(np.asarray(header[:]).astype(np.uint8).tobytes())
