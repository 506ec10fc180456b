"""Mixtures of predictions: draws, variance within and between, what fails, what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.prediction.bands import Prediction
from bayeschute.prediction.mixture import mix


def _prediction(draws: int, mean: float, sd: float, seed: int) -> Prediction:
    x = np.random.default_rng(seed).standard_normal((draws, 5))
    x = mean + sd * (x - x.mean(axis=0)) / x.std(axis=0)
    last = np.full((draws, 3), mean)
    return Prediction(np.arange(5.0), {"descent_rate": x}, last, 0, {"descent_rate": {"wind": 0.75, "parameter": 0.25}})


def test_draws_are_all_there_and_variance_is_within_plus_between():
    parts = [_prediction(300, 0.0, 1.0, 1), _prediction(100, 4.0, 2.0, 2)]
    made = mix(parts)
    rate = made.draws["descent_rate"]
    assert rate.shape == (400, 5) and made.last.shape == (400, 3)
    np.testing.assert_allclose(rate.mean(axis=0), 1.0, atol=1e-12)
    np.testing.assert_allclose(rate.var(axis=0), 0.75 * 1.0 + 0.25 * 4.0 + 0.75 * 1.0 + 0.25 * 9.0)
    shares = made.shares["descent_rate"]
    assert shares["structure"] == pytest.approx(3.0 / 4.75)
    assert shares["wind"] == pytest.approx(0.75 * 1.75 / 4.75) and sum(shares.values()) == pytest.approx(1.0)


def test_one_prediction_is_left_as_it_is():
    one = _prediction(10, 0.0, 1.0, 1)
    assert mix([one]) is one


def test_failed_simulations_are_counted_and_left_out_of_the_shares():
    parts = [_prediction(100, 0.0, 1.0, 1), _prediction(100, 4.0, 1.0, 2)]
    values = parts[1].draws["descent_rate"].copy()
    values[:] = np.nan
    made = mix([parts[0], replace(parts[1], draws={"descent_rate": values}, failed=100)])
    assert made.failed == 100 and made.shares["descent_rate"]["structure"] == 0.0
    assert np.isnan(made.draws["descent_rate"]).sum() == 500


def test_predictions_of_different_flights_are_refused():
    one = _prediction(10, 0.0, 1.0, 1)
    with pytest.raises(InputError, match="times or quantities that differ"):
        mix([one, replace(one, time=np.arange(5.0) + 1.0)])
    with pytest.raises(InputError, match="got none"):
        mix([])
