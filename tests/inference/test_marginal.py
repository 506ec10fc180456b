"""The marginal posterior against dense marginalisation and brute-force integration."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.inference.map import fit
from bayeschute.inference.marginal import draw_unknowns, log_density, marginalise, projected_residuals
from bayeschute.inference.target import cost


def _marginal(flights, hyper, priors, theta):
    best = fit(flights, hyper, priors, theta, [np.zeros(f.unknowns) for f in flights], tolerance=1e-4)
    return marginalise(flights, hyper, priors, best)


@pytest.fixture(scope="module")
def straight(linear):
    return _marginal([linear.flight], linear.hyper, linear.priors, np.zeros(2))


@pytest.fixture(scope="module")
def falling(descent):
    return _marginal(descent.flights, descent.hyper, descent.priors, descent.theta)


def test_log_density_is_the_dense_one_where_all_is_linear(linear, straight):
    xi = np.random.default_rng(0).standard_normal((2, 6)) * 2.0
    theta = np.asarray(straight.theta(xi))
    wanted = [
        linear.matrices.given_theta(linear.flight, linear.hyper, t)
        - 0.5 * sum(((x - p.centre) / p.scale) ** 2 for x, p in zip(t, linear.priors, strict=True))
        for t in theta.T
    ]
    ours = np.asarray(log_density(straight, xi))
    np.testing.assert_allclose(ours - ours[0], np.array(wanted) - wanted[0], atol=1e-8)


def test_standard_coordinates_are_standard_where_all_is_linear(straight):
    xi = np.random.default_rng(1).standard_normal((2, 6)) * 3.0
    ours = np.asarray(log_density(straight, xi))
    np.testing.assert_allclose(ours - ours[0], -0.5 * np.sum(xi**2 - xi[:, :1] ** 2, axis=0), atol=1e-6)


def test_a_descent_against_brute_force_integration(descent):
    """Five samples-wide knots, three unknowns: the integral over u by a product of Gauss-Hermite rules."""
    flight = descent.flights[0]
    keep = slice(0, 21)
    model = replace(flight.model, record=replace(flight.model.record, wind=np.zeros(21)))
    weights = np.stack([1.0 - np.arange(21) / 20.0, np.arange(21) / 20.0], axis=1)
    small = replace(
        flight, model=model, observed=flight.observed[keep], present=flight.present[keep], weights=weights, spacing=10.0
    )
    made = _marginal([small], descent.hyper, descent.priors, descent.theta)
    cond = made.conditional[0]
    nodes, weight = np.polynomial.hermite_e.hermegauss(13)
    z = np.stack(np.meshgrid(nodes, nodes, nodes, indexing="ij")).reshape(3, -1)
    log_weight = np.log(np.prod(np.stack(np.meshgrid(weight, weight, weight, indexing="ij")), axis=0).ravel())
    wanted, grid = [], np.linspace(-2.5, 2.5, 5)
    for x in grid:
        theta = np.asarray(made.theta(jnp.array([[x]])))[:, 0]
        u = (cond.u + cond.slope @ (theta - made.centre))[:, None] + np.linalg.solve(cond.upper, z)
        minus = np.asarray(cost(small, descent.hyper, jnp.broadcast_to(theta[:, None], (1, z.shape[1])), u))
        prior = 0.5 * ((theta[0] - descent.priors[0].centre) / descent.priors[0].scale) ** 2
        wanted.append(np.logaddexp.reduce(log_weight + 0.5 * np.sum(z**2, axis=0) - minus) - prior)
    ours = np.asarray(log_density(made, grid[None, :]))
    np.testing.assert_allclose(ours - ours[2], np.array(wanted) - wanted[2], atol=0.03)
    assert np.ptp(wanted) > 2.0  # it isn't flat


def test_projected_residuals_agree_with_the_log_density(falling, straight):
    for made, p in ((falling, 1), (straight, 2)):
        xi = np.random.default_rng(2).standard_normal((p, 6)) * 1.5
        from_residuals = -0.5 * np.sum(np.asarray(projected_residuals(made, xi)) ** 2, axis=0)
        np.testing.assert_allclose(from_residuals, log_density(made, xi), rtol=1e-9)


def test_drawn_unknowns_have_the_conditional_law(linear, straight):
    mean, covariance = linear.matrices.posterior(linear.flight, linear.hyper, linear.priors)
    theta = np.asarray(straight.theta(jnp.array([[1.3], [-0.4]])))[:, 0]
    gain = np.linalg.solve(covariance[:2, :2], covariance[:2, 2:]).T
    wanted = mean[2:] + gain @ (theta - mean[:2])
    spread = covariance[2:, 2:] - gain @ covariance[:2, 2:]
    n = linear.flight.unknowns
    xi = np.broadcast_to(np.array([[1.3], [-0.4]]), (2, 2 * n + 1))
    z = np.concatenate([np.zeros((n, 1)), np.eye(n), -np.eye(n)], axis=1)
    drawn = np.asarray(draw_unknowns(straight, xi, (z,))[0])
    se = np.sqrt(np.diag(spread))
    np.testing.assert_allclose(drawn[:, 0] / se, wanted / se, atol=1e-5)
    root = drawn[:, 1 : n + 1] - drawn[:, :1]  # u is linear in z: its covariance is root @ root'
    np.testing.assert_allclose(root @ root.T, spread, atol=1e-7 * np.abs(spread).max())


def test_two_flights_share_their_parameters(descent, falling):
    alone = [_marginal([f], descent.hyper, descent.priors, descent.theta) for f in descent.flights]
    precision = sum(1.0 / float(m.scale[0, 0]) ** 2 for m in alone) - 1.0 / descent.priors[0].scale ** 2
    assert float(falling.scale[0, 0]) == pytest.approx(precision**-0.5, rel=0.02)


def test_a_failed_simulation_is_not_finite(falling):
    assert not np.isfinite(np.asarray(log_density(falling, np.array([[0.0, 1e6, 0, 0, 0, 0]])))[1])
