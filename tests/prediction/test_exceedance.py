"""Shares beyond thresholds and Wilks' limits against counts and the binomial law, written out."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from bayeschute.core.errors import InputError
from bayeschute.prediction.exceedance import exceedance_table, samples_table, tolerance_table

RNG = np.random.default_rng(0)
RATE, SWING = RNG.normal(9.0, 1.0, 400), RNG.gamma(2.0, 3.0, 400)
RATE[[5, 17, 300]] = np.nan


def table(**runs):
    return samples_table(runs)


def test_draws_are_numbered_by_run_and_what_a_run_lacks_is_missing():
    made = table(a={"x": [1.0, 2.0]}, b={"x": [3.0], "y": [4.0]})
    assert made["run"].tolist() == ["a", "a", "b"] and made["draw"].tolist() == [0, 1, 0]
    np.testing.assert_array_equal(made["y"], [np.nan, np.nan, 4.0])


@pytest.mark.parametrize("bad", [{}, {"a": {"x": [1.0], "y": [1.0, 2.0]}}, {"a": {"x": [[1.0]]}}, {"a": {}}])
def test_what_is_no_draws_is_refused(bad):
    with pytest.raises(InputError, match="samples_table"):
        samples_table(bad)


def test_every_row_is_a_count():
    made = exceedance_table(table(a={"rate": RATE}, b={"rate": RATE[:100] - 1.0, "swing": SWING[:100]}), "final")
    data = {("a", "rate"): RATE, ("b", "rate"): RATE[:100] - 1.0, ("b", "swing"): SWING[:100]}
    assert set(zip(made.run, made["quantity"], strict=True)) == set(data)
    for row in made.itertuples():
        x = data[row.run, row.quantity]
        count = sum(not v <= row.threshold for v in x)  # NaN exceeds
        assert (row.exceeded, row.draws, row.failed) == (count, x.size, int(np.isnan(x).sum()))
        assert row.probability == count / x.size and row.unit == "1" and row.statistic == "final"
    for key, part in made.groupby(["run", "quantity"]):
        x = data[key][np.isfinite(data[key])]
        np.testing.assert_allclose(part.threshold, np.linspace(x.min(), x.max(), 41))


def test_limits_are_those_of_as_many_independent_draws():
    made = exceedance_table(table(a={"rate": RATE}), "final", {"rate": [9.5]}, 0.8, independent=80.0)
    row = made[made.threshold == 9.5].iloc[0]
    k, n = row.exceeded * 80.0 / 400.0, 80.0
    assert row.independent_draws == 80.0 and row.confidence == 0.8 and len(made) == 42
    assert row.clopper_pearson_low == pytest.approx(stats.beta.ppf(0.1, k, n - k + 1.0))
    assert row.clopper_pearson_high == pytest.approx(stats.beta.ppf(0.9, k + 1.0, n - k))
    assert row.credible_low == pytest.approx(stats.beta.ppf(0.1, k + 0.5, n - k + 0.5))
    assert row.credible_high == pytest.approx(stats.beta.ppf(0.9, k + 0.5, n - k + 0.5))
    most = exceedance_table(table(a={"rate": RATE}), "final", independent=1e6)
    assert (most.independent_draws == 400.0).all()


def test_a_quantity_whose_every_simulation_failed_has_no_row():
    draws = table(
        a={"rate": np.full(5, np.nan), "swing": SWING[:5]}, b={"rate": RATE[:5] * 0.0 + 1.0, "swing": SWING[:5]}
    )
    for made in (exceedance_table(draws, "final"), tolerance_table(draws, "final")):
        assert set(zip(made.run, made["quantity"], strict=True)) == {("a", "swing"), ("b", "rate"), ("b", "swing")}


def test_units_and_factors_go_to_their_quantity():
    draws = table(a={"rate": RATE, "swing": SWING}, b={"rate": RATE})
    given = {"units": {"rate": "m/s"}, "widened": {"a": {"swing": 1.3}}}
    for made in (exceedance_table(draws, "mean", **given), tolerance_table(draws, "mean", **given)):
        assert set(zip(made.run, made["quantity"], made.unit, made.widened_by, strict=True)) == {
            ("a", "rate", "m/s", 1.0), ("a", "swing", "1", 1.3), ("b", "rate", "m/s", 1.0)
        }  # fmt: skip
        assert (made.statistic == "mean").all()


def test_limits_rise_with_the_draws_and_counts_stay():
    one, other = (exceedance_table(table(a={"x": x}), "final") for x in (SWING, 2.0 * SWING + 5.0))
    np.testing.assert_allclose(other.threshold, 2.0 * one.threshold + 5.0)
    inner = slice(1, -1)  # at the ends the threshold is a draw itself
    np.testing.assert_array_equal(other.exceeded[inner], one.exceeded[inner])


@pytest.mark.parametrize(("share", "confidence"), [(0.95, 0.95), (0.9, 0.9), (0.5, 0.99)])
def test_limits_by_order_statistics_are_the_binomial_law(share, confidence):
    """The (f + 1)-th greatest of n covers the share with P(more than f of n lie above it)."""
    rows = tolerance_table(table(a={"x": SWING}), "final", ((share, confidence),))
    ordered = np.sort(SWING)[::-1]
    assert rows.enough.all()
    for row in rows.itertuples():
        assert row.limit == ordered[row.failures]
        assert stats.binom.cdf(row.failures, row.needed, 1.0 - share) <= 1.0 - confidence
        assert stats.binom.cdf(row.failures, row.needed - 1, 1.0 - share) > 1.0 - confidence
    most = rows.failures.max()
    assert stats.binom.cdf(most, 400, 1.0 - share) <= 1.0 - confidence < stats.binom.cdf(most + 1, 400, 1.0 - share)
    lone = tolerance_table(table(a={"x": SWING[:3]}), "final", ((share, confidence),))
    assert lone.limit.isna().all() and not lone.enough.any()


def test_dependent_draws_are_thinned():
    rows = tolerance_table(table(a={"x": SWING}), "final", ((0.9, 0.9),), independent=100.0)
    assert (rows.independent_draws == 100).all() and (rows.draws == 400).all()
    assert rows.limit.iloc[0] == np.max(SWING[::4])
    few = tolerance_table(table(a={"x": SWING}), "final", ((0.9, 0.9),), independent=150.0)
    assert (few.independent_draws == 134).all()  # every third
