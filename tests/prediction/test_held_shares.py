"""Shares of flights inside their bands, and how rare they are: counts by hand, and the distribution of p-values."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import kstest

from bayeschute.prediction.bands import quantiles
from bayeschute.prediction.held_shares import coverage, p_value, shares_inside


def test_coverage_counts_known_and_counted_samples():
    draws = np.tile(np.linspace(0.0, 1.0, 101)[:, None], (1, 4))  # 90 % band: 0.05 to 0.95
    counted = np.array([True, True, True, False])
    assert coverage(draws, np.array([0.5, 0.99, np.nan, 9.0]), counted) == 0.5
    assert coverage(draws, np.array([0.06, 0.94, 0.5, 9.0]), counted) == 1.0
    assert coverage(draws, np.full(4, np.nan), counted) is None
    draws[7] = np.nan
    assert coverage(draws, np.array([0.5, 0.99, np.nan, 9.0]), counted) == 0.5


def test_where_every_draw_failed_there_is_no_band_and_no_coverage(recwarn):
    everywhere = np.ones(4, bool)
    assert coverage(np.full((10, 4), np.nan), np.zeros(4), everywhere) is None
    assert np.isnan(quantiles(np.full((10, 4), np.nan))).all()
    part = np.full((10, 4), np.nan)
    part[:3, :2] = [[-1.0, -1.0], [0.0, 0.0], [1.0, 1.0]]
    assert coverage(part, np.array([0.0, 5.0, 0.0, 0.0]), everywhere) == 0.5  # of samples that have a band
    assert not recwarn.list


def test_every_motion_has_its_own_share_and_its_own_gaps():
    draws = np.tile(np.linspace(0.0, 1.0, 101)[:, None], (1, 4))
    motions = np.array([[0.5, 0.99, np.nan, 9.0], [0.5, 0.5, 0.5, 0.5], np.full(4, np.nan)])
    np.testing.assert_allclose(shares_inside(draws, motions, np.ones(4, bool)), [1.0 / 3.0, 1.0, np.nan])
    np.testing.assert_allclose(shares_inside(draws, motions[:1], np.ones(4, bool), (0.0, 1.0)), [2.0 / 3.0])


def _slow(count, rng, bias=0.0):
    """Motions that stay on one side for long (count, 200)."""
    phase, size = rng.uniform(0.0, 2.0 * np.pi, (2, count, 1))
    return size * np.sin(0.05 * np.arange(200) + phase) + 0.1 * rng.standard_normal((count, 200)) + bias


def test_law_p_of_a_right_forecast_is_uniform_or_larger_and_small_of_a_wrong_one():
    """400 forecasts of 200 draws each: of a right one 1 % are below 0.01; of one that is off nearly all are small."""
    rng, counted = np.random.default_rng(0), np.ones(200, bool)
    right, wrong = (
        np.array([p_value(_slow(200, rng), _slow(1, rng, bias)[0], counted) for _ in range(400)]) for bias in (0.0, 8.0)
    )
    assert kstest(right, "uniform", alternative="greater").pvalue > 0.01 and np.mean(right < 0.01) < 0.03
    assert np.mean(wrong < 0.05) > 0.9


def test_the_rarest_share_is_one_of_all_draws_and_the_reference():
    draws, counted = np.random.default_rng(1).standard_normal((99, 50)), np.ones(50, bool)
    assert p_value(draws, np.full(50, 9.0), counted) == pytest.approx(0.01)
    assert p_value(draws, np.zeros(50), counted) == 1.0
    draws[3, 7] = np.nan  # a simulation that failed is no flight
    assert p_value(draws, np.full(50, 9.0), counted) == pytest.approx(1.0 / 99.0)
    assert p_value(draws, np.full(50, np.nan), counted) is None
    assert p_value(np.full((9, 50), np.nan), np.zeros(50), counted) is None
