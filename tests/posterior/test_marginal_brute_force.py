"""The marginal posterior and its draws against integrals by brute force, where a flight bends and few samples are seen."""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np
import pytest

from bayeschute.likelihood import mean_correction
from bayeschute.likelihood.joint import Unknowns, cost
from bayeschute.likelihood.simulation_smoother import normals
from bayeschute.posterior.beyond_linear import laplace
from bayeschute.posterior.beyond_linear.comparison import compared
from bayeschute.posterior.beyond_linear.linear_errors import linear_errors
from bayeschute.posterior.beyond_linear.polynomials import corrected
from bayeschute.posterior.joint_mode import fit
from bayeschute.posterior.marginal import (
    Quadratic,
    draw_flights,
    log_density,
    marginalise,
    mean_correction_slope,
)


@pytest.fixture(scope="module")
def made(short):
    """Its marginal posterior, the determinant held constant."""
    flight, hyper, priors = short
    best = fit([flight], hyper, priors, np.array([np.log(0.2)]), tolerance=1e-4)
    return marginalise([flight], hyper, priors, best)


def test_a_descent_against_brute_force_integration(short, made, quadrature):
    """The integral over six unknowns; without the determinant the marginal is visibly wrong, with it right."""
    flight, hyper, priors = short
    tilt = replace(made, determinant=Quadratic(linear_errors(made).slope, np.zeros((1, 1))))
    right, _ = corrected(made)
    grid = np.linspace(-2.0, 2.0, 5)
    theta = np.asarray(made.theta(grid[None]))
    prior = -0.5 * ((theta[0] - priors[0].centre) / priors[0].scale) ** 2
    wanted = np.array([quadrature.integrated(flight, hyper, t)[0] for t in theta.T]) + prior
    error = {}
    for name, marginal in (("without", made), ("slope", tilt), ("with", right)):
        ours = np.asarray(log_density(marginal, grid[None]))
        error[name] = np.abs((ours - ours[2]) - (wanted - wanted[2])).max()
    assert error["with"] < 0.02 and error["slope"] < 0.03 and error["without"] > 0.2, error
    assert np.ptp(wanted) > 1.5  # it isn't flat
    # What its polynomials leave is told.
    xi = np.random.default_rng(0).standard_normal((8, 1))
    assert np.abs(compared(right, xi).errors).max() < 0.02 and np.abs(compared(made, xi).errors).max() > 0.1


def test_the_gap_is_what_the_exact_hessian_adds_to_that_of_a_linear_model(bent, quadrature, monkeypatch):
    """Gusts of which the data tell little, through a square: Laplace's integral with all second derivatives."""
    flight, hyper, priors = bent
    monkeypatch.setattr(mean_correction, "_PAIRS", 512)  # 32 leave a standard error of 0.014 to the slope
    monkeypatch.setattr(mean_correction, "_FEW", 128)
    made = marginalise([flight], hyper, priors, fit([flight], hyper, priors, np.array([1.0]), tolerance=1e-4))
    grid = np.array([-1.0, 0.0, 1.0])
    theta = np.asarray(made.theta(grid[None]))
    prior, wanted = -0.5 * ((theta[0] - 1.0) / 2.0) ** 2, []
    for t in theta.T:
        at, hessian = quadrature.exact_optimum(flight, hyper, t)
        least = float(cost(flight, hyper, t, Unknowns(at[:1], at[1:, None])))
        wanted.append(-least - 0.5 * np.linalg.slogdet(hessian)[1])
    wanted = np.array(wanted) + prior

    def off(marginal):
        """Slope and curvature that are missing."""
        ours = np.asarray(log_density(corrected(marginal)[0], grid[None]))
        left = ours - ours[1] - wanted + wanted[1]
        return np.array([0.5 * (left[2] - left[0]), left[2] + left[0]])

    with_gap = off(made)
    flat = replace(
        made,
        along=tuple(a._replace(mean_correction=jax.tree.map(np.zeros_like, a.mean_correction)) for a in made.along),
    )
    monkeypatch.setattr(laplace, "_mean_correction", lambda flight, hyper, along, *_: along.mean_correction)
    without = off(flat)
    assert abs(without[0]) > 0.02 and abs(with_gap[0]) < 0.5 * abs(without[0]), (with_gap, without)
    assert abs(with_gap[1]) < 0.05


def test_the_slope_that_the_search_is_told_of_is_that_of_the_density(bent):
    flight, hyper, priors = bent
    made = marginalise([flight], hyper, priors, fit([flight], hyper, priors, np.array([1.0]), tolerance=1e-4))
    flat = replace(
        made,
        along=tuple(a._replace(mean_correction=jax.tree.map(np.zeros_like, a.mean_correction)) for a in made.along),
    )
    told = float(mean_correction_slope(made)[0] * np.asarray(made.scale)[0, 0])
    ends = [float(np.diff(np.asarray(log_density(m, np.array([[-0.01, 0.01]]))))[0]) / 0.02 for m in (made, flat)]
    assert told == pytest.approx(ends[1] - ends[0], rel=0.02) and abs(told) > 0.01


def test_draws_of_a_descent_have_the_moments_of_brute_force_integration(short, made, quadrature):
    flight, hyper, priors = short
    theta, draws = np.asarray(made.theta(np.array([[1.0]])))[:, 0], 4000
    _, mean, covariance = quadrature.integrated(flight, hyper, theta)
    numbers = (normals(flight, draws, np.random.default_rng(1)),)
    u = draw_flights(made, np.ones((1, draws)), numbers)[0].unknowns
    drawn, sd = np.concatenate([u.start, np.asarray(u.process_noise)[:, 0]]), np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((drawn.mean(axis=1) - mean) / sd, 0.0, atol=4.0 / np.sqrt(draws))
    np.testing.assert_allclose((np.cov(drawn) - covariance) / np.outer(sd, sd), 0.0, atol=6.0 / np.sqrt(draws))


def test_draws_follow_the_full_equations_far_from_the_linearisation(short, made, quadrature):
    """Three standard deviations off, a draw without random numbers is still at the exact conditional optimum."""
    flight, hyper, priors = short
    xi = np.array([[-3.0, 3.0]])
    still = (jax.tree.map(np.zeros_like, normals(flight, 2, np.random.default_rng(0))),)
    theta = np.asarray(made.theta(xi))
    costs = np.asarray(cost(flight, hyper, theta, draw_flights(made, xi, still)[0].unknowns))
    for got, t in zip(costs, theta.T, strict=True):
        at = quadrature.exact_optimum(flight, hyper, t)[0]
        least = float(cost(flight, hyper, t, Unknowns(at[:1], at[1:, None])))
        assert -1e-9 < got - least < 0.01  # 0.06 if the linear model were trusted
