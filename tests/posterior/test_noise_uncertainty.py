"""What uncertain noise parameters do to the parameters: their mode's motion, their covariance's, and draws of both."""

from __future__ import annotations

from types import SimpleNamespace

import jax
import numpy as np
import pytest
import scipy.linalg

from bayeschute.core.trees import load_tree, save_tree
from bayeschute.likelihood import kalman_gradient
from bayeschute.posterior import noise_uncertainty
from bayeschute.posterior.beyond_linear.linear_errors import linear_errors
from bayeschute.posterior.joint_mode import fit
from bayeschute.posterior.marginal import marginalise
from bayeschute.posterior.noise_uncertainty import (
    NoiseEffect,
    joint_covariance,
    noise_parameter_slope,
    noise_parameter_spread,
    widened,
)

CHAINS, DRAWS = 4, 20_000


def _symmetric(rng, count, size, scale):
    square = scale * rng.standard_normal((count, size, size))
    return 0.5 * (square + np.swapaxes(square, 1, 2))


@pytest.fixture
def effect():
    """Of three noise parameters on two parameters."""
    rng = np.random.default_rng(0)
    return NoiseEffect(rng.standard_normal((2, 3)), _symmetric(rng, 3, 2, 0.5), _symmetric(rng, 1, 2, 0.2)[0])


@pytest.fixture
def covariance():
    root = 0.4 * np.random.default_rng(1).standard_normal((3, 3))
    return root @ root.T + 0.05 * np.eye(3)


def _mode(descent, hyper, theta):
    """The mode of the marginal posterior of two descents."""
    best = fit(descent.flights, hyper, descent.priors, theta, tolerance=1e-4)
    slope = linear_errors(marginalise(descent.flights, hyper, descent.priors, best)).slope
    tilt = np.linalg.solve(np.linalg.cholesky(best.covariance).T, slope)
    return fit(descent.flights, hyper, descent.priors, best.theta, best.unknowns, tolerance=1e-4, tilt=tilt)


def test_law_slope_is_the_motion_of_the_mode(descent):
    """Refitted with other noise parameters, the mode has moved by the slope."""
    at, best = kalman_gradient.to_vector(descent.hyper), _mode(descent, descent.hyper, descent.theta)
    slope = noise_parameter_slope(marginalise(descent.flights, descent.hyper, descent.priors, best))

    def mode(vector):
        hyper = jax.tree.map(np.asarray, kalman_gradient.from_vector(vector, descent.hyper))
        return _mode(descent, hyper, best.theta).theta[0]

    sd, step = np.sqrt(best.covariance[0, 0]), 0.1
    wanted = np.array([(mode(at + step * e) - mode(at - step * e)) / (2.0 * step * sd) for e in np.eye(5)])
    np.testing.assert_allclose(slope, wanted[None], atol=0.02 + 0.1 * np.abs(wanted).max())
    assert np.abs(wanted).max() > 0.2


def test_law_slope_goes_less_far_where_flights_fail(descent, fails_beyond):
    made = marginalise(descent.flights, descent.hyper, descent.priors, _mode(descent, descent.hyper, descent.theta))
    near = noise_parameter_slope(made, step=0.125)

    fails_beyond(noise_uncertainty, 0.2)
    np.testing.assert_allclose(noise_parameter_slope(made, step=0.5), near, rtol=1e-12)
    fails_beyond(noise_uncertainty, 0.01)
    with pytest.raises(FloatingPointError, match="beside the optimum"):
        noise_parameter_slope(made, step=0.5)


def test_law_spread_is_what_other_noise_parameters_make_of_the_covariance(descent):
    """Refitted with other noise parameters, the covariance has changed as told; gusts matter most."""
    at, best = kalman_gradient.to_vector(descent.hyper), _mode(descent, descent.hyper, descent.theta)
    sd, middle = 0.1, np.log(best.covariance[0, 0])
    spread, excess = noise_parameter_spread(
        marginalise(descent.flights, descent.hyper, descent.priors, best), sd**2 * np.eye(5)
    )

    def log_variance(vector):
        hyper = jax.tree.map(np.asarray, kalman_gradient.from_vector(vector, descent.hyper))
        return np.log(_mode(descent, hyper, best.theta).covariance[0, 0])

    up, down = (np.array([log_variance(at + sign * sd * e) for e in np.eye(5)]) - middle for sign in (1.0, -1.0))
    wanted = 0.5 * (up - down) / sd
    np.testing.assert_allclose(spread[:, 0, 0], wanted, atol=0.02 + 0.05 * np.abs(wanted).max())
    assert np.abs(wanted).max() > 0.5
    np.testing.assert_allclose(excess[0, 0], 0.5 * np.sum(up + down), atol=0.002)


def test_law_spread_of_matrices_that_are_known(monkeypatch):
    """Precisions whose logarithm in standard coordinates is quadratic in the noise parameters, not commuting."""
    rng = np.random.default_rng(3)
    parts, bent, prior = _symmetric(rng, 2, 3, 0.3), _symmetric(rng, 3, 3, 0.1), 9.0
    scale = np.tril(rng.standard_normal((3, 3))) + 2.0 * np.eye(3)
    inverse, covariance = np.linalg.inv(scale), np.array([[0.5, 0.2], [0.2, 0.3]])

    def information(flight, law, linear):
        square = law[0] ** 2 * bent[0] + law[1] ** 2 * bent[1] + law[0] * law[1] * bent[2]
        precision = inverse.T @ scipy.linalg.expm(np.tensordot(law, parts, 1) + square) @ inverse
        return linear * (precision - np.eye(3) / prior**2)

    monkeypatch.setattr(noise_uncertainty, "_information", information)
    monkeypatch.setattr(noise_uncertainty, "to_vector", lambda law: law)
    monkeypatch.setattr(noise_uncertainty, "from_vector", lambda vector, like: vector)
    made = SimpleNamespace(
        hyper=np.zeros(2), scale=scale, prior_factor=prior * np.eye(3), flights=("a", "b"),
        along=tuple(SimpleNamespace(linear=share, parameters=np.arange(3)) for share in (0.25, 0.75)),
    )  # fmt: skip
    spread, excess = noise_parameter_spread(made, covariance)
    np.testing.assert_allclose(spread, -parts, atol=1e-9)
    np.testing.assert_allclose(excess, -(0.5 * bent[0] + 0.3 * bent[1] + 0.2 * bent[2]), atol=1e-9)


def test_draws_are_stretched_by_half_the_logarithm_and_moved(effect):
    rng = np.random.default_rng(2)
    xi, off = rng.standard_normal((5, 2)), rng.standard_normal((5, 3))
    wanted = [
        scipy.linalg.expm(0.5 * (effect.excess + np.tensordot(d, effect.spread, 1))) @ x + effect.slope @ d
        for x, d in zip(xi, off, strict=True)
    ]
    np.testing.assert_allclose(effect.carried(xi, off), wanted, rtol=1e-12)
    np.testing.assert_allclose(effect.carried(xi[0], off[0]), wanted[0], rtol=1e-12)
    np.testing.assert_allclose(effect.carried(xi, off[0])[0], wanted[0], rtol=1e-12)
    calm = effect._replace(excess=0.0 * effect.excess)
    np.testing.assert_allclose(calm.carried(xi, np.zeros(3)), xi, rtol=1e-12)
    np.testing.assert_allclose(NoiseEffect.none(2, 3).carried(xi, off), xi, rtol=1e-12)
    np.testing.assert_allclose(effect.taken_back(effect.carried(xi, off), off), xi, rtol=1e-12)


def test_widened_draws_have_the_joint_covariance(effect, covariance):
    effect = effect._replace(spread=0.5 * effect.spread, excess=0.5 * effect.excess)
    xi = np.random.default_rng(4).standard_normal((CHAINS, DRAWS, 2))
    wide = widened(xi, effect, covariance, 1)
    np.testing.assert_array_equal(wide, widened(xi, effect, covariance, 1))
    wanted = joint_covariance(np.eye(2), effect, covariance)
    np.testing.assert_allclose(np.cov(wide.reshape(-1, 2).T), wanted, rtol=0.03, atol=0.03)
    np.testing.assert_allclose(wide.mean(axis=(0, 1)), 0.0, atol=0.03)
    scale = np.array([[2.0, 0.0], [1.0, 3.0]])
    np.testing.assert_allclose(joint_covariance(scale, effect, covariance), scale @ wanted @ scale.T)
    np.testing.assert_allclose(joint_covariance(scale, NoiseEffect.none(2, 3), covariance), scale @ scale.T)


def test_joint_covariance_is_exact_for_one_noise_parameter():
    """The mean of exp(d z), z normal, is exp(d^2 s^2 / 2), along every axis of the spread."""
    turn = scipy.linalg.expm(np.array([[0.0, -0.7], [0.7, 0.0]]))
    d, s = np.array([1.2, -0.8]), 0.6
    effect = NoiseEffect(np.array([[0.5], [2.0]]), (turn @ np.diag(d) @ turn.T)[None], np.zeros((2, 2)))
    wanted = turn @ np.diag(np.exp(0.5 * (d * s) ** 2)) @ turn.T + s**2 * effect.slope @ effect.slope.T
    np.testing.assert_allclose(joint_covariance(np.eye(2), effect, np.array([[s**2]])), wanted, rtol=1e-12)


def test_an_effect_is_stored_with_the_part_of_misfit_and_read_where_that_was_not_known_apart(effect, tmp_path):
    both = effect._replace(misfit=np.eye(2))
    for made in (effect, both):
        save_tree(tmp_path / "a.npz", made)
        back = load_tree(tmp_path / "a.npz", NoiseEffect)
        assert (back.misfit is None) == (made.misfit is None)
        np.testing.assert_array_equal(back.excess, made.excess)
    np.testing.assert_array_equal(back.misfit, np.eye(2))
