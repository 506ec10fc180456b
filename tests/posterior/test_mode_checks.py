"""Whether a point is a mode: a Gaussian posterior is, one whose corrections outweigh it is not, nor one on a cliff."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.posterior import mode_checks
from bayeschute.posterior.beyond_linear.polynomials import corrected
from bayeschute.posterior.marginal import Quadratic, log_density
from bayeschute.posterior.mode_checks import PLACES, Profile, profile

GAUSSIAN = 0.5 * np.array(PLACES) ** 2


def test_a_gaussian_posterior_falls_by_half_a_square(straight):
    told = profile(straight)
    np.testing.assert_array_equal(told.direction, np.eye(2))
    np.testing.assert_allclose(told.fall, [GAUSSIAN, GAUSSIAN], atol=2e-3)
    assert told.worst == pytest.approx(0.5, abs=2e-3) and told.is_mode


def test_further_directions_are_looked_along_too(straight):
    told = profile(straight, more=[np.array([3.0, -4.0])])
    np.testing.assert_allclose(told.direction, [[1.0, 0.0], [0.0, 1.0], [0.6, -0.8]])
    value = np.asarray(log_density(straight, jnp.asarray(np.outer([0.6, -0.8], [0.0, *PLACES]))))
    np.testing.assert_allclose(told.fall[2], value[0] - value[1:], atol=1e-12)


@pytest.mark.parametrize("which", ["determinant", "bend"])
@pytest.mark.parametrize(("by", "mode"), [(-3.0, False), (-0.5, True), (0.5, True), (30.0, False)])
def test_a_correction_that_outweighs_the_density_makes_it_no_mode(straight, which, by, mode):
    """Along an axis on which the density rises, or falls far more steeply than its covariance says."""
    along = np.array([0.8, 0.6])
    told = profile(replace(straight, **{which: Quadratic(np.zeros(2), by * np.outer(along, along))}))
    assert told.is_mode == mode
    place = np.flatnonzero(np.abs(told.direction @ along) > 1.0 - 1e-9)
    assert place.size == 1  # the axis on which it bends most is looked along
    np.testing.assert_allclose(told.fall[place[0]], (1.0 + by) * GAUSSIAN, atol=5e-3 * (1.0 + abs(by)))
    assert told.worst == pytest.approx(min(0.5, 0.5 * (1.0 + by)), abs=0.02)


def test_beside_a_mode_is_no_mode(straight):
    """A slope that lets the density rise to one side by more than it falls."""
    told = profile(replace(straight, determinant=Quadratic(np.array([0.0, 0.8]), np.zeros((2, 2)))))
    assert not told.is_mode and told.worst == pytest.approx(0.5 - 0.8, abs=5e-3)
    near = profile(replace(straight, determinant=Quadratic(np.array([0.0, 0.2]), np.zeros((2, 2)))))
    assert near.is_mode and near.worst == pytest.approx(0.5 - 0.2, abs=5e-3)


def test_about_its_mode_a_density_falls_as_from_its_centre(straight):
    """A slope puts the mode beside the centre."""
    off = replace(straight, determinant=Quadratic(np.array([-0.4, 0.8]), np.zeros((2, 2))))
    assert not profile(off).is_mode
    told = profile(off, np.array([0.4, -0.8]))
    np.testing.assert_allclose(told.fall, [GAUSSIAN, GAUSSIAN], atol=5e-3)
    assert told.is_mode


def _told(*rows):
    return Profile(np.eye(len(rows)), np.array(rows, float))


@pytest.mark.parametrize(
    ("row", "mode"),
    [
        (GAUSSIAN, True),
        ([np.nan, 0.5, 0.5, 2.0], True),  # two standard deviations out a flight may fail
        ([2.0, np.nan, 0.5, 2.0], False),
        ([2.0, 0.5, 0.5, 0.4], False),  # falls, then rises again
        ([2.0, 0.5, 0.5, 0.5], False),
        ([9.0, 5.5, 0.5, 2.0], False),  # a cliff
        ([2.0, 0.0, 0.5, 2.0], False),
        ([np.inf, 0.5, 0.5, 2.0], True),
    ],
)
def test_one_axis_decides(row, mode):
    assert _told(GAUSSIAN, row, GAUSSIAN).is_mode == mode
    assert _told(row[::-1]).is_mode == mode


@pytest.mark.parametrize(
    ("row", "words"),
    [
        (GAUSSIAN, "^$"),
        ([2.0, np.nan, 0.5, 2.0], "flights fail"),
        ([2.0, -0.3, 0.5, 2.0], "rises by 0.3 along some axis"),
        ([9.0, 5.5, 0.5, 2.0], "falls by 5.5 along some axis, where about 0.5 is expected"),
        ([2.0, 0.5, 0.5, 0.4], "two standard deviations away .* higher than at one"),
    ],
)
def test_what_is_no_mode_says_why_and_along_which_axis(row, words):
    told = _told(GAUSSIAN, row)
    assert re.search(words, told.why_not)
    assert told.blamed is None if told.is_mode else told.blamed.tolist() == [0.0, 1.0]


def test_the_worst_is_the_least_that_is_known():
    assert _told(GAUSSIAN, [np.nan, -0.3, np.nan, 2.0]).worst == -0.3
    assert _told(GAUSSIAN, [-7.0, 0.2, 0.4, -7.0]).worst == 0.2
    assert _told([1.0, np.nan, np.nan, 1.0]).worst == -np.inf


def test_a_flight_that_fails_has_no_fall(straight, monkeypatch):
    honest = log_density

    def failing(marginal, points):
        value = np.array(honest(marginal, points))
        value[np.asarray(points)[1] <= -1.0] = -np.inf
        value[np.asarray(points)[0] >= 2.0] = np.nan
        return value

    monkeypatch.setattr(mode_checks, "log_density", failing)
    told = profile(straight)
    assert not told.is_mode and np.isnan(told.fall[0, 3])
    assert told.worst == pytest.approx(0.5, abs=2e-3)
    assert not np.isfinite(told.fall[1, :2]).any()


def test_all_that_is_found_of_a_descent_is_a_mode(found):
    assert found.profile.is_mode and 0.3 < found.profile.worst < 0.7 and found.lost == ()
    _, ahead = corrected(found.marginal)
    np.testing.assert_allclose(profile(found.marginal, ahead.step()).fall, found.profile.fall, atol=1e-4)


def test_a_density_is_looked_at_from_where_it_shows_a_mode(monkeypatch):
    looks = {(): (False, 0.9), ("step",): (True, 0.1)}
    monkeypatch.setattr(
        mode_checks, "profile", lambda made, *step: SimpleNamespace(is_mode=looks[step][0], worst=looks[step][1])
    )
    assert mode_checks.best_profile("made", "step").worst == 0.1
    looks[()] = (True, 0.9)
    assert mode_checks.best_profile("made", "step").worst == 0.9
