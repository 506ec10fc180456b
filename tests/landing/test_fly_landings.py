"""Landings: rows that hold together and depend on nothing but their numbers, and the drift of the wind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayeschute.atmosphere.standard import standard_density
from bayeschute.compiler.runge_kutta import Stepping
from bayeschute.landing import campaign_plan
from bayeschute.landing.fly_landings import fly, nested
from bayeschute.landing.measures import LABELS, MEASURES
from bayeschute.landing.wind_plan import WindPlan


@pytest.fixture(scope="module")
def landed(plan):
    return fly(plan, nested(plan.draws, 48))


def test_rows_hold_together(landed):
    assert (landed["outcome"] == 0).all()
    speed = np.hypot(landed["vertical_speed"], landed["horizontal_speed"])
    body = np.sqrt(sum(landed[f"velocity_{a}"] ** 2 for a in "xyz"))
    np.testing.assert_allclose(body, speed, rtol=1e-3)
    np.testing.assert_allclose(np.cos(landed["incidence"]), -landed["velocity_x"] / body, atol=1e-9)
    ratio = np.sqrt(standard_density(np.array([302.0]))[0] / 1.225)
    np.testing.assert_allclose(landed["sea_level_vertical_speed"], ratio * landed["vertical_speed"], rtol=1e-4)
    assert {LABELS[i] for i in landed["label"]} <= set(LABELS)
    assert all(np.isfinite(landed[name]).all() for name in MEASURES)
    weight = 9463.0 * 9.81
    assert np.median(landed["riser_tension_sum"]) == pytest.approx(weight, rel=0.2)


def test_a_landing_is_the_same_in_another_batch_and_order(plan, landed):
    ids = nested(plan.draws, 48)
    some = np.array([31, 5, 5, 17])
    again = fly(plan, ids[some])
    for name in landed.dtype.names:
        np.testing.assert_allclose(again[name], landed[name][some], rtol=1e-10, atol=1e-10)


def test_landings_that_share_all_but_one_differ_by_that(plan):
    ids = np.array([[0, 1, 1, 1, 1, 1], [0, 1, 1, 2, 1, 1], [1, 1, 1, 1, 1, 1]])
    made = fly(plan, ids)
    assert (made["start_altitude"][0] == made["start_altitude"]).all()
    assert (made["wind_shear"][0] == made["wind_shear"]).all()
    assert len(set(made["vertical_speed"])) == 3


def test_drift_is_that_of_the_wind(plan):
    calm = replace(plan, winds=WindPlan(), models=(_quiet(plan.models[0]),))
    windy = replace(calm, winds=replace(plan.winds, error_sd=0.0))
    ids = nested(plan.draws, 8)
    without, with_ = fly(calm, ids), fly(windy, ids)
    assert np.abs(without["surface_wind_north"]).max() < 1e-7
    profile = plan.winds.profiles[0]
    h = np.arange(302.0, 700.0)
    mean = np.interp(h, profile.altitude, profile.wind[:, 0]).mean()
    np.testing.assert_allclose((with_["drift_north"] - without["drift_north"]) / with_["time"], mean, atol=1.0)
    np.testing.assert_allclose(
        with_["surface_wind_north"], np.interp(302.0, profile.altitude, profile.wind[:, 0]), atol=0.05
    )


def _quiet(one):
    return replace(one, laws=tuple(np.concatenate([1e-9 * law[:, :1], law[:, 1:]], axis=1) for law in one.laws))


def test_steps_are_short_enough_for_what_gusts_do_to_risers(plan, landed, monkeypatch):
    """Against several times as many: two extended ones to a sample, which are stable, err by 0.7 m/s."""
    monkeypatch.setattr(campaign_plan, "stepping", lambda one: Stepping(40))
    tight = fly(replace(plan), nested(plan.draws, 48))
    for name, most in (("vertical_speed", 1e-3), ("horizontal_speed", 1e-3), ("incidence", 1e-4)):
        np.testing.assert_allclose(landed[name], tight[name], atol=most)
