"""Tension of a riser against its formula, and its derivative against differences of that."""

from __future__ import annotations

import jax
import numpy as np
import pytest

from bayeschute.dynamics.riser import riser_tension, taut_share

STIFFNESS, DAMPING, ENGAGEMENT = 4e4, 900.0, 0.05


def naive(s, rate, k=STIFFNESS, c=DAMPING, d=ENGAGEMENT):
    force = k * s + c * rate
    if s <= 0.0 or force <= 0.0:
        return 0.0
    x = min(s / d, 1.0)
    return (3.0 * x**2 - 2.0 * x**3) * force


CASES = [(-0.2, 1.0), (-1e-3, 5.0), (0.01, 0.0), (0.01, 2.0), (0.03, -3.0), (0.03, -0.5), (0.049, 1.0), (0.2, -9.5), (0.2, 0.3)]  # fmt: skip


@pytest.mark.parametrize(("s", "rate"), CASES)
def test_tension_and_its_derivative(s, rate):
    point = (s, rate, STIFFNESS, DAMPING, ENGAGEMENT)
    assert riser_tension(*point) == pytest.approx(naive(*point))
    slope = jax.grad(riser_tension, argnums=(0, 1, 2, 3, 4))(*point)
    for i, size in enumerate((1e-6, 1e-6, 1e-2, 1e-4, 1e-7)):
        up, down = (naive(*(v + sign * size * (i == j) for j, v in enumerate(point))) for sign in (1.0, -1.0))
        assert slope[i] == pytest.approx((up - down) / (2.0 * size), rel=1e-5, abs=1e-3), i


def test_many_at_once_are_each_their_own():
    s, rate = np.array(CASES).T
    made = riser_tension(s, rate, STIFFNESS, DAMPING, ENGAGEMENT)
    np.testing.assert_allclose(made, [naive(*case) for case in CASES])
    assert (np.asarray(made) >= 0.0).all()


def test_lines_come_taut_smoothly_from_none_to_all():
    x = np.array([-1.0, 0.0, 0.25, 0.5, 0.75, 1.0, 3.0]) * ENGAGEMENT
    np.testing.assert_allclose(taut_share(x, ENGAGEMENT), [0.0, 0.0, 0.15625, 0.5, 0.84375, 1.0, 1.0])
    assert taut_share(ENGAGEMENT, ENGAGEMENT) == 1.0
    for end in (0.0, ENGAGEMENT):  # no kink at either end
        before, at, after = taut_share(end + 1e-5 * ENGAGEMENT * np.array([-1.0, 0.0, 1.0]), ENGAGEMENT)
        assert abs(before - at) < 1e-9 and abs(after - at) < 1e-9


def test_where_a_riser_comes_taut_its_rate_pulls_no_jump():
    made = riser_tension(np.array([0.0, 1e-7]), 5.0, STIFFNESS, DAMPING, ENGAGEMENT)
    assert made[0] == 0.0 and 0.0 <= made[1] < 1e-4
    assert jax.grad(riser_tension)(0.0, 5.0, STIFFNESS, DAMPING, ENGAGEMENT) == 0.0


def test_beyond_the_engagement_it_is_a_spring_with_a_damper():
    s = np.linspace(ENGAGEMENT, 1.0, 9)
    np.testing.assert_allclose(riser_tension(s, 0.4, STIFFNESS, DAMPING, ENGAGEMENT), STIFFNESS * s + DAMPING * 0.4)
