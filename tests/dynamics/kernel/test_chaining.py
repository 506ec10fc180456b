"""Chained derivatives of steps against the same in JAX, for knots of every reach."""

from __future__ import annotations

import jax
import numpy as np
import pytest

from bayeschute.dynamics.integrate import Steps, chained
from bayeschute.dynamics.kernel import chaining

T, X, P, D, A, K, C, SPARE = 31, 5, 3, 2, 2, 6, 4, 3
_by_jax = jax.jit(chained)


def hats(order):
    """Linear interpolation between knots, in some order."""
    return np.maximum(0.0, 1.0 - np.abs(np.linspace(0.0, K - 1.0, T)[:, None] - np.arange(K)))[:, order]


WEIGHTS = {
    "in order": hats(np.arange(K)),
    "backwards": hats(np.arange(K)[::-1]),
    "everywhere": np.random.default_rng(2).normal(size=(T, K)),
    "never": np.zeros((T, K)),
    "at the last sample only": np.eye(T)[:, -1:] * np.ones(K),
}


@pytest.mark.parametrize("name", WEIGHTS)
def test_equals_jax(name):
    rng = np.random.default_rng(1)
    step = rng.normal(size=(T - 1, X, P + 2 * A + X + SPARE)) / np.sqrt(X)
    step[..., P + 2 * A + X :] = 0.0
    first_theta, first_start = rng.normal(size=(X, P)), rng.normal(size=(X, D))
    out_state, out_theta = rng.normal(size=(T, C, X)), rng.normal(size=(T, C, P))
    by_theta, by_now, by_then, by_state, _ = np.split(step, np.cumsum([P, A, A, X]), axis=2)
    got = chaining.chained(chaining.Along(step, first_theta, first_start, out_state, out_theta), WEIGHTS[name], A)
    steps = Steps(by_state, by_theta, by_now, by_then, first_theta, first_start, out_state, out_theta)
    want = np.asarray(_by_jax(steps, WEIGHTS[name]))
    assert got.shape == want.shape == (T, C, P + D + K * A)
    assert np.abs(got - want).max() < 1e-12 * np.abs(want).max()


def test_knots_reached():
    assert chaining.reached(np.array([[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])) == [
        1,
        2,
        2,
        3,
    ]
    assert chaining.reached(np.zeros((2, 0))) == [0, 0]
