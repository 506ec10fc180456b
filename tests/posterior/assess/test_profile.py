"""Profiles against closed forms: a Gaussian's profile is its marginal, and one without a prior is the likelihood's."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

from bayeschute.likelihood.priors import Prior
from bayeschute.posterior.assess.profile import OFFSETS, Profile, likelihood_interval, profile
from bayeschute.posterior.joint_mode import fit
from bayeschute.posterior.marginal import log_density, marginalise

FINE = tuple(np.linspace(-6.0, 6.0, 81))


@pytest.fixture(scope="module")
def straight(linear):
    """The linear flight: its posterior is Gaussian, with mean and covariance from dense matrices."""
    flights = [linear.flight]
    best = fit(flights, linear.hyper, linear.priors, np.zeros(2), tolerance=1e-6)
    mean, covariance = linear.matrices.posterior(linear.flight, linear.hyper, linear.priors)
    return marginalise(flights, linear.hyper, linear.priors, best), mean[:2], covariance[:2, :2]


@pytest.mark.parametrize("which", [0, 1])
def test_a_gaussian_has_its_marginal_as_its_profile(straight, linear, which):
    made, mean, covariance = straight
    found = profile(made, linear.priors, which, rounds=2)
    sd = np.sqrt(covariance[which, which])
    assert found.parameter == linear.priors[which].name
    np.testing.assert_allclose(found.value, mean[which] + sd * np.array(OFFSETS), atol=1e-4 * sd)
    np.testing.assert_allclose(found.log_density, -0.5 * np.square(OFFSETS), atol=2e-4)
    other = 1 - which
    given = mean[other] + covariance[other, which] / sd * np.array(OFFSETS)
    np.testing.assert_allclose(found.others[:, other], given, atol=1e-3 * np.sqrt(covariance[other, other]))
    assert found.left.max() < 1e-3


def test_its_own_prior_is_taken_out(straight, linear):
    made, mean, covariance = straight
    prior, sd = linear.priors[0], np.sqrt(covariance[0, 0])
    found = profile(made, linear.priors, 0, FINE, rounds=2)
    precision = 1.0 / sd**2 - 1.0 / prior.scale**2
    top = (mean[0] / sd**2 - prior.centre / prior.scale**2) / precision
    wanted = -0.5 * precision * (found.value - top) ** 2
    np.testing.assert_allclose(found.log_likelihood, wanted - wanted.max(), atol=1e-3)
    assert np.ptp(found.log_likelihood - found.log_density) > 1e-2
    interval = likelihood_interval(found, 0.9)
    assert interval.drop == pytest.approx(scipy.stats.norm.ppf(0.95) ** 2 / 2.0)
    half = scipy.stats.norm.ppf(0.95) / np.sqrt(precision)
    assert interval.low == pytest.approx(top - half, abs=0.02 * half)
    assert interval.high == pytest.approx(top + half, abs=0.02 * half)


def test_a_parameter_that_only_the_prior_tells_is_not_bounded(linear):
    priors = [replace(linear.priors[0], scale=1e-3), linear.priors[1]]
    best = fit([linear.flight], linear.hyper, priors, np.array([0.5, 0.0]), tolerance=1e-6)
    made = profile(marginalise([linear.flight], linear.hyper, priors, best), priors, 0)
    np.testing.assert_allclose(made.log_density, -0.5 * np.square(OFFSETS), atol=1e-2)
    assert np.ptp(made.log_likelihood) < 0.1
    interval = likelihood_interval(made)
    assert interval.low is None and interval.high is None


def test_a_single_parameter_has_the_density_itself_in_its_own_unit(falling, descent):
    made = profile(falling, descent.priors, 0)
    density = np.asarray(log_density(falling, jnp.asarray([OFFSETS])))
    np.testing.assert_allclose(made.log_density, density - density.max(), atol=1e-8 * np.abs(density).max())
    np.testing.assert_allclose(made.value, np.exp(made.working))
    assert (np.diff(made.value) > 0.0).all() and not made.left.any()
    interval = likelihood_interval(made)
    assert interval.low < np.exp(float(falling.centre[0])) < interval.high


@pytest.mark.filterwarnings("ignore:overflow encountered in exp")
def test_where_a_simulation_fails_the_profile_has_no_value_and_the_rest_stands(falling, descent):
    whole = profile(falling, descent.priors, 0)
    made = profile(falling, descent.priors, 0, (*OFFSETS, 1e5))
    assert np.isnan(made.log_density[-1]) and np.isfinite(made.log_density[:-1]).all()
    np.testing.assert_allclose(made.log_density[:-1], whole.log_density, atol=1e-9)
    assert likelihood_interval(made) == pytest.approx(likelihood_interval(whole))


def test_an_interval_open_to_one_side():
    value = np.arange(-3.0, 4.0)
    height = np.where(value < 0.0, -0.5 * value**2, 0.0)
    made = Profile("p", value, value, height, height, value[:, None], 0.0 * value)
    interval = likelihood_interval(made, 0.9)
    assert interval.low == pytest.approx(scipy.stats.norm.ppf(0.05)) and interval.high is None


def test_the_posterior_profile_of_a_wide_prior_is_the_likelihoods(linear):
    priors = [Prior("one", 0.5, 1e4, False, "1", ""), linear.priors[1]]
    best = fit([linear.flight], linear.hyper, priors, np.array([0.5, 0.0]), tolerance=1e-6)
    made = profile(marginalise([linear.flight], linear.hyper, priors, best), priors, 0)
    np.testing.assert_allclose(made.log_likelihood, made.log_density, atol=1e-6)
