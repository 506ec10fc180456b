"""Residual noise: what the map does; its density is tested in tests/laws."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from bayeschute.likelihood.noise import Noise, colour, gains, whiten

NOISE = Noise(np.array([0.1, 0.3]), np.array([0.5, 0.2]), np.array([1.0, 3.0]))


def test_whitening_is_linear_and_serves_derivatives():
    rng = np.random.default_rng(0)
    present = jnp.asarray(rng.random((40, 2)) > 0.2)
    a, b = jnp.asarray(rng.standard_normal((2, 40, 2)))
    both = whiten(NOISE, 0.1, present, 2.0 * a - 3.0 * b)
    np.testing.assert_allclose(
        both, 2.0 * whiten(NOISE, 0.1, present, a) - 3.0 * whiten(NOISE, 0.1, present, b), atol=1e-11
    )
    columns = whiten(NOISE, 0.1, present, jnp.stack([a, b], axis=-1))
    np.testing.assert_allclose(columns[..., 1], whiten(NOISE, 0.1, present, b), atol=1e-12)


def test_missing_samples_are_ignored():
    rng = np.random.default_rng(1)
    present = rng.random((40, 2)) > 0.3
    series = rng.standard_normal((40, 2))
    spoiled = np.where(present, series, 1e6)
    made = np.asarray(whiten(NOISE, 0.1, jnp.asarray(present), jnp.asarray(spoiled)))
    np.testing.assert_array_equal(made, whiten(NOISE, 0.1, jnp.asarray(present), jnp.asarray(series)))
    assert (made[~present] == 0.0).all()


def test_gains_at_missing_samples_are_nil():
    present = jnp.asarray(np.array([[True], [False], [True]]))
    noise = Noise(np.array([0.1]), np.array([0.5]), np.array([1.0]))
    _, k, s = gains(noise, 0.1, present)
    assert k[1, 0] == 0.0 and s[1, 0] == 1.0
    np.testing.assert_allclose(s[0, 0], 0.26)
    assert s[2, 0] < s[0, 0]


def test_coloured_numbers_have_the_dense_covariance(dense):
    """`colour` is linear in its numbers: each alone gives a root of the covariance."""
    each = np.eye(2 * 40 * 2).reshape(2, 40, 2, -1)
    made = dense.stack(
        np.asarray(colour(NOISE, 0.1, jnp.asarray(each[0]), jnp.asarray(each[1]))), np.ones((40, 2), bool)
    )
    wanted = dense.noise_covariance(0.1 * np.arange(40), np.ones((40, 2), bool), *NOISE.__dict__.values())
    np.testing.assert_allclose(made @ made.T, wanted, atol=1e-13)
    single = colour(NOISE, 0.1, jnp.asarray(each[0, ..., 3]), jnp.asarray(each[1, ..., 3]))
    np.testing.assert_allclose(dense.stack(np.asarray(single), np.ones((40, 2), bool)), made[:, 3], atol=1e-15)
