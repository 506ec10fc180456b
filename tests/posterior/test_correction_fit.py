"""Corrections fitted over the posterior: known polynomials from few and noisy values, and a density bent far out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayeschute.posterior import laplace
from bayeschute.posterior.fit import correction_fit
from bayeschute.posterior.fit.correction_fit import GOOD, change, fitted
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
    found = change(expected, points, values(wanted, points, 0.02))
    left = values(wanted, more, 0.0) - np.asarray(found.at(more.T))
    before = values(wanted, more, 0.0)
    assert np.std(left) < (0.7 if count < 28 else 0.1) * np.std(before)
    np.testing.assert_array_equal(found.curvature, found.curvature.T)


def test_an_expansion_that_holds_is_left_as_it_is(world):
    rng, expected, values = world
    points = rng.standard_normal((30, SIZE))
    found = change(expected, points, values(expected, points, 0.05))
    more = rng.standard_normal((200, SIZE))
    assert np.std(np.asarray(found.at(more.T))) < 0.05


def test_products_that_say_nothing_of_the_density_at_large_are_taken_back(world):
    """Fewer points than coefficients are enough, as they go together."""
    rng, expected, values = world
    own = np.diag(np.diag(expected.curvature))
    points, more = rng.standard_normal((14, SIZE)), rng.standard_normal((200, SIZE))
    wanted = Quadratic(expected.slope, own)
    found = change(expected, points, values(wanted, points, 0.02))
    left = values(wanted, more, 0.0) - np.asarray(found.at(more.T))
    assert np.std(left) < 0.2 * np.std(values(wanted, more, 0.0))


@pytest.fixture
def bent(straight, monkeypatch):
    """A posterior in place of whose flights a function is: minus the log density that is right, at points (N, P)."""

    def put(right):
        def lacking(marginal, points):
            return right(points) - np.asarray(marginal.correction.at(points.T))

        monkeypatch.setattr(laplace, "lacking", lacking)
        return straight

    return put


def test_a_correction_read_near_the_mode_is_replaced_where_it_fails_far_from_it(bent):
    """The right one has a dent about the mode, which an expansion there extrapolates."""

    def right(points):
        dent = 0.2 * np.exp(-8.0 * points**2)
        return np.sum(0.5 * points**2 - dent, axis=1) + 0.5 * points[:, 0] * points[:, 1]

    size, said = 2, []
    made = replace(bent(right), bend=Quadratic(np.zeros(size), np.array([[4.2, 0.5], [0.5, 4.2]])))
    made = replace(made, determinant=Quadratic.none(size))
    got = fitted(made, np.random.default_rng(1), lambda share, words: said.append(words))
    assert got.before > GOOD and got.points >= correction_fit._FIRST and got.error < 0.5 * got.before
    fresh = np.random.default_rng(2).standard_normal((500, size))
    assert np.std(laplace.lacking(got.marginal, fresh)) < 0.4 * np.std(laplace.lacking(made, fresh))
    assert said[0].endswith(f"8 points: off by {got.before:.2g}") and said[-1].endswith(f"off by {got.error:.2g}")


def test_corrections_that_are_good_stay_and_flights_that_fail_are_told(bent):
    made = bent(lambda points: 0.05 * points[:, 0] ** 3)
    got = fitted(made, np.random.default_rng(1))
    assert got.marginal is made and got.points == 0 and got.error == got.before < GOOD
    lost = fitted(
        bent(lambda points: np.where(points[:, 0] > -0.5, np.nan, 9.0 * points[:, 0])), np.random.default_rng(1)
    )
    assert np.isnan(lost.error) and lost.points == 0


def test_the_search_ends_where_no_polynomial_will_do(bent):
    """The error told is that of points which the corrections were not fitted to."""
    made = bent(lambda points: 3.0 * np.sin(40.0 * points[:, 0]))
    got = fitted(made, np.random.default_rng(1))
    size = np.size(made.centre)
    assert correction_fit._LEAST * size <= got.points < (correction_fit._MOST + 2) * size + correction_fit._FIRST
    assert 1.0 < got.error
