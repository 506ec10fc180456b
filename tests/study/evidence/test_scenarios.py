"""Disturbances change what is flown, each in its one way, and leave the identification's study alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bayeschute.study.assembly import assemble
from bayeschute.study.evidence.scenarios import HEAVIER, SCENARIOS
from bayeschute.study.load import load_study
from bayeschute.study.study import canonical
from bayeschute.virtual.drop import fly

STUDY = load_study(Path(__file__).parents[3] / "models/studies/cdt-3-11.toml")


def flown(name):
    return SCENARIOS[name].flown(STUDY)


def drops(study):
    return [f.virtual for f in study.flights]


def test_none_flies_the_study_itself():
    assert canonical(flown("none")) == canonical(STUDY)


@pytest.mark.parametrize("name", [n for n in SCENARIOS if n != "none"])
def test_each_changes_what_is_flown_and_nothing_of_the_identification(name):
    before, changed = canonical(STUDY), canonical(flown(name))
    assert changed != before
    for key in ("model", "structure", "priors", "noise", "sampler", "predict"):
        assert changed[key] == before[key]
    assert canonical(STUDY) == before


def test_gusts_have_the_strength_and_the_time_they_are_named_for():
    for old, strong, short, long in zip(
        drops(STUDY), drops(flown("strong-gusts")), drops(flown("short-gusts")), drops(flown("long-gusts")), strict=True
    ):
        assert strong.turbulence.horizontal == pytest.approx(2.0 * old.turbulence.horizontal)
        assert strong.turbulence.vertical == pytest.approx(2.0 * old.turbulence.vertical)
        assert strong.turbulence.time_constant == old.turbulence.time_constant
        assert (short.turbulence.time_constant, long.turbulence.time_constant) == (1.5, 30.0)
        assert short.turbulence.horizontal == long.turbulence.horizontal == old.turbulence.horizontal


def test_breathing_wind_and_dropouts():
    for old, breathing, wind, gaps in zip(
        drops(STUDY), drops(flown("breathing")), drops(flown("wind-profile")), drops(flown("dropouts")), strict=True
    ):
        assert breathing.breathing.amplitude == pytest.approx(3.0 * old.breathing.amplitude)
        assert wind.sensors.wind.correlated == pytest.approx(3.0 * old.sensors.wind.correlated)
        assert wind.sensors.wind.time_constant == 60.0
        if old.sensors.dropouts is not None:
            assert (gaps.sensors.dropouts.share, gaps.sensors.dropouts.mean_length) == (0.2, 2.0)


def test_every_capsule_is_heavier_also_where_a_flight_has_its_own():
    heavy = flown("mass")
    assert heavy.vehicle.capsule.mass == pytest.approx(HEAVIER * STUDY.vehicle.capsule.mass)
    for old, new in zip(STUDY.flights, heavy.flights, strict=True):
        if old.capsule_mass is None:
            assert new.capsule_mass is None
        else:
            assert new.capsule_mass == pytest.approx(HEAVIER * old.capsule_mass)


def test_another_form_has_terms_of_no_pool_and_therefore_no_true_values():
    aero = flown("form").vehicle.aero
    pool = STUDY.structure
    assert "alpha^3" in aero.axial and "alpha^3" not in pool.axial
    assert "e*alpha" in aero.transverse and "e*alpha" not in pool.transverse
    assert not SCENARIOS["form"].terms_known


@pytest.mark.parametrize("name", SCENARIOS)
def test_what_is_flown_stays_finite(name):
    study = flown(name)
    model, structure = assemble.cluster(study.vehicle)
    for flight in study.flights:
        _, truth = fly(assemble.drop(flight.virtual), model, structure, 20_000)
        assert np.abs(truth["swing_angle"].values).max() < np.radians(40.0)
