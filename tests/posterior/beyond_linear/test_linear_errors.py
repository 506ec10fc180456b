"""Slopes and information that linear models leave out, against differences and closed forms."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from tests.fitting import limited

from bayeschute.posterior.along_record.conditional_mode import approached
from bayeschute.posterior.beyond_linear import laplace
from bayeschute.posterior.beyond_linear import linear_errors as module
from bayeschute.posterior.beyond_linear.linear_errors import linear_errors
from bayeschute.posterior.beyond_linear.polynomials import corrected
from bayeschute.posterior.marginal import place_at, shifted


def test_the_information_in_covariances_is_fishers(gusty):
    """One output: half the sum of squared slopes of the logarithm of the innovations' variance."""
    *_, made = gusty
    h = 1e-3
    (flight,) = made.flights

    def log_variance(xi):
        theta, shift = shifted(made, np.array([xi]))
        place = place_at(flight, made.along[0], shift)
        (found,) = approached(made.flights, made.hyper, np.asarray(theta), [place])
        return 2.0 * np.log(np.asarray(found.gains.root)[:, 0, 0])

    slope = (log_variance(h) - log_variance(-h)) / (2.0 * h)
    found = linear_errors(made, h).information[0, 0]
    assert found == pytest.approx(0.5 * slope @ slope, rel=0.01) and found > 0.01


@pytest.mark.parametrize("which", ["falling", "gusty"])
def test_what_lacks_slopes_as_the_polynomials_do(which, request):
    """Over a step to one side, whose end their curvature has a part in."""
    made, h = request.getfixturevalue(which), 0.2
    made = made[-1] if which == "gusty" else made
    rest = corrected(made, h)[0].correction
    assert linear_errors(made, h).slope[0] == pytest.approx(rest.slope[0] + 0.5 * h * rest.curvature[0, 0], abs=0.01)
    assert linear_errors(made, -h).slope[0] == pytest.approx(rest.slope[0] - 0.5 * h * rest.curvature[0, 0], abs=0.01)


def test_the_slope_is_taken_to_the_side_on_which_flights_fly(falling, monkeypatch):
    down = linear_errors(falling, -0.4)
    limited(monkeypatch, -1.0, 0.1)
    for found, wanted in zip(linear_errors(falling), down, strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-9)
    limited(monkeypatch, -0.1, 0.1)
    with pytest.raises(FloatingPointError, match="both sides"):
        linear_errors(falling)


def _jump(monkeypatch, up, down):
    """Two axes of a flight of one output: relative covariances at the ends of the second, to either side."""

    def at(marginal, point, most, here=None):
        sign = np.sign(point.sum())
        size = 1.0 if sign == 0.0 else 1.1 if point[1] == 0.0 else up if sign > 0.0 else down
        roots = (np.sqrt(size) * np.ones((3, 1, 1)),)
        return laplace.Laplace(0.0, np.array([0.4 * sign]), np.zeros(1), (), (), roots)

    monkeypatch.setattr(laplace, "at", at)
    monkeypatch.setattr(module, "linear_change", lambda marginal, number, points: np.zeros(len(points)))
    return SimpleNamespace(centre=np.zeros(2), felt=np.ones((1, 2), bool))


def test_covariances_that_jump_to_one_side_are_compared_to_the_other(monkeypatch):
    """A riser that goes slack on one path alone: its difference is no derivative."""
    found = linear_errors(_jump(monkeypatch, 1e6, 1.2))
    np.testing.assert_allclose(found.slope, 1.0)
    change = np.array([0.1, -0.2]) / 0.4  # of three samples
    np.testing.assert_allclose(found.information, 1.5 * np.outer(change, change), rtol=1e-12)


def test_covariances_that_jump_to_both_sides_are_told(monkeypatch):
    with pytest.raises(FloatingPointError, match="jump to both sides"):
        linear_errors(_jump(monkeypatch, 1e6, 1e7))
