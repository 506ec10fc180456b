"""Moments by the rates of angle of attack and sideslip (6.3.3-13) against differences of the angles along a motion."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.twins import small_cluster as small

from bayeschute.core.vectors import Vec3
from bayeschute.dynamics.cluster import Air, state_rate
from bayeschute.dynamics.state import unpack

WIND, WIND_RATE, SHEAR = np.array([2.0, -1.0, 0.5]), np.array([0.4, 0.3, -0.2]), np.array([0.02, -0.05, 0.01])
PLAIN = small.cluster()
BOTH = replace(PLAIN, capsule=replace(small.CAPSULE, pitch_rate_damping=-0.3, yaw_rate_damping=-0.5))


def air_at(t, altitude):
    """Wind that changes with time and altitude."""
    wind = WIND + WIND_RATE * t + SHEAR * altitude
    return Air(Vec3(*wind), Vec3(*jnp.asarray(WIND_RATE)), 1.1, 1.0, Vec3(*jnp.asarray(SHEAR)))


@jax.jit
def rate(x, model, t):
    return state_rate(x, model, small.TWO, air_at(t, -x[2]))


def angles(x, t):
    """Angle of attack and of sideslip of the capsule (6.3.3-10)."""
    state = unpack(jnp.asarray(x), 2)
    v = state.attitude.to_body(state.velocity - air_at(t, -x[2]).wind).stack()
    v = np.asarray(v)
    return np.array([np.arctan2(v[2], v[0]), np.arcsin(v[1] / np.linalg.norm(v))]), np.linalg.norm(v)


@pytest.mark.parametrize("seed", range(4))
def test_moments_are_the_rates_of_the_angles(seed):
    rng = np.random.default_rng(seed)
    start = small.start([[0.2, -0.1], [0.1, 0.15], [-1.0, -1.0]])
    flight = small.flight(PLAIN, start)
    x = np.array(flight.initial(PLAIN, jnp.zeros(17)))
    x[3:6] += rng.normal(size=3) * 3.0
    x[6:10] += 0.3 * rng.normal(size=4)
    x[6:10] /= np.linalg.norm(x[6:10])
    x[10:13] = 0.3 * rng.normal(size=3)
    plain = np.asarray(rate(jnp.asarray(x), PLAIN, 0.0))
    change = np.asarray(rate(jnp.asarray(x), BOTH, 0.0)) - plain
    h = 1e-5
    (ahead, _), (behind, _), (_, speed) = angles(x + h * plain, h), angles(x - h * plain, -h), angles(x, 0.0)
    alpha_rate, beta_rate = (ahead - behind) / (2.0 * h)
    scale = 0.5 * 1.1 * speed**2 * small.CAPSULE.area * small.CAPSULE.length**2 / (2.0 * speed)
    want = np.zeros_like(x)
    want[11] = -0.3 * alpha_rate * scale / small.CAPSULE.inertia.y
    want[12] = -0.5 * beta_rate * scale / small.CAPSULE.inertia.z
    np.testing.assert_allclose(change, want, rtol=1e-6, atol=1e-8)
    assert abs(want[11]) > 1e-4 and abs(want[12]) > 1e-4


def test_yaw_damping_replaces_the_pitch_s():
    x = np.array(
        small.flight(PLAIN, small.start([[0.1, -0.1], [0.0, 0.0], [-1.0, -1.0]])).initial(PLAIN, jnp.zeros(17))
    )
    x[10:13] = 0.0, 0.0, 0.4
    other = replace(PLAIN, capsule=replace(small.CAPSULE, yaw_damping=-0.7))
    same = replace(PLAIN, capsule=replace(small.CAPSULE, yaw_damping=small.CAPSULE.pitch_damping))
    plain = np.asarray(rate(jnp.asarray(x), PLAIN, 0.0))
    np.testing.assert_allclose(rate(jnp.asarray(x), same, 0.0), plain, atol=1e-14)
    change = np.asarray(rate(jnp.asarray(x), other, 0.0)) - plain
    speed = angles(x, 0.0)[1]
    moment = (
        (-0.7 - small.CAPSULE.pitch_damping) * 0.4 * 0.25 * 1.1 * speed * small.CAPSULE.area * small.CAPSULE.length**2
    )
    assert change[12] == pytest.approx(moment / small.CAPSULE.inertia.z, rel=1e-9)
    assert np.abs(np.delete(change, 12)).max() < 1e-12
