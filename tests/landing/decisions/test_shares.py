"""Shares of known functions, and of landings' parts."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.landing.decisions.shares import by_groups, design, jansen, shapley
from bayeschute.landing.measures import IDS


def ishigami(u):
    x = np.pi * (2.0 * u - 1.0)
    return np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])


def test_ishigami():
    a, b = 7.0, 0.1
    v1, v2 = 0.5 * (1.0 + b * np.pi**4 / 5.0) ** 2, a**2 / 8.0
    v13 = b**2 * np.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
    whole = v1 + v2 + v13
    a, b = np.random.default_rng(0).random((2, 20_000, 3))
    mixed = [ishigami(np.where(np.arange(3) == i, b, a)) for i in range(3)]
    first, first_error, total, total_error = jansen(ishigami(a), ishigami(b), np.array(mixed))
    known, whole_share = np.array([v1, v2, 0.0]) / whole, np.array([v1 + v13, v2, v13]) / whole
    np.testing.assert_allclose(first, known, atol=0.03)
    np.testing.assert_allclose(total, whole_share, atol=0.04)
    assert (np.abs(first - known) < 4.0 * first_error).all()
    assert (np.abs(total - whole_share) < 4.0 * total_error).all()


def test_a_failure_that_is_rare_has_errors_of_resamples_that_meet_it():
    """Most resamples have the one failure; without it there is nothing to share."""
    a, b, mixed = np.zeros(40), np.zeros(40), np.zeros((2, 40))
    a[7] = mixed[0, 7] = 1.0  # what the second source is changes it
    first, first_error, total, total_error = jansen(a, b, mixed)
    variance = 1.0 / 80.0 - 1.0 / 80.0**2
    np.testing.assert_allclose(total, [0.0, 0.5 / 40.0 / variance], atol=1e-12)
    np.testing.assert_allclose(first, [1.0 - 0.5 / 40.0 / variance, 1.0], atol=1e-12)
    assert (first_error < 1.0).all() and (total_error < 1.0).all()


def test_landings_of_which_none_was_flown_have_no_shares():
    found = by_groups(np.full(8 * 30, np.nan))
    assert np.isnan([found.first, found.first_error, found.total, found.total_error]).all()
    assert np.isnan(shapley(np.ones((0, 2)), np.zeros(0), "xy")["y"])


def test_what_never_differs_has_no_shares():
    for value in (0.0, 9.81):
        found = by_groups(np.full(8 * 30, value) * (1.0 + 1e-15 * np.arange(240)))
        assert np.isnan([found.first, found.first_error, found.total, found.total_error]).all()
        assert np.isnan(
            list(shapley(np.random.default_rng(0).random((30, 2)), np.full(30, value), "xy").values())
        ).all()


@pytest.mark.parametrize("draws", [2, 50, 700])
def test_no_landing_of_the_design_meets_its_own_draw_again_and_all_draws_are_used(draws):
    first, second = design(draws, 2000)[:2000, 0], design(draws, 2000)[2000:4000, 0]
    assert (first != second).all() and set(first) == set(second) == set(range(draws))


@pytest.mark.parametrize("varied", [IDS[:-1], IDS])
def test_groups_of_landings_by_a_known_sum(varied):
    ids = design(50, 8000, varied)
    sd = np.array([1.0, 0.5, 0.7, 1.2, 0.0, 0.6])[: len(varied)]
    normal = np.random.default_rng(0).standard_normal((len(varied), 16_000))
    values = sum(sd[i] * normal[i, ids[:, i]] for i in range(len(varied)))
    found = by_groups(values, varied)
    exact = np.array([(sd[0] * normal[0, :50]).var(), *sd[1:] ** 2])
    np.testing.assert_allclose(found.first, exact / exact.sum(), atol=0.05)
    np.testing.assert_allclose(found.total, exact / exact.sum(), atol=0.05)
    assert found.names[0] == "parameters" and (found.names[-1] == "surface") == (varied == IDS)
    values[3] = np.nan  # a landing that failed takes its row along
    assert np.isfinite(by_groups(values, varied).total).all()


@pytest.mark.parametrize("many", [2, 14])
def test_shapley_shares_of_correlated_inputs(many):
    """Two inputs of unit variance, y = x1 + x2: (1 + rho) of 2 (1 + rho) each; inputs without effect have none."""
    rng, n = np.random.default_rng(2), 40_000
    x = rng.standard_normal((n, many))
    x[:, 1] = 0.6 * x[:, 0] + 0.8 * x[:, 1]
    y = x[:, 0] + x[:, 1] + rng.standard_normal(n) * np.sqrt(3.2)
    found = shapley(x, y, [f"x{i}" for i in range(many)])
    assert found["x0"] == pytest.approx(0.25, abs=0.02) and found["x1"] == pytest.approx(0.25, abs=0.02)
    assert sum(found.values()) == pytest.approx(0.5, abs=0.02)
    alone = shapley(x, 3.0 * x[:, 0] + 0.0 * y, [f"x{i}" for i in range(many)])
    # Owen and Prieur: x2 has a share by its correlation, rho^2 / 2.
    assert alone["x1"] == pytest.approx(0.18, abs=0.02)
