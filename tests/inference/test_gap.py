"""Mean flight less flight of the mean: none of a linear flight, and what it adds to the slope by the parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayeschute.inference import gap
from bayeschute.inference.statespace import innovations
from bayeschute.inference.target import as_seen, course, filter_gains, linearise


@pytest.fixture(scope="module")
def along(linear):
    """A linear flight linearised, and its filter."""
    made = linearise(linear.flight, linear.theta, course(linear.flight, linear.hyper, linear.u))
    return made, filter_gains(linear.flight, linear.hyper, made)


def test_a_linear_flight_has_none(linear, along):
    lin, made = along
    found, lost = gap.mean(linear.flight, linear.hyper, made, linear.theta, lin.driven)
    assert lost == 0 and found.shape == np.shape(linear.flight.observed)
    np.testing.assert_allclose(found, 0.0, atol=1e-9)


def test_flights_that_all_fail_are_refused(linear, along):
    lin, made = along
    spoiled = replace(linear.flight, observed=np.full(np.shape(linear.flight.observed), np.nan))
    with pytest.raises(FloatingPointError, match="all drawn disturbances"):
        gap.mean(spoiled, linear.hyper, made, linear.theta, lin.driven)


def test_the_slope_is_that_of_half_the_squared_innovations(linear, along):
    lin, made = along
    shift = np.random.default_rng(3).standard_normal(np.shape(linear.flight.observed))
    shift = np.where(linear.flight.present, shift, 0.0)
    seen = as_seen(lin)

    def cost(theta, by):
        series, driven = (part[..., 0] - part[..., 1:] @ theta for part in seen)
        return 0.5 * float(np.sum(np.square(innovations(made, (series - by)[..., None], driven[..., None]))))

    told = gap.slope(lin, made, shift)
    for i, axis in enumerate(np.eye(linear.theta.size)):
        by_gap = [cost(s * axis, shift) - cost(s * axis, 0.0 * shift) for s in (1e-3, -1e-3)]
        assert float(told[i]) == pytest.approx((by_gap[0] - by_gap[1]) / 2e-3, rel=1e-5, abs=1e-7)


def test_where_no_pair_flies_narrower_ones_tell_the_same(bent, monkeypatch):
    """Of a flight bent by a square the second order is all there is, so a quarter of the width tells it exactly."""
    flight, hyper, _ = bent
    theta, real = np.array([1.0]), gap.residuals
    lin = linearise(flight, theta, course(flight, hyper, flight.still()))
    made = filter_gains(flight, hyper, lin)
    wanted, lost = gap.mean(flight, hyper, made, theta, lin.driven)
    assert lost == 0 and np.abs(wanted).max() > 0.01
    widths = []

    def narrow(flight, theta, driven):
        made = np.array(real(flight, theta, driven))
        if made.ndim == 3:
            widths.append(float(np.abs(driven.error).max()))
            if len(widths) < 3:
                made[3:] = np.nan
        return made

    monkeypatch.setattr(gap, "residuals", narrow)
    found, lost = gap.mean(flight, hyper, made, theta, lin.driven)
    assert len(widths) == 3 and widths[2] == pytest.approx(0.25 * widths[0]) and lost == 32
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-12)
