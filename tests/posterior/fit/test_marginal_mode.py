"""What the search for the marginal mode carries between coordinates and places, in several parameters at once."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from bayeschute.posterior.beyond_linear import linear_errors
from bayeschute.posterior.fit import marginal_mode as module

SCALE = np.array([[2.0, 0.0, 0.0], [0.5, 0.3, 0.0], [-1.0, 0.2, 4.0]])
CENTRE = np.array([1.0, -2.0, 0.5])
SLOPE = np.array([0.3, -1.0, 2.0])
INFORMATION = np.array([[2.0, 0.4, -0.1], [0.4, 1.0, 0.3], [-0.1, 0.3, 0.5]])


def left_out(theta):
    """A parabola in standard coordinates, of parameters."""
    xi = np.linalg.solve(SCALE, theta - CENTRE)
    return SLOPE @ xi + 0.5 * xi @ INFORMATION @ xi


def test_slope_and_information_are_those_of_the_parameters(monkeypatch):
    """Standard coordinates are lower triangular in the parameters: a transpose in the wrong place gives another slope."""
    monkeypatch.setattr(linear_errors, "linear_errors", lambda made: linear_errors.LinearErrors(SLOPE, INFORMATION))
    errors = module._LinearErrors.at(SimpleNamespace(centre=CENTRE, scale=SCALE))
    for theta in (CENTRE, CENTRE + [0.3, -0.1, 0.7]):
        steps = 1e-5 * np.eye(3)
        differences = [(left_out(theta + step) - left_out(theta - step)) / 2e-5 for step in steps]
        np.testing.assert_allclose(errors.slope_at(theta), differences, rtol=1e-6)
    np.testing.assert_allclose(errors.information, errors.information.T)


def test_the_rise_between_two_places_has_the_mean_correction_in_it():
    placed = module._Placed(
        CENTRE, SimpleNamespace(marginal=10.0), np.array([1.0, 0.0, -2.0]), np.array([0.1, 0.2, 0.3])
    )
    there = CENTRE + [0.5, 9.0, 0.25]
    assert placed.rise(there, SimpleNamespace(marginal=13.0)) == pytest.approx(3.0 + 0.5 - 0.5)
    assert placed.rise(CENTRE + [1.0, 0.0, 0.0], SimpleNamespace(marginal=9.0)) == pytest.approx(0.0)
