"""The simulation loop, its exact Jacobian and its batch axis, on a cluster with one canopy."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.dynamics.cluster_flight import channel_sizes
from bayeschute.dynamics.integrate import jacobian_compiled, outputs, rk4, trajectory_compiled
from bayeschute.dynamics.parameters import Structure

_spec = importlib.util.spec_from_file_location(
    "small_cluster", Path(__file__).parents[1] / "twins" / "small_cluster.py"
)
small = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(small)

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
THETA = np.array([1.8, 0.3, np.log(2.19e5), np.log(1.46e5), 71.3, 9463.0, 1.0])
STEP = np.array([1e-5, 1e-5, 1e-5, 1e-5, 1e-5, 1e-2, 1e-5])
CHANNELS = ("canopy_position", "capsule_velocity", "capsule_attitude", "riser_tension")
FLIGHT = small.flight(
    small.cluster((1.8,), (0.1, 0.3)), small.start([[0.2], [0.1], [-1.0]]), ONE, wind=(2.0, 1.0, 0.0), samples=T, substeps=3,
    names=NAMES, channels=CHANNELS,
)  # fmt: skip
WEIGHTS = np.maximum(0.0, 1.0 - np.abs(np.linspace(0, KNOTS - 1, T)[:, None] - np.arange(KNOTS)))
see = jax.jit(outputs)


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


@pytest.mark.slow  # half a minute of compilation; the point mass tests the same chain in seconds
def test_jacobian_equals_central_differences(runs):
    z, h, _, seen = runs
    p, m = THETA.size, z.size
    knots = z[p + 13 :].reshape(KNOTS, 4)
    y, J = jacobian_compiled(FLIGHT, z[:p], z[p : p + 13], WEIGHTS @ knots, WEIGHTS)
    np.testing.assert_allclose(y, seen[:, :, 0], rtol=1e-9, atol=1e-9)
    want = (seen[:, :, 1 : m + 1] - seen[:, :, m + 1 :]) / (2 * h)
    J = np.asarray(J)
    assert J.shape == want.shape == (T, sum(channel_sizes(CHANNELS, 1).values()), m)
    scale = np.abs(want).max(axis=0) + np.array([1e-2] * 9 + [1e2])[:, None]
    np.testing.assert_array_less(np.abs(J - want) / scale, 2e-5)
    assert (np.abs(want).max(axis=(0, 1)) > 0).all()


def test_batch_axis_is_a_loop_over_singles(runs):
    z, _, states, _ = runs
    p = THETA.size
    for b in (0, 9, 25):
        column = z + (0 if b == 0 else runs[1] * (np.arange(z.size) == b - 1))
        error = WEIGHTS @ column[p + 13 :].reshape(KNOTS, 4)
        single = trajectory_compiled(FLIGHT, column[:p], column[p : p + 13], error)
        np.testing.assert_allclose(states[:, :, b], single, rtol=1e-11, atol=1e-10)


def test_runge_kutta_has_order_four_and_sees_the_share_of_the_sample():
    """x' = x + t from 1: x(1) = 2 e - 2."""
    error = [abs(float(rk4(lambda x, s: x + s, jnp.array(1.0), 1.0, k)) - (2 * np.e - 2)) for k in (8, 16, 32)]
    np.testing.assert_allclose(np.log2(np.array(error[:-1]) / error[1:]), 4.0, atol=0.15)


def test_unknown_parameter_is_refused():
    with pytest.raises(KeyError, match="no parameter of the cluster"):
        replace(FLIGHT, names=("colour",)).numbers(jnp.ones(1))
