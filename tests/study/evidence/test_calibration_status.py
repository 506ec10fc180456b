"""A run is called verified only where its checks pass and enough replicates of its configuration kept the promise."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from bayeschute.study.evidence.calibration_status import NONE_STORED, calibration_check, hint, verification
from bayeschute.study.evidence.identity import configuration
from bayeschute.study.load import load_study
from bayeschute.study.run.stage_report import flown_terms

STUDY = load_study(Path(__file__).parents[3] / "models/studies/cdt-3-11.toml")
GOOD = {"rhat": {"passed": True}, "ess": {"passed": True}}
BAND = "cdt-3-12/swing_angle"


@pytest.fixture
def label(tmp_path, monkeypatch):
    monkeypatch.setattr("bayeschute.study.evidence.calibration_status.places", lambda job: [tmp_path / "calibration"])

    def made(checks=GOOD, replicates=None, failed=0, **coverage):
        if replicates is not None:
            shares = {"axial[1]": 0.9, "side*e": 0.5, BAND: 0.88} | coverage
            result = {
                "hash": configuration(STUDY), "disturbance": "none", "replicates": replicates,
                "failed": {str(seed): "did not converge" for seed in range(failed)},
                "coverage": shares, "standard_error": dict.fromkeys(shares, 0.03),
                "parameters": {"axial[1]": {}, "side*e": {}}, "bands": {BAND: {"role": "predict"}},
            }  # fmt: skip
            (tmp_path / "calibration").mkdir(exist_ok=True)
            (tmp_path / "calibration/latent.none.json").write_text(json.dumps(result))
        study = replace(STUDY, path=Path("s.toml"))
        job = SimpleNamespace(study=study, out=tmp_path, quick=False)
        check = calibration_check(job)
        return check, verification(checks | {"calibration": check}, study)

    return made


def test_nothing_stored_says_so_and_how_to_make_it(label):
    check, says = label()
    assert check["passed"] is None
    assert says == f"not verified: {NONE_STORED} (run `bayeschute calibrate s.toml`)"


def test_verified_where_all_that_is_promised_was_kept(label):
    check, says = label(replicates=100)
    assert check["passed"] is True
    assert set(check["held"]) == {"axial[1]", BAND}
    assert says.startswith("verified: 100 replicate flights, 0 failed") and "88 to 90 %" in says


@pytest.mark.parametrize(("share", "word"), [(0.6, "too narrow"), (0.99, "too wide")])
def test_a_broken_promise_is_named(label, share, word):
    check, says = label(replicates=100, **{BAND: share})
    assert check["passed"] is False
    assert says.startswith("not verified: ") and f"{BAND} is {100 * share:.0f} % ({word})" in says
    assert check["value"] == share


def test_few_replicates_prove_nothing(label):
    _, says = label(replicates=20)
    assert says == "not verified: only 20 replicates are stored, at least 100 are needed"


@pytest.mark.parametrize(("failed", "passed"), [(5, True), (6, False)])
def test_replicates_that_could_be_fitted_speak_for_all_only_while_few_failed(label, failed, passed):
    check, says = label(replicates=100, failed=failed)
    assert check["passed"] is passed
    assert says.startswith(f"{'' if passed else 'not '}verified: 100 replicate flights, {failed} failed")
    assert ("so many failures" in says) is not passed


def test_a_run_that_missed_its_own_checks_is_not_verified_by_replicates(label):
    _, says = label(checks=GOOD | {"rhat": {"passed": False}}, replicates=100)
    assert says == "not verified: failed checks: rhat"


def test_the_default_study_promises_the_terms_it_flies():
    assert {"axial[1]", "axial[alpha^2]"} <= set(flown_terms(STUDY))


def test_recorded_flights_and_descents_are_not_sent_to_a_command_that_refuses_them():
    recorded = replace(STUDY, flights=tuple(replace(f, virtual=None) for f in STUDY.flights))
    assert "with the same tables and with virtual flights" in hint(recorded)
    assert hint(replace(STUDY, model="descent")) == "calibration is not available for the descent model"
