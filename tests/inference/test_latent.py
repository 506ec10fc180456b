"""Knots of latent disturbances against dense covariances."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.inference import latent
from bayeschute.inference.latent import Latent

SD, TAU = np.array([0.7, 3.0]), np.array([1.0, 40.0])


@pytest.mark.parametrize("spacing", [0.01, 2.0, 60.0])
def test_log_density_is_the_dense_one(dense, spacing):
    law, knots = Latent(SD, TAU), np.random.default_rng(0).standard_normal((9, 2))
    times = spacing * np.arange(9)
    z = np.asarray(latent.whiten(law, spacing, jnp.asarray(knots)))
    ours = -0.5 * np.sum(z**2) - latent.log_determinant(law, spacing, 9) - 9 * np.log(2.0 * np.pi)
    wanted = sum(
        dense.gaussian_log_density(knots[:, a], dense.stationary_covariance(times, SD[a], TAU[a])) for a in (0, 1)
    )
    assert float(ours) == pytest.approx(wanted, rel=1e-9)


def test_batches_are_whitened_alike():
    law, knots = Latent(SD, TAU), np.random.default_rng(1).standard_normal((9, 2, 3, 2))
    whole = latent.whiten(law, 2.0, jnp.asarray(knots))
    assert whole.shape == knots.shape
    np.testing.assert_allclose(whole[..., 1, 0], latent.whiten(law, 2.0, jnp.asarray(knots[..., 1, 0])), rtol=1e-12)


def test_draws_have_the_law():
    drawn = latent.draw(Latent(SD, TAU), 2.0, (12, 2, 4000), np.random.default_rng(2))
    np.testing.assert_allclose(drawn.std(axis=(0, 2)), SD, rtol=0.05)
    lag = np.mean(drawn[1:] * drawn[:-1], axis=(0, 2)) / SD**2
    np.testing.assert_allclose(lag, np.exp(-2.0 / TAU), atol=0.05)
    z = np.asarray(latent.whiten(Latent(SD, TAU), 2.0, jnp.asarray(drawn)))
    np.testing.assert_allclose(z.var(axis=2), 1.0, atol=0.12)
    assert abs(np.mean(z[1:] * z[:-1])) < 0.02


def test_gradients_are_finite_at_long_time_constants():
    def value(log_tau):
        law = Latent(SD, jnp.exp(log_tau))
        return jnp.sum(latent.whiten(law, 0.5, jnp.ones((5, 2))) ** 2) + latent.log_determinant(law, 0.5, 5)

    gradient = jax.jit(jax.grad(value))
    for exponent in (-12.0, 12.0):
        assert np.isfinite(gradient(jnp.full(2, exponent))).all()


def test_knots_cover_the_record_evenly():
    knots = latent.knot_times(50.0, 4.0)
    assert knots[0] == 0.0 and knots[-1] == 50.0 and np.ptp(np.diff(knots)) < 1e-12 and np.diff(knots)[0] <= 4.0
    assert latent.knot_times(50.0, 5.0).size == 11
    assert latent.knot_times(1.0, 5.0).size == 2


def test_interpolation_reproduces_straight_lines():
    knots, times = latent.knot_times(10.0, 2.0), np.linspace(0.0, 10.0, 37)
    weights = latent.interpolation(times, knots)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    np.testing.assert_allclose(weights @ (3.0 * knots - 1.0), 3.0 * times - 1.0, atol=1e-12)
