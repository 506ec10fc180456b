"""Latent processes against their stationary kernels."""

from __future__ import annotations

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.likelihood import disturbances
from bayeschute.likelihood.disturbances import Latent

SAMPLES = 25
DRIFT, OSCILLATOR = np.array([0.7, 1.5]), np.array([0.4, 0.3, 0.12])
CASES = {
    "drift": (Latent(("drift",), ((0, 0),)), (DRIFT,)),
    "oscillator": (Latent(("oscillator",), ((0, 0),)), (OSCILLATOR,)),
    "overdamped": (Latent(("oscillator",), ((0, 0),)), (np.array([0.4, 0.3, 1.7]),)),
    "added up, shared, not in order": (
        Latent(("oscillator", "drift", "drift"), ((2, 1), (0, 0), (1, 2), (0, 1), (1, 0))),
        (OSCILLATOR, DRIFT, np.array([0.2, 9.0])),
    ),
}


def _by_shocks(which, laws, dt):
    """Disturbances (T A, T L) made by each shock alone."""
    size = SAMPLES * which.size
    each = jnp.eye(size).reshape(SAMPLES, which.size, size)
    return np.asarray(disturbances.disturbances(disturbances.dynamics(which, laws, dt), each)).reshape(-1, size)


@pytest.mark.parametrize("dt", [0.1, 2.0])
@pytest.mark.parametrize("name", CASES)
def test_disturbances_have_the_stationary_kernel_at_all_lags(dense, name, dt):
    which, laws = CASES[name]
    by = _by_shocks(which, laws, dt)
    wanted = dense.disturbance_covariance(which, laws, dt * np.arange(SAMPLES))
    np.testing.assert_allclose(by @ by.T, wanted, atol=1e-11)
    assert by.shape[0] == SAMPLES * which.rows


def test_the_twin_solves_the_oscillators_equation(dense):
    """Its kernel k has k'' + 2 zeta w k' + w^2 k = 0 at positive lags and no slope at lag zero."""
    sd, frequency, zeta = OSCILLATOR
    omega, h = 2.0 * np.pi * frequency, 1e-4
    for lag in (0.4, 1.0, 3.0):
        k = dense.oscillator_covariance(np.array([0.0, lag - h, lag, lag + h]), *OSCILLATOR)[0, 1:]
        first, second = (k[2] - k[0]) / (2.0 * h), (k[2] - 2.0 * k[1] + k[0]) / h**2
        assert second + 2.0 * zeta * omega * first + omega**2 * k[1] == pytest.approx(0.0, abs=1e-6)
    near = dense.oscillator_covariance(np.array([0.0, h]), *OSCILLATOR)[0]
    assert near[0] == pytest.approx(sd**2) and (near[0] - near[1]) / h == pytest.approx(0.0, abs=1e-3)


def test_shapes():
    which, laws = CASES["added up, shared, not in order"]
    made = disturbances.dynamics(which, laws, 0.1)
    assert (which.rows, which.size) == (3, 7)
    assert made.transition.shape == made.noise_gain.shape == made.first.shape == (7, 7) and made.output.shape == (3, 7)
    for factor in (made.noise_gain, made.first):
        np.testing.assert_array_equal(factor, np.tril(factor))
        assert (np.diag(factor) > 0.0).all()


def test_a_process_once_stationary_stays_so_and_its_gradient_is_finite():
    """Over all that a study's bounds allow (logarithms five prior standard deviations of 0.7 about the medians)."""
    which = Latent(("drift", "oscillator"), ((0, 0), (0, 1)))

    @jax.jit
    def both(logs, dt):
        def value(logs):
            made = disturbances.dynamics(which, (jnp.exp(logs[:2]), jnp.exp(logs[2:])), dt)
            return jnp.sum(disturbances.disturbances(made, jnp.ones((6, which.size))) ** 2)

        made = disturbances.dynamics(which, (jnp.exp(logs[:2]), jnp.exp(logs[2:])), dt)
        return made, jax.grad(value)(logs)

    middle, corners = np.log([1.0, 3.0, 0.02, 0.25, 0.1]), list(itertools.product((-3.5, 0.0, 3.5), repeat=2))
    for dt, (slow, damped) in itertools.product((0.02, 0.1, 1.0), corners):
        made, gradient = both(middle + np.array([0.0, slow, 0.0, slow, damped]), dt)
        f, s, p = (np.asarray(a) for a in (made.transition, made.noise_gain, made.first))
        scale = np.outer(np.diag(p), np.diag(p))
        np.testing.assert_allclose((f @ p @ p.T @ f.T + s @ s.T) / scale, p @ p.T / scale, atol=1e-12)
        assert np.isfinite(gradient).all()


def test_gradients_of_drift_are_finite_at_any_time_constant():
    which = CASES["drift"][0]

    @jax.jit
    @jax.grad
    def gradient(log_tau):
        made = disturbances.dynamics(which, (jnp.stack([1.0, jnp.exp(log_tau)]),), 0.5)
        return jnp.sum(disturbances.disturbances(made, jnp.ones((5, 1))) ** 2)

    for exponent in (-30.0, -12.0, 12.0, 30.0):
        assert np.isfinite(gradient(exponent))


def test_path_and_disturbances_agree():
    which, laws = CASES["added up, shared, not in order"]
    made = disturbances.dynamics(which, laws, 0.3)
    process_noise = jnp.asarray(np.random.default_rng(0).standard_normal((SAMPLES, which.size)))
    states, seen = disturbances.path(made, process_noise), disturbances.disturbances(made, process_noise)
    np.testing.assert_allclose(seen, states @ np.asarray(made.output).T, atol=1e-14)
    for t in (1, 10):  # one step at a time
        step = np.asarray(made.transition) @ states[t - 1] + np.asarray(made.noise_gain) @ process_noise[t]
        np.testing.assert_allclose(states[t], step, atol=1e-14)
    np.testing.assert_allclose(states[0], np.asarray(made.first) @ process_noise[0], atol=1e-14)


def test_batches_are_singles_side_by_side():
    which, laws = CASES["added up, shared, not in order"]
    made = disturbances.dynamics(which, laws, 0.3)
    process_noise = jnp.asarray(np.random.default_rng(1).standard_normal((SAMPLES, which.size, 3, 2)))
    whole, one = disturbances.disturbances(made, process_noise), process_noise[..., 1, 0]
    assert whole.shape == (SAMPLES, 3, 3, 2)
    np.testing.assert_allclose(whole[..., 1, 0], disturbances.disturbances(made, one), atol=1e-14)
    np.testing.assert_allclose(
        disturbances.path(made, process_noise)[..., 1, 0], disturbances.path(made, one), atol=1e-14
    )


def test_a_law_short_of_a_group_is_refused():
    with pytest.raises(ValueError, match="zip"):
        disturbances.dynamics(CASES["added up, shared, not in order"][0], (DRIFT,), 0.1)


def test_no_process_is_rest():
    still = Latent((), (), 3)
    assert still.rows == 3 and still.size == 0 and hash(still) == hash(Latent((), (), 3))
    made = disturbances.dynamics(still, (), 0.1)
    np.testing.assert_array_equal(disturbances.disturbances(made, jnp.zeros((7, 0))), np.zeros((7, 3)))
    np.testing.assert_array_equal(disturbances.disturbances(made, jnp.zeros((7, 0, 4))), np.zeros((7, 3, 4)))
    assert Latent(("drift",), ((0, 0),), 3).rows == 3
