"""Rare failures where a landing is a sum of its normal numbers: the probability is that of the normal law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from bayeschute.landing.decisions import rare_landings
from bayeschute.landing.decisions.requirements import Limit, Requirement
from bayeschute.landing.measures import ROW

SPEED = Requirement("soft", (Limit("vertical_speed", 10.0, 2.0), Limit("hang_angle", 0.5)), 0.9, 0.9)


def _rows(**values):
    made = np.zeros(len(next(iter(values.values()))), ROW)
    for name, x in values.items():
        made[name] = x
    return made


def test_the_margin_is_the_least_distance_in_units_of_each_limit():
    rows = _rows(vertical_speed=[9.0, 3.0, 11.0, 6.0, 6.0, np.nan], hang_angle=[0.1, 0.1, 0.1, 0.6, 0.45, 0.1],
                 outcome=[0, 0, 0, 0, 1, 0])  # fmt: skip
    made = rare_landings.margin(SPEED, rows, np.array([2.0, 0.1]))
    np.testing.assert_allclose(made, [0.5, 0.5, -0.5, -1.0, np.nan, np.nan])


@pytest.fixture
def linear(plan, monkeypatch):
    """Vertical speed is the sum of two parameters, of the law of the draw and of one number of each kind."""
    seen = []

    def flown(plan, number, theta, laws, given, ids):
        seen.append(theta.shape[1])
        parts = [given.wind, given.start, given.gust, given.canopies, given.surface]
        assert [len(part) for part in parts] == [1, 2, 1, 3, 1]
        speed = theta[0] + theta[1] + laws[0][0] + sum(part[-1] for part in parts)
        return _rows(vertical_speed=speed, hang_angle=0.0 * speed)

    monkeypatch.setattr(rare_landings, "normal_sizes", lambda plan, number: (1, 2, 1, 3, 1))
    monkeypatch.setattr(rare_landings, "fly_normals", flown)
    rng = np.random.default_rng(0)
    root = np.array([[1.0, 0.0], [-0.8, 0.6]])
    z = rng.standard_normal((400, 2))
    z = (z - z.mean(axis=0)) @ np.linalg.inv(np.linalg.cholesky(np.cov(z, rowvar=False))).T
    laws = (np.repeat([[-1.0], [1.0]], 200, axis=0),)
    other = replace(plan.models[0], theta=np.full((3, 2), 1e9), laws=(np.zeros((3, 1)),))
    most = replace(plan.models[0], theta=[3.0, 4.0] + z @ root.T, laws=laws)
    return replace(plan, models=(other, most)), seen


def test_the_probability_of_the_model_with_most_draws_is_that_of_the_normal_law(linear):
    """Parameters of mean 7 and variance 1 - 1.6 + 1, five normals, and a law that is -1 or 1: half of each."""
    plan, seen = linear
    one = Requirement("soft", (Limit("vertical_speed", 15.0),), 0.9, 0.9)
    found = rare_landings.failure(plan, one, 2000)
    sd = np.sqrt(0.4 + 5.0)
    wanted = 0.5 * (ndtr(-(15.0 - 6.0) / sd) + ndtr(-(15.0 - 8.0) / sd))
    assert found.probability == pytest.approx(wanted, rel=4.0 * found.variation) and 1e-4 < wanted < 2e-3
    assert max(seen) == rare_landings.BATCH and sum(seen) >= found.evaluations + seen[0]
    assert found.samples.shape[1] == 2 + 1 + 8
    again = rare_landings.failure(plan, one, 2000)
    assert again.probability == found.probability


def test_a_landing_that_failed_is_a_failure(linear, monkeypatch):
    plan, _ = linear
    flown = rare_landings.fly_normals

    def lost(*given):
        rows = flown(*given)
        rows["outcome"] = np.where(rows["vertical_speed"] < 7.0, 1, 0)
        return rows

    monkeypatch.setattr(rare_landings, "fly_normals", lost)
    found = rare_landings.failure(plan, Requirement("soft", (Limit("vertical_speed", 1e6),), 0.9, 0.9), 1000)
    assert found.probability == pytest.approx(0.5, abs=0.06)
