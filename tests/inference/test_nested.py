"""The joint posterior of parameters and noise parameters, point by point, against dense matrices and the fast way."""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np
import pytest
from scipy.stats import multivariate_normal

from bayeschute.inference.evidence import HyperPrior, from_vector, to_vector
from bayeschute.inference.finding import Found
from bayeschute.inference.map import fit
from bayeschute.inference.marginal import log_density, marginalise
from bayeschute.inference.nested import Nested, draw

LOG_SD = 0.5


@pytest.fixture(scope="module")
def found(linear):
    """A fit of the linear flight."""
    best = fit([linear.flight], linear.hyper, linear.priors, np.zeros(2))
    made = marginalise([linear.flight], linear.hyper, linear.priors, best)
    return Found(best, linear.hyper, made, 0.0, np.eye(11), np.zeros((2, 11)), 0.0)


@pytest.fixture(scope="module")
def nested(found, linear):
    return Nested(found, linear.priors, HyperPrior(linear.hyper, LOG_SD))


def test_joint_densities_are_those_of_dense_matrices(nested, linear):
    rng, middle = np.random.default_rng(2), to_vector(linear.hyper)
    ours, wanted = [], []
    for _ in range(4):
        theta, eta = linear.theta + 0.2 * rng.standard_normal(2), middle + 0.4 * rng.standard_normal(middle.size)
        point = nested.log_density(theta, eta)
        assert point.unsettled < 1e-6  # a linear flight is settled at once
        ours.append(point.value)
        hyper = jax.tree.map(np.asarray, from_vector(eta, linear.hyper))
        mean, covariance = linear.matrices.posterior(linear.flight, hyper, linear.priors)
        of_theta = multivariate_normal(mean[:2], covariance[:2, :2]).logpdf(theta)
        of_eta = -0.5 * np.sum(((eta - middle) / LOG_SD) ** 2)
        wanted.append(linear.matrices.evidence(linear.flight, hyper, linear.priors) + of_theta + of_eta)
    np.testing.assert_allclose(np.diff(ours), np.diff(wanted), rtol=1e-7, atol=1e-7)


def test_draws_of_the_fast_way_have_equal_weights_on_a_linear_flight(nested, found):
    xi = np.random.default_rng(3).standard_normal((40, 2))
    drawn = draw(found, xi, np.asarray(log_density(found.marginal, xi.T)), 8, seed=1, held=True)
    pick = np.linspace(0, 39, 8).astype(int)
    np.testing.assert_allclose(drawn.theta, np.asarray(found.marginal.theta(xi[pick].T)).T)
    values = [nested.log_density(theta, eta).value for theta, eta in zip(drawn.theta, drawn.eta, strict=True)]
    np.testing.assert_allclose(np.diff(np.array(values) - drawn.log_proposal), 0.0, atol=1e-6)


def test_drawn_noise_parameters_follow_their_law_and_parameters_follow_them(found):
    xi, known, slope = np.zeros((400, 2)), 0.04 * np.eye(11), np.zeros((2, 11))
    slope[0, 3] = 2.0
    drawn = draw(replace(found, law_covariance=known, law_slope=slope), xi, np.zeros(400), 400, seed=1)
    eta = drawn.eta - to_vector(found.hyper)
    np.testing.assert_allclose(eta.std(axis=0), 0.2, rtol=0.2)
    np.testing.assert_allclose(drawn.log_proposal, -0.5 * np.sum((eta / 0.2) ** 2, axis=1))
    shift = (drawn.theta - np.asarray(found.marginal.centre)) @ np.linalg.inv(np.asarray(found.marginal.scale)).T
    np.testing.assert_allclose(shift, np.stack([2.0 * eta[:, 3], 0.0 * eta[:, 3]], axis=1), atol=1e-9)


def test_a_point_that_does_not_fly_has_no_density(nested, linear):
    point = nested.log_density(np.array([np.nan, 0.0]), to_vector(linear.hyper))
    assert np.isnan(point.value) and point.unsettled == np.inf
