"""Tables of a capsule meet their own values, turn with the body and stay smooth on the axis."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.aero.capsule_grid import COEFFICIENTS
from bayeschute.aero.capsule_table import capsule_table, table_coefficients
from bayeschute.core.errors import InputError
from bayeschute.core.vectors import Vec3

ANGLE, ROLL = np.deg2rad(np.arange(0.0, 181.0, 15.0)), np.deg2rad(np.arange(0.0, 360.0, 45.0))


def along(angle, roll):
    """Direction of the airflow in the body: v/V = sin a sin phi, w/V = sin a cos phi (6.3.3-10)."""
    return Vec3(*(jnp.asarray(c) for c in (np.cos(angle), np.sin(angle) * np.sin(roll), np.sin(angle) * np.cos(roll))))


def grid(seed):
    """Random coefficients of one value on the axis."""
    bump = np.sin(ANGLE)[:, None] * np.random.default_rng(seed).normal(size=(ANGLE.size, ROLL.size))
    return np.cos(ANGLE)[:, None] + np.where(np.abs(bump) < 1e-9, 0.0, bump)


def test_a_table_meets_its_values():
    given = {name: grid(i) for i, name in enumerate(COEFFICIENTS)}
    table = capsule_table(ANGLE, ROLL, given)
    inside = ANGLE[1:-1]
    got = table_coefficients(table, along(inside[:, None], ROLL[None, :]))
    for name, values in zip(COEFFICIENTS, got, strict=True):
        np.testing.assert_allclose(values, given[name][1:-1], atol=1e-10, err_msg=name)


def test_coefficients_that_are_not_given_are_zero():
    got = table_coefficients(capsule_table(ANGLE, ROLL, {"C_m": grid(0)}), along(0.7, 0.3))
    assert [float(value) == 0.0 for value in got] == [name != "C_m" for name in COEFFICIENTS]


def test_a_body_of_revolution_turns_its_force_with_the_roll():
    """The force across the axis lies in the plane of the airflow, whatever the roll; axial force and size don't change."""
    given = {"C_A": np.cos(ANGLE)[:, None], "C_N": np.sin(ANGLE)[:, None], "C_m": -0.1 * np.sin(2.0 * ANGLE)[:, None]}
    given = {name: np.where(np.abs(values) < 1e-12, 0.0, values) for name, values in given.items()}
    table = capsule_table(ANGLE, np.zeros(1), given)
    roll = np.random.default_rng(0).uniform(0.0, 2.0 * np.pi, 50)
    for angle in np.deg2rad([15.0, 75.0, 150.0]):
        C_A, C_Y, C_N, C_l, C_m, C_n = map(np.asarray, table_coefficients(table, along(angle, roll)))
        np.testing.assert_allclose(C_A, np.cos(angle), atol=1e-10)
        np.testing.assert_allclose(C_N, np.sin(angle) * np.cos(roll), atol=1e-10)
        np.testing.assert_allclose(C_Y, -np.sin(angle) * np.sin(roll), atol=1e-10)
        np.testing.assert_allclose(C_m, -0.1 * np.sin(2.0 * angle) * np.cos(roll), atol=1e-10)
        np.testing.assert_allclose(C_n, 0.1 * np.sin(2.0 * angle) * np.sin(roll), atol=1e-10)
        assert np.abs(C_l).max() == 0.0


def test_splines_come_close_to_a_smooth_body_between_the_angles():
    table = capsule_table(ANGLE, ROLL, {"C_A": np.cos(ANGLE)[:, None] + 0.2 * np.outer(np.sin(ANGLE), np.cos(ROLL))})
    angle, roll = np.random.default_rng(1).uniform(0.0, np.pi, 200), np.random.default_rng(2).uniform(0.0, 6.2, 200)
    got = table_coefficients(table, along(angle, roll))[0]
    np.testing.assert_allclose(got, np.cos(angle) + 0.2 * np.sin(angle) * np.cos(roll), atol=1e-4)


@pytest.mark.parametrize("axis", [1.0, -1.0])
def test_gradients_are_finite_and_continuous_on_the_axis(axis):
    table = capsule_table(ANGLE, ROLL, {name: grid(i) for i, name in enumerate(COEFFICIENTS)})
    slopes = jax.jacfwd(lambda v: jnp.stack(table_coefficients(table, Vec3(v[0], v[1], v[2]))))
    there = slopes(jnp.array([axis, 0.0, 0.0]))
    assert np.isfinite(there).all()
    near = slopes(jnp.array([axis, 1e-8, -1e-8]))
    np.testing.assert_allclose(there[:, 1:], near[:, 1:], atol=1e-4 * np.abs(there).max() + 1e-6)


def test_a_faulty_table_is_refused():
    with pytest.raises(InputError, match="angles that increase"):
        capsule_table(ANGLE[::-1], ROLL, {"C_A": grid(0)})
