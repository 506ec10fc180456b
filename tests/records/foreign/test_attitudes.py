"""Quaternions against rotation matrices written out, and rates of attitudes that turn steadily."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bayeschute.records.foreign.attitudes import in_schema, of_euler, of_matrix, product, rate_of_attitude
from bayeschute.records.foreign.conventions import Conventions


def some(count, seed=0):
    q = np.random.default_rng(seed).standard_normal((count, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def matrix(q):
    w, x, y, z = np.moveaxis(q, -1, 0)
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def test_products_are_those_of_matrices():
    a, b, c = some(20, 1), some(20, 2), some(20, 3)
    np.testing.assert_allclose(matrix(product(a, b)), matrix(a) @ matrix(b), atol=1e-14)
    np.testing.assert_allclose(product(product(a, b), c), product(a, product(b, c)), atol=1e-14)
    np.testing.assert_allclose(product(a, a * [1, -1, -1, -1]), np.tile([1.0, 0, 0, 0], (20, 1)), atol=1e-14)
    np.testing.assert_allclose(product(3.0 * a, b[0]), 3.0 * product(a, np.tile(b[0], (20, 1))), atol=1e-14)


def test_a_matrix_has_its_quaternion_half_turns_too():
    for q in np.concatenate([some(30, 4), np.eye(4)]):
        made = of_matrix(matrix(q))
        assert made[0] >= 0.0 and abs(made @ q) == pytest.approx(1.0, abs=1e-14)
        np.testing.assert_allclose(matrix(made), matrix(q), atol=1e-14)


def test_angles_in_their_usual_order():
    yaw, pitch, roll = np.random.default_rng(5).uniform(-1.4, 1.4, (3, 20))
    wanted = Rotation.from_euler("ZYX", np.stack([yaw, pitch, roll], axis=1)).as_matrix()
    np.testing.assert_allclose(matrix(of_euler(yaw, pitch, roll)), wanted, atol=1e-14)


@pytest.mark.parametrize("axes", ["NED", "ENU", "SWD"])
@pytest.mark.parametrize("body", ["x y z", "-z y x"])
@pytest.mark.parametrize("sense", ["body to earth", "earth to body"])
def test_into_the_schema_as_matrices_go(axes, body, sense):
    said, q = Conventions(axes, body, sense), some(12, 6)
    theirs = np.swapaxes(matrix(q), 1, 2) if sense == "earth to body" else matrix(q)
    np.testing.assert_allclose(matrix(in_schema(q, said)), said.earth() @ theirs @ said.body().T, atol=1e-14)


def test_into_the_schema_without_jumps_gaps_left():
    time = 0.1 * np.arange(80)[:, None]
    q = np.hstack([np.cos(time), np.sin(time), 0.0 * time, 0.0 * time])
    mixed = q * np.random.default_rng(7).choice([-1.0, 1.0], (80, 1))
    mixed[[5, 30, 31]] = np.nan
    made = in_schema(mixed, Conventions())
    assert np.flatnonzero(np.isnan(made).any(axis=1)).tolist() == [5, 30, 31]
    np.testing.assert_allclose(np.delete(made, [5, 30, 31], axis=0), np.sign(made[0, 0]) * np.delete(q, [5, 30, 31], axis=0), atol=1e-14)  # fmt: skip


@pytest.mark.parametrize("rate", [(0.3, 0.0, 0.0), (-0.1, 0.25, 0.4)])
def test_a_steady_turn_has_its_rate_about_body_axes(rate):
    """After q(t) = q(0) exp(w t/2), whatever q(0); clock uneven; NaN where the attitude is missing, and there alone."""
    rng = np.random.default_rng(8)
    time = np.cumsum(rng.uniform(0.045, 0.055, 200))
    first, size = some(1, 9)[0], np.linalg.norm(rate)
    half = 0.5 * size * time[:, None]
    q = product(first, np.hstack([np.cos(half), np.sin(half) * np.array(rate) / size]))
    q[[50, 51, 120]] = np.nan
    found = rate_of_attitude(time, q)
    gone = np.isnan(found).any(axis=1)
    assert np.flatnonzero(gone).tolist() == [50, 51, 120]
    np.testing.assert_allclose(found[~gone], np.tile(rate, (197, 1)), atol=5e-3)
    assert np.isnan(rate_of_attitude(time[:9], q[:9])).all()


def test_a_longer_window_takes_more_noise_off():
    rng, time = np.random.default_rng(10), 0.05 * np.arange(400)
    q = np.hstack([np.ones((400, 1)), 1e-3 * rng.standard_normal((400, 3))])
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    short, long = (rate_of_attitude(time, q, length)[60:-60].std() for length in (0.5, 2.0))
    assert short / long == pytest.approx(4.0**1.5, rel=0.35)  # the deviation of a line's slope goes as n^-3/2
