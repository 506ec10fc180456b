"""The summary of a run: true values of virtual drops, lost simulations, noise as found, and what a search chose."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from bayeschute.api.drop_by_drop import taught_table
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior.term_search import PENALTY
from bayeschute.study.load import load_study
from bayeschute.study.run import forecasts
from bayeschute.study.run import stage_report as module
from bayeschute.study.run.stage_report import bands_check, flown_terms, true_values, what_flights_taught

STUDY = load_study(Path(__file__).parents[3] / "models/studies/cdt-3-11.toml")


def test_the_default_study_promises_the_terms_it_flies():
    assert {"axial[1]", "axial[alpha^2]"} <= set(flown_terms(STUDY))


@pytest.mark.parametrize(("failed", "told"), [(8, False), (9, True), (297, True)])
def test_bands_of_the_simulations_that_are_left_fail_where_many_are_lost(failed, told):
    entry = {"draws": 400 - failed, "failed": failed}
    made = bands_check({"sound": {"swing_angle": {"draws": 400, "failed": 0}}, "new": {"swing_angle": entry}})
    if not told:
        assert made == {}
        return
    check = made["bands"]
    assert check["passed"] is False and check["value"] == failed / 400 > check["bound"]
    assert check["detail"] == f"{failed} of 400 simulations of new failed: its bands are of the others"


def test_the_check_of_bands_has_the_greatest_share_and_all_the_words():
    table = {"a": {"draws": 300, "failed": 100}, "b": {"draws": 390, "failed": 10}}
    made = bands_check({"one": table, "two": {"a": {"draws": 0, "failed": 400}}, "none": {}})["bands"]
    assert made["value"] == 1.0
    assert made["detail"].split("; ") == [
        "100 of 400 simulations of one failed: its bands are of the others",
        "400 of 400 simulations of two failed: it has no bands",
    ]


def test_every_row_says_which_coordinate_it_is_of():
    """A fit with the apparent mass has coefficients of transverse force at the vehicle's own."""
    force = Prior("transverse[e]", 0.1, 0.2, False, "1", "x", air_share=0.8)
    stiff = Prior("riser_stiffness", 12.0, 0.2, True, "N/m", "x")
    air = Prior("enclosed_air_factor", 0.0, 0.5, True, "1", "x")
    rng = np.random.default_rng(1)
    draws = {p.name: rng.lognormal(0.0, 0.1, (2, 50)) for p in (force, stiff, air)}

    def said(*priors):
        told = what_flights_taught(priors, {p.name: draws[p.name] for p in priors}, ["x"])
        return taught_table([told])["coordinate"].tolist()

    assert said(force, stiff) == ["value", "logarithm"]
    assert said(force, stiff, air) == ["at the vehicle's apparent mass", "logarithm", "logarithm"]


def numbers(names, draws, prior, **truth):
    """Entries of parameters whose truth is known of some."""
    told = {key: dict.fromkeys(names, i) for i, key in enumerate(("rhat", "ess_bulk", "ess_tail"))}
    job = SimpleNamespace(truth=truth)
    return module._parameters(job, draws, prior, dict.fromkeys(names, "m"), told)


def test_parameters_in_numbers(monkeypatch):
    monkeypatch.setattr(module, "true_values", lambda job: job.truth)
    x = np.arange(101.0).reshape(1, 101)
    made = numbers(("a", "b"), {"a": x, "b": 2.0 * x}, {"a": 4.0 * x - 7.0, "b": x}, b=3.0)
    one = made["a"]
    assert (one["q05"], one["q50"], one["q95"], one["mean"]) == (5.0, 50.0, 95.0, 50.0)
    assert one["sd"] == pytest.approx(x.std()) and one["prior_mean"] == 193.0
    assert one["prior_sd"] == pytest.approx(4.0 * x.std()) and one["contraction"] == pytest.approx(1.0 - 1.0 / 16.0)
    assert made["b"]["contraction"] == pytest.approx(-3.0) and made["b"]["truth"] == 3.0 and "truth" not in one
    assert (one["rhat"], one["ess_bulk"], one["ess_tail"], one["unit"]) == (0, 1, 2, "m")


def flight(name="a", canopy_sd=None, measured=False):
    return SimpleNamespace(name=name, virtual=None if measured else SimpleNamespace(canopy_sd=canopy_sd))


def study(*flights, vary_canopies=None, vehicle=True):
    capsule = SimpleNamespace(
        mass=9000.0, axial_force=0.7, normal_force_slope=None, pitch_moment_slope=-0.1, pitch_damping=-0.2
    )
    own = SimpleNamespace(
        risers=SimpleNamespace(length=70.0, stiffness=1e5, damping=2e3),
        capsule=capsule,
        canopies=SimpleNamespace(number=3, dry_mass=150.0, pitch_moment_slope=-0.3, pitch_damping=-0.4),
        aero=SimpleNamespace(coefficients=lambda: {"axial[1]": 0.8}),
    )
    return SimpleNamespace(
        vehicle=own if vehicle else None,
        with_role=lambda role: flights if role == "identify" else (),
        priors=SimpleNamespace(vary_canopies=vary_canopies),
    )


NAMES = {
    "axial[1]": 0.8, "axial[alpha^2]": 0.0, "capsule_mass": 9000.0, "canopy_mass": 150.0, "enclosed_air_factor": 1.0,
    "canopy_position_scale": 1.0, "capsule_inertia_factor_y": 1.0, "capsule_axial_force": 0.7, "capsule_normal_force_slope": 0.0,
    "capsule_pitch_moment_slope": -0.1, "capsule_pitch_damping": -0.2, "canopy_pitch_moment_slope": -0.3,
    "canopy_pitch_damping": -0.4, "riser_length": 70.0, "riser_stiffness": 1e5, "riser_damping": 2e3,
}  # fmt: skip


def test_true_values_are_those_of_the_vehicle_and_zero_of_a_term_that_was_not_flown(monkeypatch):
    monkeypatch.setattr(module, "load_priors", lambda job: [SimpleNamespace(name=name) for name in NAMES])
    assert true_values(SimpleNamespace(study=study(flight()))) == NAMES
    assert true_values(SimpleNamespace(study=study(flight(), flight("b", measured=True)))) == {}
    assert true_values(SimpleNamespace(study=study(flight(), vehicle=False))) == {}


def test_every_canopy_has_its_own_truth_and_the_spread_is_known_where_drops_agree(monkeypatch):
    drawn = {"a": {"axial[1]": np.array([0.7, 0.8, 0.9])}, "b": {}}
    monkeypatch.setattr(module.canopies, "flown", lambda study, flight, seed: drawn[flight.name])
    monkeypatch.setattr(module.assemble, "flight_seed", lambda study, flight: 1)
    law = {"axial[1]": 0.1}
    made = module._of_members(
        study(flight("a", law), flight("b", law), vary_canopies=("axial[1]",)), {"axial[1]": 0.85}
    )
    assert made.pop("sd(axial[1])") == 0.1
    assert made == {f"axial[1]@a.canopy{i + 1}": v for i, v in enumerate((0.7, 0.8, 0.9))} | {
        f"axial[1]@b.canopy{i}": 0.85 for i in (1, 2, 3)
    }
    differ = module._of_members(study(flight("a", law), flight("b"), vary_canopies=("axial[1]",)), {})
    assert "sd(axial[1])" not in differ and differ["axial[1]@b.canopy1"] == 0.0
    assert module._of_members(study(flight("a")), {}) == {}


def test_noise_as_found_is_told_by_its_kind(monkeypatch):
    """A process of three numbers is an oscillator, one of two a drift; winds are speeds, others shares."""
    noise = SimpleNamespace(
        white=np.array([0.1, 0.2]), correlated=np.array([0.3, 0.4]), time_constant=np.array([5.0, 6.0])
    )
    processes = [np.array([1.0, 0.2, 0.3]), np.array([2.0, 9.0])]
    found = SimpleNamespace(noise=noise, disturbance_parameters=processes)
    monkeypatch.setattr(module, "load_noise_parameters", lambda job, group: found if group == "first" else None)
    monkeypatch.setattr(module, "groups", lambda job: ["first", "second"])
    monkeypatch.setattr(module.assemble, "noise_parameter_names", lambda study: ["breathing", "wind_aloft"])
    monkeypatch.setattr(module.formulation, "unused_of", lambda channel, model: [channel] if channel else [])
    channels = {"descent_rate": None, "swing_angle": "correlated"}
    table = SimpleNamespace(model="latent", channels=lambda: channels)
    made = module._disturbances(SimpleNamespace(study=SimpleNamespace(noise=table)))
    assert made["noise_model"] == "latent"
    rate, swing = made["noise"]["descent_rate"], made["noise"]["swing_angle"]
    assert rate == {"white": 0.1, "correlated": 0.3, "time_constant": 5.0, "unit": "m/s"}
    assert swing == {"white": 0.2, "correlated": None, "time_constant": 6.0, "unit": "rad"}
    assert made["noise"]["breathing"] == {
        "white": None, "correlated": 1.0, "unit": "1", "frequency": 0.2, "damping_ratio": 0.3,
    }  # fmt: skip
    assert made["noise"]["wind_aloft"] == {"white": None, "correlated": 2.0, "unit": "m/s", "time_constant": 9.0}


@pytest.mark.parametrize("fit", ["search", "selected", "pool"])
def test_terms_of_the_fit_are_told_with_the_evidence_of_a_search(monkeypatch, fit):
    names = ("axial[1]", "transverse[e]", "riser_length")
    monkeypatch.setattr(module, "load_priors", lambda job: [SimpleNamespace(name=n) for n in names])
    scores = {"transverse[e]": 20.0, "axial[alpha^2]": None, "axial[alpha^4]": -1.0}
    study = SimpleNamespace(structure=SimpleNamespace(fit=fit))
    told = module._fitted_terms(SimpleNamespace(study=study, load=lambda name: {"scores": scores}))["fitted_terms"]
    assert told["terms"] == ["axial[1]", "transverse[e]"] and told["how"] == fit
    known = {"log_bayes_factors": {"transverse[e]": 20.0, "axial[alpha^4]": -1.0}, "threshold": PENALTY}
    assert {k: told[k] for k in told if k not in ("terms", "how")} == (known if fit == "search" else {})


def test_a_fit_without_terms_tells_none(monkeypatch):
    monkeypatch.setattr(module, "load_priors", lambda job: [SimpleNamespace(name="cds_over_mass")])
    for structure in (None, SimpleNamespace(fit="pool")):
        assert module._fitted_terms(SimpleNamespace(study=SimpleNamespace(structure=structure))) == {}


def test_a_file_that_no_stage_left_is_no_entry(tmp_path):
    job = SimpleNamespace(out=tmp_path, load=lambda name: f"content of {name}")
    assert module._stored(job, "key", "a.json") == {}
    (tmp_path / "a.json").write_text("x")
    assert module._stored(job, "key", "a.json") == {"key": "content of a.json"}


def test_noise_parameters_at_a_limit_are_told_and_others_are_not(monkeypatch):
    """Only one that came to rest there: within a hundredth of the logarithm, at either end, and in use."""
    study = load_study(Path(__file__).parents[3] / "models/studies/cdt-3-11.toml")
    job = SimpleNamespace(study=study)
    labels, _ = module.noise_labels(job)
    low, high = module.assemble.noise_prior(study).limits()
    slow, rate = labels.index("slow wind, vertical, time constant"), labels.index("breathing, frequency")

    def told(vector, used=True):
        monkeypatch.setattr(module, "groups", lambda job: [None])
        monkeypatch.setattr(module, "load_noise_parameters", lambda job, group: vector)
        monkeypatch.setattr(module, "to_vector", lambda vector: vector)
        monkeypatch.setattr(module, "noise_labels", lambda job: (labels, np.full(len(labels), used)))
        return module._at_limits(job)

    middle = (low + high) / 2.0
    assert told(middle) == []
    middle[slow], middle[rate] = high[slow] - 0.005, low[rate] + 0.02
    (note,) = told(middle)
    assert note.endswith(f"would go: slow wind, vertical, time constant (at most {np.exp(high[slow]):.3g} s).")
    middle[rate] = low[rate]
    (note,) = told(middle)
    assert f"would go: breathing, frequency (at least {np.exp(low[rate]):.3g} Hz); slow wind" in note
    assert told(middle, used=False) == []


def test_the_angle_at_which_powers_level_off_is_told(monkeypatch):
    def notes(saturation, saturate):
        monkeypatch.setattr(
            module, "load_priors", lambda job: [SimpleNamespace(name="axial[1]", saturation=saturation)]
        )
        return module._saturation(SimpleNamespace(study=SimpleNamespace(structure=SimpleNamespace(saturate=saturate))))

    assert notes(None, "auto") == []
    (asked,), (found,) = notes(0.4, "always"), notes(0.4, "auto")
    assert asked.startswith("At 22.9 deg, which few samples") and "were lost" not in asked
    assert found.startswith("At 22.9 deg") and "since flights with powers that go on were lost" in found


def test_lost_simulations_name_the_remedy_that_is_left(monkeypatch):
    """None where powers of the angle level off already, be it by an earlier drop's, or nothing has such powers."""
    table = {"a": {"swing_angle": {"draws": 300, "failed": 100}}}
    monkeypatch.setattr(forecasts, "load_priors", lambda job: [SimpleNamespace(saturation=job.saturation)])

    def remedy(study, saturation=None):
        return module.when_lost(SimpleNamespace(study=study, saturation=saturation))

    made = bands_check(table, remedy(STUDY))["bands"]["detail"]
    assert made.startswith("100 of 400") and 'saturate = "always"' in made.split("; ")[1]
    for said in (remedy(STUDY, 0.4), remedy(replace(STUDY, structure=None))):
        assert said == "" and bands_check(table, said)["bands"]["detail"].count("; ") == 0
