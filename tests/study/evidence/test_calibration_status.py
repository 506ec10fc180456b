"""Levels of runs: ten runs outside of what is stored, broken promises, contradictions, and flights of others."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from bayeschute.calibration.domain import Conditions, domain
from bayeschute.calibration.label import CONTRADICTED, Level
from bayeschute.study.evidence import calibration_status as module
from bayeschute.study.evidence.calibration_status import hint, status
from bayeschute.study.evidence.conditions import ORIGIN, RECORD, VIRTUAL
from bayeschute.study.evidence.identity import configuration, with_noise
from bayeschute.study.evidence.numerics_hash import numerics
from bayeschute.study.load import load_study

STUDY = load_study(Path(__file__).parents[3] / "models/studies/cdt-3-11.toml")
GOOD = {"rhat": {"passed": True}, "ess": {"passed": True}}
BAND = "cdt-3-12/swing_angle"
RATE = "cdt-3-12/mean sea_level_descent_rate"
UNITS = {"duration of fitted flights": "s", "time between samples of fitted flights": "s"}


def had(sampler="nuts", origin=VIRTUAL, channels=("canopy_position",), **changes):
    numbers = {
        "duration of fitted flights": 90.0, "time between samples of fitted flights": 0.1,
        "number of canopies of fitted flights": 2.0, "capsule mass of fitted flights": 9463.0,
        "fitted standard deviation of the horizontal wind": 0.75, "fitted noise of canopy position": 0.29,
    } | changes  # fmt: skip
    values = {name: [value] for name, value in numbers.items()}
    return Conditions(values, {"channels": list(channels), "sampler": [sampler], ORIGIN: [origin]}, UNITS)


def spread():
    """Conditions of replicates: the noise found varies, the rest is the same."""
    for share in (0.75, 0.9, 1.0, 1.1, 1.3):
        wind = {"fitted standard deviation of the horizontal wind": 0.75 * share}
        yield had(**wind, **{"fitted noise of canopy position": 0.29 * (0.5 + 0.5 * share)})


def stored(replicates=200, failed=0, disturbance="none", **coverage):
    shares = {"axial[1]": 0.91, "side*e": 0.5, BAND: 0.90} | coverage
    statistic = {"role": "predict", "share": 0.91, "standard_error": 0.02}
    return {
        "hash": configuration(STUDY), "numerics": numerics(), "disturbance": disturbance, "replicates": replicates,
        "failed": {str(seed): "did not converge" for seed in range(failed)}, "coverage": shares,
        "standard_error": dict.fromkeys(shares, 0.01), "parameters": {"axial[1]": {}, "side*e": {}},
        "bands": {BAND: {"role": "predict", "lowest": 0.62}}, "statistics": {RATE: statistic},
        "domain": domain(spread()),
    }  # fmt: skip


@pytest.fixture
def found(tmp_path, monkeypatch):
    """The status of a run among stored results."""
    place = tmp_path / "calibration"
    place.mkdir()
    monkeypatch.setattr(module, "places", lambda job: [place])

    def made(*results, study=STUDY, run=None, checks=GOOD, coverage=None):
        for old in place.glob("*.json"):
            old.unlink()
        for i, result in enumerate(results):
            (place / f"{i}.json").write_text(json.dumps(result))
        monkeypatch.setattr(module, "conditions", lambda job: run or had())
        (tmp_path / "priors.json").write_text(json.dumps([{"name": "axial[1]"}, {"name": "riser_length"}]))
        study = replace(study, path=Path("s.toml"))
        job = SimpleNamespace(
            study=study, out=tmp_path, quick=False, load=lambda name: json.loads((tmp_path / name).read_text())
        )
        return status(job, checks, coverage or {})

    return made


def test_a_run_inside_of_what_replicates_held_is_self_consistent(found):
    made = found(stored(), stored(8, disturbance="wind-profile", **{BAND: 0.74}))
    assert made.claim.level is Level.SELF_CONSISTENT and made.check["passed"] is True
    assert made.claim.label.startswith("self-consistent: 200 replicates, coverage of nominal 90 % intervals 90 to 91 %")
    assert "worst case stored of a wrong model: nominal 90 % bands held 74 ± 1 % of the swing angle" in made.claim.label
    assert "error of the recorded wind" in made.claim.label and "(8 replicates)" in made.claim.label


RECORDS = replace(STUDY, flights=tuple(replace(f, virtual=None, path=Path(__file__)) for f in STUDY.flights))
OUTSIDE = {
    "shorter": ({"run": had(**{"duration of fitted flights": 30.0})}, "duration of fitted flights 30 s, replicates had 90 s"),
    "longer": ({"run": had(**{"duration of fitted flights": 300.0})}, "duration of fitted flights 300 s"),
    "slower sampling": ({"run": had(**{"time between samples of fitted flights": 1.0})}, "between samples of fitted flights 1 s"),
    "stronger gusts": (
        {"run": had(**{"fitted standard deviation of the horizontal wind": 1.5})},
        "fitted standard deviation of the horizontal wind 1.5",
    ),
    "other payload": ({"run": had(**{"capsule mass of fitted flights": 6000.0})}, "capsule mass of fitted flights 6,000"),
    "other canopies": ({"run": had(**{"number of canopies of fitted flights": 3.0})}, "canopies of fitted flights 3"),
    "recorded flight": ({"study": RECORDS, "run": had(origin=RECORD)}, "the flights are records"),
    "other noise": ({"study": with_noise(STUDY, "ar1")}, "no calibration of this configuration is stored"),
    "other sampler": ({"run": had(sampler="emcee")}, "sampler emcee, replicates had nuts"),
    "missing channel": ({"run": had(channels=())}, "channels none, replicates had canopy_position"),
}  # fmt: skip


@pytest.mark.parametrize("which", OUTSIDE)
def test_runs_outside_carry_no_level_and_say_why(found, which):
    given, words = OUTSIDE[which]
    made = found(stored(), **given)
    assert made.claim.level is Level.NOT_CHECKED and made.check["passed"] is not True or which == "recorded flight"
    assert made.claim.level is Level.NOT_CHECKED and made.claim.label.startswith("not checked: ")
    assert words in made.claim.label


def test_older_numerics_are_said_and_give_no_level(found):
    made = found(stored() | {"numerics": "0" * 64, "versions": {"bayeschute": "0.1.0"}})
    assert made.claim.level is Level.NOT_CHECKED and made.check["passed"] is False
    assert made.claim.label.startswith("not checked with these numerics; the 200 replicates stored were made by other")


def test_an_older_misspecification_alone_checks_nothing(found):
    made = found(stored(disturbance="mass") | {"numerics": "0" * 64, "versions": {"bayeschute": "0.1.0"}})
    assert made.check["passed"] is None and "no calibration of this configuration is stored" in made.claim.label


def test_results_of_versions_without_a_hash_of_their_numerics_are_older_ones(found):
    old = stored() | {
        "hash": "0" * 64,
        "title": STUDY.title,
        "noise": "latent",
        "quick": False,
        "versions": {"bayeschute": "0.1.0"},
    }
    del old["numerics"]
    assert "not checked with these numerics" in found(old).claim.label
    assert found(old | {"title": "another"}).claim.lacking[0].startswith("no calibration of this configuration")


def test_a_calibration_without_a_domain_gives_no_level(found):
    old = stored()
    del old["domain"]
    assert "does not say which flights its replicates had" in found(old).claim.label


def test_nothing_stored_says_so_and_how_to_make_it(found):
    made = found()
    assert made.check["passed"] is None
    label = "not checked: no calibration of this configuration is stored (run `bayeschute calibrate s.toml`)"
    assert made.claim.label == label


@pytest.mark.parametrize(("share", "word"), [(0.6, "too narrow"), (0.99, "too wide")])
def test_a_broken_promise_is_named_and_no_level_is_left(found, share, word):
    made = found(stored(**{BAND: share}))
    assert made.check["passed"] is False and made.claim.level is Level.NOT_CHECKED
    assert f"swing angle of unseen flights held {100 * share:.0f} ± 1 % ({word})" in made.claim.label


def test_a_requirement_that_replicates_miss_takes_the_level(found):
    result = stored()
    result["statistics"][RATE] |= {"share": 0.7}
    assert "mean sea level descent rate of unseen flights held 70 ± 2 % (too narrow)" in found(result).claim.label


def test_few_replicates_prove_nothing(found):
    so_far = "so far nominal 90 % bands of unseen flights held 90 %"
    label = f"not checked: 20 replicates, 0 failed: at least 100 are needed ({so_far})"
    assert found(stored(20)).claim.label == label


@pytest.mark.parametrize(("failed", "level"), [(5, Level.SELF_CONSISTENT), (6, Level.NOT_CHECKED)])
def test_replicates_that_could_be_fitted_speak_for_all_only_while_few_failed(found, failed, level):
    made = found(stored(100, failed)).claim
    assert made.level is level and f"100 replicates{', 6' if failed == 6 else f' ({failed}'} failed" in made.label


def test_what_is_shown_and_not_promised_is_named(found):
    named = found(stored()).claim.not_promised
    assert "riser_length" in named and "landings" in named and "swing angle of fitted flights" in named
    assert "axial[1]" not in named and "mean sea level descent rate of unseen flights" not in named


def test_a_failed_check_of_the_computation_takes_the_level(found):
    made = found(stored(), checks=GOOD | {"rhat": {"passed": False}}).claim
    assert made.level is Level.NOT_CHECKED and made.label.startswith("not checked: failed checks: rhat")


def test_a_record_that_the_model_does_not_make_takes_the_level_first(found):
    missed = {"predictive": {"passed": False, "detail": "the record differs from the model: mean of capsule_velocity"}}
    made = found(stored(), checks=GOOD | missed).claim
    assert made.level is Level.NOT_CHECKED
    assert made.label.startswith(
        f"{CONTRADICTED}, no level: the record differs from the model: mean of capsule_velocity"
    )


def test_innovations_off_their_interval_take_the_level(found):
    missed = {"innovations": {"passed": False, "value": 0.71, "detail": "a share"}}
    made = found(stored(), checks=GOOD | missed).claim
    assert made.label.startswith(
        f"{CONTRADICTED}, no level: 71 % of the standardised innovations lie inside their 90 %"
    )


def test_a_run_whose_band_holds_a_third_of_the_swing_has_no_level(found):
    coverage = {"cdt-3-12": {"swing_angle": {"truth": 0.35, "record": 0.4, "draws": 400}}}
    made = found(stored(), coverage=coverage).claim
    assert made.label.startswith(
        f"{CONTRADICTED}, no level: the 90 % band of the swing angle of cdt-3-12 contains only 35 % of it"
    )
    coverage["cdt-3-12"]["swing_angle"]["truth"] = 0.7  # as low as a replicate's
    assert found(stored(), coverage=coverage).claim.level is Level.SELF_CONSISTENT


def test_without_replicates_a_flight_is_judged_by_how_rare_its_share_is_among_draws(found):
    entry = {"truth": None, "record": 0.6, "record_p": 0.005, "draws": 400}
    coverage = {"cdt-3-12": {"swing_angle": entry}}
    label = found(coverage=coverage).claim.label
    assert "the 90 % band of the swing angle of cdt-3-12 contains only 60 % of it (p 0.005)" in label
    for usual in ({"record_p": 0.02}, {"record_p": None}, {"draws": 0}):  # not rare, no draw, nothing flown
        assert CONTRADICTED not in found(coverage={"cdt-3-12": {"swing_angle": entry | usual}}).claim.label
    half = found(coverage={"cdt-3-12": {"swing_angle": entry | {"record": 0.49, "record_p": 0.2}}}).claim.label
    assert "contains only 49 % of it" in half and "(p" not in half  # where few draws, of many flights, can't tell
    several = replace(RECORDS, flights=tuple(replace(RECORDS.flights[1], name=f"f{i}") for i in range(3)))
    for p, contradicted in ((0.004, False), (0.003, True)):  # one in a hundred over all three
        label = found(study=several, coverage={"f1": {"swing_angle": entry | {"record_p": p}}}).claim.label
        assert (CONTRADICTED in label) == contradicted


def held_out(count, share, simulated_by=None):
    flights = [replace(RECORDS.flights[1], name=f"f{i}", simulated_by=simulated_by) for i in range(count)]
    study = replace(RECORDS, flights=(replace(RECORDS.flights[0], simulated_by=simulated_by), *flights))
    shares = [share + 0.02 * (-1) ** i for i in range(count)]
    return study, {f"f{i}": {"swing_angle": {"truth": None, "record": s, "draws": 400}} for i, s in enumerate(shares)}


@pytest.mark.parametrize(("by", "level"), [(None, Level.RECORDED), ("Adams", Level.OTHER_PROGRAMS)])
def test_held_out_flights_of_others_give_their_level(found, by, level):
    study, coverage = held_out(20, 0.9, by)
    made = found(stored(), study=study, coverage=coverage).claim
    assert made.level is level and "20 flights" in made.label
    few, coverage = held_out(19, 0.9, by)
    assert found(stored(), study=few, coverage=coverage).claim.level is Level.NOT_CHECKED


def test_held_out_flights_that_bands_miss_contradict(found):
    study, coverage = held_out(20, 0.7)
    assert found(stored(), study=study, coverage=coverage).claim.label.startswith(CONTRADICTED)


def test_records_of_a_descent_need_no_replicates(found):
    study, coverage = held_out(20, 0.9)
    made = found(study=replace(study, model="descent", vehicle=None), coverage=coverage).claim
    assert made.level is Level.RECORDED


def test_recorded_flights_and_descents_are_not_sent_to_a_command_that_refuses_them():
    assert "with the same tables and with virtual flights" in hint(RECORDS)
    assert hint(replace(STUDY, model="descent")) == "calibration is not available for the descent model"
