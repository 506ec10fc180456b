"""The simulation loop, its exact derivatives and its batch axis, on a cluster with one canopy and on a toy."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.twins import small_cluster as small

from bayeschute.compiler.integrate import along_path, outputs, trajectory, trajectory_compiled
from bayeschute.dynamics.cluster_flight import channel_sizes
from bayeschute.dynamics.parameters import Structure

ONE = Structure(("1",), ("e", "rate"), 1, "riser")
T, KNOTS = 21, 3
NAMES = (
    "axial[1]",
    "transverse[rate]",
    "riser_stiffness",
    "riser_damping",
    "riser_length",
    "capsule_mass",
    "enclosed_air_factor",
)
THETA = np.array([1.8, 0.3, np.log(2.19e5), np.log(1.46e5), 71.3, 9463.0, 0.0])
STEP = np.array([1e-5, 1e-5, 1e-5, 1e-5, 1e-5, 1e-2, 1e-5])
CHANNELS = ("canopy_position", "capsule_velocity", "capsule_attitude", "riser_tension")
FLIGHT = small.flight(
    small.cluster((1.8,), (0.1, 0.3)), small.start([[0.2], [0.1], [-1.0]]), ONE, wind=(2.0, 1.0, 0.0), samples=T, substeps=3,
    names=NAMES, channels=CHANNELS,
)  # fmt: skip
WEIGHTS = np.maximum(0.0, 1.0 - np.abs(np.linspace(0, KNOTS - 1, T)[:, None] - np.arange(KNOTS)))
see = jax.jit(outputs)


def step_jacobians(*given):
    """Outputs and the derivatives of all steps along a flight's own simulation."""
    y, _, steps = along_path(*given, trajectory(*given))
    return y, steps


def batch(z):
    """Outputs (T, C, B) for columns of z: parameters, initial deviations, knots of wind and of the axial factor."""
    p, d = THETA.size, 13
    error = np.einsum("tk,kab->tab", WEIGHTS, z[p + d :].reshape(KNOTS, 4, -1))
    states = trajectory_compiled(FLIGHT, z[:p], z[p : p + d], error)
    return np.asarray(states), np.asarray(see(FLIGHT, states, z[:p]))


@pytest.fixture(scope="module")
def runs():
    rng = np.random.default_rng(0)
    z = np.concatenate([THETA, rng.normal(size=13) * 0.02, rng.normal(size=KNOTS * 4) * 0.1])
    h = np.concatenate([STEP, np.full(13, 1e-5), np.full(KNOTS * 4, 1e-4)])
    columns = np.concatenate([z[:, None], z[:, None] + np.diag(h), z[:, None] - np.diag(h)], axis=1)
    return z, h, *batch(columns)


def _chained(steps, weights):
    """Derivatives of the outputs (T, C, P + D + K A) from those of the steps, in plain NumPy."""
    a, b, c0, c1, first_theta, first_start, out_state, out_theta = (np.asarray(part) for part in steps)
    (x, p), d, knots, axes = first_theta.shape, first_start.shape[1], weights.shape[1], c0.shape[2]
    s, rows = np.concatenate([first_theta, first_start, np.zeros((x, knots * axes))], axis=1), []
    for t in range(len(weights)):
        if t:
            by_knots = sum(
                np.einsum("k,xa->xka", w, c) for w, c in ((weights[t - 1], c0[t - 1]), (weights[t], c1[t - 1]))
            )
            s = a[t - 1] @ s + np.concatenate([b[t - 1], np.zeros((x, d)), by_knots.reshape(x, -1)], axis=1)
        rows.append(out_state[t] @ s)
        rows[-1][:, :p] += out_theta[t]
    return np.array(rows)


@pytest.mark.slow  # half a minute of compilation; the toy tests the same in seconds
def test_step_jacobians_chain_to_central_differences(runs):
    z, h, _, seen = runs
    p, m = THETA.size, z.size
    error = WEIGHTS @ z[p + 13 :].reshape(KNOTS, 4)
    y, steps = jax.jit(step_jacobians)(FLIGHT, z[:p], z[p : p + 13], error)
    np.testing.assert_allclose(y, seen[:, :, 0], rtol=1e-9, atol=1e-9)
    want, got = (seen[:, :, 1 : m + 1] - seen[:, :, m + 1 :]) / (2 * h), _chained(steps, WEIGHTS)
    assert got.shape == want.shape == (T, sum(channel_sizes(CHANNELS, 1).values()), m)
    scale = np.abs(want).max(axis=0) + np.array([1e-2] * 9 + [1e2])[:, None]
    np.testing.assert_array_less(np.abs(got - want) / scale, 2e-5)
    assert (np.abs(want).max(axis=(0, 1)) > 0).all()


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Toy:
    """A `FlightModel` small enough to be differentiated by hand."""

    drive: Any

    def inputs(self):
        return self.drive

    def numbers(self, theta):
        return jnp.exp(theta)

    def initial(self, numbers, start):
        return jnp.stack([1.0 + numbers[0] * start[0], start[1] ** 2 + numbers[1]])

    def advance(self, x, numbers, now, then, error_now, error_then):
        first = x[0] + 0.1 * jnp.sin(x[1]) * numbers[0] + now * error_now[0] * x[0]
        return jnp.stack([first, 0.5 * x[1] * numbers[1] + then * error_then[0] ** 2 + error_now[0] * error_then[0]])

    def observe(self, x, numbers, now):
        return jnp.stack([x[0] * x[1] + now * numbers[0]])


def test_step_jacobians_are_those_by_hand():
    rng, samples = np.random.default_rng(3), 6
    drive, error = rng.standard_normal(samples), rng.standard_normal((samples, 1))
    theta, start = np.array([0.3, -0.5]), np.array([0.4, 0.7])
    a, b = np.exp(theta)
    x = np.asarray(trajectory(Toy(drive), theta, start, error))
    y, steps = step_jacobians(Toy(drive), theta, start, error)
    np.testing.assert_allclose(y[:, 0], x[:, 0] * x[:, 1] + drive * a, rtol=1e-14)
    e0, e1, zero = error[:-1, 0], error[1:, 0], np.zeros(samples - 1)
    before, now, then = x[:-1], drive[:-1], drive[1:]
    wanted = {
        "by_state": [[1.0 + now * e0, 0.1 * np.cos(before[:, 1]) * a], [zero, zero + 0.5 * b]],
        "by_theta": [[0.1 * np.sin(before[:, 1]) * a, zero], [zero, 0.5 * before[:, 1] * b]],
        "by_now": [[now * before[:, 0]], [e1]],
        "by_then": [[zero], [2.0 * then * e1 + e0]],
        "out_state": [[x[:, 1], x[:, 0]]],
        "out_theta": [[drive * a, 0.0 * drive]],
    }
    for name, rows in wanted.items():
        np.testing.assert_allclose(getattr(steps, name), np.moveaxis(np.array(rows), -1, 0), atol=1e-14, err_msg=name)
    np.testing.assert_allclose(steps.first_theta, [[a * start[0], 0.0], [0.0, b]])
    np.testing.assert_allclose(steps.first_start, [[a, 0.0], [0.0, 2.0 * start[1]]])


def test_step_jacobians_of_the_toy_chain_to_central_differences():
    rng, samples, h = np.random.default_rng(4), 12, 1e-6
    drive, knots = 0.3 * rng.standard_normal(samples), 0.3 * rng.standard_normal(4)
    weights = np.maximum(0.0, 1.0 - np.abs(np.linspace(0, 3, samples)[:, None] - np.arange(4)))
    z = np.concatenate([[0.1, -0.3, 0.4, 0.7], knots])
    _, steps = step_jacobians(Toy(drive), z[:2], z[2:4], weights @ z[4:, None])

    def seen(z):
        error = np.einsum("tk,kb->tb", weights, z[4:])[:, None]
        return np.asarray(outputs(Toy(drive), trajectory(Toy(drive), z[:2], z[2:4], error), z[:2]))

    wanted = (seen(z[:, None] + h * np.eye(8)) - seen(z[:, None] - h * np.eye(8))) / (2.0 * h)
    np.testing.assert_allclose(_chained(steps, weights), wanted, atol=1e-8)
    assert (np.abs(wanted).max(axis=(0, 1)) > 1e-2).all()


def test_batch_axis_is_a_loop_over_singles(runs):
    z, _, states, _ = runs
    p = THETA.size
    for b in (0, 9, 25):
        column = z + (0 if b == 0 else runs[1] * (np.arange(z.size) == b - 1))
        error = WEIGHTS @ column[p + 13 :].reshape(KNOTS, 4)
        single = trajectory_compiled(FLIGHT, column[:p], column[p : p + 13], error)
        np.testing.assert_allclose(states[:, :, b], single, rtol=1e-11, atol=1e-10)


def test_unknown_parameter_is_refused():
    with pytest.raises(KeyError, match="no parameter of the cluster"):
        replace(FLIGHT, names=("colour",)).numbers(jnp.ones(1))
