"""Angles, rates and neighbours without a singular axis."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.aero.airflow import axis_rate, neighbours, riser_rate, squared_angle, wind_direction_rate
from bayeschute.core.vectors import dot, vec3


@pytest.mark.parametrize("angle", [0.0, 1e-9, 5e-5, 9.9e-5, 1.01e-4, 0.3, 1.5707, 2.5, 3.1])
def test_squared_angle(angle):
    got = squared_angle(jnp.sin(angle) ** 2, jnp.cos(angle))
    assert float(got) == pytest.approx(angle**2, rel=1e-9)


def test_squared_angle_of_air_from_behind():
    assert float(squared_angle(jnp.array(0.0), jnp.array(-1.0))) == pytest.approx(np.pi**2, rel=1e-4)


def test_squared_angle_has_a_finite_gradient_everywhere():
    slope = jax.vmap(jax.grad(lambda a: squared_angle(jnp.sin(a) ** 2, jnp.cos(a))))
    angles = jnp.array([0.0, 1e-6, 9e-5, 1.1e-4, 0.4, 2.0])
    np.testing.assert_allclose(slope(angles), 2 * angles, rtol=1e-6, atol=1e-12)
    assert np.isfinite(slope(jnp.array([np.pi])))


def test_rates_are_derivatives_of_directions():
    rng = np.random.default_rng(1)
    line, velocity = rng.normal(size=(2, 3)) * 10.0
    wind, acceleration = rng.normal(size=(2, 3)) * 5.0

    def unit(v):
        return v / jnp.linalg.norm(v)

    _, x_dot = jax.jvp(lambda r: -unit(r), (line,), (velocity,))
    length = np.linalg.norm(line)
    np.testing.assert_allclose(axis_rate(vec3(line / length), vec3(velocity), length).stack(), x_dot, rtol=1e-12)
    w, w_dot = jax.jvp(unit, (wind,), (acceleration,))
    speed = np.linalg.norm(wind)
    np.testing.assert_allclose(wind_direction_rate(vec3(w), vec3(acceleration), speed).stack(), w_dot, rtol=1e-12)


def test_transverse_rate_has_the_components_of_the_report():
    """cos(alpha) alpha_dot along k and sin(alpha) phi_dot along j, of the wind as seen from a moving riser."""
    alpha, phi, alpha_dot, phi_dot = 0.4, 0.7, 0.13, -0.21
    axis = np.array([0.0, 0.0, 1.0])

    def wind(a, p):
        return jnp.array([jnp.sin(a) * jnp.cos(p), jnp.sin(a) * jnp.sin(p), jnp.cos(a)])

    w, w_dot = jax.jvp(wind, (alpha, phi), (alpha_dot, phi_dot))
    k = np.array([np.cos(phi), np.sin(phi), 0.0])
    j = np.cross(k, axis)
    x_dot = np.array([0.3, -0.2, 0.0])
    r = np.asarray(w_dot) * [1, 1, 0] + np.asarray(riser_rate(vec3(axis), vec3(x_dot), w[2]).stack())
    # Along k the sine of the angle changes with both motions, as d(e)/dt in axes that move with the riser.
    assert (r + np.cos(alpha) * x_dot) @ k == pytest.approx(np.cos(alpha) * alpha_dot)
    assert abs((r + np.cos(alpha) * x_dot) @ j) == pytest.approx(abs(np.sin(alpha) * phi_dot))


def test_every_canopy_sees_every_other_once():
    rng = np.random.default_rng(2)
    n, length = 3, 35.0
    r, v = rng.normal(size=(2, 3, n)) * 20.0
    axis = rng.normal(size=(3, n))
    axis /= np.linalg.norm(axis, axis=0)
    seen = neighbours(vec3(r), vec3(v), vec3(axis), length, n)
    assert len(seen) == n - 1
    for i in range(n):
        distance = sorted(np.linalg.norm(r[:, i] - r[:, j]) / length for j in range(n) if j != i)
        np.testing.assert_allclose(sorted(float(s.distance[i]) for s in seen), distance)
    for shift, s in enumerate(seen, start=1):
        apart, opening = r - np.roll(r, shift, axis=1), v - np.roll(v, shift, axis=1)
        np.testing.assert_allclose(s.closing, np.sum(apart * opening, axis=0) / np.linalg.norm(apart, axis=0) / length)
        np.testing.assert_allclose(dot(s.away, vec3(axis)), 0.0, atol=1e-14)
        assert (np.sum(np.asarray(s.away.stack()) * apart, axis=0) > 0).all()


def test_a_single_canopy_has_no_neighbours_and_coincident_ones_stay_finite():
    r = vec3(np.zeros((3, 2)))
    axis = vec3(np.tile([[0.0], [0.0], [1.0]], 2))
    assert neighbours(r, r, axis, 35.0, 1) == ()
    (other,) = neighbours(r, r, axis, 35.0, 2)
    assert np.isfinite(other.away.stack()).all() and np.isfinite(other.closing).all()
