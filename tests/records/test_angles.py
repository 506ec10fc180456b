"""Airflow, proximity and cluster angles against closed forms and numeric derivatives."""

import numpy as np
import pytest

from bayeschute.records.angles import (
    across,
    airflow,
    canopy_axes,
    dot,
    flyout_angle,
    proximity,
    swing_angle,
    unit,
    wind_axes,
)

DOWN = np.array([0.0, 0.0, 1.0])
STEP = 1e-4
T = np.arange(0.0, 1.0, STEP)


def one(*components):
    return np.array(components, dtype=float).reshape(1, 1, 3)


def moving():
    """A velocity and an axis that both turn, with exact rates (T, 1, 3)."""
    v = np.stack([2 + np.sin(2 * T), 1.5 * np.cos(3 * T), 9 + np.sin(T)], -1)[:, None]
    dv = np.stack([2 * np.cos(2 * T), -4.5 * np.sin(3 * T), np.cos(T)], -1)[:, None]
    a = np.stack([0.2 * np.sin(T), 0.1 * np.cos(2 * T), np.ones_like(T)], -1)[:, None]
    da = np.stack([0.2 * np.cos(T), -0.2 * np.sin(2 * T), np.zeros_like(T)], -1)[:, None]
    x = unit(a)
    return v, dv, x, across(da, x) / np.linalg.norm(a, axis=-1, keepdims=True)


def test_axes_are_right_handed_and_y_points_east():
    x = unit(np.random.default_rng(0).standard_normal((50, 2, 3)))
    y, z = canopy_axes(x)
    np.testing.assert_allclose(np.cross(x, y), z, atol=1e-12)
    np.testing.assert_allclose(dot(y, y), 1.0)
    assert (y[..., 1] > 0).all()
    y, z = canopy_axes(one(0, 0, 1))
    np.testing.assert_allclose(y.ravel(), [0, 1, 0])
    np.testing.assert_allclose(z.ravel(), [-1, 0, 0])


def test_angles_of_a_known_flow():
    still = one(0, 0, 0)
    flow = airflow(one(0, np.sin(0.2), np.cos(0.2)) * 10, still, one(0, 0, 1), still)
    assert flow.alpha_T.item() == pytest.approx(0.2)
    assert flow.beta.item() == pytest.approx(0.2)
    assert flow.alpha.item() == pytest.approx(0.0)
    assert flow.phi_a.item() == pytest.approx(np.pi / 2)


def test_angles_obey_their_identities():
    rng = np.random.default_rng(1)
    v, x = rng.standard_normal((100, 2, 3)) + 3 * DOWN, unit(rng.standard_normal((100, 2, 3)) * 0.3 + DOWN)
    flow = airflow(v, 0 * v, x, 0 * x)
    np.testing.assert_allclose(np.cos(flow.alpha_T), np.cos(flow.alpha) * np.cos(flow.beta))  # 6.3.3-10b
    np.testing.assert_allclose(np.tan(flow.phi_a), np.tan(flow.beta) / np.sin(flow.alpha), rtol=1e-6)  # 6.3.3-10a


def test_rates_are_the_derivatives_of_the_angles_about_a_fixed_axis():
    v, dv, _, _ = moving()
    x = np.broadcast_to(unit(one(0.1, -0.2, 1.0)), v.shape)
    flow = airflow(v, dv, x, np.zeros_like(v))
    for name in ("beta", "alpha", "alpha_T"):
        numeric = np.gradient(getattr(flow, name)[:, 0], STEP)
        np.testing.assert_allclose(getattr(flow, f"{name}_rate")[1:-1, 0], numeric[1:-1], atol=1e-5)
    numeric = np.gradient(np.unwrap(flow.phi_a[:, 0]), STEP)
    np.testing.assert_allclose(flow.phi_a_rate[1:-1, 0], numeric[1:-1], atol=1e-4)


def test_rates_are_the_components_of_the_transverse_rate():
    """PHYSICS 3: r = P w_dot - cos(alpha_T) x_dot has cos(a) a_dot along k and sin(a) phi_dot along j."""
    v, dv, x, dx = moving()
    flow = airflow(v, dv, x, dx)
    np.testing.assert_allclose(flow.alpha_T_rate[1:-1, 0], np.gradient(flow.alpha_T[:, 0], STEP)[1:-1], atol=1e-5)
    w = unit(v)
    r = across(across(dv, w) / np.linalg.norm(v, axis=-1, keepdims=True), x) - np.cos(flow.alpha_T)[..., None] * dx
    j, k = wind_axes(v, x)
    np.testing.assert_allclose(dot(r, k), np.cos(flow.alpha_T) * flow.alpha_T_rate, atol=1e-9)
    np.testing.assert_allclose(dot(r, j), np.sin(flow.alpha_T) * flow.phi_a_rate, atol=1e-9)


def test_j_is_k_cross_x():
    v, _, x, _ = moving()
    j, k = wind_axes(v, x)
    np.testing.assert_allclose(np.cross(k, x), j, atol=1e-12)
    np.testing.assert_allclose(dot(k, v), np.linalg.norm(across(v, x), axis=-1))


def test_flow_along_the_axis_has_no_azimuth_but_an_angle_and_its_rate():
    flow = airflow(one(0, 0, 10), one(1, 0, 0), one(0, 0, 1), one(0, 0, 0))
    assert flow.alpha_T.item() == 0.0
    assert flow.alpha_T_rate.item() == pytest.approx(0.1)
    assert np.isnan(flow.phi_a.item()) and np.isnan(flow.phi_a_rate.item())


def test_proximity_of_two_canopies():
    position = np.array([[[0, 20.0, 0], [0, -10.0, 0]]])
    velocity = np.array([[[0, 1.0, 0], [0, -2.0, 0]]])
    air = np.broadcast_to([0, 1.0, 10.0], (1, 2, 3))
    near = proximity(position, velocity, air, np.broadcast_to(DOWN, (1, 2, 3)), 40.0)
    np.testing.assert_allclose(near.distance, 0.75)
    np.testing.assert_allclose(near.closing, 3.0 / 40.0)
    np.testing.assert_allclose(near.angle[0], [0.0, np.pi], atol=1e-12)


def test_proximity_takes_the_nearest_of_three_and_none_of_one():
    position = np.array([[[0, 0.0, 0], [0, 10.0, 0], [0, 14.0, 0]]])
    x = np.broadcast_to(DOWN, (1, 3, 3))
    near = proximity(position, 0 * position, 0 * position + [0.1, 0, 5], x, 1.0)
    np.testing.assert_allclose(near.distance, [[10, 4, 4]])
    assert np.isnan(proximity(position[:, :1], 0 * position[:, :1], x[:, :1], x[:, :1], 1.0).distance).all()


def test_proximity_is_missing_where_a_position_is():
    position = np.array([[[0, 0.0, 0], [np.nan, 10.0, 0]]])
    near = proximity(position, 0 * position, 0 * position, np.broadcast_to(DOWN, (1, 2, 3)), 1.0)
    assert np.isnan(near.distance).all()


@pytest.mark.parametrize("n", [1, 2, 3])
def test_swing_and_flyout_of_a_regular_cluster(n):
    swing, flyout = 0.3, 0.15 if n > 1 else 0.0
    turn = 2 * np.pi * np.arange(n) / n
    risers = np.stack([np.sin(flyout) * np.cos(turn), np.sin(flyout) * np.sin(turn), -np.cos(flyout) + 0 * turn], -1)
    c, s = np.cos(swing), np.sin(swing)
    risers = 70 * (risers @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]))[None]
    assert swing_angle(risers).item() == pytest.approx(swing)
    half = {1: 0.0, 2: flyout, 3: np.arcsin(np.sin(flyout) * np.sqrt(3) / 2)}[n]
    assert flyout_angle(risers).item() == pytest.approx(half)


def test_flyout_of_coincident_canopies_is_zero_to_rounding():
    risers = np.broadcast_to([3.0, 1.0, -70.0], (4, 2, 3))
    assert flyout_angle(risers).max() < 1e-15
