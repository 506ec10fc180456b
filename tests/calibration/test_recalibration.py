"""Widening that replicates ask for: nested shares against a plain loop, and what the factor promises to flights unseen."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.calibration.recalibration import FACTORS, learned, scaled_shares


def summary(shares, replicates=100, role="predict"):
    return {"replicates": replicates, "bands": {"new/swing_angle": {"role": role, "scaled": shares}}}


def test_shares_equal_a_plain_loop():
    rng = np.random.default_rng(1)
    draws, truth = rng.normal(size=(80, 40)) ** 3, 1.5 * rng.normal(size=40)
    draws[5], truth[7] = np.nan, np.nan
    kept = np.delete(draws, 5, axis=0)
    for factor, got in zip(FACTORS, scaled_shares(draws, truth), strict=True):
        held = []
        for t in np.flatnonzero(np.isfinite(truth)):
            moved = np.median(kept[:, t]) + factor * (kept[:, t] - np.median(kept[:, t]))
            low, high = np.quantile(moved, [0.05, 0.95])
            held.append(low - 1e-12 <= truth[t] <= high + 1e-12)
        assert got == np.mean(held)


def test_the_least_factor_whose_expected_miss_is_a_tenth():
    shares = [0.80 + 0.01 * i for i in range(len(FACTORS))]  # (100 R + 1)/101 <= 0.1 where the share is 0.909
    assert learned(summary([min(s, 1.0) for s in shares])) == {"swing_angle": FACTORS[11]}
    assert learned(summary([0.5] * len(FACTORS))) == {"swing_angle": None}
    assert learned(summary([1.0] * len(FACTORS), replicates=8)) == {"swing_angle": None}  # too few to say anything
    assert learned(summary([1.0] * len(FACTORS), role="identify")) == {}


def test_flights_unseen_hold_nine_tenths_when_bands_were_too_narrow():
    """Bands 1.3 times too narrow whose centres err together over a flight: the law holds over campaigns."""
    rng, held, factors = np.random.default_rng(2), [], []

    def flight():
        return rng.normal() * 0.8 + 0.6 * rng.normal(size=30)  # of unit variance

    unit = np.linspace(-3.0, 3.0, 201)
    weights = np.exp(-(unit**2) / 2)
    draws = np.interp(np.linspace(0.005, 0.995, 100), np.cumsum(weights) / weights.sum(), unit)[:, None] / 1.3
    draws = np.repeat(draws, 30, axis=1)
    for _ in range(60):
        shares = np.mean([scaled_shares(draws, flight()) for _ in range(60)], axis=0)
        factor = learned(summary(shares.tolist(), replicates=60))["swing_angle"]
        factors.append(factor)
        held += [scaled_shares(draws, flight())[FACTORS.index(factor)] for _ in range(5)]
    assert np.mean(factors) == pytest.approx(1.35, abs=0.1)
    assert np.mean(held) > 0.9 - 3.0 * np.std(held) / np.sqrt(60)
