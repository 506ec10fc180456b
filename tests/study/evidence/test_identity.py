"""What makes a configuration, and what a campaign: flights and seeds belong to neither or to one."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from bayeschute.study.evidence.identity import STORED, configuration, identity, stored, with_noise
from bayeschute.study.evidence.numerics_hash import numerics
from bayeschute.study.evidence.shipped import shipped
from bayeschute.study.load import load_study

ROOT = Path(__file__).parents[3]
STUDY = load_study(ROOT / "models/studies/cdt-3-11.toml")


def test_a_configuration_is_how_a_study_identifies_not_what_it_flies():
    wanted = configuration(STUDY)
    assert configuration(replace(STUDY, seed=99, title="another", flights=STUDY.flights[:1])) == wanted
    assert configuration(with_noise(STUDY, "white")) != wanted
    assert configuration(STUDY, quick=True) != wanted
    sampler = STUDY.sampler.model_copy(update={"draws": STUDY.sampler.draws + 1})
    assert configuration(replace(STUDY, sampler=sampler)) != wanted


def test_a_campaign_is_all_that_its_rows_depend_on_beside_the_seed():
    wanted = identity(STUDY, "none", False)
    assert identity(replace(STUDY, seed=99), "none", False) == wanted
    others = [
        identity(STUDY, "mass", False),
        identity(STUDY, "none", True),
        identity(replace(STUDY, flights=STUDY.flights[:1]), "none", False),
        identity(with_noise(STUDY, "ar1"), "none", False),
    ]
    assert len({wanted, *others}) == 5


def test_an_installed_program_finds_the_calibrations_and_comparisons_shipped_with_it(tmp_path):
    """Of the package as its wheel holds it, away from the checkout."""
    wheel = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]
    (package,) = wheel["packages"]
    site = tmp_path / "site"
    shutil.copytree(ROOT / package, site / "bayeschute", ignore=shutil.ignore_patterns("__pycache__"))
    for source, target in wheel["force-include"].items():
        shutil.copytree(ROOT / source, site / target)
    program = (
        "import sys; from pathlib import Path; from types import SimpleNamespace\n"
        "from bayeschute.study.evidence.identity import places\n"
        "made = places(SimpleNamespace(out=Path('run'), study=SimpleNamespace(path=Path('mine/study.toml'))))\n"
        "print(*(p for p in made if list(p.glob('latent.none.json'))))\n"
        "from bayeschute.study.evidence.numerics_compared import comparisons; print(len(comparisons()))"
    )
    environment = os.environ | {"PYTHONPATH": str(site)}
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    compared = len(list((ROOT / "models/reference/numerics").glob("*.json")))
    assert done.stdout.split() == [str(site / "bayeschute/reference/calibration"), str(compared)]


def test_a_checkout_finds_those_of_its_models():
    assert shipped(STORED) == ROOT / "models/reference/calibration" and list(shipped(STORED).glob("latent.none.json"))


@pytest.fixture
def place(tmp_path):
    def put(name, **entries):
        (tmp_path / f"{name}.json").write_text(
            json.dumps(
                {"hash": configuration(STUDY), "numerics": numerics(), "disturbance": "none", "coverage": {}} | entries
            )
        )
        return tmp_path

    return put


def test_the_largest_calibration_of_each_scenario_is_found_by_numerics(place, tmp_path):
    place("few", replicates=40)
    place("many", replicates=120)
    place("disturbed", replicates=8, disturbance="mass")
    place("old", replicates=500, numerics="0" * 64)
    place("other", replicates=900, hash="0" * 64)
    (tmp_path / "no-result.json").write_text("[1, 2")
    (tmp_path / "list.json").write_text("[1, 2]")
    found = stored(STUDY, False, [tmp_path / "nowhere", tmp_path])
    assert {name: one["replicates"] for name, one in found.current.items()} == {"none": 120, "mass": 8}
    assert {name: one["replicates"] for name, one in found.older.items()} == {"none": 500}
    assert stored(STUDY, True, [tmp_path]) == ({}, {})


def test_results_of_numerics_that_give_the_same_ones_are_current(place, tmp_path, monkeypatch):
    place("equal", replicates=500, numerics="1" * 64)
    place("old", replicates=900, numerics="0" * 64)
    monkeypatch.setattr(
        "bayeschute.study.evidence.identity.present_numerics",
        lambda wanted: {numerics(), "1" * 64} if wanted == configuration(STUDY) else set(),
    )
    found = stored(STUDY, False, [tmp_path])
    assert found.current["none"]["replicates"] == 500 and found.older["none"]["replicates"] == 900


def test_shipped_results_without_a_hash_of_their_numerics_are_older():
    found = stored(STUDY, False, [shipped(STORED)])
    assert "none" not in found.current or "numerics" in found.current["none"]
    assert all("numerics" not in one or one["numerics"] != numerics() for one in found.older.values())
