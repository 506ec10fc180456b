"""Corrections fitted over the posterior: known polynomials from few and noisy values, and a density bent far out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayeschute.posterior.beyond_linear import comparison
from bayeschute.posterior.beyond_linear.comparison import Compared
from bayeschute.posterior.fit import correction_fit
from bayeschute.posterior.fit.correction_fit import change, fitted, implied
from bayeschute.posterior.marginal import Quadratic

SIZE = 6


def _symmetric(rng, scale):
    made = scale * rng.standard_normal((SIZE, SIZE))
    return made + made.T


@pytest.fixture
def world():
    """An expansion, what it should be, and the values of their difference at points, with errors."""
    rng = np.random.default_rng(4)
    expected = Quadratic(0.1 * rng.standard_normal(SIZE), _symmetric(rng, 0.2))

    def values(wanted, points, error):
        made = np.asarray(wanted.at(points.T)) - np.asarray(expected.at(points.T))
        return made + 7.0 + error * rng.standard_normal(len(points))

    return rng, expected, values


@pytest.mark.parametrize("count", [20, 90])
def test_a_polynomial_is_found_whether_its_coefficients_are_outnumbered_or_not(world, count):
    """What a constant adds does not count. With 28 coefficients and 20 points some of the difference is left."""
    rng, expected, values = world
    wanted = Quadratic(
        np.asarray(expected.slope) + 0.2 * rng.standard_normal(SIZE),
        np.asarray(expected.curvature) + _symmetric(rng, 0.1),
    )
    points, more = rng.standard_normal((count, SIZE)), rng.standard_normal((200, SIZE))
    found = change(expected, points, values(wanted, points, 0.02)).polynomial
    left = values(wanted, more, 0.0) - np.asarray(found.at(more.T))
    before = values(wanted, more, 0.0)
    assert np.std(left) < (0.7 if count < 28 else 0.1) * np.std(before)
    np.testing.assert_array_equal(found.curvature, found.curvature.T)


def test_an_expansion_that_holds_is_left_as_it_is(world):
    rng, expected, values = world
    points = rng.standard_normal((30, SIZE))
    found = change(expected, points, values(expected, points, 0.05)).polynomial
    more = rng.standard_normal((200, SIZE))
    assert np.std(np.asarray(found.at(more.T))) < 0.05


def test_products_that_say_nothing_of_the_density_at_large_are_taken_back(world):
    """Fewer points than coefficients are enough, as they go together."""
    rng, expected, values = world
    own = np.diag(np.diag(expected.curvature))
    points, more = rng.standard_normal((14, SIZE)), rng.standard_normal((200, SIZE))
    wanted = Quadratic(expected.slope, own)
    found = change(expected, points, values(wanted, points, 0.02)).polynomial
    left = values(wanted, more, 0.0) - np.asarray(found.at(more.T))
    assert np.std(left) < 0.2 * np.std(values(wanted, more, 0.0))


@pytest.fixture
def bent(straight, monkeypatch):
    """A posterior in place of whose flights a function is: minus the log density that is right, at points (N, P)."""

    def put(right, in_range=lambda points: np.ones(len(points), bool)):
        def compared(marginal, points, progress=None):
            own = 0.5 * np.sum(points**2, axis=1) + np.asarray(marginal.correction.at(points.T))
            broken = np.where(in_range(points), own, 1e4)
            exact = 0.5 * np.sum(points**2, axis=1) + right(points)
            return Compared(broken, exact, in_range(points), (exact - broken)[None])

        monkeypatch.setattr(comparison, "compared", compared)
        return straight

    return put


def test_errors_are_those_of_leaving_a_point_out(world, monkeypatch):
    """Fitted anew without each, at the same spreads."""
    monkeypatch.setattr(correction_fit, "_BENDS", (0.1,))
    monkeypatch.setattr(correction_fit, "_ERRORS", (0.2,))
    rng, expected, values = world
    wanted = Quadratic(np.zeros(SIZE), _symmetric(rng, 0.1))
    points = rng.standard_normal((25, SIZE))
    missing = values(wanted, points, 0.1)
    found = change(expected, points, missing)
    for n in (0, 7, 24):
        others = np.delete(np.arange(25), n)
        part = change(expected, points[others], missing[others]).polynomial
        # The constant isn't returned: differences of two points left out, by the mean of what the others lack.
        constant = np.mean(missing[others] - np.asarray(part.at(points[others].T)))
        left = missing[n] - float(part.at(points[n])) - constant
        assert found.errors[n] == pytest.approx(left, abs=0.05)


def test_what_an_error_implies_is_the_difference_of_two_densities():
    """Of Gaussians: one linear in a coordinate shifts its mean by as much, a square one narrows it."""
    xi = np.random.default_rng(3).standard_normal((200_000, 2))
    own = 0.5 * np.sum(xi**2, axis=1)
    assert implied(xi, own, own + 0.3 * xi[:, 0] + 5.0) == pytest.approx(0.3, abs=0.01)
    assert implied(xi, own, own - 0.3 * xi[:, 1]) == pytest.approx(0.3, abs=0.01)
    assert implied(xi, own, own + 0.5 * 0.5 * xi[:, 0] ** 2) == pytest.approx(1.5**0.5 - 1.0, abs=0.01)
    assert implied(xi, own, own) == pytest.approx(0.0, abs=1e-12)
    off = own + 0.5 * xi[:, 0]
    assert implied(xi, off, off + 0.3 * xi[:, 1]) == pytest.approx(0.3, abs=0.02)
    assert np.isfinite(implied(xi, own, own + 40.0 * np.sin(9.0 * xi[:, 0])))


def test_where_the_right_density_holds_one_point_only_nothing_can_be_told():
    xi = np.random.default_rng(3).standard_normal((50, 2))
    own = 0.5 * np.sum(xi**2, axis=1)
    alone = np.where(np.arange(50) == 7, own, own + 1e4)
    assert implied(xi, own, alone) == implied(xi, alone, alone) == np.inf


def test_a_hole_where_there_is_next_to_nothing_changes_next_to_nothing():
    xi = np.random.default_rng(5).standard_normal((264, 16))
    own = 0.5 * np.sum(xi**2, axis=1)
    far = np.argsort(own)[-2:]
    hole = np.where(np.isin(np.arange(264), far), own + 9.5e3, own)
    assert 0.0 < implied(xi, hole, own) < 0.1
    assert implied(xi, hole, own + 0.5 * xi[:, 3]) == pytest.approx(0.5, abs=0.2)


def test_a_correction_read_near_the_mode_is_replaced_where_it_fails_far_from_it(bent):
    """The right one has a dent about the mode, which an expansion there extrapolates."""

    def right(points):
        return 0.5 * points[:, 0] * points[:, 1] - np.sum(0.2 * np.exp(-8.0 * points**2), axis=1)

    size, said = 2, []
    made = replace(bent(right), bend=Quadratic(np.zeros(size), np.array([[3.2, 0.5], [0.5, 3.2]])))
    made = replace(made, determinant=Quadratic.none(size))
    got = fitted(made, np.random.default_rng(1), lambda share, words: said.append((share, words)))
    assert got.before > 0.2 > got.shift and got.points > correction_fit._FIRST
    fresh = np.random.default_rng(2).standard_normal((2000, size))
    left, before = comparison.compared(got.marginal, fresh), comparison.compared(made, fresh)
    assert np.std(left.errors) < 0.1 * np.std(before.errors)
    assert np.std(left.errors) < 2.0 * got.error < 0.2 * np.std(before.errors)
    assert implied(fresh, *left[:2]) < 0.1 and implied(fresh, *before[:2]) > 0.2
    assert [share for share, _ in said] == sorted(share for share, _ in said)
    assert said[-1][1].startswith(f"log density over the posterior, {got.points} points: off by {got.error:.2g}")


def test_places_that_the_linear_models_do_not_reach_leave_the_fit_alone(bent):
    """A twentieth of the points, the outermost, where they say that there is nothing: the fit is that of the others."""

    def right(points):
        return 0.8 * points[:, 0] * points[:, 1]

    whole = fitted(bent(right), np.random.default_rng(1))
    holed = fitted(bent(right, lambda points: np.sum(points**2, axis=1) < 9.0), np.random.default_rng(1))
    assert whole.before > 0.2 and holed.error < 0.05 and whole.shift < holed.shift < 0.2
    np.testing.assert_allclose(holed.marginal.correction.curvature, whole.marginal.correction.curvature, atol=0.05)
    lost = fitted(bent(right, lambda points: points[:, 0] < 0.0), np.random.default_rng(1))
    assert np.isnan(lost.error)


def test_corrections_that_are_good_stay_and_flights_that_fail_are_told(bent):
    made = bent(lambda points: 0.05 * points[:, 0] ** 3)
    got = fitted(made, np.random.default_rng(1))
    assert got.marginal is made and got.points == correction_fit._FIRST and got.shift == got.before < 0.2
    lost = fitted(bent(lambda points: np.where(points[:, 0] > -0.5, np.nan, 9.0)), np.random.default_rng(1))
    assert np.isnan(lost.error) and np.isnan(lost.shift) and lost.points == correction_fit._FIRST


def test_points_are_added_while_what_the_error_implies_is_not_small(bent, monkeypatch):
    made = bent(lambda points: 0.05 * points[:, 0] ** 3)
    first = fitted(made, np.random.default_rng(1))
    monkeypatch.setattr(correction_fit, "MOST_SHIFT", 0.5 * first.shift)
    more = fitted(made, np.random.default_rng(1))
    assert more.points == correction_fit._MOST * np.size(made.centre) > first.points == correction_fit._FIRST


def test_the_search_ends_where_no_polynomial_will_do(bent):
    made = bent(lambda points: 3.0 * np.sin(40.0 * points[:, 0]))
    got = fitted(made, np.random.default_rng(1))
    batch = max(correction_fit._FIRST, correction_fit._BATCH * np.size(made.centre))
    assert got.points == correction_fit._FIRST + (correction_fit._STILL + 1) * batch
    assert 1.0 < got.error and 0.2 < got.shift


@pytest.mark.parametrize(
    ("off", "vain"),
    [
        ([2.0, 2.0, 2.0], False),
        ([2.0, 2.0, 2.0, 2.0], True),
        ([2.0, 2.0, 1.9, 1.7], False),
        ([9.0, 0.4, 0.4, 0.4], False),
    ],
    ids=["too few", "no better", "better", "small enough for the most points"],
)
def test_more_points_are_in_vain_where_they_help_no_more_and_the_most_would_not_do(off, vain):
    assert correction_fit._in_vain(off, 100) is vain
