"""Predictive checks: p-values of series that the model makes are uniform, those of others small."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import kstest, norm

from bayeschute.prediction.predictive_checks import (
    BOUND,
    Check,
    autocorrelation_test,
    draws_checks,
    error_check,
    least,
    mean_test,
    missed,
    pit_counts,
    pit_test,
    power_test,
    prior_check,
    series_checks,
    size_test,
    verdict,
)

DT = 0.1
FREQUENCIES = {"pendulum": 0.07, "scissors": 0.23}
TESTS = {
    "mean": mean_test, "size": size_test, "autocorrelation": autocorrelation_test, "pit": pit_test,
    "power": lambda z: power_test(z, DT, 0.23),
}  # fmt: skip


@pytest.mark.parametrize("name", TESTS)
def test_p_values_of_white_noise_are_uniform(name):
    rng = np.random.default_rng(3)
    p = [TESTS[name](rng.standard_normal(900))[2] for _ in range(400)]
    assert kstest(p, "uniform").pvalue > 0.001


TIME = np.arange(900) * DT
SPOILED = {
    "mean": lambda z: z + 0.3,
    "size": lambda z: 1.3 * z,
    "autocorrelation": lambda z: np.r_[z[0], 0.5 * z[:-1] + np.sqrt(0.75) * z[1:]],
    "pit": lambda z: np.sign(z) * norm.isf(0.25 * norm.sf(np.abs(z)) + 0.125),
    "power": lambda z: z + 0.6 * np.sin(2.0 * np.pi * 0.23 * TIME),
}


@pytest.mark.parametrize("name", TESTS)
def test_each_statistic_notices_what_it_is_for(name):
    rng = np.random.default_rng(4)
    found = [TESTS[name](SPOILED[name](rng.standard_normal(900)))[2] for _ in range(20)]
    assert np.median(found) < 1e-6


def flight_of(rng, spoil=lambda z: z):
    series = rng.standard_normal((12, 900))
    series[0] = spoil(series[0])
    return [c for i, z in enumerate(series) for c in series_checks("a", f"output {i}", z, DT, FREQUENCIES)]


def test_a_sound_flight_is_seldom_flagged_and_a_spoiled_one_is_named():
    rng = np.random.default_rng(5)
    assert sum(bool(missed(flight_of(rng))) for _ in range(100)) <= 4
    off = verdict(flight_of(rng, SPOILED["mean"]))
    assert off["passed"] is False and off["value"] < BOUND
    assert off["detail"].startswith("the record is not one that the model makes: mean of output 0 ")
    assert "on a" in off["detail"] and "of 72 predictive statistics" in off["detail"]


def test_a_record_that_only_priors_contradict_is_not_called_one_that_the_model_can_not_make():
    off = [prior_check("a", "standard deviation of gusts", -6.0), prior_check("a", "C_A", 0.5)]
    told = "the record is not what the priors say: distance from the prior of standard deviation of gusts -6 "
    assert verdict(off)["detail"].startswith(told)
    both = [*off, *series_checks("a", "x", SPOILED["mean"](np.random.default_rng(8).standard_normal(900)), DT, {})]
    assert verdict(both)["detail"].startswith("the record is not one that the model makes: ")


def test_gaps_are_left_out_and_short_series_not_tested():
    z = np.random.default_rng(6).standard_normal(900)
    z[::3] = np.nan
    assert all(np.isfinite(one.p) for one in series_checks("a", "x", z, DT, FREQUENCIES))
    assert series_checks("a", "x", z[:30], DT, FREQUENCIES) == []
    assert power_test(z[1:3], DT, 0.07) is None


def test_draws_of_sound_disturbances_are_seldom_off_and_offset_ones_are():
    rng = np.random.default_rng(7)
    known = rng.standard_normal((900, 1))
    draws = np.sqrt(0.5) * (known + rng.standard_normal((900, 16)))
    assert not missed(draws_checks("a", "wind", draws, DT, {}))
    (first, *_) = least(draws_checks("a", "wind", draws + 0.3, DT, {}))
    assert first.statistic == "mean" and first.p < 1e-6


def test_checks_of_draws_are_the_means_of_the_checks_of_each():
    """Twice the mean p-value, at most one; of normal numbers that are drawn, the distribution is not asked about."""
    draws = np.random.default_rng(9).standard_normal((900, 5)) + [0.0, 0.0, 0.05, 0.1, 0.0]
    made = {c.statistic: c for c in draws_checks("a", "wind", draws, DT, FREQUENCIES)}
    each = [{c.statistic: c for c in series_checks("a", "wind", z, DT, FREQUENCIES)} for z in draws.T]
    assert set(made) == set(each[0]) - {"PIT distance"} and len(made) == 5
    for name, check in made.items():
        assert check.p == pytest.approx(min(1.0, 2.0 * np.mean([one[name].p for one in each])))
        assert check.value == pytest.approx(np.mean([one[name].value for one in each]))
        assert (check.flight, check.what) == ("a", "wind")


def test_the_distance_from_a_prior_is_two_sided():
    assert prior_check("a", "x", 2.0).p == prior_check("a", "x", -2.0).p == pytest.approx(0.0455, abs=1e-4)


def test_no_check_is_no_objection():
    lighter = error_check("a", "the mass of the capsule", "%", -4.96, 1e-9, matters=True)
    assert lighter.words == "estimated error of the mass of the capsule -4.96 % (expected 0, p = 1e-09)"
    assert missed([lighter]) == [lighter] and missed([lighter._replace(matters=False)]) == []
    assert verdict([lighter._replace(matters=False), Check("a", "x", "mean", 0.0, 0.0, 0.5)])["value"] == 1.0
    assert verdict([])["passed"] is True and missed([Check("a", "x", "mean", 0.0, 0.0, 0.5)]) == []


def test_pit_counts_hold_every_sample():
    z = np.random.default_rng(8).standard_normal(1000)
    assert sum(pit_counts(np.r_[z, np.nan])) == 1000 and len(pit_counts(z)) == 10
