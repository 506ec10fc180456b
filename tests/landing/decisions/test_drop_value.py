"""Worth of a drop on a Gaussian test whose answers are known; onset and placard on landings that are made up."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtr

from bayeschute.landing.decisions.drop_value import probit_slope, ranking, spread
from bayeschute.landing.decisions.onset import PlacardPlan, in_cell, placard, placard_table
from bayeschute.landing.decisions.requirements import Limit, Requirement
from bayeschute.landing.measures import ROW


def test_the_slope_of_a_probit_is_found():
    rng = np.random.default_rng(0)
    theta = rng.multivariate_normal([1.0, 2.0], [[0.04, 0.01], [0.01, 0.09]], 400)
    eta = 1.0 + 3.0 * (theta[:, 0] - 1.0) - 1.0 * (theta[:, 1] - 2.0)
    draw = np.repeat(np.arange(400), 60)
    found = probit_slope(theta, draw, rng.random(draw.size) < ndtr(eta[draw]))
    np.testing.assert_allclose(found.slope, [3.0, -1.0], atol=0.3)
    assert found.at_mean == pytest.approx(1.0, abs=0.15)


def test_the_expected_spread_is_that_of_repeated_drops():
    """A drop that measures the margin: simulate its data, update, and average the spread that is left."""
    at_mean, now, after = 0.8, 0.7, 0.3
    rng = np.random.default_rng(1)
    means = at_mean + np.sqrt(now**2 - after**2) * rng.standard_normal(3000)
    left = [ndtr(m + after * rng.standard_normal(400)).std() for m in means]
    assert spread(at_mean, now, after) == pytest.approx(np.mean(left), rel=0.02)
    assert spread(at_mean, now, now) == pytest.approx(
        ndtr(at_mean + now * rng.standard_normal(200_000)).std(), rel=0.01
    )
    assert spread(at_mean, now, 0.0) == pytest.approx(0.0, abs=1e-9)


def test_candidates_are_ranked_by_what_they_tell_of_the_goal():
    now = np.diag([1.0, 1.0])
    after = {"other": np.diag([1.0, 0.01]), "goal": np.diag([0.25, 1.0]), "nothing": now}
    from bayeschute.landing.decisions.drop_value import Slope

    table = ranking(Slope(0.5, np.array([0.8, 0.0])), now, after, ("a", "b"))
    assert table["candidate"].tolist()[0] == "goal"
    told = table.set_index("candidate")
    assert told.loc["other", "shrinking"] == pytest.approx(0.0, abs=1e-9)
    assert told.loc["other", "information"] > told.loc["goal", "information"]
    assert told.loc["goal", "sd left of a"] == pytest.approx(0.5)
    assert ranking(Slope(0.5, np.array([0.8, 0.0])), now, after, ("a", "b"), "b")["candidate"][0] == "other"


def test_a_placard_judges_every_cell(plan):
    cells = PlacardPlan((0.0, 5.0), (8000.0, 9000.0), 200.0, 60.0, 600, 0.1)
    wanted = (Requirement("soft", (Limit("vertical_speed", 10.0),), 0.9, 0.9),)

    def flown(one, landings):
        """Pendulum by shear, speed by payload."""
        rows, rng = np.zeros(landings, ROW), np.random.default_rng(0)
        rows["draw"] = np.arange(landings) % 20
        rows["swing_amplitude"] = np.where(rng.random(landings) < one.winds.events[-1].change[0] / 10.0, 0.3, 0.0)
        rows["vertical_speed"] = one.models[0].base.capsule.mass / 1000.0 + 0.4 * rng.standard_normal(landings)
        return rows

    made = placard(plan, cells, wanted, flown)
    table = placard_table(made).set_index(["shear_m_per_s", "capsule_mass_kg"])
    assert table.loc[(5.0, 8000.0), "pendulum_probability"] == pytest.approx(0.5, abs=0.06)
    assert table.loc[(0.0, 8000.0), "pendulum_probability"] == 0.0
    assert table.loc[(0.0, 8000.0), "verdict"] == "go"
    heavy = in_cell(plan, cells, 5.0, 11_000.0)
    assert heavy.winds.events[-1].middle == plan.ground + 200.0 and heavy.models[0].base.capsule.mass == 11_000.0
    assert placard(plan, PlacardPlan((0.0,), (10_500.0,), 200.0, 60.0, 600, 0.1), wanted, flown)[0].word == "no-go"
