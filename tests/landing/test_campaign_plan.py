"""Campaigns of landings as numbers: altitudes, draws through all models, and the steps that the stiffest draw needs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.landing.plans import single

from bayeschute.atmosphere.standard import standard_density
from bayeschute.dynamics.step_size import steps
from bayeschute.landing import campaign_plan as module
from bayeschute.landing.campaign_plan import flight_model, stepping
from bayeschute.landing.descend import SAMPLE, SECOND
from bayeschute.landing.start_plan import StartPlan
from bayeschute.landing.wind_plan import STEP

POLES = np.array([-60.0 + 0.0j])


@pytest.fixture
def asked(monkeypatch):
    """What poles were asked of; the fastest is said to be 60 1/s."""
    seen = []
    monkeypatch.setattr(module, "poles", lambda *given: seen.append(given) or POLES)
    return seen


def test_a_plan_counts_draws_through_all_models_and_ends_at_the_contact(plan):
    two = replace(plan, models=(plan.models[0], replace(plan.models[0], theta=plan.models[0].theta[:5])))
    assert plan.draws == 12 and two.draws == 17 and plan.floor == 302.0
    assert plan != replace(plan) and len({plan, replace(plan)}) == 2  # never equal to another


def test_winds_are_held_from_below_the_floor_to_above_the_highest_start(plan):
    made = replace(plan, start=StartPlan((700.0, 20.0))).altitudes
    assert made[0] == 282.0 and set(np.diff(made)) == {STEP} and 820.0 + 300.0 - STEP <= made[-1] < 820.0 + 300.0


def test_the_model_of_a_plan_is_made_once_and_has_the_air_of_all_its_altitudes(plan, asked):
    own = replace(plan)
    model = flight_model(own, 0)
    assert flight_model(own, 0) is model and len(asked) == 1
    assert model.middle - model.half == 302.0 - 800.0 and model.middle + model.half == 760.0 + 300.0
    h = np.linspace(-498.0, 1060.0, 7)
    np.testing.assert_allclose([float(model.density_at(one)) for one in h], standard_density(h), rtol=1e-6)
    np.testing.assert_allclose(model.clock, 0.2 * np.arange(6))
    assert (model.dt, len(model.clock)) == (SAMPLE, SECOND + 1)
    assert model.stepping == steps(POLES, SAMPLE)
    assert model.names == own.models[0].names and model.structure == own.models[0].structure


def test_steps_are_of_the_stiffest_risers_among_the_draws_and_else_of_their_mean(plan, asked):
    one = plan.models[0]
    rng = np.random.default_rng(0)
    more = np.concatenate([one.theta, rng.standard_normal((12, 2))], axis=1)
    stiff = replace(one, names=(*one.names, "riser_stiffness", "riser_damping"), theta=more)
    assert stepping(stiff) == steps(POLES, 0.2)
    flight, thetas, deviations = asked[0]
    for theta, damping in zip(thetas, (more[:, -1].max(), more[:, -1].min()), strict=True):
        np.testing.assert_allclose(theta[:-2], one.theta.mean(axis=0))
        np.testing.assert_array_equal(theta[-2:], [more[:, -2].max(), damping])
    assert deviations == 17 and flight.dt == SAMPLE


def test_the_steps_are_of_canopies_around_the_vertical_in_a_steady_fall(plan, asked):
    stepping(plan.models[0])
    stepping(single(plan.models[0]))
    two, alone = (given[0].start for given in asked)
    np.testing.assert_allclose(np.linalg.norm(two.direction, axis=0), 1.0)
    np.testing.assert_allclose(two.direction.sum(axis=1), [0.0, 0.0, -2.0 * np.cos(0.15)], atol=1e-15)
    np.testing.assert_allclose(two.direction[0, 0] - two.direction[0, 1], 2.0 * np.sin(0.15))
    np.testing.assert_array_equal(alone.direction, [[0.0], [0.0], [-1.0]])
    assert asked[1][2] == 13 and two.velocity.tolist() == [0.0, 0.0, 9.0]
    inputs = asked[0][0].record
    assert (inputs.density == 1.0).all()


def test_stronger_damping_of_the_risers_needs_more_steps(plan):
    one = plan.models[0]
    strong = replace(one.base.risers, damping=4.0 * one.base.risers.damping)
    more, few = (stepping(m) for m in (replace(one, base=replace(one.base, risers=strong)), one))
    assert more.stages > few.stages >= 12
