"""Ranks of truths, and the simultaneous band of their distribution."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from bayeschute.calibration.ranks import rank, uniform

LEVELS = 39


def _gaussian_ranks(shift: float, spread: float, seed: int, count: int = 300) -> np.ndarray:
    """Ranks of a conjugate Gaussian model whose posterior draws are shifted and stretched, in posterior sds."""
    rng = np.random.default_rng(seed)
    truth = rng.standard_normal(count)
    data = truth + rng.standard_normal(count)
    mean, sd = 0.5 * data, np.sqrt(0.5)
    draws = mean[:, None] + sd * (shift + spread * rng.standard_normal((count, 400)))
    return np.array([rank(d, t, LEVELS) for d, t in zip(draws, truth, strict=True)])


def test_rank_counts_draws_below():
    draws = np.arange(10.0)
    assert [rank(draws, t, 10) for t in (-1.0, 0.5, 4.5, 20.0)] == [0, 1, 5, 10]


def test_rank_uses_evenly_spaced_draws():
    assert rank(np.repeat([0.0, 1.0], 500), 0.5, 4) == 2


def test_too_few_draws_are_refused():
    with pytest.raises(ValueError, match="5 draws for 10"):
        rank(np.zeros(5), 0.0, 10)


def test_a_right_posterior_passes_as_often_as_the_band_says():
    rng = np.random.default_rng(0)
    passed = [uniform(rng.integers(0, LEVELS + 1, 100), LEVELS).passed for _ in range(400)]
    assert 0.92 < np.mean(passed) < 0.98  # 95 % plus or minus three standard errors


def test_a_conjugate_posterior_passes():
    assert uniform(_gaussian_ranks(0.0, 1.0, 3), LEVELS).passed


@pytest.mark.parametrize(("shift", "spread"), [(0.3, 1.0), (-0.3, 1.0), (0.0, 0.75), (0.0, 1.35)])
def test_a_broken_sampler_fails(shift: float, spread: float):
    assert not uniform(_gaussian_ranks(shift, spread, 4), LEVELS).passed


def test_the_band_is_wider_than_pointwise_and_within_bonferroni():
    test = uniform(_gaussian_ranks(0.0, 1.0, 5), LEVELS)
    assert 0.05 / LEVELS <= test.bound < 0.05
    pointwise = binom.ppf(0.025, 300, test.at) / 300
    assert (test.low <= pointwise).all() and (test.low < pointwise).any()
    assert test.passed == bool(((test.ecdf >= test.low) & (test.ecdf <= test.high)).all())


def test_more_quantities_widen_the_band():
    ranks = _gaussian_ranks(0.0, 1.0, 6)
    one, many = uniform(ranks, LEVELS), uniform(ranks, LEVELS, tests=10)
    assert many.bound < one.bound and (many.low <= one.low).all() and (many.high >= one.high).all()


@pytest.mark.parametrize("ranks", [[], [-1, 3], [0, LEVELS + 1]])
def test_ranks_out_of_range_are_refused(ranks: list[int]):
    with pytest.raises(ValueError, match="ranks must be 0 to 39"):
        uniform(np.array(ranks, int), LEVELS)
