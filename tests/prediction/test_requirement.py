"""P(met) on draws of a known law: what the posterior leaves open, what simulation adds, and failures against us."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtr
from scipy.stats import beta

from bayeschute.core.errors import InputError
from bayeschute.prediction.requirement import requirement_check


def _check(samples, **limits):
    return requirement_check(samples, name="soft", quantity="descent_rate", unit="m/s", **limits)


def test_the_spread_over_the_posterior_is_told_without_that_of_the_simulations():
    """Shares from Beta(6, 2): sd and quantiles come back, though each row has ten simulations only."""
    rng = np.random.default_rng(0)
    p = rng.beta(6.0, 2.0, 20_000)
    met = rng.random((20_000, 10)) < p[:, None]
    found = _check(np.where(met, 0.0, 2.0), at_most=1.0)
    law = beta(6.0, 2.0)
    assert found["probability_met"] == pytest.approx(0.75, abs=0.01)
    assert found["posterior_sd"] == pytest.approx(law.std(), rel=0.02)
    assert [found["posterior_q05"], found["posterior_q95"]] == pytest.approx(list(law.ppf([0.05, 0.95])), abs=0.008)
    raw = met.mean(axis=1).var()
    assert found["posterior_sd"] ** 2 < 0.7 * raw  # the binomial scatter of a row is taken out
    # as many independent flights as tell the mean as well: worst case over the variance of rows' mean
    assert found["independent_simulations"] == pytest.approx(0.75 * 0.25 / (raw / 20_000), rel=0.03)


def test_rows_that_do_not_differ_leave_nothing_open():
    x = np.tile([0.0, 0.0, 0.0, 2.0], (50, 1))
    found = _check(x, at_most=1.0)
    assert found["posterior_sd"] == 0.0 and found["posterior_q05"] == found["posterior_q95"] == 0.75
    assert found["independent_simulations"] == 50.0 and found["simulations"] == 200 and found["draws"] == 50


def test_rows_that_are_all_or_nothing_count_as_one_flight_each():
    x = np.repeat(np.where(np.arange(40) < 30, 0.0, 2.0)[:, None], 25, axis=1)
    found = _check(x, at_most=1.0)
    assert found["posterior_sd"] == pytest.approx(np.std(x[:, 0] < 1.0, ddof=1))
    assert found["independent_simulations"] == 40.0
    assert found["simulation_low"] == pytest.approx(beta(30, 11).ppf(0.05))
    assert found["simulation_high"] == pytest.approx(beta(31, 10).ppf(0.95))
    assert found["credible_low"] == pytest.approx(beta(30.5, 10.5).ppf(0.05))


def test_single_draws_can_not_be_taken_apart_and_count_as_told():
    x = np.linspace(0.0, 1.0, 200)
    found = _check(x, at_most=0.9, confidence=0.8)
    assert {found[key] for key in ("posterior_sd", "posterior_q05", "posterior_q95")} == {None}
    assert found["met"] == 180 and found["independent_simulations"] == 200.0
    assert found["simulation_low"] == pytest.approx(beta(180, 21).ppf(0.1))
    fewer = _check(x, at_most=0.9, independent=20.0)
    assert fewer["independent_simulations"] == 20.0 and fewer["simulation_low"] == pytest.approx(beta(18, 3).ppf(0.05))
    assert _check(x, at_most=0.9, independent=1e9)["independent_simulations"] == 200.0
    assert (
        _check(x[:, None], at_most=0.9)["posterior_sd"] is None and _check(x[None], at_most=0.9)["posterior_sd"] is None
    )


def test_a_limit_itself_is_met_and_what_failed_is_not():
    x = np.array([1.0, 2.0, 3.0, np.nan, np.inf, -np.inf])
    most, least = _check(x, at_most=2.0), _check(x, at_least=2.0)
    assert (most["met"], most["failed"]) == (2, 3) and (least["met"], least["failed"]) == (2, 3)
    assert most["probability_met"] == pytest.approx(2.0 / 6.0)
    assert most["median"] == 2.0 and most["q05"] == pytest.approx(1.1) and most["q95"] == pytest.approx(2.9)


@pytest.mark.parametrize(
    ("limit", "margin"), [({"at_most": 5.0}, 3.0), ({"at_most": 1.0}, -1.0), ({"at_least": 0.5}, 1.5)]
)
def test_a_margin_is_positive_where_the_median_meets_the_limit(limit, margin):
    found = _check([1.0, 2.0, 3.0], **limit)
    assert found["margin"] == pytest.approx(margin) and (margin > 0.0) == (found["probability_met"] > 0.5)
    assert found["at_most"] == limit.get("at_most") and found["at_least"] == limit.get("at_least")
    lost = _check([np.nan, np.nan], **limit)
    assert lost["margin"] is None and lost["median"] is None and lost["probability_met"] == 0.0 and lost["failed"] == 2


def test_a_limit_of_zero_is_a_limit():
    found = _check([-1.0, 1.0, 2.0], at_least=0.0)
    assert found["met"] == 2 and found["margin"] == 1.0 and found["at_least"] == 0.0


def test_limits_cover_the_truth_of_nested_normals():
    """Rows mu + 0.5 z_k, flights of sd 1 about them: P(met) of all flights is in the simulation limits nine times of ten."""
    rng, truth = np.random.default_rng(3), ndtr(1.0 / np.hypot(1.0, 0.5))
    held = 0
    for _ in range(150):
        x = 0.5 * rng.standard_normal((60, 1)) + rng.standard_normal((60, 20))
        found = _check(x, at_most=1.0)
        held += found["simulation_low"] <= truth <= found["simulation_high"]
    assert held / 150 >= 0.85


@pytest.mark.parametrize("limits", [{}, {"at_most": 1.0, "at_least": 0.0}])
def test_exactly_one_limit_is_wanted(limits):
    with pytest.raises(InputError, match="exactly one"):
        _check([1.0], **limits)


@pytest.mark.parametrize("samples", [[], np.ones((2, 2, 2)), 1.0])
def test_samples_of_another_shape_are_refused(samples):
    with pytest.raises(InputError, match=r"\(draw,\) or"):
        _check(samples, at_most=1.0)
