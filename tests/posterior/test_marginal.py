"""The marginal posterior against dense marginalisation and brute-force integration."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.likelihood import disturbances
from bayeschute.likelihood.joint import NoiseParameters, cost, latent_path_of, states, stepped
from bayeschute.likelihood.kalman import innovations
from bayeschute.likelihood.simulation_smoother import normals
from bayeschute.posterior import marginal
from bayeschute.posterior.joint_mode import fit
from bayeschute.posterior.marginal import (
    Quadratic,
    draw_flights,
    in_batches,
    latent_path_at,
    linear_residuals,
    log_density,
    marginalise,
    place_at,
    prior_residuals,
    projected_residuals,
    seen_along,
)
from bayeschute.posterior.numpyro_model import log_likelihood

POINT = np.array([1.3, -0.4])  # standard coordinates away from the optimum


def _flat(marginal):
    """The posterior whose determinant is held constant."""
    return replace(marginal, determinant=Quadratic.none(np.size(marginal.centre)))


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
        slope, curvature = (np.asarray(a) for a in made.correction)
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
    drawn, at = draw_flights(falling, xi, still), np.asarray(falling.theta(xi))
    costs = sum(np.asarray(cost(f, descent.hyper, at, x.unknowns)) for f, x in zip(descent.flights, drawn, strict=True))
    np.testing.assert_allclose(costs[:3], best, atol=0.01)


def test_drawn_unknowns_have_the_conditional_law(linear, straight, each_number):
    """Draws are linear in their numbers: mean and covariance are read off exactly."""
    mean, covariance = linear.matrices.posterior(linear.flight, linear.hyper, linear.priors)
    theta = np.asarray(straight.theta(jnp.asarray(POINT[:, None])))[:, 0]
    gain = np.linalg.solve(covariance[:2, :2], covariance[:2, 2:]).T
    wanted = mean[2:] + gain @ (theta - mean[:2])
    spread = covariance[2:, 2:] - gain @ covariance[:2, 2:]
    numbers = each_number(linear.flight)
    count = numbers.start.shape[-1]
    drawn, found, _ = draw_flights(straight, np.repeat(POINT[:, None], count, axis=1), (numbers,))[0]
    error = np.asarray(disturbances.disturbances(linear.hyper.dynamics(linear.flight), drawn.process_noise))
    np.testing.assert_allclose(found, error, atol=1e-12)
    dense = np.concatenate([drawn.start, error.reshape(-1, count)])
    se = np.sqrt(np.diag(spread))
    np.testing.assert_allclose(dense[:, 0] / se, wanted / se, atol=1e-5)
    root = dense[:, 1:] - dense[:, :1]
    np.testing.assert_allclose(root @ root.T / np.outer(se, se), spread / np.outer(se, se), atol=1e-6)
    # The process noise, of which two make one disturbance: the identity less what the data tell.
    _, _, by = linear.matrices.model(linear.flight)
    each = jnp.eye(60 * 4).reshape(60, 4, -1)
    process_noise = np.asarray(disturbances.disturbances(linear.hyper.dynamics(linear.flight), each)).reshape(120, -1)
    by_z = np.concatenate([by[:, 2:4], by[:, 4:] @ process_noise], axis=1)
    r, _, _ = linear.matrices.covariances(linear.flight, linear.hyper, linear.priors)
    left = np.eye(len(by_z.T)) - by_z.T @ np.linalg.solve(r + by_z @ by_z.T, by_z)
    z = np.concatenate([drawn.start, np.asarray(drawn.process_noise).reshape(240, count)])
    np.testing.assert_allclose((z[:, 1:] - z[:, :1]) @ (z[:, 1:] - z[:, :1]).T, left, atol=1e-8)


def test_drawn_unknowns_under_other_noise_have_its_conditional_law(linear, straight, each_number):
    """Noise parameters of a draw's own: the dense conditional law under those."""
    law = NoiseParameters(
        jax.tree.map(lambda a: 1.5 * a, linear.hyper.noise), (np.array([0.3, 4.0]), np.array([0.5, 0.5, 0.3]))
    )
    mean, covariance = linear.matrices.posterior(linear.flight, law, linear.priors)
    theta = np.asarray(straight.theta(jnp.asarray(POINT[:, None])))[:, 0]
    gain = np.linalg.solve(covariance[:2, :2], covariance[:2, 2:]).T
    wanted, spread = mean[2:] + gain @ (theta - mean[:2]), covariance[2:, 2:] - gain @ covariance[:2, 2:]
    numbers = each_number(linear.flight)
    count = numbers.start.shape[-1]
    drawn, found, path = draw_flights(straight, np.repeat(POINT[:, None], count, axis=1), (numbers,), law)[0]
    driven = latent_path_of(linear.flight, law, drawn)
    np.testing.assert_allclose(found, driven.error, atol=1e-12)
    np.testing.assert_allclose(path, states(linear.flight, np.repeat(theta[:, None], count, axis=1), driven), atol=1e-8)
    error = np.asarray(driven.error).reshape(-1, count)
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
    still = draw_flights(falling, xi, jax.tree.map(np.zeros_like, numbers))
    for flight, x, y in zip(descent.flights, draw_flights(falling, xi, numbers), still, strict=True):
        u = x.unknowns
        twice = 2.0 * np.asarray(cost(flight, descent.hyper, theta, u))
        least = 2.0 * np.asarray(cost(flight, descent.hyper, theta, y.unknowns))
        free = u.start.shape[0] + u.process_noise[..., 0].size
        # The paths nearly obey: repeated moves leave what is of second order of second order.
        _, defects = stepped(flight, theta, x.latent_path(flight, 1))
        assert np.abs(defects).max() < 0.02
        assert twice.mean() - least.mean() == pytest.approx(free, abs=4.0 * np.sqrt(2.0 * free / 64))
        assert np.ptp(least) < 1e-9 * least.mean()


def test_a_correction_that_runs_away_is_not_made(straight, monkeypatch):
    """Of one draw to numbers without sense, of another to none: they stay as the linear model drew them."""
    (flight,), xi = straight.flights, np.zeros((2, 5))
    numbers, usual, calls = (normals(flight, 5, np.random.default_rng(0)),), marginal.drawn, []

    def strays(*given):
        made = usual(*given)
        calls.append(made)
        lost = jnp.array([0.0, 1e7, 0.0, jnp.nan, 0.0]) if len(calls) > 1 else 0.0
        noise = made.unknowns.process_noise + lost
        return made._replace(unknowns=made.unknowns._replace(process_noise=noise))

    whole = draw_flights(straight, xi, numbers)[0]
    monkeypatch.setattr(marginal, "drawn", strays)
    found = draw_flights(straight, xi, numbers)[0]
    assert len(calls) == 2
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(whole), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-6)  # all is linear: the correction of a sound draw is nothing


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


def test_batches_are_joined_and_padding_dropped():
    xi = np.arange(2.0 * 70).reshape(2, 70)
    seen = []
    made = in_batches(lambda part: (seen.append(part.shape), part.sum(axis=0))[1], xi)
    np.testing.assert_array_equal(made, xi.sum(axis=0))
    assert seen == [(2, 64), (2, 64)]


def test_flights_follow_the_parameters_on_the_dense_conditional_means(linear, straight, flown):
    """Where all is linear start, process noise, disturbances and path of every point are those of its own optimum."""
    mean, covariance = linear.matrices.posterior(linear.flight, linear.hyper, linear.priors)
    gain = np.linalg.solve(covariance[:2, :2], covariance[:2, 2:]).T
    xi, (along,) = np.stack([POINT, -2.0 * POINT], axis=1), straight.along
    theta = np.asarray(straight.theta(xi))
    shift = jnp.asarray(theta - np.asarray(straight.centre)[:, None])
    many = place_at(linear.flight, along, shift)
    for b in range(2):
        at = place_at(linear.flight, along, shift[:, b])
        jax.tree.map(lambda a, c, b=b: np.testing.assert_allclose(a, c[..., b], atol=1e-12), at, many)
        found = np.concatenate([at.unknowns.start, np.asarray(at.error).ravel()])
        np.testing.assert_allclose(found, mean[2:] + gain @ (theta[:, b] - mean[:2]), atol=1e-5)
        own = flown(linear.flight, linear.hyper, theta[:, b], at.unknowns)
        np.testing.assert_allclose(at.path, own.path, atol=1e-9)
        np.testing.assert_allclose(at.error, own.error, atol=1e-12)
    driven = latent_path_at(linear.flight, along, shift)
    np.testing.assert_allclose(driven.start, linear.flight.start_scale[:, None] * many.unknowns.start)
    np.testing.assert_array_equal(driven.path, many.path)


def test_what_is_seen_does_not_hang_on_the_path_where_all_is_linear(linear, straight):
    """Innovations at a point from its own path, or from another with the defects that it has."""
    flight, (along,) = linear.flight, straight.along
    theta = jnp.asarray(straight.theta(POINT[:, None]))
    shift = theta - jnp.asarray(straight.centre)[:, None]
    driven = latent_path_at(flight, along, shift)
    away = 0.3 * np.random.default_rng(6).standard_normal(driven.path.shape)
    unit = []
    for one in (driven, driven._replace(path=driven.path + away)):
        residual, defects = stepped(flight, theta, one)
        seen = seen_along(along, residual, defects, shift)
        unit.append(np.asarray(innovations(along.gains, *seen)))
    np.testing.assert_allclose(unit[1], unit[0], atol=1e-8)


def test_the_optimum_is_next_to_the_place_it_is_asked_for_at(linear):
    """From a path that is anything but a flight, where all is linear: its own conditional optimum."""
    best = fit([linear.flight], linear.hyper, linear.priors, np.zeros(2), tolerance=1e-6)
    (at,) = best.flights
    rng = np.random.default_rng(8)
    path = at.path + 0.3 * rng.standard_normal(at.path.shape)
    process_noise = at.unknowns.process_noise + rng.standard_normal(at.unknowns.process_noise.shape)
    lost = at._replace(path=path, unknowns=at.unknowns._replace(process_noise=process_noise))
    (found,) = marginalise([linear.flight], linear.hyper, linear.priors, replace(best, flights=(lost,))).along
    np.testing.assert_allclose(found.at.unknowns.process_noise, at.unknowns.process_noise, atol=1e-5)
    np.testing.assert_allclose(found.at.path, at.path, atol=1e-5)
    np.testing.assert_allclose(found.linear.defects, 0.0, atol=1e-9)


def test_no_place_is_out_of_range_where_all_is_linear(straight):
    """The centre among them."""
    xi = np.concatenate([np.zeros((2, 1)), 5.0 * np.random.default_rng(9).standard_normal((2, 5))], axis=1)
    rows = np.asarray(projected_residuals(straight, xi))
    inside, prices = linear_residuals(straight, xi)
    np.testing.assert_array_equal(np.concatenate([inside, prices]), rows)
    assert not np.any(prices)
    size = straight.flights[0].observed.size
    assert len(rows) == size + 1 + 2
    np.testing.assert_array_equal(rows[-1], 0.0)


def test_places_where_innovations_bend_too_far_are_dear(straight):
    """Against a linear model to which the parameters are nothing, though the flight follows them."""
    (along,) = straight.along
    unit = jnp.concatenate([along.unit[..., :1], 1e-12 * along.unit[..., 1:]], axis=2)
    short = replace(straight, along=(along._replace(unit=unit),))
    xi = np.stack([POINT, -2.0 * POINT], axis=1)
    shift = np.asarray(straight.scale) @ xi
    square = np.sum(np.einsum("tcp,pb->tcb", along.unit[..., 1:], shift) ** 2, axis=(0, 1))
    beyond = square - 0.05 * (np.sum(xi**2, axis=0) + 1e-3)
    price = beyond + 0.025 * beyond**2
    np.testing.assert_allclose(log_density(straight, xi) - log_density(short, xi), price, rtol=1e-6)
    assert np.all(np.asarray(linear_residuals(short, xi)[1]) > 0.0)


def test_batches_side_by_side_are_those_one_after_the_other():
    xi = np.random.default_rng(4).standard_normal((3, 11))
    one, other = (in_batches(lambda part: np.cumsum(part, axis=0) ** 2, xi, 4, side) for side in (False, True))
    np.testing.assert_array_equal(one, np.cumsum(xi, axis=0) ** 2)
    np.testing.assert_array_equal(one, other)


def test_law_the_density_does_not_rise_without_bound_where_its_corrections_fall(straight):
    """Along an axis on which the polynomial outweighs the squares; within its reach the density is what it was."""
    bent = replace(straight, bend=Quadratic(np.zeros(2), np.diag([-1.4, 0.0])))
    away = np.array([[0.0, 2.0, 5.0, 20.0, 100.0, 1000.0], np.zeros(6)])
    held, free = np.asarray(log_density(bent, away)), np.asarray(log_density(straight, away))
    np.testing.assert_allclose(held[:3] - free[:3], 0.7 * away[0, :3] ** 2, atol=1e-9)
    assert held[1] > held[0]  # as on the way to another place
    np.testing.assert_allclose(held[3:] - free[3:], 0.7 * (4.0 + 2.0**0.5) ** 2, rtol=1e-9)
    assert (np.diff(held[2:]) < 0.0).all() and held[-1] < held[0] - 1e4
    np.testing.assert_allclose(bent.followed(away)[0, 3:], 4.0 + 2.0**0.5)
    np.testing.assert_array_equal(bent.followed(away)[:, :3], away[:, :3])
    ours = np.array([float(log_likelihood(bent)(jnp.asarray(t))) for t in np.asarray(bent.theta(away)).T])
    before = -0.5 * np.sum(prior_residuals(bent, away) ** 2, axis=0)
    np.testing.assert_allclose(ours + before - ours[0] - before[0], held - held[0], rtol=1e-9, atol=1e-9)
    slope = jax.grad(log_likelihood(bent))(jnp.asarray(np.asarray(bent.theta(np.zeros((2, 1))))[:, 0]))
    assert np.isfinite(slope).all()


def test_a_correction_that_grows_is_followed_however_far(straight):
    """What keeps a walk from a place is not forgotten there; of two axes, one each."""
    grown = replace(straight, bend=Quadratic(np.zeros(2), np.diag([0.6, -0.6])))
    away = np.array([[0.0, 20.0, 0.0, 20.0], [0.0, 0.0, 20.0, 10.0]])
    found = np.asarray(log_density(straight, away) - log_density(grown, away))
    end = 0.3 * (4.0 + 2.0**0.5) ** 2
    np.testing.assert_allclose(found, [0.0, 0.3 * 400.0, -end, 0.3 * (400.0 - 100.0)], atol=1e-9)
