"""A population of like bodies."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.posterior.combine.random_effects import fit, likelihood_of


def test_a_prior_is_taken_out_again():
    m, s, prior_m, prior_s = 0.3, 0.2, -0.5, 0.6  # likelihood and prior
    precision = s**-2 + prior_s**-2
    posterior = ((m / s**2 + prior_m / prior_s**2) / precision, precision**-0.5)
    assert likelihood_of(*posterior, prior_m, prior_s) == pytest.approx((m, s))


def test_a_posterior_no_narrower_than_its_prior_tells_nothing():
    mean, sd = likelihood_of(0.0, 0.6, 0.0, 0.6)
    assert np.isfinite(mean) and sd > 1e5


def test_a_known_population_is_recovered():
    rng = np.random.default_rng(0)
    true_mean, true_sd, bodies = -1.5, 0.25, 60
    sd = rng.uniform(0.05, 0.3, bodies)
    seen = true_mean + true_sd * rng.standard_normal(bodies) + sd * rng.standard_normal(bodies)
    made = fit(seen, sd, (-1.0, 1.0), 2, 300, 400, seed=1)
    assert made.mean.shape == made.sd.shape == (2, 400)
    assert made.mean.mean() == pytest.approx(true_mean, abs=0.15)
    assert made.sd.mean() == pytest.approx(true_sd, abs=0.1)
    # Weak priors and many bodies: the spread of the mean is that of weighted averaging.
    weighted = np.sum(1.0 / (true_sd**2 + sd**2)) ** -0.5
    assert made.mean.std() == pytest.approx(weighted, rel=0.3)
    # Against the exact posterior on a grid.
    mu, spread = np.linspace(-2.2, -0.8, 141)[:, None, None], np.linspace(0.005, 0.8, 160)[None, :, None]
    variance = sd**2 + spread**2
    log_p = -0.5 * np.sum((seen - mu) ** 2 / variance + np.log(variance), axis=2)
    log_p = log_p - 0.5 * (mu[..., 0] + 1.0) ** 2 - 0.5 * spread[..., 0] ** 2
    p = np.exp(log_p - log_p.max())
    p /= p.sum()
    assert made.mean.mean() == pytest.approx(float(np.sum(p * mu[..., 0])), abs=0.01)
    assert made.sd.mean() == pytest.approx(float(np.sum(p * spread[..., 0])), abs=0.012)
