"""What makes a configuration, and what a campaign: flights and seeds belong to neither or to one."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from bayeschute.study.evidence.identity import configuration, identity, stored, with_noise
from bayeschute.study.load import load_study

STUDY = load_study(Path(__file__).parents[3] / "models/studies/cdt-3-11.toml")


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
