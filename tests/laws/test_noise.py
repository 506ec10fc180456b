"""AR(1) plus white noise against dense Gaussian covariances, with gaps and at the edges of its parameters."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.twins import dense_noise as twin

from bayeschute.likelihood.noise import Noise, gains, whiten

DT, SAMPLES = 0.1, 70


@jax.jit
def _value(vector, present, series):
    e = jnp.exp(vector)
    noise = Noise(e[:2], e[2:4], e[4:])
    variance = gains(noise, DT, present)[2]
    constant = 0.5 * jnp.sum(jnp.where(present, jnp.log(2.0 * jnp.pi * variance), 0.0))
    return -0.5 * jnp.sum(whiten(noise, DT, present, series) ** 2) - constant


_gradient = jax.jit(jax.grad(_value))
CASES = {
    "middle": (0.3, 0.5, 1.0),
    "hardly correlated": (0.3, 1e-6, 1.0),
    "hardly white": (1e-4, 0.5, 1.0),
    "slow": (0.3, 0.5, 1e4),
    "fast": (0.3, 0.5, 1e-3),
    "large": (3e3, 5e3, 0.4),
}
PATTERNS = {"full": 0.0, "gaps": 0.3, "nearly empty": 0.95}


def _logs(noise):
    return np.log(np.concatenate([noise.white, noise.correlated, noise.time_constant]))


def _case(name, gaps):
    white, correlated, tau = CASES[name]
    rng = np.random.default_rng(5)
    present = rng.random((SAMPLES, 2)) >= gaps
    present[20:30, 1] &= gaps == 0.0
    noise = Noise(np.array([white, 0.2]), np.array([correlated, 0.4]), np.array([tau, 2.0]))
    series = rng.standard_normal((SAMPLES, 2)) * np.hypot(noise.white, noise.correlated)
    return noise, present, series


@pytest.mark.parametrize("gaps", PATTERNS.values(), ids=PATTERNS.keys())
@pytest.mark.parametrize("name", CASES)
def test_log_density_is_the_dense_one(name, gaps):
    noise, present, series = _case(name, gaps)
    covariance = twin.noise_covariance(
        DT * np.arange(SAMPLES), present, noise.white, noise.correlated, noise.time_constant
    )
    wanted = twin.gaussian_log_density(twin.stack(series, present), covariance)
    assert float(_value(_logs(noise), present, series)) == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize("name", CASES)
def test_gradient_is_finite_and_the_dense_one(name):
    noise, present, series = _case(name, 0.3)
    at = _logs(noise)

    def dense(vector):
        e = np.exp(vector)
        covariance = twin.noise_covariance(DT * np.arange(SAMPLES), present, e[:2], e[2:4], e[4:])
        return twin.gaussian_log_density(twin.stack(series, present), covariance)

    gradient = np.asarray(_gradient(at, present, series))
    step = 1e-5
    wanted = [(dense(at + step * e) - dense(at - step * e)) / (2.0 * step) for e in np.eye(6)]
    assert np.isfinite(gradient).all()
    np.testing.assert_allclose(gradient, wanted, rtol=1e-4, atol=1e-3)


def test_innovations_of_simulated_noise_are_white():
    rng = np.random.default_rng(6)
    noise = Noise(np.array([0.3]), np.array([0.5]), np.array([1.0]))
    chol = np.linalg.cholesky(twin.stationary_covariance(DT * np.arange(200), 0.5, 1.0))
    series = chol @ rng.standard_normal((200, 300)) + 0.3 * rng.standard_normal((200, 300))
    present = rng.random(200) > 0.2
    z = np.asarray(whiten(noise, DT, jnp.asarray(present[:, None]), jnp.asarray(series[:, None, :])))[present, 0]
    assert np.mean(z**2) == pytest.approx(1.0, abs=0.02)
    for lag in (1, 2, 5):
        assert abs(np.mean(z[lag:] * z[:-lag])) < 4.0 / np.sqrt(z.size)
