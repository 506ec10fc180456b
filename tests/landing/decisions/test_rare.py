"""Rare events of limit states whose probability is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtr

from bayeschute.landing.decisions.rare import subset_simulation


@pytest.mark.parametrize(("beta", "dimension"), [(2.3263, 2), (3.719, 2), (3.719, 200), (4.2649, 20)])
def test_a_half_space(beta, dimension):
    """P = Phi(-beta): 1e-2, 1e-4 and 1e-5, in few and in many dimensions."""
    found = [
        subset_simulation(
            lambda u: beta - u.sum(axis=1) / np.sqrt(dimension), dimension, 4000, np.random.default_rng(s)
        )
        for s in range(8)
    ]
    p = np.array([one.probability for one in found])
    exact = ndtr(-beta)
    assert np.mean(p) == pytest.approx(exact, rel=0.15)
    assert (np.abs(p / exact - 1.0) < 0.3 * max(1.0, 0.25 * np.log10(1.0 / exact))).mean() >= 0.75
    assert np.mean([one.variation for one in found]) == pytest.approx(p.std() / exact, rel=0.8)
    for one in found:
        assert (one.samples.sum(axis=1) / np.sqrt(dimension) >= beta - 1e-9).all()
        assert one.evaluations < 30_000 and one.levels[-1] == 0.0


def test_a_curved_limit_state_against_counting():
    def limit(u):
        return 2.9 - np.abs(u[:, 0]) + 0.3 * u[:, 1] ** 2

    rng = np.random.default_rng(1)
    counted = np.mean(np.concatenate([limit(rng.standard_normal((1_000_000, 2))) <= 0.0 for _ in range(3)]))
    assert 3e-4 < counted < 4e-3
    found = np.mean([subset_simulation(limit, 2, 5000, np.random.default_rng(s)).probability for s in range(4)])
    assert found == pytest.approx(counted, rel=0.3)


def test_brute_force_at_one_in_ten_thousand():
    def limit(u):
        return 24.0 - (u**2).sum(axis=1)  # chi-squared of 4: 8.0e-5

    rng = np.random.default_rng(3)
    counted = np.mean(np.concatenate([limit(rng.standard_normal((1_000_000, 4))) <= 0.0 for _ in range(4)]))
    found = np.mean([subset_simulation(limit, 4, 4000, np.random.default_rng(s)).probability for s in range(4)])
    assert found == pytest.approx(counted, rel=0.3)


@pytest.mark.parametrize("samples", [500, 997])
def test_every_evaluation_of_the_limit_state_is_counted(samples):
    made = []

    def limit(u):
        made.append(len(u))
        return 3.5 - u[:, 0]

    found = subset_simulation(limit, 3, samples, np.random.default_rng(1))
    assert found.evaluations == sum(made) and len(found.levels) > 2


def test_what_is_not_finite_has_failed():
    found = subset_simulation(lambda u: np.where(u[:, 0] > 1.0, np.nan, 1.0), 1, 1000, np.random.default_rng(0))
    assert found.probability == pytest.approx(ndtr(-1.0), abs=0.05)
