"""Nested P(met) against closed forms on a Gaussian test, direct counting, and coverage over virtual posteriors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtr, ndtri

from bayeschute.core.errors import InputError
from bayeschute.landing.decisions.decision import chance, decide
from bayeschute.landing.decisions.requirements import Limit, Requirement, effective, exceedance, judge
from bayeschute.landing.measures import ROW
from bayeschute.prediction.binomial_limits import wilks_sample_size


def drawn(mu: float, s: float, draws: int, each: int, rng: np.random.Generator):
    """Landings of a Gaussian margin: mu + s z_k over draws, plus a standard normal from landing to landing."""
    draw = np.repeat(np.arange(draws), each)
    return draw, mu + s * rng.standard_normal(draws)[draw] + rng.standard_normal(draw.size)


def rows_of(draw, values):
    rows = np.zeros(draw.size, ROW)
    rows["draw"], rows["vertical_speed"] = draw, values
    return rows


def test_spreads_have_their_closed_forms():
    mu, s = 1.2, 0.4
    draw, margin = drawn(mu, s, 1000, 100, np.random.default_rng(1))
    found = chance(draw, margin > 0.0)
    p = ndtr(mu + s * ndtri(np.linspace(0.0005, 0.9995, 1000)))
    assert found.met == np.mean(margin > 0.0)
    assert found.met == pytest.approx(ndtr(mu / np.hypot(1.0, s)), abs=4.0 * found.monte_carlo_sd)
    assert found.epistemic_sd == pytest.approx(p.std(), rel=0.1)
    assert found.aleatory_sd == pytest.approx(np.sqrt(np.mean(p * (1.0 - p))), rel=0.05)
    assert [found.low, found.high] == pytest.approx(list(ndtr(mu + s * ndtri([0.05, 0.95]))), abs=0.02)
    counted = np.array([np.mean(margin[draw == k] > 0.0) for k in range(1000)])
    assert found.epistemic_sd**2 == pytest.approx(counted.var() - np.mean(p * (1.0 - p)) / 100, rel=0.1)


def test_monte_carlo_error_is_the_scatter_of_repeated_campaigns():
    found = [chance(*_met(0.8, 0.5, 50, 20, seed)) for seed in range(40)]
    assert np.mean([f.monte_carlo_sd for f in found]) == pytest.approx(np.std([f.met for f in found]), rel=0.35)


def _met(mu, s, draws, each, seed):
    draw, margin = drawn(mu, s, draws, each, np.random.default_rng(seed))
    return draw, margin > 0.0


def test_the_interval_holds_the_true_probability_over_virtual_posteriors():
    rng, held, count = np.random.default_rng(7), 0, 120
    for _ in range(count):
        mu, s = rng.normal(1.2, 0.6), rng.uniform(0.1, 0.7)
        truth = ndtr(mu + s * rng.standard_normal())  # the true parameters are a draw of the posterior
        draw, margin = drawn(mu, s, 100, 20, rng)
        found = chance(draw, margin > 0.0)
        held += found.low <= truth <= found.high
    assert 0.85 <= held / count <= 0.95


def test_verdicts():
    met = decide(chance(*_met(3.0, 0.2, 200, 50, 0)), 0.95, 0.9)
    assert met.verdict == "met" and met.reached > 0.99
    assert decide(chance(*_met(0.5, 0.2, 200, 50, 0)), 0.95, 0.9).verdict == "not met"
    open_ = decide(chance(*_met(1.9, 0.6, 400, 50, 0)), 0.95, 0.9)
    gap = 1.9 - ndtri(0.95)
    assert open_.verdict == "can't tell yet" and open_.more_draws is None
    assert open_.more_drops == pytest.approx((1.2816 * 0.6 / gap) ** 2 - 1.0, rel=0.6)
    assert f"about {int(np.ceil(open_.more_drops))} more drops as telling" in open_.why
    few = decide(chance(*_met(2.2, 0.05, 8, 8, 0)), 0.95, 0.9)
    assert few.verdict == "can't tell yet" and (few.more_draws or 0.0) > 1.0


def test_failures_count_against_it_and_limits_hold_together():
    rng = np.random.default_rng(3)
    draw = np.arange(4000) % 100
    rows = rows_of(draw, rng.normal(9.0, 1.0, 4000))
    rows["horizontal_speed"] = rng.normal(5.0, 1.0, 4000)
    rows["outcome"][:400] = 1
    both = Requirement("both", (Limit("vertical_speed", 10.0), Limit("horizontal_speed", 6.0)), 0.5, 0.9)
    found = judge(both, rows)
    assert found.chance.failed == 400
    assert found.chance.met == pytest.approx(0.9 * ndtr(1.0) ** 2, abs=0.02)


def test_exceedance_against_the_normal_law_and_counting():
    draw, margin = drawn(0.0, 0.5, 200, 100, np.random.default_rng(5))
    table = exceedance(rows_of(draw, margin), "vertical_speed", [-1.0, 0.0, 2.0])
    np.testing.assert_array_equal(table["probability"], [np.mean(margin > t) for t in (-1.0, 0.0, 2.0)])
    exact = 1.0 - ndtr(np.array([-1.0, 0.0, 2.0]) / np.hypot(1.0, 0.5))
    assert ((table["clopper_pearson_low"] <= exact) & (exact <= table["clopper_pearson_high"])).all()
    low = 1.0 - ndtr(np.array([-1.0, 0.0, 2.0]) + 0.5 * ndtri(0.95))
    np.testing.assert_allclose(table["posterior_low"], low, atol=0.02)


def test_landings_that_share_draws_are_worth_fewer():
    alike, apart = (chance(*_met(0.5, s, 100, 100, 2)) for s in (0.0, 1.0))
    assert effective(alike) > 5000 and 100 <= effective(apart) < 500


def test_wilks_limits_of_independent_landings_hold_their_share():
    rng, n = np.random.default_rng(4), wilks_sample_size(0.95, 0.95)
    held = [ndtr(rng.standard_normal(n).max()) >= 0.95 for _ in range(2000)]
    assert n == 59 and np.mean(held) == pytest.approx(0.95, abs=0.015)


def test_one_draw_is_refused():
    with pytest.raises(InputError, match="two or more"):
        chance(np.zeros(10), np.ones(10, bool))
