"""The marginal posterior and its draws against integrals by brute force, where a flight bends and few samples are seen."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np
import pytest

from bayeschute.dynamics.descent import DescentInputs
from bayeschute.inference.drawing import normals
from bayeschute.inference.map import fit
from bayeschute.inference.marginal import (
    Determinant,
    determinant_around,
    determinant_error,
    determinant_slope,
    draw_unknowns,
    gap_slope,
    log_density,
    marginalise,
)
from bayeschute.inference.noise import Noise
from bayeschute.inference.priors import Prior
from bayeschute.inference.target import Hyper, Unknowns, cost, course, residuals


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class BentFlight:
    """A `FlightModel` whose disturbance enters with its square as well: its mean is not the flight of the mean."""

    drive: Any

    def inputs(self):
        return self.drive

    def numbers(self, theta):
        return theta

    def initial(self, numbers, start):
        return start

    def advance(self, x, numbers, now, then, error_now, error_then):
        e = 0.5 * (error_now + error_then)
        return 0.8 * x + 0.3 * numbers + e + 0.2 * e**2

    def observe(self, x, numbers, now):
        return x


@pytest.fixture(scope="module")
def short(descent):
    """Five samples of a descent in strong gusts, seen sharply: its determinant depends on the drag."""
    flight, rng = descent.flights[0], np.random.default_rng(0)
    model = replace(flight.model, record=DescentInputs(np.zeros(5)))
    hyper = Hyper(Noise(*(np.array([x]) for x in (0.05, 0.05, 2.0))), (np.array([1.0, 3.0]),))
    empty = replace(flight, model=model, observed=np.zeros((5, 1)), present=np.ones((5, 1), bool))
    u = Unknowns(rng.standard_normal(1), rng.standard_normal((5, 1)))
    from_truth = -np.asarray(residuals(empty, descent.theta, course(empty, hyper, u)))
    observed = from_truth + 0.05 * rng.standard_normal((5, 1))
    return replace(empty, observed=observed), hyper, [replace(descent.priors[0], centre=np.log(0.2))]


@pytest.fixture(scope="module")
def made(short):
    """Its marginal posterior, the determinant held constant."""
    flight, hyper, priors = short
    best = fit([flight], hyper, priors, np.array([np.log(0.2)]), tolerance=1e-4)
    return marginalise([flight], hyper, priors, best)


@jax.jit
def _bent(x, flight, hyper, theta):
    """Gradient and Hessian of the cost by start and shocks (6,)."""

    def slope(x):
        return jax.grad(lambda x: cost(flight, hyper, theta, Unknowns(x[:1], x[1:, None])))(x)

    return slope(x), jax.jacfwd(slope)(x)


def _exact_optimum(flight, hyper, theta):
    """Start and shocks (6,) of least cost, by Newton's method, and the Hessian there."""
    at = np.zeros(6)
    for _ in range(20):
        gradient, hessian = _bent(at, flight, hyper, theta)
        at = at - np.linalg.solve(hessian, gradient)
    np.testing.assert_allclose(gradient, 0.0, atol=1e-8)
    return at, hessian


def _integrated(flight, hyper, theta, nodes=5):
    """Integrals of exp(-cost) over start and shocks by Gauss-Hermite rules about the exact optimum.

    Returns the logarithm of the integral, and mean and covariance of (start, shocks).
    """
    at, hessian = _exact_optimum(flight, hyper, theta)
    lower = np.linalg.cholesky(hessian)
    x, w = np.polynomial.hermite_e.hermegauss(nodes)
    z = np.stack(np.meshgrid(*[x] * 6, indexing="ij")).reshape(6, -1)
    weight = np.prod(np.stack(np.meshgrid(*[w] * 6, indexing="ij")), axis=0).ravel()
    points = at[:, None] + np.linalg.solve(lower.T, z)
    many = Unknowns(points[:1], points[1:, None])
    minus = np.asarray(cost(flight, hyper, np.broadcast_to(theta[:, None], (1, z.shape[1])), many))
    logs = np.log(weight) + 0.5 * np.sum(z**2, axis=0) - minus
    total = np.logaddexp.reduce(logs)
    share = np.exp(logs - total)
    mean = points @ share
    covariance = (points - mean[:, None]) * share @ (points - mean[:, None]).T
    return total - np.log(np.diag(lower)).sum(), mean, covariance


def test_a_descent_against_brute_force_integration(short, made):
    """The integral over six unknowns; without the determinant the marginal is visibly wrong, with it right."""
    flight, hyper, priors = short
    tilt = replace(made, determinant=Determinant(determinant_slope(made), np.zeros(1)))
    right = replace(made, determinant=determinant_around(made))
    grid = np.linspace(-2.0, 2.0, 5)
    theta = np.asarray(made.theta(grid[None]))
    prior = -0.5 * ((theta[0] - priors[0].centre) / priors[0].scale) ** 2
    wanted = np.array([_integrated(flight, hyper, t)[0] for t in theta.T]) + prior
    error = {}
    for name, marginal in (("without", made), ("slope", tilt), ("with", right)):
        ours = np.asarray(log_density(marginal, grid[None]))
        error[name] = np.abs((ours - ours[2]) - (wanted - wanted[2])).max()
    assert error["with"] < 0.02 and error["slope"] < 0.03 and error["without"] > 0.2, error
    assert np.ptp(wanted) > 1.5  # it isn't flat
    # What its polynomial leaves of the determinant is told.
    assert determinant_error(right, 8, np.random.default_rng(0)) < 0.01
    assert determinant_error(made, 8, np.random.default_rng(0)) > 0.05


def test_the_mean_of_a_bent_flight_is_not_the_flight_of_the_mean(descent):
    """Gusts of which the data tell little, through a square: without the gap the parameter makes up for their mean."""
    rng, priors = np.random.default_rng(3), [Prior("drive", 1.0, 2.0, False, "1", "test")]
    hyper = Hyper(Noise(*(np.array([x]) for x in (0.3, 0.3, 2.0))), (np.array([0.8, 3.0]),))
    model, present = BentFlight(np.zeros(5)), np.ones((5, 1), bool)
    flight = replace(
        descent.flights[0], model=model, observed=np.zeros((5, 1)), present=present, start_scale=np.array([0.2])
    )
    u = Unknowns(rng.standard_normal(1), rng.standard_normal((5, 1)))
    seen = -np.asarray(residuals(flight, np.array([1.0]), course(flight, hyper, u)))
    flight = replace(flight, observed=seen + 0.3 * rng.standard_normal((5, 1)))
    made = marginalise([flight], hyper, priors, fit([flight], hyper, priors, np.array([1.0]), tolerance=1e-4))
    made = replace(made, determinant=determinant_around(made))
    flat = replace(made, along=tuple(along._replace(gap=0.0 * along.gap) for along in made.along))
    grid = np.array([-1.0, 0.0, 1.0])
    theta = np.asarray(made.theta(grid[None]))
    prior = -0.5 * ((theta[0] - 1.0) / 2.0) ** 2
    wanted = np.array([_integrated(flight, hyper, t)[0] for t in theta.T]) + prior
    slopes = {}
    for name, marginal in (("with", made), ("without", flat)):
        ours = np.asarray(log_density(marginal, grid[None]))
        slopes[name] = 0.5 * float(ours[2] - ours[0] - (wanted[2] - wanted[0]))
    assert abs(slopes["without"]) > 0.01 and abs(slopes["with"]) < 0.25 * abs(slopes["without"]), slopes
    # The slope that the search for the mode is told of is that of the density.
    told = float(gap_slope(made)[0] * np.asarray(made.scale)[0, 0])
    ends = [float(np.diff(np.asarray(log_density(m, np.array([[-0.01, 0.01]]))))[0]) / 0.02 for m in (made, flat)]
    assert told == pytest.approx(ends[1] - ends[0], rel=0.02)


def test_draws_of_a_descent_have_the_moments_of_brute_force_integration(short, made):
    flight, hyper, priors = short
    theta, draws = np.asarray(made.theta(np.array([[1.0]])))[:, 0], 4000
    _, mean, covariance = _integrated(flight, hyper, theta)
    numbers = (normals(flight, draws, np.random.default_rng(1)),)
    u = draw_unknowns(made, np.ones((1, draws)), numbers)[0]
    drawn, sd = np.concatenate([u.start, np.asarray(u.shocks)[:, 0]]), np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((drawn.mean(axis=1) - mean) / sd, 0.0, atol=4.0 / np.sqrt(draws))
    np.testing.assert_allclose((np.cov(drawn) - covariance) / np.outer(sd, sd), 0.0, atol=6.0 / np.sqrt(draws))


def test_draws_follow_the_full_equations_far_from_the_linearisation(short, made):
    """Three standard deviations off, a draw without random numbers is still at the exact conditional optimum."""
    flight, hyper, priors = short
    xi = np.array([[-3.0, 3.0]])
    still = (jax.tree.map(np.zeros_like, normals(flight, 2, np.random.default_rng(0))),)
    theta = np.asarray(made.theta(xi))
    costs = np.asarray(cost(flight, hyper, theta, draw_unknowns(made, xi, still)[0]))
    for got, t in zip(costs, theta.T, strict=True):
        at = _exact_optimum(flight, hyper, t)[0]
        least = float(cost(flight, hyper, t, Unknowns(at[:1], at[1:, None])))
        assert -1e-9 < got - least < 0.01  # 0.06 if the linear model were trusted
