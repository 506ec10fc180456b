"""The marginal posterior against dense marginalisation and brute-force integration."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.inference import latent
from bayeschute.inference.drawing import Normals, normals
from bayeschute.inference.map import fit
from bayeschute.inference.marginal import (
    Quadratic,
    draw_unknowns,
    log_density,
    marginalise,
    projected_residuals,
)
from bayeschute.inference.target import Hyper, cost, course

POINT = np.array([1.3, -0.4])  # standard coordinates away from the optimum


def _flat(marginal):
    """The posterior whose determinant is held constant."""
    return replace(marginal, determinant=jax.tree.map(np.zeros_like, marginal.determinant))


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


def test_a_quadratic_is_its_slope_and_half_its_curvature():
    two = Quadratic(np.array([0.3, -0.2]), np.array([[0.1, 0.05], [0.05, 0.4]]))
    xi = np.array([[1.0, 0.5], [2.0, -1.0]])
    np.testing.assert_allclose(two.at(xi), [0.3 - 0.4 + 0.05 + 0.8 + 0.1, 0.15 + 0.2 + 0.0125 + 0.2 - 0.025])


def test_projected_residuals_agree_with_the_log_density(falling, straight):
    bent = replace(straight, determinant=Quadratic(np.array([0.4, -0.3]), np.array([[0.1, -0.1], [-0.1, 0.2]])))
    for made, p in ((falling, 1), (bent, 2)):
        xi = np.random.default_rng(2).standard_normal((p, 6)) * 1.5
        slope, curvature = (np.asarray(a) for a in made.determinant)
        from_residuals = -0.5 * np.sum(np.asarray(projected_residuals(made, xi)) ** 2, axis=0)
        from_residuals = from_residuals - slope @ xi - 0.5 * np.sum(xi * (curvature @ xi), axis=0)
        np.testing.assert_allclose(from_residuals, log_density(made, xi), rtol=1e-9)


def test_the_exact_profile_is_followed_to_second_order(descent, falling):
    """Along the linear course the density without its determinant is nearly that of the conditional optimum."""
    flat, xi = _flat(falling), np.array([[-1.5, 0.0, 1.5, 0.0, 0.0, 0.0]])
    ours = np.asarray(log_density(flat, xi))
    theta = np.asarray(falling.theta(xi))[0, :3]
    tight = [[replace(descent.priors[0], centre=t, scale=1e-7)] for t in theta]  # theta held there
    best = [fit(descent.flights, descent.hyper, p, np.array([p[0].centre])).cost for p in tight]
    prior = descent.priors[0]
    wanted = -np.array(best) - 0.5 * ((theta - prior.centre) / prior.scale) ** 2
    np.testing.assert_allclose(ours[:3] - ours[1], wanted - wanted[1], atol=0.01)
    assert np.ptp(wanted) > 0.5
    # Without random numbers, draws are nearly that optimum.
    still = tuple(jax.tree.map(np.zeros_like, normals(f, 6, np.random.default_rng(0))) for f in descent.flights)
    drawn, at = draw_unknowns(falling, xi, still), np.asarray(falling.theta(xi))
    costs = sum(np.asarray(cost(f, descent.hyper, at, u)) for f, u in zip(descent.flights, drawn, strict=True))
    np.testing.assert_allclose(costs[:3], best, atol=0.01)


def _columns(flight):
    """Zeros, then each number behind a draw alone."""
    t, c = flight.observed.shape
    shapes = ((flight.starts,), (t, flight.latent.size), (t, c), (t, c))
    sizes = [int(np.prod(s)) for s in shapes]
    eye = np.concatenate([np.zeros((sum(sizes), 1)), np.eye(sum(sizes))], axis=1)
    return Normals(*(a.reshape(*s, -1) for a, s in zip(np.split(eye, np.cumsum(sizes)[:-1]), shapes, strict=True)))


def test_drawn_unknowns_have_the_conditional_law(linear, straight):
    """Draws are linear in their numbers: mean and covariance are read off exactly."""
    mean, covariance = linear.matrices.posterior(linear.flight, linear.hyper, linear.priors)
    theta = np.asarray(straight.theta(jnp.asarray(POINT[:, None])))[:, 0]
    gain = np.linalg.solve(covariance[:2, :2], covariance[:2, 2:]).T
    wanted = mean[2:] + gain @ (theta - mean[:2])
    spread = covariance[2:, 2:] - gain @ covariance[:2, 2:]
    numbers = _columns(linear.flight)
    count = numbers.start.shape[-1]
    drawn = draw_unknowns(straight, np.repeat(POINT[:, None], count, axis=1), (numbers,))[0]
    error = np.asarray(latent.disturbances(linear.hyper.dynamics(linear.flight), drawn.shocks))
    dense = np.concatenate([drawn.start, error.reshape(-1, count)])
    se = np.sqrt(np.diag(spread))
    np.testing.assert_allclose(dense[:, 0] / se, wanted / se, atol=1e-5)
    root = dense[:, 1:] - dense[:, :1]
    np.testing.assert_allclose(root @ root.T / np.outer(se, se), spread / np.outer(se, se), atol=1e-6)
    # The shocks, of which two make one disturbance: the identity less what the data tell.
    _, _, by = linear.matrices.model(linear.flight)
    each = jnp.eye(60 * 4).reshape(60, 4, -1)
    shocks = np.asarray(latent.disturbances(linear.hyper.dynamics(linear.flight), each)).reshape(120, -1)
    by_z = np.concatenate([by[:, 2:4], by[:, 4:] @ shocks], axis=1)
    r, _, _ = linear.matrices.covariances(linear.flight, linear.hyper, linear.priors)
    left = np.eye(len(by_z.T)) - by_z.T @ np.linalg.solve(r + by_z @ by_z.T, by_z)
    z = np.concatenate([drawn.start, np.asarray(drawn.shocks).reshape(240, count)])
    np.testing.assert_allclose((z[:, 1:] - z[:, :1]) @ (z[:, 1:] - z[:, :1]).T, left, atol=1e-8)


def test_drawn_unknowns_under_other_noise_have_its_conditional_law(linear, straight):
    """Noise parameters of a draw's own: the dense conditional law under those."""
    law = Hyper(jax.tree.map(lambda a: 1.5 * a, linear.hyper.noise), (np.array([0.3, 4.0]), np.array([0.5, 0.5, 0.3])))
    mean, covariance = linear.matrices.posterior(linear.flight, law, linear.priors)
    theta = np.asarray(straight.theta(jnp.asarray(POINT[:, None])))[:, 0]
    gain = np.linalg.solve(covariance[:2, :2], covariance[:2, 2:]).T
    wanted, spread = mean[2:] + gain @ (theta - mean[:2]), covariance[2:, 2:] - gain @ covariance[:2, 2:]
    numbers = _columns(linear.flight)
    count = numbers.start.shape[-1]
    drawn = draw_unknowns(straight, np.repeat(POINT[:, None], count, axis=1), (numbers,), law)[0]
    error = np.asarray(course(linear.flight, law, drawn).error).reshape(-1, count)
    dense, se = np.concatenate([drawn.start, error]), np.sqrt(np.diag(spread))
    np.testing.assert_allclose(dense[:, 0] / se, wanted / se, atol=1e-5)
    root = (dense[:, 1:] - dense[:, :1]) / se[:, None]
    np.testing.assert_allclose(root @ root.T, spread / np.outer(se, se), atol=1e-6)


def test_drawn_unknowns_of_a_descent_fit_their_data(descent, falling):
    """Cost at a draw: half as many squares as data and unknowns, on the whole; the conditional mean has fewer."""
    rng, xi = np.random.default_rng(3), np.zeros((1, 64))
    numbers = tuple(normals(f, 64, rng) for f in descent.flights)
    assert [a.shape for a in numbers[0]] == [(1, 64), (101, 1, 64), (101, 1, 64), (101, 1, 64)]
    theta = falling.theta(jnp.asarray(xi))
    still = draw_unknowns(falling, xi, jax.tree.map(np.zeros_like, numbers))
    for flight, u, v in zip(descent.flights, draw_unknowns(falling, xi, numbers), still, strict=True):
        twice = 2.0 * np.asarray(cost(flight, descent.hyper, theta, u))
        least = 2.0 * np.asarray(cost(flight, descent.hyper, theta, v))
        free = u.start.shape[0] + u.shocks[..., 0].size
        assert twice.mean() - least.mean() == pytest.approx(free, abs=4.0 * np.sqrt(2.0 * free / 64))
        assert np.ptp(least) < 1e-9 * least.mean()


def test_two_flights_share_their_parameters(descent, falling):
    each = [[f] for f in descent.flights]
    best = [fit(f, descent.hyper, descent.priors, descent.theta, tolerance=1e-4) for f in each]
    alone = [marginalise(f, descent.hyper, descent.priors, b) for f, b in zip(each, best, strict=True)]
    precision = sum(1.0 / float(m.scale[0, 0]) ** 2 for m in alone) - 1.0 / descent.priors[0].scale ** 2
    assert float(falling.scale[0, 0]) == pytest.approx(precision**-0.5, rel=0.02)


def test_a_failed_simulation_is_nan_and_leaves_the_rest(falling):
    xi = np.array([[0.0, 1e6, 0.3, 150.0, 0, 0]])
    made = np.asarray(log_density(falling, xi))
    assert np.isnan(made[1]) and np.isfinite(made[[0, 2, 4, 5]]).all()
    np.testing.assert_allclose(made[2], np.asarray(log_density(falling, np.where(xi == 1e6, 0.0, xi)))[2], rtol=1e-12)
