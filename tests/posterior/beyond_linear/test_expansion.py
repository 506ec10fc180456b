"""Steps to the least value of a quadratic polynomial, against a search of the whole disc."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.posterior.beyond_linear.expansion import Expansion


@pytest.mark.parametrize(
    ("slope", "curvature"),
    [
        ([0.3, -0.2], [[1.2, 0.4], [0.4, 0.7]]),  # its mode is near
        ([30.0, -20.0], [[1.2, 0.4], [0.4, 0.7]]),  # far
        ([0.3, -0.2], [[1.0, 2.0], [2.0, 1.0]]),  # none
        ([0.3, 0.3], [[1.0, 2.0], [2.0, 1.0]]),  # none, and no slope where it falls
        ([0.0, 0.0], [[1.0, 0.0], [0.0, -0.1]]),
        ([0.2, 0.0], [[0.0, 0.0], [0.0, 1.0]]),  # neither rises nor falls: straight
    ],
)
def test_the_way_ahead_is_to_the_least_value_within_three(slope, curvature):
    slope, curvature = np.array(slope), np.array(curvature)
    about = Expansion(slope, curvature)
    step = about.step()
    radius, angle = np.meshgrid(np.linspace(0.0, 3.0, 301), np.linspace(0.0, 2.0 * np.pi, 721))
    grid = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
    value = grid @ slope + 0.5 * np.einsum("...i,ij,...j->...", grid, curvature, grid)
    ours = step @ slope + 0.5 * step @ curvature @ step
    assert np.linalg.norm(step) <= 3.0 + 1e-6 and ours <= value.min() + 1e-6
    assert about.has_mode == (np.linalg.eigvalsh(curvature)[0] > 0.0)
    if about.has_mode and np.linalg.norm(step) < 2.9:
        np.testing.assert_allclose(step, -np.linalg.solve(curvature, slope))
