"""The inputs that a run keeps: from its folder alone the same run can be made again, whatever became of the originals."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from bayeschute.study.kept_inputs import FOLDER, keep
from bayeschute.study.load import load_study
from bayeschute.study.run.stages import run_study
from bayeschute.study.study import study_hash
from bayeschute.study.templates import template

WIND = "h,n,e\n0,1,2\n3000,3,4\n"


@pytest.fixture
def scattered(tmp_path: Path) -> Path:
    """A study whose vehicle, and whose two wind files of one name, lie in other folders."""
    study, wind = template("virtual.toml").read_text(encoding="utf-8"), "wind.csv"
    for place in ("study", "cars", "data/a", "data/b"):
        (tmp_path / place).mkdir(parents=True)
    for i, place in enumerate(("a", "b")):
        (tmp_path / "data" / place / wind).write_text(WIND.replace("3000", f"{3000 + i}"), encoding="utf-8")
    shutil.copy(template("vehicle.toml"), tmp_path / "cars" / "main.toml")
    profile = "\n[flight.virtual.wind.profile]\nfile = {}\naltitude = {{ column = 'h', unit = 'm' }}\n"
    profile += (
        "north = {{ column = 'n', unit = 'm/s' }}\neast = {{ column = 'e', unit = 'm/s' }}\n[flight.virtual.turbulence]"
    )
    study = study.replace('vehicle = "vehicle.toml"', "vehicle = '../cars/main.toml'  # the two mains")
    kept, inside = list[str](), False
    for line in study.splitlines():  # lists by altitude give way to files
        inside = inside and not line.startswith("[") or line.startswith("[flight.virtual.wind]")
        if not (inside and line.startswith(("altitude", "north", "east", "[flight.virtual.wind]"))):
            kept.append(line)
    study = "\n".join(kept)
    for path in ("'../data/a/wind.csv'", '"${DATA}/b/wind.csv"'):
        assert "\n[flight.virtual.turbulence]" in study
        study = study.replace(
            "\n[flight.virtual.turbulence]", profile.format(path).replace("[flight.virtual.t", "[flight.virtual.~t"), 1
        )
    path = tmp_path / "study" / "drop.toml"
    path.write_text(study.replace(".~t", ".t"), encoding="utf-8")
    return path


def test_a_study_of_many_folders_is_kept_in_one(scattered: Path, tmp_path: Path):
    data, run = tmp_path / "data", tmp_path / "run"
    study = load_study(scattered, data)
    assert keep(study, run, "# head", data) == ""
    for place in ("study", "cars", "data"):
        shutil.rmtree(tmp_path / place)
    assert study_hash(load_study(run / "study.toml")) == study_hash(study)
    assert sorted(path.name for path in (run / FOLDER).iterdir()) == ["main.toml", "wind-2.csv", "wind.csv"]
    text = (run / "study.toml").read_text(encoding="utf-8")
    assert text.startswith("# head\n") and "# the two mains" in text


def test_the_copy_has_the_seed_that_was_run(scattered: Path, tmp_path: Path):
    study = replace(load_study(scattered, tmp_path / "data"), seed=77)
    assert keep(study, tmp_path / "run", "", tmp_path / "data") == ""
    assert load_study(tmp_path / "run" / "study.toml").seed == 77


def test_a_run_can_be_the_study_of_its_own_folder(scattered: Path, tmp_path: Path):
    run = tmp_path / "run"
    study = load_study(scattered, tmp_path / "data")
    keep(study, run, "# one", tmp_path / "data")
    (run / FOLDER / "old.csv").write_text("of an earlier study", encoding="utf-8")
    names = {"main.toml", "wind.csv", "wind-2.csv"}
    for _ in range(2):
        again = load_study(run / "study.toml")
        assert keep(again, run, "# two") == "" and study_hash(again) == study_hash(study)
        assert {path.name for path in (run / FOLDER).iterdir()} == names


def test_originals_in_the_folder_under_names_of_copies_are_safe(scattered: Path, tmp_path: Path):
    """A study whose second file has the name and place of the first one's copy."""
    own = tmp_path / "study"
    (own / FOLDER).mkdir()
    (tmp_path / "data/b/wind.csv").rename(own / FOLDER / "wind.csv")
    scattered.write_text(scattered.read_text().replace("${DATA}/b/", f"{FOLDER}/"), encoding="utf-8")
    study = load_study(scattered)
    assert keep(study, own, "") == "" and study_hash(load_study(own / "study.toml")) == study_hash(study)


def test_what_cannot_be_kept_is_told(scattered: Path, tmp_path: Path):
    study = load_study(scattered, tmp_path / "data")
    assert "not read from a file" in keep(replace(study, text=""), tmp_path / "a", "", tmp_path / "data")
    assert "is not the study that was run" in keep(replace(study, title="other"), tmp_path / "b", "", tmp_path / "data")


def test_a_run_is_made_again_from_a_copy_of_its_folder(finished, tmp_path: Path):
    """With the originals out of sight: the same draws and bands, bit for bit."""
    folder = Path(shutil.copytree(finished.folder, tmp_path / "elsewhere"))
    assert ".." not in (folder / "study.toml").read_text(encoding="utf-8")
    run_study(folder / "study.toml", tmp_path / "again")
    for name, group in (("posterior.nc", "posterior"), ("predictions.nc", None)):
        trees = [xr.open_datatree(place / name, engine="h5netcdf") for place in (finished.folder, tmp_path / "again")]
        for tree in trees:
            tree.load().close()
        pair = [tree if group is None else tree[group] for tree in trees]
        for one, two in zip(*(tree.subtree for tree in pair), strict=True):
            assert set(one.data_vars) == set(two.data_vars)
            for key in one.data_vars:
                np.testing.assert_array_equal(one[key].values, two[key].values)
    stages = [sorted((place / ".stages").iterdir()) for place in (finished.folder, tmp_path / "again")]
    assert [path.read_text() for path in stages[0]] == [path.read_text() for path in stages[1]]
