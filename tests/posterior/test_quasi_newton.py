"""Secant steps: a quadratic whose matrix they are not told, slopes that hardly fall, and lengths."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.posterior.quasi_newton import length, secant_step


def test_bent_steps_find_the_least_of_a_quadratic_whose_matrix_they_are_not_told():
    rng = np.random.default_rng(1)
    root = rng.standard_normal((4, 4))
    matrix, least, at = root @ root.T + 0.5 * np.eye(4), rng.standard_normal(4), np.zeros(4)
    bends, last = [], None
    for _ in range(40):
        slope = matrix @ (at - least)
        if np.linalg.norm(slope) < 1e-6:
            break
        if last is not None:
            bends.append((at - last[0], slope - last[1]))
        last = at, slope
        at = at + secant_step(slope, np.eye(4), bends)
    np.testing.assert_allclose(at, least, atol=1e-5)


@pytest.mark.parametrize(("curvature", "expected"), [(-1.0, -2.0), (0.0, -1.5), (0.05, -1.425), (0.5, -0.3)])
def test_where_the_slope_hardly_falls_bent_steps_are_long_but_not_too_long(curvature, expected):
    """Gauss-Newton expects a curvature of 1; the slope was 0.3 before a step of -0.3."""
    before = np.array([-0.3])
    made = secant_step(np.array([0.3]) + curvature * before, np.eye(1), [(before, curvature * before)])
    assert made[0] == pytest.approx(expected)


def test_without_earlier_steps_it_is_gauss_newton_s():
    rng = np.random.default_rng(2)
    root, slope = rng.standard_normal((3, 3)), rng.standard_normal(3)
    covariance = root @ root.T + np.eye(3)
    np.testing.assert_allclose(secant_step(slope, covariance, []), -covariance @ slope, rtol=1e-12)


def test_what_the_slope_did_is_what_it_will_do():
    """The secant condition: a change of the slope that a step has made asks for that step back, whatever the rest."""
    rng = np.random.default_rng(3)
    root, step = rng.standard_normal((4, 4)), rng.standard_normal(4)
    covariance = root @ root.T + np.eye(4)
    change = 1.7 * np.linalg.solve(covariance, step) + 0.01 * rng.standard_normal(4)
    np.testing.assert_allclose(secant_step(change, covariance, [(step, change)]), -step, rtol=1e-9)


def test_length_is_in_standard_deviations():
    covariance = np.array([[4.0, 1.0], [1.0, 9.0]])
    step = np.array([2.0, -3.0])
    assert length(step, covariance) == pytest.approx(np.sqrt(step @ np.linalg.solve(covariance, step)))
    assert length(np.array([2.0, 0.0]), np.diag([4.0, 9.0])) == pytest.approx(1.0)
