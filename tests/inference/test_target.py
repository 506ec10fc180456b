"""The joint density of data and unknowns against dense Gaussians, and its derivatives against differences."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.inference.target import (
    cost,
    linearise,
    log_normaliser,
    normal_equations,
    residuals,
    split,
    standardised,
)


def test_joint_density_is_the_dense_one(linear, dense):
    flight, u = linear.flight, linear.u
    s = standardised(flight, linear.hyper, residuals(flight, jnp.asarray(linear.theta), jnp.asarray(u)), jnp.asarray(u))
    ours = -0.5 * np.sum(np.asarray(s) ** 2) - log_normaliser(flight, linear.hyper) - 0.5 * u.size * np.log(2.0 * np.pi)
    y, zero, by = linear.matrices.model(flight)
    r, prior, _ = linear.matrices.covariances(flight, linear.hyper, linear.priors)
    wanted = dense.gaussian_log_density(y - zero - by @ np.concatenate([linear.theta, u]), r)
    assert float(ours) == pytest.approx(wanted + dense.gaussian_log_density(u, prior), rel=1e-9)


def test_linearisation_is_the_dense_one(linear):
    made = linearise(linear.flight, linear.theta, linear.u)
    y, zero, by = linear.matrices.model(linear.flight)
    stack = linear.matrices.dense.stack
    np.testing.assert_allclose(stack(np.asarray(made.derivative), linear.flight.present), -by, atol=1e-12)
    wanted = y - zero - by @ np.concatenate([linear.theta, linear.u])
    np.testing.assert_allclose(stack(np.asarray(made.residual), linear.flight.present), wanted, atol=1e-12)
    assert (np.asarray(made.derivative)[~linear.flight.present] == 0.0).all()


def test_linearisation_of_a_descent_against_differences(descent):
    flight, at = descent.flights[0], np.concatenate([descent.theta, descent.u[0]])
    made = linearise(flight, descent.theta, descent.u[0])
    step = 1e-5 * np.eye(at.size)
    points = np.concatenate([at + step, at - step]).T
    moved = np.asarray(residuals(flight, jnp.asarray(points[:1]), jnp.asarray(points[1:])))
    wanted = (moved[..., : at.size] - moved[..., at.size :]) / 2e-5
    np.testing.assert_allclose(made.derivative, wanted, atol=2e-7 * np.abs(wanted).max())


def test_normal_equations_are_derivatives_of_the_cost(descent):
    flight, at = descent.flights[0], np.concatenate([descent.theta, descent.u[0]])
    m, g, c = normal_equations(flight, descent.hyper, linearise(flight, descent.theta, descent.u[0]))
    points = np.concatenate([at + 1e-5 * np.eye(at.size), at - 1e-5 * np.eye(at.size)]).T
    moved = np.asarray(cost(flight, descent.hyper, points[:1], points[1:]))
    np.testing.assert_allclose(g, (moved[: at.size] - moved[at.size :]) / 2e-5, rtol=1e-5, atol=1e-5)
    assert float(c) == pytest.approx(float(cost(flight, descent.hyper, descent.theta, descent.u[0])), rel=1e-12)
    assert np.linalg.eigvalsh(np.asarray(m)).min() > 0.0


def test_residuals_of_the_truth_have_the_law_of_the_noise(descent):
    for flight, u in zip(descent.flights, descent.u, strict=True):
        s = cost(flight, descent.hyper, descent.theta, u)
        degrees = flight.present.sum() + flight.unknowns
        assert abs(2.0 * float(s) - degrees) < 4.0 * np.sqrt(2.0 * degrees)


def test_split_keeps_batches(linear):
    u = jnp.arange(linear.flight.unknowns * 3.0).reshape(-1, 3)
    start, knots = split(linear.flight, u)
    assert start.shape == (2, 3) and knots.shape == (linear.flight.weights.shape[1], 2, 3)
    np.testing.assert_array_equal(knots[1, 0], u[4])
