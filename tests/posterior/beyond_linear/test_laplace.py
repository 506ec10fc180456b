"""Laplace's approximation at points against dense Gaussians and exact optima."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.likelihood.joint import latent_path_of
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior.beyond_linear import laplace
from bayeschute.posterior.beyond_linear.laplace import at
from bayeschute.posterior.joint_mode import fit

POINT = np.array([1.3, -0.4])  # standard coordinates away from the optimum


def test_it_is_the_dense_marginal_density_where_all_is_linear(linear, straight):
    """And its flights are the dense conditional means."""
    flight, hyper, priors = linear.flight, linear.hyper, linear.priors
    mean, covariance = linear.matrices.posterior(flight, hyper, priors)
    gain = np.linalg.solve(covariance[:2, :2], covariance[:2, 2:]).T
    constant = -0.5 * flight.present.sum() * np.log(2.0 * np.pi)
    for xi in (np.zeros(2), POINT, np.array([-3.0, 2.0])):
        theta = np.asarray(straight.theta(xi))
        off = np.array([(t - p.centre) / p.scale for t, p in zip(theta, priors, strict=True)])
        made = at(straight, xi)
        wanted = linear.matrices.given_theta(flight, hyper, theta) - 0.5 * off @ off
        assert constant - made.square - made.determinant == pytest.approx(wanted, abs=1e-7)
        (there,) = made.flights
        found = np.concatenate([there.unknowns.start, np.asarray(there.error).ravel()])
        np.testing.assert_allclose(found, mean[2:] + gain @ (theta - mean[:2]), atol=1e-8)


@pytest.mark.parametrize("xi", [-1.0, 1.0])
def test_the_squares_are_those_of_the_exact_optimum(gusty, xi):
    """Of a fit with the parameter held."""
    flight, hyper, priors, made, _ = gusty
    cost = []
    for theta in np.asarray(made.theta(np.array([[0.0, xi]])))[0]:
        held = [Prior("felt", float(theta), 1e-7, False, "1", "held")]
        best = fit([flight], hyper, held, np.array([theta]), tolerance=1e-4)
        cost.append(best.cost + 0.5 * ((theta - priors[0].centre) / priors[0].scale) ** 2)
    ours = at(made, np.array([xi]))
    assert ours.square - at(made, np.zeros(1)).square == pytest.approx(cost[1] - cost[0], abs=2e-3)
    assert abs(cost[1] - cost[0]) > 0.2
    np.testing.assert_allclose(ours.flights[0].unknowns.process_noise, best.unknowns[0].process_noise, atol=0.01)
    np.testing.assert_allclose(ours.flights[0].error, latent_path_of(flight, hyper, ours.flights[0].unknowns).error)


def test_two_steps_together_lead_to_what_is_found_there(falling):
    """After Gauss-Newton steps; not from where neither led, nor with the mean correction of one of them only."""
    half = np.array([0.5])
    here, step, there = at(falling, 0.0 * half), at(falling, half), at(falling, 2.0 * half)

    def error(one, other):
        found = laplace.at_corner(falling, here, one, other, 2.0 * half, np.ones(2, bool))
        return abs(found.square - there.square), abs(found.determinant - there.determinant)

    square, determinant = error(step, step)
    assert square < 2e-6 and determinant < 2e-6
    assert error(here, here)[0] > 10.0 * square
    assert error(step._replace(means=here.means), step)[0] > 10.0 * square
