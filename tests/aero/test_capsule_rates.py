"""Rates of angle of attack and sideslip against differences of the angles; finite where they are undefined."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.aero.capsule_rates import angle_rates
from bayeschute.core.vectors import Vec3


@pytest.mark.parametrize("seed", range(5))
def test_rates_are_differences_of_the_angles(seed):
    rng = np.random.default_rng(seed)
    u = rng.normal(size=3) * (1.0, 0.5, 1.0)
    u /= np.linalg.norm(u)
    assert np.hypot(u[0], u[2]) > np.cos(np.deg2rad(80.0))
    turning = np.cross(rng.normal(size=3), u)

    def angles(t):
        v = u + t * turning
        v /= np.linalg.norm(v)
        return np.array([np.arctan2(v[2], v[0]), np.arcsin(v[1])])

    want = (angles(1e-6) - angles(-1e-6)) / 2e-6
    np.testing.assert_allclose(angle_rates(Vec3(*u), Vec3(*turning)), want, rtol=1e-7, atol=1e-8)


def test_rates_stay_finite_in_flow_along_the_body_s_y_axis():
    got = angle_rates(Vec3(0.0, 1.0, 0.0), Vec3(1.0, 0.0, 2.0))
    assert np.isfinite(got).all()
