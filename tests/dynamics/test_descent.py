"""The point mass against tanh and coth, and its exact Jacobian against differences."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.compiler.integrate import outputs, trajectory, trajectory_compiled
from bayeschute.dynamics.descent import DensityProfile, DescentFlight, DescentInputs, quantity

T, DT, RHO, G = 61, 0.2, 1.1, 9.80665
FLAT = DensityProfile(0.0, 1000.0, np.log(np.full(5, RHO)))
THIN = DensityProfile(0.0, 100.0, np.log(1.2 * np.exp(-np.arange(41) * 100.0 / 8000.0)))
THETA = np.array([np.log(0.15)])
V_T = np.sqrt(2 * G / (RHO * 0.15))
see = jax.jit(outputs)


def drop(speed, wind=0.0, air=FLAT, dt=DT):
    return DescentFlight(air, DescentInputs(np.full(T, wind)), 3000.0, speed, dt)


def fly(flight, theta=THETA, start=None, error=None):
    start = np.zeros(1) if start is None else start
    return np.asarray(trajectory_compiled(flight, theta, start, np.zeros((T, 1)) if error is None else error))


@pytest.mark.parametrize("ratio", [0.0, 0.5, 1.0, 1.5])
@pytest.mark.parametrize("wind", [0.0, -3.0])
def test_constant_density_is_tanh_below_terminal_speed_and_coth_above(ratio, wind):
    time, tau = np.arange(T) * DT, V_T / G
    if ratio < 1:
        phase = time / tau + np.arctanh(ratio)
        u, fallen = V_T * np.tanh(phase), V_T * tau * np.log(np.cosh(phase) / np.cosh(phase[0]))
    elif ratio == 1:
        u, fallen = np.full(T, V_T), V_T * time
    else:
        phase = time / tau + np.arctanh(1 / ratio)
        u, fallen = V_T / np.tanh(phase), V_T * tau * np.log(np.sinh(phase) / np.sinh(phase[0]))
    x = fly(drop(ratio * V_T + wind, wind))
    np.testing.assert_allclose(x[:, 1], u + wind, atol=2e-6)
    np.testing.assert_allclose(x[:, 0], 3000.0 - fallen - wind * time, atol=2e-6)


def test_runge_kutta_converges_at_order_four():
    """Halving the step divides the error by about sixteen; a step is a quarter of a sample."""
    tau = V_T / G
    error = []
    for dt in (0.8, 0.4, 0.2):
        time = np.arange(T) * dt
        want = V_T * np.tanh(time / tau)
        error.append(np.abs(fly(drop(0.0, dt=dt))[:, 1] - want).max())
    order = np.log2(np.array(error[:-1]) / error[1:])
    np.testing.assert_allclose(order, 4.0, atol=0.35)


def test_density_is_exact_at_nodes_and_exponential_between_and_beyond():
    altitude = np.array([-250.0, 0.0, 130.0, 4000.0, 4700.0])
    np.testing.assert_allclose(THIN.density(jnp.asarray(altitude)), 1.2 * np.exp(-altitude / 8000.0), rtol=1e-12)


def test_falls_slower_in_denser_air():
    x = fly(drop(V_T, air=THIN))
    settled = x[30:, 1] / np.sqrt(2 * G / (0.15 * np.asarray(THIN.density(jnp.asarray(x[30:, 0])))))
    np.testing.assert_allclose(settled, 1.0, atol=2e-3)
    sea = np.asarray(quantity("sea_level_descent_rate", jnp.asarray(x[30:].T), THIN))
    np.testing.assert_allclose(sea, np.sqrt(2 * G / (0.15 * 1.225)), rtol=2e-3)


def test_jacobian_equals_central_differences():
    rng = np.random.default_rng(1)
    place = np.linspace(0, 3, T)
    weights = np.maximum(0.0, 1.0 - np.abs(place[:, None] - np.arange(4)))
    z = np.concatenate([THETA, [0.4], rng.normal(size=4)])
    flight = drop(5.0, -1.0, THIN)

    def seen(z):
        x = fly(flight, z[:1], z[1:2], weights @ z[2:, None])
        return np.asarray(see(flight, x, z[:1]))

    def traced(z):
        return outputs(flight, trajectory(flight, z[:1], z[1:2], weights @ z[2:, None]), z[:1])

    J = jax.jit(jax.jacfwd(traced))(z)
    for m, h in enumerate(1e-5 * np.eye(6)):
        np.testing.assert_allclose(np.asarray(J)[:, :, m], (seen(z + h) - seen(z - h)) / 2e-5, atol=1e-7)


def test_batch_axis_is_a_loop_over_singles():
    theta, start = np.log([[0.1, 0.15, 0.3]]), np.array([[0.0, 1.0, -1.0]])
    error = np.random.default_rng(2).normal(size=(T, 1, 3))
    flight = replace(drop(5.0), air=THIN)
    together = fly(flight, theta, start, error)
    for b in range(3):
        np.testing.assert_allclose(together[:, :, b], fly(flight, theta[:, b], start[:, b], error[:, :, b]), rtol=1e-13)
