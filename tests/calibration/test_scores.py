"""Scores against closed forms and plain double loops."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from bayeschute.calibration.scores import LEVELS, crps, inside, score, standard_error

RNG = np.random.default_rng(2)
DRAWS, TRUTH = RNG.normal(size=(60, 7)), RNG.normal(size=7)


def test_crps_equals_its_definition():
    want = [
        np.mean([abs(x - y) for x in d]) - 0.5 * np.mean([abs(x - z) for x in d for z in d])
        for d, y in zip(DRAWS.T, TRUTH, strict=True)
    ]
    np.testing.assert_allclose(crps(DRAWS, TRUTH), want, rtol=1e-12)


def test_crps_of_a_gaussian():
    """Gneiting and Raftery 2007, equation 21."""
    y, draws = np.array([-1.0, 0.0, 0.7, 3.0]), norm.ppf((np.arange(4000) + 0.5) / 4000)[:, None]
    want = y * (2.0 * norm.cdf(y) - 1.0) + 2.0 * norm.pdf(y) - 1.0 / np.sqrt(np.pi)
    np.testing.assert_allclose(crps(np.repeat(draws, 4, axis=1), y), want, atol=1e-3)


def test_crps_of_one_draw_is_the_error():
    np.testing.assert_allclose(crps(DRAWS[:1], TRUTH), np.abs(DRAWS[0] - TRUTH))


def test_score_equals_a_plain_loop():
    got = score(DRAWS, TRUTH)
    for k, level in enumerate(LEVELS):
        held, width, missed = [], [], []
        for d, y in zip(DRAWS.T, TRUTH, strict=True):
            low, high = np.quantile(d, 0.5 - level / 2), np.quantile(d, 0.5 + level / 2)
            held.append(low <= y <= high)
            width.append(high - low)
            missed.append(width[-1] + 2.0 / (1.0 - level) * (max(low - y, 0.0) + max(y - high, 0.0)))
        assert got.coverage[k] == pytest.approx(np.mean(held))
        assert got.width[k] == pytest.approx(np.mean(width))
        assert got.interval_score[k] == pytest.approx(np.mean(missed))


def test_calibrated_draws_hold_what_they_say():
    rng = np.random.default_rng(3)
    middle = rng.normal(size=4000)
    got = score(middle + rng.normal(size=(300, 4000)), middle + rng.normal(size=4000))
    np.testing.assert_allclose(got.coverage, LEVELS, atol=0.02)
    np.testing.assert_allclose(got.pit, np.arange(0.05, 1.0, 0.1), atol=0.03)


def test_failed_draws_and_unknown_truth_are_left_out():
    draws, truth = DRAWS.copy(), TRUTH.copy()
    draws[3, 2], truth[5] = np.nan, np.nan
    keep = np.arange(7) != 5
    want = score(np.delete(DRAWS, 3, axis=0)[:, keep], TRUTH[keep])
    assert score(draws, truth) == want


def test_a_flight_that_no_draw_could_fly_holds_nothing():
    """To leave it out would flatter a fit so wrong that its parameters can't be flown."""
    got = score(np.full((60, 7), np.nan), TRUTH)
    assert got.coverage == (0.0,) * len(LEVELS)
    assert got.width is got.interval_score is got.crps is got.pit is None
    assert inside(np.empty(0), 0.0) == (False,) * len(LEVELS)


def test_nothing_to_score_is_refused():
    with pytest.raises(ValueError, match="nothing to score"):
        score(DRAWS, np.full(7, np.nan))


def test_inside_is_nested():
    assert inside(np.linspace(0.0, 1.0, 101), 0.86) == (False, True, True, True, True)


def test_standard_error_of_shares():
    assert standard_error(1.0, 100) > 0.0
    assert standard_error(0.9, 100) == pytest.approx(0.03, abs=0.002)
    assert standard_error(0.9, 100, spread=0.2) == pytest.approx(0.02)
