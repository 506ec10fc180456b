"""Differences beside a point: closed forms, and shorter steps where a function knows no value."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.posterior.differences import beside

STEP = 0.8


def _cubes(points):
    """Two functions of three numbers, known where the second is no more than a third of the step."""
    known = np.where(points[:, 1] > STEP / 3.0, np.nan, 1.0)
    return known[:, None] * np.stack([points.sum(axis=1), 2.0 + points[:, 0] ** 3], axis=1)


def test_values_lie_to_either_side_at_steps_that_are_shorter_only_where_they_must():
    asked = []

    def values(points):
        asked.append(len(points))
        return _cubes(points)

    up, down, steps = beside(values, 3, STEP, "what is asked for")
    np.testing.assert_allclose(steps[:, 0], [STEP, STEP / 4.0, STEP])
    np.testing.assert_allclose(up, np.stack([steps[:, 0], [2.0 + STEP**3, 2.0, 2.0]], axis=1))
    np.testing.assert_allclose(down, np.stack([-steps[:, 0], [2.0 - STEP**3, 2.0, 2.0]], axis=1))
    assert asked == [6, 2, 2]  # what is known is not asked for again


def test_what_is_unknown_at_an_eighth_of_the_step_is_an_error_that_says_of_what():
    def values(points):
        return np.where(points[:, :1] < -0.05, np.nan, points)

    with pytest.raises(FloatingPointError, match="beside the optimum fail: the slope is not known"):
        beside(values, 2, STEP, "the slope")
