"""Starts and shocks follow the parameters: exactly where all is linear, and with the change of what they do elsewhere."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.inference import following
from bayeschute.inference.drawing import normals
from bayeschute.inference.following import felt, follow
from bayeschute.inference.map import fit
from bayeschute.inference.marginal import draw_unknowns, log_density, marginalise
from bayeschute.inference.noise import Noise
from bayeschute.inference.numpyro_model import log_likelihood
from bayeschute.inference.priors import Prior
from bayeschute.inference.target import Hyper, cost


@pytest.fixture(scope="module")
def gusty(descent, felt_flight):
    """Such a flight of 100 samples, and its marginal posterior before and after."""
    priors = [Prior("felt", 1.0, 1.0, False, "1", "test")]
    hyper = Hyper(Noise(*(np.array([x]) for x in (0.2, 0.2, 2.0))), (np.array([0.5, 3.0]),))
    nothing = np.zeros((100, 1))
    empty = replace(
        descent.flights[0], model=felt_flight(nothing[:, 0]), observed=nothing, present=nothing == 0.0, start_scale=np.array([0.2])
    )  # fmt: skip
    flight, _ = descent.simulate(empty, hyper, np.array([1.0]), 4)
    made = marginalise([flight], hyper, priors, fit([flight], hyper, priors, np.array([1.0]), tolerance=1e-4))
    return flight, hyper, priors, made, follow(made)


def test_nothing_changes_where_all_is_linear(linear):
    best = fit([linear.flight], linear.hyper, linear.priors, np.zeros(2), tolerance=1e-4)
    made = marginalise([linear.flight], linear.hyper, linear.priors, best)
    followed, xi = follow(made), np.random.default_rng(0).standard_normal((2, 6))
    for part in (*followed.along[0].pull, *followed.pull):
        np.testing.assert_allclose(part, 0.0, atol=1e-7)
    np.testing.assert_allclose(log_density(followed, xi), log_density(made, xi), atol=1e-7)


def test_residuals_are_felt_through_the_derivatives_of_the_outputs(linear):
    """``J' R^-1 r`` by dense matrices."""
    flight, hyper = linear.flight, linear.hyper
    made = marginalise([flight], hyper, linear.priors, fit([flight], hyper, linear.priors, np.zeros(2)))
    residual = np.random.default_rng(1).standard_normal((*flight.observed.shape, 3)) * flight.present[..., None]
    ours = felt(flight, hyper, made.along[0].linear, jnp.asarray(residual))
    _, _, by = linear.matrices.model(flight)
    r, _, _ = linear.matrices.covariances(flight, hyper, linear.priors)
    stacked = linear.matrices.dense.stack(residual, flight.present)
    np.testing.assert_allclose(ours.start, (by.T @ np.linalg.solve(r, stacked))[2:4], rtol=1e-8)
    assert ours.shocks.shape == (60, 4, 3)


def _profile(marginal, flight, hyper, xi):
    """Minus the least cost (K,) over start and shocks at standard coordinates (1, K)."""
    found = []
    for theta in np.asarray(marginal.theta(xi))[0]:
        held = [Prior("felt", float(theta), 1e-7, False, "1", "held")]
        found.append(-fit([flight], hyper, held, np.array([theta]), tolerance=1e-4).cost)
    return np.array(found)


def test_the_exact_profile_is_followed(gusty):
    """The density without its determinant is that of the exact optimum, whose curvature Gauss-Newton's is not."""
    flight, hyper, priors, made, followed = gusty
    xi = np.array([[-1.0, 0.0, 1.0]])
    theta = np.asarray(made.theta(xi))[0]
    wanted = _profile(made, flight, hyper, xi) - 0.5 * ((theta - priors[0].centre) / priors[0].scale) ** 2
    off = []
    for one in (made, followed):
        ours = np.asarray(log_density(one, xi))
        off.append(np.abs(ours - ours[1] - wanted + wanted[1]).max())
    assert off[0] > 0.08 and off[1] < 0.015, off


def test_draws_without_random_numbers_lie_at_the_exact_optimum(gusty):
    flight, hyper, _, made, followed = gusty
    xi, still = np.array([[-1.0, 1.0]]), (jax.tree.map(np.zeros_like, normals(gusty[0], 2, np.random.default_rng(0))),)
    least, theta = -_profile(made, flight, hyper, xi), np.asarray(made.theta(xi))
    above = [
        np.asarray(cost(flight, hyper, theta, draw_unknowns(one, xi, still)[0])) - least for one in (made, followed)
    ]
    assert (above[0] > 0.05).all() and (np.abs(above[1]) < 0.015).all(), above


def test_numpyro_is_told_the_same(gusty):
    *_, followed = gusty
    xi = np.array([[-1.0, 0.0, 1.0]])
    whole = np.asarray(log_density(followed, xi))
    z = (np.asarray(followed.theta(xi))[0] - 1.0) / 1.0
    ours = np.array([float(log_likelihood(followed)(jnp.asarray(t))) for t in np.asarray(followed.theta(xi)).T])
    np.testing.assert_allclose(ours - 0.5 * z**2 - (ours[1] - 0.5 * z[1] ** 2), whole - whole[1], atol=1e-8)


def test_the_step_is_shorter_where_flights_fail(gusty, fails_beyond):
    *_, made, followed = gusty
    fails_beyond(following, 0.3)
    near = follow(made)
    pull = np.asarray(followed.along[0].pull.shocks)
    np.testing.assert_allclose(near.along[0].pull.shocks, pull, atol=0.05 * np.abs(pull).max())
    fails_beyond(following, 0.1)
    with pytest.raises(FloatingPointError, match="follow the parameters"):
        follow(made)
