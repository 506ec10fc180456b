"""Starts of landings: what the plan says, and which of the random numbers moves what."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import ndtri
from tests.landing.plans import single, small_model

from bayeschute.atmosphere.standard import standard_density
from bayeschute.dynamics.state import pack, unpack
from bayeschute.landing.start_plan import SIZE, StartPlan, begin, steady_speed


def test_starts_are_what_the_plan_says(plan):
    model, rng = small_model(plan.models[0]), np.random.default_rng(4)
    start = StartPlan((700.0, 0.0), swing=(0.2, 0.0), azimuth=0.5, swing_rate=(0.1, 0.0), flyout=(0.1, 0.0), tilt=0.0)
    theta = np.repeat(plan.models[0].theta[:1].T, 4, axis=1)
    x = begin(start, model, theta, rng.standard_normal((SIZE, 4)), np.zeros((3, 4)))
    state = unpack(x, 2)
    away = np.stack(
        [np.asarray(c) for c in (state.canopy_position.x, state.canopy_position.y, state.canopy_position.z)]
    )
    mean = (away - x[0:3, None]).mean(axis=1)
    np.testing.assert_allclose(np.arctan2(np.hypot(mean[0], mean[1]), -mean[2]), 0.2, atol=0.01)
    np.testing.assert_allclose(np.arctan2(mean[1], mean[0]), 0.5, atol=0.02)
    np.testing.assert_allclose(np.linalg.norm(x[6:10], axis=0), 1.0, atol=1e-12)
    np.testing.assert_array_equal(np.asarray(pack(state)), x)


def begun(one, start, u, wind=(0.0, 0.0, 0.0)):
    """Begin with the first draw: states, and by canopy the riser's direction and its rate (3, n, B)."""
    count, n = u.shape[1], one.structure.canopies
    theta = np.repeat(one.theta[:1].T, count, axis=1)
    x = begin(start, small_model(one), theta, u, np.tile(np.reshape(wind, (3, 1)), count))
    to_ned = Rotation.from_quat(x[[7, 8, 9, 6]].T)
    b = one.base.capsule.attach_b
    attach = np.array([b.x, b.y, b.z], float)
    moving = x[3:6] + to_ned.apply(np.cross(x[10:13].T, attach)).T
    along = x[13 : 13 + 3 * n].reshape(3, n, count) - (x[0:3] + to_ned.apply(attach).T)[:, None]
    length = np.linalg.norm(along, axis=0)
    return x, to_ned, along / length, (x[13 + 3 * n :].reshape(3, n, count) - moving[:, None]) / length


def test_a_canopy_leans_and_moves_as_drawn(plan):
    """One canopy: its riser leans by the angle, to the side of the azimuth, and turns in that plane and across it."""
    start = StartPlan((700.0, 20.0), swing=(0.2, 0.1), swing_rate=(0.05, 0.02), cone_rate=(-0.03, 0.01))
    u = np.zeros((SIZE, 4))
    u[0], u[1], u[2], u[3], u[4] = 1.5, [0.0, 1.0, -0.5, 2.0], ndtri([0.1, 0.3, 0.6, 0.95]), [1, 0, -1, 2], [0, 1, 2, 3]
    x, _, direction, turning = begun(single(plan.models[0]), start, u)
    swing, azimuth = 0.2 + 0.1 * u[1], 2.0 * np.pi * np.array([0.1, 0.3, 0.6, 0.95])
    c, s = np.cos(azimuth), np.sin(azimuth)
    np.testing.assert_allclose(direction[:, 0], [np.sin(swing) * c, np.sin(swing) * s, -np.cos(swing)], atol=1e-9)
    fast, across = 0.05 + 0.02 * u[3], -0.03 + 0.01 * u[4]
    want = np.stack([np.cos(swing) * c, np.cos(swing) * s, np.sin(swing)]) * fast + np.stack([-s, c, 0 * c]) * across
    np.testing.assert_allclose(turning[:, 0], want, atol=1e-9)
    np.testing.assert_allclose(-x[2], start.altitudes(u))
    assert start.altitudes(u)[0] == 730.0 and start.highest() == 820.0 and not x[0:2].any()


def test_canopies_fly_out_and_turn_about_the_axis(plan):
    """Two canopies: on opposite sides of the axis, each as far off it, both turning clockwise from above; the place is any."""
    start = StartPlan((700.0, 0.0), swing=(0.3, 0.0), azimuth=0.8, flyout=(0.1, 0.02), turn_rate=(0.05, 0.02))
    u = np.zeros((SIZE, 4))
    u[5], u[6], u[7] = ndtri([0.1, 0.35, 0.6, 0.9]), [0.0, 1.0, -1.0, -11.0], [0.0, 1.0, 2.0, -1.0]
    _, _, direction, turning = begun(plan.models[0], start, u)
    axis = np.array([np.sin(0.3) * np.cos(0.8), np.sin(0.3) * np.sin(0.8), -np.cos(0.3)])
    lean = np.array([np.cos(0.3) * np.cos(0.8), np.cos(0.3) * np.sin(0.8), np.sin(0.3)])
    aside = np.array([-np.sin(0.8), np.cos(0.8), 0.0])
    angle = np.abs(0.1 + 0.02 * u[6])
    for i in range(2):
        one, rate = direction[:, i], turning[:, i]
        np.testing.assert_allclose(axis @ one, np.cos(angle), atol=1e-12)
        np.testing.assert_allclose(np.arctan2(aside @ one, lean @ one) % (2.0 * np.pi),
                                   2.0 * np.pi * (np.array([0.1, 0.35, 0.6, 0.9]) + 0.5 * i) % (2.0 * np.pi), atol=1e-7)  # fmt: skip
        spin = -axis @ np.cross(one.T, rate.T).T / np.sin(angle) ** 2
        np.testing.assert_allclose(spin, 0.05 + 0.02 * u[7], rtol=1e-6)
        np.testing.assert_allclose((one * rate).sum(axis=0), 0.0, atol=1e-12)


def test_a_lean_that_changes_turns_no_riser_along_itself(plan):
    start = StartPlan((700.0, 0.0), swing=(0.3, 0.0), azimuth=0.0, swing_rate=(0.1, 0.0), flyout=(0.2, 0.0))
    u = np.zeros((SIZE, 4))
    u[5] = ndtri([1e-12, 0.1, 0.35, 0.6])
    _, _, direction, turning = begun(plan.models[0], start, u)
    np.testing.assert_allclose((direction * turning).sum(axis=0), 0.0, atol=1e-12)
    lean = np.array([np.cos(0.3), 0.0, np.sin(0.3)])
    np.testing.assert_allclose(np.einsum("i,inb->nb", lean, turning)[:, 0], 0.1 * np.cos(0.2) ** 2, rtol=1e-6)


def test_velocities_are_those_of_the_wind_the_steady_descent_and_the_release(plan):
    one = plan.models[0]
    start = StartPlan((700.0, 0.0), azimuth=0.8, speed=(1.2, 0.1), horizontal=(3.0, 1.0))
    u = np.zeros((SIZE, 4))
    u[8], u[9] = [0.0, 0.5, 0.0, -1.0], [0.0, 0.0, 2.0, 1.0]
    x, *_ = begun(one, start, u, (2.0, -3.0, 0.5))
    base, n = one.base, one.structure.canopies
    assert n == 2 and one.names[0].startswith("axial")
    model, theta = small_model(one), one.theta[:1].T
    axial = np.asarray(model.numbers(theta).axial[0], float).mean()
    weight = (base.capsule.mass + 2.0 * base.canopies.dry_mass) * 9.80665
    steady = np.sqrt(weight / (standard_density(700.0) * base.canopies.area * axial))
    assert float(steady_speed(model, theta, np.array([[0.0], [0.0], [-700.0]]))[0]) == pytest.approx(steady, rel=1e-6)
    push = 3.0 + u[9]
    want = [2.0 + push * np.cos(0.8), -3.0 + push * np.sin(0.8), 0.5 + (1.2 + 0.1 * u[8]) * steady]
    np.testing.assert_allclose(x[3:6], want, rtol=1e-6)


def test_a_negative_drag_has_a_speed_still(plan):
    one = plan.models[0]
    theta, place = -one.theta[:1].T, np.array([[0.0], [0.0], [-700.0]])
    model = small_model(one)
    weight = (one.base.capsule.mass + 2.0 * one.base.canopies.dry_mass) * 9.80665
    want = np.sqrt(weight / (standard_density(700.0) * one.base.canopies.area * 0.1))
    assert float(steady_speed(model, theta, place)[0]) == pytest.approx(want, rel=1e-6)


def test_the_capsule_hangs_along_the_axis_rolls_tilts_and_turns_as_drawn(plan):
    """Unrolled it is turned from upright (body x up, y east) by the shortest turn; rolls and tilts are about its axes."""
    start = StartPlan((700.0, 0.0), swing=(0.3, 0.0), azimuth=0.8, tilt=0.02, body_rate=0.1)
    u = np.zeros((SIZE, 4))
    u[10] = ndtri([1e-14, 0.25, 1e-14, 1e-14])
    u[11], u[12] = [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, -2.0]
    u[13], u[14], u[15] = [1.0, 0.0, 0.0, 2.0], [0.0, 1.0, 0.0, 1.0], [0.0, 0.0, 1.0, -1.0]
    x, to_ned, *_ = begun(plan.models[0], start, u)
    np.testing.assert_allclose(x[10:13], 0.1 * u[13:16])
    np.testing.assert_allclose(np.linalg.norm(x[6:10], axis=0), 1.0, rtol=1e-12)
    up, east, north = np.array([0.0, 0.0, -1.0]), np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])
    across = np.array([np.sin(0.8), -np.cos(0.8), 0.0])  # up x the level way of the azimuth, backwards
    bend = Rotation.from_rotvec(-0.3 * across)
    axis = np.array([np.sin(0.3) * np.cos(0.8), np.sin(0.3) * np.sin(0.8), -np.cos(0.3)])
    if not np.allclose(bend.apply(up), axis):
        bend = bend.inv()
    np.testing.assert_allclose(bend.apply(up), axis, atol=1e-12)
    frame = [to_ned.apply(e) for e in np.eye(3)]
    xb, yb, zb = bend.apply(up), bend.apply(east), bend.apply(north)
    np.testing.assert_allclose([f[0] for f in frame], [xb, yb, zb], atol=1e-9)
    np.testing.assert_allclose([f[1] for f in frame], [xb, zb, -yb], atol=1e-9)  # a quarter of a roll: y to z
    np.testing.assert_allclose(frame[0][2], np.cos(0.02) * xb - np.sin(0.02) * zb, atol=1e-5)
    np.testing.assert_allclose(frame[0][3], np.cos(0.04) * xb - np.sin(0.04) * yb, atol=1e-5)
