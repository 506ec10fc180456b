"""Candidate drops: how each would be recorded, and what their files may not say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.landing.plans import ROOT

from bayeschute.core.errors import InputError
from bayeschute.dynamics.cluster_flight import with_parameters
from bayeschute.likelihood.priors import Prior
from bayeschute.study.assembly import assemble
from bayeschute.study.landing_campaign.candidate_drops import candidates, fly_candidate
from bayeschute.study.load import load_study
from bayeschute.study.schema.vehicle_schema import NOT_FLOWN
from bayeschute.virtual.drop import fly

STUDY = load_study(ROOT / "models/studies/cdt-3-11.toml")
SHIPPED = ROOT / "models/campaigns/candidate-drops.toml"


def test_noise_that_a_drop_does_not_state_is_the_study_s():
    shipped = candidates(SHIPPED, STUDY)
    assert list(shipped.noise) == [f.name for f in shipped.study.flights if f not in STUDY.flights]
    assert shipped.noise["short"] == STUDY.noise
    fine = shipped.noise["fine-positions"]
    assert (
        fine.canopy_position.white == 0.05
        and fine.model_copy(update={"canopy_position": STUDY.noise.canopy_position}) == STUDY.noise
    )
    sounded = shipped.noise["second-sounding"]
    assert sounded.slow_wind.horizontal == pytest.approx(0.3 * 0.3048) and sounded.wind == STUDY.noise.wind


def uncommented() -> str:
    """The shipped file with its commented drop."""
    head, rest = SHIPPED.read_text(encoding="utf-8").split("# [[flight]]", 1)
    return head + "\n".join(line.removeprefix("# ") for line in f"# [[flight]]{rest}".splitlines())


def test_the_commented_drop_carries_imus_in_its_canopies(tmp_path):
    path, text = tmp_path / "drops.toml", uncommented()
    path.write_text(text, encoding="utf-8")
    found, shipped = candidates(path, STUDY), candidates(SHIPPED, STUDY)
    assert list(found.noise) == [*shipped.noise, "canopy-imu"]  # after the others, which are as they were
    assert found.study.flights[: len(shipped.study.flights)] == shipped.study.flights
    noise, flight = found.noise["canopy-imu"], found.study.flights[-1]
    assert noise.canopy_velocity is not None and noise.model_copy(update={"canopy_velocity": None}) == STUDY.noise
    sensor = flight.virtual.sensors.canopy_velocity
    assert (sensor.white, sensor.correlated, sensor.time_constant) == (0.05, 0.15, 1.0)
    assert (ROOT / "src/bayeschute/templates/candidate-drops.toml").read_text(encoding="utf-8") == SHIPPED.read_text(
        encoding="utf-8"
    )
    sensor = 'canopy_velocity = { white = "0.05 m/s", correlated = "0.15 m/s", time_constant = "1 s" }\ncapsule'
    assert sensor in text
    path.write_text(text.replace(sensor, "capsule"), encoding="utf-8")
    with pytest.raises(InputError, match="canopy_velocity, which it does not record"):
        candidates(path, STUDY)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('name = "short"', 'name = "cdt-3-11"', "name of a fitted flight"),
        (
            'name = "short"', 'name = "short"\nnoise = { riser_tension = { white = "1 kN", kind = "white" } }',
            "riser_tension, which it does not record",
        ),
        ('name = "short"', 'name = "short"\nnoise = { model = "white" }', "wanted the posterior's: 'latent'"),
        ('name = "short"', 'name = "short"\nnoise = { gusts = "2 m/s" }', "gusts"),
        ('name = "short"', 'name = "short"\nfile = "drop.csv"', "virtual"),
        ('duration = "25 s"', 'duration = "25 s"\ncanopy_sd = { "axial[1]" = 0.02 }', "canopies that differ"),
    ],
)  # fmt: skip
def test_faults_of_a_file_of_candidates(tmp_path, old, new, words):
    path, text = tmp_path / "drops.toml", SHIPPED.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=words):
        candidates(path, STUDY)


def test_a_study_s_flights_have_no_noise_of_their_own(tmp_path):
    """It is a drop's that might be flown; flights to be predicted are read by the same table without it."""
    from bayeschute.study.load import load_flights

    with pytest.raises(InputError, match="noise"):
        load_flights(SHIPPED, STUDY)


def test_a_vehicle_without_aerodynamics_flies_candidates_by_the_posterior(tmp_path):
    """A record's vehicle has none; with the coefficients of one that has them, the same record comes out."""
    path = tmp_path / "drops.toml"
    path.write_text(SHIPPED.read_text(encoding="utf-8").replace('"25 s"', '"6 s"'), encoding="utf-8")
    bare = replace(STUDY, vehicle=STUDY.vehicle.model_copy(update={"aero": NOT_FLOWN}))
    with_it, without = candidates(path, STUDY).study, candidates(path, bare).study
    assert [f.name for f in without.flights] == [f.name for f in with_it.flights]
    values = {**STUDY.vehicle.aero.coefficients(), "riser_length": 71.0, "enclosed_air_factor": 1.2}
    priors = [Prior(n, x, 0.1, n == "enclosed_air_factor", "1", "test") for n, x in values.items()]
    theta = np.array([np.log(x) if p.logarithmic else x for p, x in zip(priors, values.values(), strict=True)])
    (flight,) = [f for f in without.flights if f.name == "short"]
    found = fly_candidate(without, flight, priors, STUDY.flights[0], theta, seed=3)
    model, structure = assemble.cluster(STUDY.vehicle)
    model = with_parameters(model, structure, ("riser_length", "enclosed_air_factor"), theta[-2:])
    wanted, _ = fly(assemble.drop(flight.virtual), model, structure, 3)
    for name in ("canopy_position", "capsule_velocity", "wind"):
        np.testing.assert_array_equal(found[name].values, wanted[name].values)
    names = (*[p.name for p in priors], "canopy_position_scale")
    seen = [
        replace(priors[0], name=n) if n == names[-1] else p for n, p in zip(names, [*priors, priors[0]], strict=True)
    ]
    scaled = fly_candidate(without, flight, seen, STUDY.flights[0], np.append(theta, 1.02), seed=3)
    apart, wide = (x["canopy_position"] - x["capsule_position"] for x in (found, scaled))
    np.testing.assert_allclose(wide.values, 1.02 * apart.values, rtol=1e-9)
    np.testing.assert_array_equal(scaled["capsule_velocity"].values, found["capsule_velocity"].values)
    stretched = fly_candidate(without, flight, priors, STUDY.flights[0], theta + np.eye(theta.size)[-2], seed=3)
    assert np.abs(stretched["canopy_position"].values - found["canopy_position"].values).max() > 0.5
