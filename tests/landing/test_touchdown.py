"""Measures at touchdown of a state put together by hand, against vectors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.landing.plans import small_model

from bayeschute.atmosphere.standard import SEA_LEVEL_DENSITY, standard_density
from bayeschute.landing.touchdown import at_ground

ALTITUDE, VELOCITY = 302.0, np.array([3.0, -4.0, 9.0])
TILT = (0.2, 0.7)  # of the body's x axis off the vertical and its azimuth


@pytest.fixture(scope="module")
def touched(plan):
    """Two landings, the second turned by a quarter about the vertical: measures, attitude, directions of the risers."""
    one = plan.models[0]
    model = small_model(replace(one, base=replace(one.base, risers=replace(one.base.risers, damping=0.0))))
    lean, azimuth = TILT
    turn = Rotation.from_rotvec(lean * np.array([-np.sin(azimuth), np.cos(azimuth), 0.0]))
    if turn.apply([0.0, 0.0, -1.0])[0] < 0.0:
        turn = turn.inv()
    attitude = turn * Rotation.from_quat([0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)]) * Rotation.from_rotvec([0.4, 0.0, 0.0])
    b, length = one.base.capsule.attach_b, float(one.base.risers.length)
    ways = np.array([[0.3, 0.1, -1.0], [0.0, -0.2, -1.0]])
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    stretch = np.array([0.9, 0.4])
    x = np.zeros((25, 2))
    for k in range(2):
        about = Rotation.from_rotvec([0.0, 0.0, 0.5 * np.pi * k])
        here = about * attitude
        x[0:3, k], x[3:6, k] = [70.0, -20.0, -ALTITUDE], about.apply(VELOCITY)
        x[6:10, k] = here.as_quat()[[3, 0, 1, 2]]
        attach = x[0:3, k] + here.apply([float(b.x), float(b.y), float(b.z)])
        x[13:19, k] = (attach + about.apply(ways) * (length + stretch)[:, None]).T.ravel()
        x[19:25, k] = np.repeat(x[3:6, k], 2)
    made = at_ground(model, np.repeat(one.theta[:1].T, 2, axis=1), x)
    return made, attitude, ways, stretch * float(one.base.risers.stiffness), length + stretch


def test_speeds_and_drift(touched):
    made = touched[0]
    np.testing.assert_allclose(made["vertical_speed"], 9.0)
    np.testing.assert_allclose(made["horizontal_speed"], 5.0)
    ratio = np.sqrt(standard_density(ALTITUDE) / SEA_LEVEL_DENSITY)
    np.testing.assert_allclose(made["sea_level_vertical_speed"], 9.0 * ratio, rtol=1e-6)
    np.testing.assert_allclose(made["drift_north"], 70.0)
    np.testing.assert_allclose(made["drift_east"], -20.0)


def test_angles_of_the_capsule_and_its_velocity_in_body_axes(touched):
    made, attitude, *_ = touched
    body = attitude.inv().apply(VELOCITY)
    for axis, value in zip("xyz", body, strict=True):
        np.testing.assert_allclose(made[f"velocity_{axis}"], value, rtol=1e-10)
    up = attitude.apply([1.0, 0.0, 0.0])
    assert np.arctan2(up[1], up[0]) == pytest.approx(TILT[1])
    np.testing.assert_allclose(made["hang_angle"], TILT[0], rtol=1e-10)
    np.testing.assert_allclose(made["incidence"], np.arccos(-body[0] / np.linalg.norm(body)), rtol=1e-10)
    np.testing.assert_allclose(made["incidence_direction"], np.arctan2(body[1], body[2]), rtol=1e-10)


def test_tensions_are_of_the_springs(touched):
    made, _, _, pull, _ = touched
    np.testing.assert_allclose(made["riser_tension"], pull.max(), rtol=1e-9)
    np.testing.assert_allclose(made["riser_tension_sum"], pull.sum(), rtol=1e-9)


def test_angles_of_the_cluster(touched):
    made, _, ways, _, length = touched
    mean = (ways * length[:, None]).sum(axis=0)
    np.testing.assert_allclose(made["swing_angle"], np.arctan2(np.hypot(*mean[:2]), -mean[2]), rtol=1e-9)
    np.testing.assert_allclose(made["flyout_angle"], 0.5 * np.arccos(ways[0] @ ways[1]), rtol=1e-9)


def test_values_are_plain_arrays_a_landing_each(touched):
    assert all(type(v) is np.ndarray and v.shape == (2,) for v in touched[0].values())
