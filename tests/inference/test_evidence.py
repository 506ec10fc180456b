"""The evidence against dense marginal likelihoods; noise parameters recovered."""

from __future__ import annotations

import jax
import numpy as np
import pytest

from bayeschute.inference import evidence
from bayeschute.inference.evidence import HyperPrior
from bayeschute.inference.noise import Noise
from bayeschute.inference.priors import working
from bayeschute.inference.target import Hyper, linearise


@pytest.fixture(scope="module")
def objective(linear):
    """Minus the log evidence and log prior, and its gradient, at the logarithms of the noise parameters."""
    centre, scale = working(linear.priors)
    prior = HyperPrior(linear.hyper)
    lin = linearise(linear.flight, linear.theta, linear.u)
    fixed = (
        evidence.to_vector(prior.median),
        prior.log_sd,
        (linear.flight,),
        (lin,),
        (linear.theta - centre) / scale,
        scale,
    )

    def value(vector):
        got, gradient = evidence._gradient(vector, *fixed, channels=2, groups=2)
        return float(got), np.asarray(gradient)

    return value


@pytest.fixture(scope="module")
def points(linear):
    middle = evidence.to_vector(linear.hyper)
    return [middle, middle + 0.4 * np.random.default_rng(0).standard_normal(middle.size)]


def test_vectors_are_invertible(linear):
    there = evidence.from_vector(jax.numpy.asarray(evidence.to_vector(linear.hyper)), 2, 2)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-12), there, linear.hyper)


def test_differences_are_those_of_dense_marginal_likelihoods(linear, objective, points):
    def dense(vector):
        hyper = jax.tree.map(np.asarray, evidence.from_vector(jax.numpy.asarray(vector), 2, 2))
        log_prior = -0.5 * np.sum(((vector - points[0]) / 0.7) ** 2)
        return linear.matrices.evidence(linear.flight, hyper, linear.priors) + log_prior

    ours = objective(points[1])[0] - objective(points[0])[0]
    assert ours == pytest.approx(dense(points[0]) - dense(points[1]), abs=1e-7)


def test_gradient_by_differences(objective, points):
    at, step = points[1], 1e-5
    wanted = [(objective(at + step * e)[0] - objective(at - step * e)[0]) / (2.0 * step) for e in np.eye(at.size)]
    np.testing.assert_allclose(objective(at)[1], wanted, rtol=1e-5, atol=1e-6)


def test_maximise_recovers_the_noise(descent):
    (flight, u), (more, v) = (
        descent.simulate(descent.flights[0], descent.hyper, descent.theta, seed, gaps=0.05) for seed in (11, 12)
    )
    off = Hyper(Noise(np.array([0.15]), np.array([0.04]), np.array([4.0])), np.array([1.0]), np.array([6.0]))
    lin = [linearise(f, descent.theta, x) for f, x in ((flight, u), (more, v))]
    flights, prior = [flight, more], HyperPrior(off, 1.0)
    best, value = evidence.maximise(flights, lin, descent.priors, descent.theta, off, prior)
    made, true = evidence.to_vector(best), evidence.to_vector(descent.hyper)
    # White and correlated sd, and sd of the wind error, are told well by 190 samples; time constants to a factor.
    assert (np.abs(made - true) < np.array([0.35, 0.35, 1.0, 0.8, 1.2])).all()
    again, _ = evidence.maximise(flights, lin, descent.priors, descent.theta, descent.hyper, prior)
    np.testing.assert_allclose(evidence.to_vector(again), made, atol=0.15)
    assert np.isfinite(value)


def test_latent_covariance_is_the_inverse_curvature_and_never_wider_than_the_prior(linear):
    lin = [linearise(linear.flight, linear.theta, linear.u)]
    prior = HyperPrior(linear.hyper)
    at = evidence.maximise([linear.flight], lin, linear.priors, linear.theta, linear.hyper, prior)[0]
    made = evidence.latent_covariance([linear.flight], lin, linear.priors, linear.theta, at, prior)
    assert made.shape == (4, 4)
    np.testing.assert_allclose(made, made.T, atol=1e-12)
    values = np.linalg.eigvalsh(made)
    assert values.min() > 0.0 and values.max() <= 0.7**2 + 1e-12
