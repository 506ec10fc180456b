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

from bayeschute.study.evidence.identity import configuration, identity, shipped, stored, with_noise
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


def test_an_installed_program_finds_the_calibrations_shipped_with_it(tmp_path):
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
        "print(*(p for p in made if list(p.glob('latent.none.json'))))"
    )
    environment = os.environ | {"PYTHONPATH": str(site)}
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == [str(site / "bayeschute/reference/calibration")]


def test_a_checkout_finds_those_of_its_models():
    assert shipped() == ROOT / "models/reference/calibration" and list(shipped().glob("latent.none.json"))


@pytest.fixture
def place(tmp_path):
    def put(name, **entries):
        (tmp_path / f"{name}.json").write_text(
            json.dumps({"hash": configuration(STUDY), "disturbance": "none"} | entries)
        )
        return tmp_path

    return put


def test_the_largest_undisturbed_calibration_of_the_configuration_is_found(place, tmp_path):
    place("few", replicates=40)
    place("many", replicates=120)
    place("disturbed", replicates=500, disturbance="mass")
    place("other", replicates=900, hash="0" * 64)
    (tmp_path / "no-result.json").write_text("[1, 2")
    (tmp_path / "list.json").write_text("[1, 2]")
    found = stored(STUDY, False, [tmp_path / "nowhere", tmp_path])
    assert found is not None and found["replicates"] == 120
    assert stored(STUDY, True, [tmp_path]) is None
