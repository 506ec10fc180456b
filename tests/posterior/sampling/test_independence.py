"""Independent proposals that learn: known distributions from far off, exactness, and what does not fly."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.posterior.sampling.independence import Proposal, fitted, learned, sample


def _skewed(x):
    """A banana of two dimensions beside two normals, far from where learning begins: moments are known."""
    a, b = x[0] / 3.0, x[1] - 0.1 * (x[0] ** 2 - 9.0)
    return -0.5 * (a**2 + b**2 + ((x[2] - 4.0) / 0.2) ** 2 + (x[3] + 1.0) ** 2)


def test_moments_of_a_banana_far_from_the_start():
    made = sample(_skewed, 4, 4, 1000, 1)
    x = made.xi.reshape(-1, 4)
    assert made.xi.shape == (4, 1000, 4) and made.failed == 0
    sd = np.array([3.0, np.sqrt(1.0 + 2.0 * (0.1 * 9.0) ** 2), 0.2, 1.0])
    error_of_mean, error_of_sd = [0.04, 0.04, 0.017, 0.017], [0.03, 0.06, 0.013, 0.011]  # measured over 24 seeds
    assert (np.abs(x.mean(axis=0) - [0.0, 0.0, 4.0, -1.0]) / sd < 3.5 * np.array(error_of_mean)).all()
    assert (np.abs(x.std(axis=0) / sd - 1.0) < 3.5 * np.array(error_of_sd)).all()
    np.testing.assert_allclose(made.log_density.ravel(), _skewed(x.T))


def test_a_narrow_proposal_leaves_the_draws_exact():
    """Acceptance pays for a proposal that learned nothing; the draws stay those of the density."""
    made = sample(lambda x: -0.5 * np.sum((x / 1.5) ** 2, axis=0), 1, 8, 2000, 2)
    assert made.xi.std() == pytest.approx(1.5, rel=0.05)
    assert 0.2 < made.stats["acceptance_rate"].mean() < 1.0
    assert made.stats["log_ratio"].shape == made.stats["acceptance_rate"].shape == (8, 2000)


def test_a_fit_has_the_weighed_moments():
    rng = np.random.default_rng(3)
    x = rng.standard_normal((4000, 2)) * [1.0, 2.0] + [3.0, 0.0]
    made = fitted(x, np.zeros(4000))
    np.testing.assert_allclose(made.middle, x.mean(axis=0))
    np.testing.assert_allclose(made.factor @ made.factor.T, np.cov(x.T, bias=True))


def test_the_density_of_a_proposal_is_that_of_its_draws():
    """Importance weights of a normal by it average to the ratio of the constants, by a grid in one dimension."""
    made, x = Proposal(np.array([1.0]), np.array([[2.0]])), np.linspace(-400.0, 400.0, 200001)[:, None]
    total = np.trapezoid(np.exp(made.log_density(x)), x[:, 0])
    drawn = made.draw(200_000, np.random.default_rng(4))[:, 0]
    inside = np.trapezoid(np.where(np.abs(x[:, 0] - 1.0) < 3.0, np.exp(made.log_density(x)), 0.0), x[:, 0]) / total
    assert np.mean(np.abs(drawn - 1.0) < 3.0) == pytest.approx(inside, abs=0.004)


def test_failures_are_counted_and_left_out():
    made = sample(lambda x: np.where(x[0] > 0.0, np.nan, -0.5 * x[0] ** 2), 1, 2, 500, 5)
    assert made.failed > 0 and (made.xi <= 0.0).all()
    assert made.xi.std() == pytest.approx(np.sqrt(1.0 - 2.0 / np.pi), rel=0.12)


def test_what_never_flies_is_said():
    with pytest.raises(FloatingPointError, match="0 of 768 points"):
        learned(lambda x: np.full(x.shape[1], -np.inf), 2, np.random.default_rng(6))


def test_the_same_seed_draws_the_same():
    one, other = (sample(_skewed, 4, 2, 50, 7).xi for _ in range(2))
    np.testing.assert_array_equal(one, other)
