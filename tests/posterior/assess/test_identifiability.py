"""What a record tells: eigenvectors, correlations and sensitivities where all is known in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayeschute.likelihood.joint import NoiseParameters
from bayeschute.likelihood.kalman_gradient import to_vector
from bayeschute.likelihood.noise import Noise
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior.assess.identifiability import (
    confounding,
    directions,
    in_words,
    noise_parameter_labels,
    power_scaling,
)
from bayeschute.posterior.assess.identifiability_result import SENSITIVE
from bayeschute.posterior.joint_mode import fit
from bayeschute.posterior.marginal import Quadratic, marginalise
from bayeschute.posterior.noise_uncertainty import NoiseEffect


def _priors(scales):
    return [Prior(f"p{i}", 0.3 * i, float(s), False, "1", "") for i, s in enumerate(scales)]


@pytest.fixture(scope="module")
def straight(linear):
    """The linear flight's marginal posterior, with a log determinant that isn't flat."""
    flights = [linear.flight]
    best = fit(flights, linear.hyper, linear.priors, np.zeros(2), tolerance=1e-6)
    made = marginalise(flights, linear.hyper, linear.priors, best)
    return best, replace(made, determinant=Quadratic(np.array([0.3, -0.1]), np.diag([0.05, 0.02])))


def test_directions_are_those_of_the_fisher_matrix_in_prior_standard_deviations():
    rng, scale = np.random.default_rng(4), np.array([0.5, 2.0, 10.0, 1.0])
    root = rng.standard_normal((6, 4)) / scale
    fisher = root.T @ root
    found = directions(np.linalg.inv(fisher + np.diag(1.0 / scale**2)), _priors(scale))
    scaled = scale[:, None] * fisher * scale
    told = np.array([d.information for d in found])
    assert (np.diff(told) > 0.0).all()
    np.testing.assert_allclose(told, np.linalg.eigvalsh(scaled), rtol=1e-9)
    for d in found:
        weights = np.array(list(d.weights.values()))
        np.testing.assert_allclose(scaled @ weights, d.information * weights, rtol=1e-8, atol=1e-9)
        assert np.linalg.norm(weights) == pytest.approx(1.0)
        assert weights[np.argmax(np.abs(weights))] > 0.0
        assert d.contraction == pytest.approx(d.information / (1.0 + d.information))


def test_a_direction_that_only_the_prior_tells_comes_first():
    """The record sees 2 a + b alone: along a - 2 b it is silent, in units of the values."""
    scale, seen = np.array([0.5, 3.0]), np.array([2.0, 1.0])
    first, second = directions(np.linalg.inv(400.0 * np.outer(seen, seen) + np.diag(1.0 / scale**2)), _priors(scale))
    assert first.information == pytest.approx(0.0, abs=1e-7) and first.contraction == pytest.approx(0.0, abs=1e-7)
    silent = np.array([1.0, -2.0]) / scale  # per prior standard deviation
    weights = np.array([first.weights["p0"], first.weights["p1"]])
    assert abs(weights @ silent) / np.linalg.norm(silent) == pytest.approx(1.0)
    assert second.information == pytest.approx(400.0 * np.sum((seen * scale) ** 2))
    assert second.contraction > 0.99


def test_directions_of_a_linear_flight_are_those_of_dense_matrices(straight, linear):
    best, _ = straight
    flight, hyper, priors = linear.flight, linear.hyper, linear.priors
    _, _, by = linear.matrices.model(flight)
    noise, unknown, _ = linear.matrices.covariances(flight, hyper, priors)
    fisher = by[:, :2].T @ np.linalg.solve(noise + by[:, 2:] @ unknown @ by[:, 2:].T, by[:, :2])
    scale = np.array([p.scale for p in priors])
    wanted = np.linalg.eigvalsh(scale[:, None] * fisher * scale)
    found = directions(best.covariance, priors)
    np.testing.assert_allclose([d.information for d in found], wanted, rtol=1e-6)


def test_words_leave_small_weights_out_but_never_all():
    weights = {"a": -0.59, "b": 0.81, "c": 0.05}
    assert in_words(weights) == "0.81 b - 0.59 a"
    assert in_words(weights, least=0.01) == "0.81 b - 0.59 a + 0.05 c"
    assert in_words(weights, least=2.0) == "0.81 b"


def test_confounding_is_that_of_the_joint_gaussian():
    rng, p, v = np.random.default_rng(8), 3, 4
    root = rng.standard_normal((p + v, p + v))
    joint = root @ root.T + 0.1 * np.eye(p + v)
    law = joint[p:, p:]
    slope = np.linalg.solve(law, joint[p:, :p]).T
    held = joint[:p, :p] - slope @ law @ slope.T
    scale = np.linalg.cholesky(held)
    effect = NoiseEffect.none(p, v)._replace(slope=np.linalg.solve(scale, slope))
    found = confounding(scale, effect, law, _priors(np.ones(p)), [f"law{i}" for i in range(v)])
    sd = np.sqrt(np.diag(joint))
    np.testing.assert_allclose(found.correlation, (joint / np.outer(sd, sd))[:p, p:], rtol=1e-10)
    np.testing.assert_allclose(found.share, 1.0 - np.diag(held) / np.diag(joint)[:p], rtol=1e-10)
    for i, (name, correlation) in enumerate(found.strongest().values()):
        assert abs(correlation) == pytest.approx(np.abs(found.correlation[i]).max())
        assert correlation == found.correlation[i][int(name.removeprefix("law"))]


def test_parameters_that_do_not_move_with_the_noise_are_not_confounded():
    found = confounding(np.eye(2), NoiseEffect.none(2, 1), np.array([[0.4]]), _priors([1.0, 1.0]), ["sd"])
    assert not found.correlation.any() and not found.share.any()


def test_the_share_counts_what_the_noise_makes_of_the_covariance():
    """A variance that goes with the noise parameter to the power two: known exactly, it would be less by that much."""
    effect = NoiseEffect(np.zeros((1, 1)), np.array([[[2.0]]]), np.zeros((1, 1)))
    found = confounding(np.array([[3.0]]), effect, np.array([[0.2]]), _priors([1.0]), ["sd"])
    assert found.share[0] == pytest.approx(1.0 - np.exp(-0.5 * 4.0 * 0.2), rel=1e-12) and not found.correlation.any()


def test_labels_stand_in_the_order_of_the_vector():
    noise = Noise(np.array([1.0, 2.0]), np.array([3.0, 4.0]), np.array([5.0, 6.0]))
    hyper = NoiseParameters(noise, (np.array([7.0, 8.0]), np.array([9.0, 10.0, 11.0])))
    labels = noise_parameter_labels(["x", "y"], ["wind", "breathing"], ["drift", "oscillator"])
    values = dict(zip(labels, np.exp(to_vector(hyper)), strict=True))
    wanted = {"x, white noise": 1, "y, correlated noise": 4, "x, time constant": 5, "wind, sd": 7}
    wanted |= {"wind, time constant": 8, "breathing, frequency": 10, "breathing, damping ratio": 11}
    assert {k: values[k] for k in wanted} == pytest.approx(wanted)


def _sensitivities(seen, sd, seed=1):
    """Of parameters with standard normal priors, seen with errors: exact draws of the posterior."""
    rng, seen, sd = np.random.default_rng(seed), np.asarray(seen), np.asarray(sd)
    precision = 1.0 + 1.0 / sd**2
    theta = seen / sd**2 / precision + rng.standard_normal((4, 1000, seen.size)) / np.sqrt(precision)
    likelihood = -0.5 * np.sum(((theta - seen) / sd) ** 2, axis=-1)
    priors = [Prior(f"p{i}", 0.0, 1.0, False, "1", "") for i in range(seen.size)]
    return priors, theta, likelihood


@pytest.mark.parametrize(
    ("seen", "sd", "felt"),
    [(0.3, 0.1, (False, True)), (0.3, 10.0, (True, False)), (6.0, 1.0, (True, True))],
)
def test_power_scaling_tells_who_speaks(seen, sd, felt):
    """Prior and likelihood: of a good record, of next to none, and of one that the prior contradicts."""
    found = power_scaling(*_sensitivities([seen], [sd]))["p0"]
    assert (found.prior >= SENSITIVE, found.likelihood >= SENSITIVE) == felt


def test_power_scaling_knows_no_constants():
    priors, theta, likelihood = _sensitivities([0.5, -1.0], [0.4, 2.0])
    one, two = power_scaling(priors, theta, likelihood), power_scaling(priors, theta, likelihood + 1e4)
    for name, entry in one.items():
        assert entry == pytest.approx(two[name], rel=1e-6)
    assert one["p1"].prior > one["p0"].prior
