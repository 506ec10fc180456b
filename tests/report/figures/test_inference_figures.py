"""Figures of the inference: densities in the shown unit, ranks of chains that agree and of one that doesn't."""

from __future__ import annotations

from math import comb

import numpy as np
import pytest
from matplotlib.figure import Figure

from bayeschute.report.figures import inference_figures as module


def ax():
    return Figure().add_subplot()


def line(axes, label):
    (found,) = [one for one in axes.lines if one.get_label() == label]
    return found


def test_ranks_of_chains_that_share_their_draws_fairly_are_flat():
    draws = np.arange(800.0).reshape(200, 4).T
    np.testing.assert_array_equal(module.rank_counts(draws), np.full((4, 20), 10))
    apart = module.rank_counts(np.arange(800.0).reshape(4, 200))
    np.testing.assert_array_equal(apart, 40 * np.repeat(np.eye(4, dtype=int), 5, axis=1))


def test_the_histogram_of_ranks_is_over_the_expected_count_and_a_fair_one_inside_the_band():
    draws = np.random.default_rng(0).standard_normal((4, 400))
    axes = module.ranks(ax(), draws)
    chains = [p.get_data().values for p in axes.patches if hasattr(p, "get_data")]
    assert [c.mean() for c in chains] == pytest.approx([1.0] * 4)
    (band,) = [p for p in axes.patches if not hasattr(p, "get_data")]
    low, high = band.get_y(), band.get_y() + band.get_height()
    chance = [comb(400, k) * 0.05**k * 0.95 ** (400 - k) for k in range(33)]  # of k of 400 in one of twenty bins
    assert sum(chance[:10]) < 0.005 < sum(chance[:11]) and sum(chance[:32]) < 0.995 < sum(chance)
    assert (low, high) == pytest.approx((10 / 20, 32 / 20))
    assert np.mean([(c >= low) & (c <= high) for c in chains]) > 0.95
    apart = module.ranks(ax(), np.arange(1600.0).reshape(4, 400))
    assert apart.get_ylim()[1] == pytest.approx(4.2)


def test_the_selected_number_of_terms_is_marked_on_the_predicted_error():
    ranking = [{"mse": 4.0, "pse": 9.0}, {"mse": 1.0, "pse": 2.25}, {"mse": 0.25, "pse": 4.0}]
    axes = module.predicted_error(ax(), "axial", {"ranking": ranking, "pse_minimum_at": 2, "selected": [{}]})
    np.testing.assert_allclose(line(axes, "fit error, √mse").get_ydata(), [2.0, 1.0, 0.5])
    np.testing.assert_allclose(line(axes, "predicted error, √PSE").get_ydata(), [3.0, 1.5, 2.0])
    mark = line(axes, "selected")
    assert (mark.get_xdata()[0], mark.get_ydata()[0]) == (2, 1.5)
    mark = line(module.predicted_error(ax(), "axial", {"ranking": ranking, "selected": [{}]}), "selected")
    assert (mark.get_xdata()[0], mark.get_ydata()[0]) == (1, 3.0)
    axes = module.predicted_error(ax(), "axial", {"ranking": ranking, "pse_minimum_at": 4})
    assert "selected" not in {one.get_label() for one in axes.lines}


def test_a_density_is_of_degrees_with_the_truth_where_it_lies():
    draws = 0.1 + 0.01 * np.random.default_rng(1).standard_normal((4, 500))
    axes = module.marginal(ax(), "angle", draws, None, 0.2, "rad")
    x, y = line(axes, "posterior").get_data()
    assert np.trapezoid(y, x) == pytest.approx(1.0, abs=0.01) and np.trapezoid(x * y, x) == pytest.approx(
        5.73, abs=0.05
    )
    assert (
        line(axes, "truth").get_xdata()[0] == pytest.approx(np.rad2deg(0.2)) and axes.get_title("left") == "angle [deg]"
    )
    assert x[-1] >= np.rad2deg(0.2)
    assert "truth" not in {one.get_label() for one in module.marginal(ax(), "a", draws, truth=None).lines}


def test_a_wide_prior_is_seen_and_the_posterior_still_resolved():
    rng = np.random.default_rng(2)
    after, before = rng.standard_normal(2000), 100.0 * rng.standard_normal(2000)
    x = line(module.marginal(ax(), "a", after, before), "prior").get_xdata()
    assert (x[0], x[-1]) == pytest.approx((after.mean() - 10 * after.std(), after.mean() + 10 * after.std()))
    x = line(module.marginal(ax(), "a", after, 0.01 * before), "prior").get_xdata()
    assert (x[0], x[-1]) == pytest.approx((after.mean() - 3.6 * after.std(), after.mean() + 3.6 * after.std()))


def test_draws_that_do_not_vary_have_no_density():
    grid = np.linspace(0.0, 1.0, 5)
    for flat in (np.full(50, 0.5), np.array([0.1, 0.2]), np.full(9, np.nan)):
        np.testing.assert_array_equal(module._density(flat, grid), 0.0)
    assert np.isfinite(line(module.marginal(ax(), "a", np.full(50, 0.5)), "posterior").get_ydata()).all()


def test_correlations_are_the_lower_triangle_each_at_its_pair():
    matrix = np.array([[1.0, 0.1, -0.7], [0.1, 1.0, 0.3], [-0.7, 0.3, 1.0]])
    axes = module.correlations(ax(), ["a", "b", "c"], matrix)
    down, across = ([t.get_text() for t in ticks] for ticks in (axes.get_yticklabels(), axes.get_xticklabels()))
    said = {(down[round(t.get_position()[1])], across[round(t.get_position()[0])]): t for t in axes.texts}
    assert {pair: t.get_text() for pair, t in said.items()} == {
        ("b", "a"): "0.10", ("c", "a"): "−0.70", ("c", "b"): "0.30",
    }  # fmt: skip
    assert [pair for pair, t in said.items() if t.get_color() == "white"] == [("c", "a")]
    (image,) = axes.images
    assert image.get_array().mask.tolist() == [[False, True], [False, False]] and image.get_clim() == (-1, 1)


def test_an_autocorrelation_below_the_usual_range_is_shown_whole():
    low, high = module.autocorrelation(ax(), "swing", np.arange(3.0), np.array([1.0, -0.8, 0.1])).get_ylim()
    assert (low, high) == pytest.approx((-0.85, 1.02))
    assert module.autocorrelation(ax(), "swing", np.arange(3.0), np.ones(3)).get_ylim()[0] == pytest.approx(-0.35)


def test_chains_have_two_parameters_a_row_in_their_shown_unit():
    draws = {name: np.random.default_rng(i).standard_normal((2, 300)) for i, name in enumerate("abc")}
    figure = module.chain_figure(draws, {"b": "rad"})
    assert [a.get_title("left") for a in figure.axes if a.get_title("left")] == ["a", "b [deg]", "c"]
    assert [a.get_visible() for a in figure.axes] == [True] * 6 + [False] * 2
    first = figure.axes[2].lines[0]
    np.testing.assert_allclose(first.get_ydata(), np.rad2deg(draws["b"][0][::3]))
    np.testing.assert_array_equal(first.get_xdata(), np.arange(0, 300, 3))
