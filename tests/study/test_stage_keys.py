"""Which stages a change of a study reaches, by their keys."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from bayeschute.study.load import load_study
from bayeschute.study.stage_keys import STAGES, USES, readers, reads, stage_keys

ALL = set(STAGES)
CHANGES = [  # of the file, and the stages that it reaches
    ('title = "My descents"', 'title = "x"', {"report"}),
    ("seed = 1", "seed = 2", ALL - {"structure", "priors"}),
    ('skip_first = "10 s"', 'skip_first = "11 s"', ALL - {"structure", "priors"}),
    ('identify_until = "65 %"', 'identify_until = "60 %"', {"fit", "check", "predict", "risk", "report"}),
    ('median = "0.15 m^2/kg"', 'median = "0.16 m^2/kg"', ALL - {"ingest", "structure"}),
    ('white = "0.4 m/s"', 'white = "0.5 m/s"', {"fit", "check", "predict", "risk", "report"}),
    ("draws = 500", "draws = 600", {"fit", "check", "predict", "risk", "report"}),
    ("draws = 400", "draws = 500", {"predict", "risk", "report"}),
    ('at_most = "6 m/s"', 'at_most = "7 m/s"', {"risk", "report"}),
    ("#   1. Put", "#   one. Put", set()),
    ('at_most = "6 m/s"', 'at_most = "600 cm/s"', set()),
]


def _changed(one: dict[str, str], other: dict[str, str]) -> set[str]:
    return {stage for stage in STAGES if one[stage] != other[stage]}


@pytest.fixture
def keys(descent: Path):
    return stage_keys(load_study(descent), False, {})


@pytest.mark.parametrize(("old", "new", "reached"), CHANGES, ids=lambda x: x if isinstance(x, str) else "")
def test_a_change_reaches_those_that_read_it_and_no_other(descent: Path, keys, old: str, new: str, reached: set[str]):
    text = descent.read_text(encoding="utf-8")
    assert old in text
    descent.write_text(text.replace(old, new, 1), encoding="utf-8")
    assert _changed(keys, stage_keys(load_study(descent), False, {})) == reached


def test_a_record_reaches_all_that_look_at_it(descent: Path, keys):
    record = descent.parent / "my-descent.csv"
    record.write_text(record.read_text(encoding="utf-8").replace("990", "991"), encoding="utf-8")
    assert _changed(keys, stage_keys(load_study(descent), False, {})) == ALL - {"structure", "priors"}


def test_a_flight_that_is_only_predicted_is_not_fitted_again(descent: Path):
    study = load_study(descent)
    other = replace(study.flights[0], name="other", roles=("predict",))
    one, two = (
        stage_keys(replace(study, flights=(study.flights[0], f)), False, {})
        for f in (other, replace(other, skip_first=3.0))
    )
    assert _changed(one, two) == {"ingest", "predict", "risk", "report"}
    fitted = reads(replace(study, flights=(study.flights[0], other)))["fit"]["flights"]
    assert [flight["name"] for flight in fitted] == ["my-descent"]


def test_what_is_found_outside_and_a_quick_run_count(descent: Path, keys):
    study = load_study(descent)
    assert _changed(keys, stage_keys(study, True, {})) == ALL
    assert _changed(keys, stage_keys(study, False, {"check": {"x": 1}})) == {"check", "risk", "report"}
    assert _changed(keys, stage_keys(study, False, {"other": 1})) == set() and len(set(keys.values())) == len(STAGES)


def test_what_is_found_outside_reaches_all_that_read_its_stage_and_always_the_report(descent: Path, keys):
    study = load_study(descent)
    for stage in STAGES:
        assert _changed(keys, stage_keys(study, False, {stage: {"x": 1}})) == {*readers(stage), "report"}


def test_readers_are_found_through_others_in_order():
    assert readers("priors") == ("priors", "fit", "check", "predict", "risk", "report")
    assert readers("check") == ("check", "risk", "report") and readers("report") == ("report",)
    assert readers("ingest") == ("ingest", "report")
    for stage, used in USES.items():
        assert all(STAGES.index(other) < STAGES.index(stage) for other in used)
