"""Leave-future-out scores against dense marginal likelihoods and quadrature; weights against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import expit, roots_hermitenorm

from bayeschute.likelihood.joint import filter_gains, linearise
from bayeschute.posterior import joint_mode as optimum
from bayeschute.posterior.combine import model_average
from bayeschute.posterior.combine.model_average import counts, sequential_scores, terms, weights
from bayeschute.posterior.marginal import latent_path_at, log_density, marginalise, sample_log_likelihoods, shifted


@pytest.fixture(scope="module")
def marginal(linear):
    best = optimum.fit([linear.flight], linear.hyper, linear.priors, linear.theta)
    return marginalise([linear.flight], linear.hyper, linear.priors, best)


def test_scores_of_a_linear_flight_are_its_marginal_likelihoods(linear, marginal):
    """The openings' sum is the evidence of the opening, the sum of both that of the record: dense matrices say so."""
    flight = linear.flight
    seen = np.array(flight.present)
    seen[int(np.ceil(0.4 * len(seen))) :] = False
    first, later = sequential_scores(marginal, 0.4)
    part = linear.matrices.evidence(replace(flight, present=seen), linear.hyper, linear.priors)
    whole = linear.matrices.evidence(flight, linear.hyper, linear.priors)
    assert len(first) == 24 and len(later) == 36
    assert first.sum() == pytest.approx(part, rel=1e-9)
    assert later.sum() == pytest.approx(whole - part, rel=1e-9)


def test_the_rest_hardly_hangs_on_a_wide_prior_and_the_evidence_does(linear, marginal):
    """The reason for scoring the rest only."""
    scale = np.asarray(marginal.prior_factor)
    near, far = (sequential_scores(replace(marginal, prior_factor=by * scale), 0.4) for by in (10.0, 1000.0))
    assert abs(far[1].sum() - near[1].sum()) < 0.1
    assert far[0].sum() + far[1].sum() < near[0].sum() + near[1].sum() - 5.0


def test_scores_of_falling_bodies_sum_to_the_evidence_by_quadrature(found):
    """One parameter: the marginal density itself is integrated, its determinant a slope as in the scores."""
    made = found.marginal
    straight = replace(
        made, determinant=made.determinant._replace(curvature=0.0 * np.asarray(made.determinant.curvature))
    )
    at = np.array([[0.0]])
    scale, prior = float(made.scale[0, 0]), float(made.prior_factor[0, 0])
    level = sum(float(np.sum(part)) for part in sample_log_likelihoods(made, at)) - np.log(prior) + np.log(scale)
    level -= 0.5 * ((float(made.centre[0]) - float(made.prior_centre[0])) / prior) ** 2
    xi, w = roots_hermitenorm(40)  # weights exp(-xi^2/2), so the density is a mild function times those
    ratio = np.asarray(log_density(straight, xi[None])) - float(log_density(straight, at)[0]) + 0.5 * xi**2
    wanted = level + np.log(np.sum(w * np.exp(ratio)) / np.sqrt(2.0 * np.pi))
    first, later = sequential_scores(made)
    assert len(first) == 2 * 26 and len(later) == 2 * 75
    assert first.sum() + later.sum() == pytest.approx(wanted, abs=0.02)


def test_tilts_are_those_of_the_determinant(found):
    per_flight = terms(found.marginal)
    total = sum(part.tilt.sum(axis=0) for part in per_flight)
    ends, made = [], found.marginal
    for xi in (np.ones(1), -np.ones(1)):
        theta, shift = shifted(made, xi)
        linear = [
            linearise(f, theta, latent_path_at(f, a, shift)) for f, a in zip(made.flights, made.along, strict=True)
        ]
        pairs = zip(made.flights, linear, strict=True)
        ends.append(sum(float(filter_gains(f, made.hyper, one).log_determinant) for f, one in pairs))
    np.testing.assert_allclose(total, [0.5 * (ends[0] - ends[1])], rtol=1e-9)


def test_tilts_are_taken_nearer_where_flights_fail(found, fails_beyond):
    made = found.marginal
    near = terms(made, step=0.125)

    fails_beyond(model_average, 0.2)
    for one, wanted in zip(terms(made), near, strict=True):
        np.testing.assert_allclose(one.tilt, wanted.tilt, rtol=1e-12)
    fails_beyond(model_average, 0.01)
    with pytest.raises(FloatingPointError, match="beside the optimum"):
        terms(made)


def test_weights_of_two_are_the_mean_of_a_logistic():
    """Many blocks: the bootstrap's difference is normal, and its logistic's mean an integral."""
    rng = np.random.default_rng(1)
    gap = rng.standard_normal(400)
    gap = 3.0 / 400 + (gap - gap.mean()) * 0.1
    made = weights(np.array([gap, 0.0 * gap]), np.random.default_rng(2), blocks=400)
    se = 0.1 * np.sqrt(400)
    wanted = quad(lambda z: expit(3.0 + se * z) * np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi), -8, 8)[0]
    assert made.weight.sum() == pytest.approx(1.0)
    assert made.weight[0] == pytest.approx(wanted, abs=0.02)
    assert made.behind[1] == pytest.approx(-3.0) and made.behind_se[1] == pytest.approx(se, rel=0.1)
    assert made.behind[0] == 0.0 == made.behind_se[0]


def test_equal_structures_share_and_a_hopeless_one_gets_nothing():
    score = np.random.default_rng(0).standard_normal(100)
    made = weights(np.array([score, score, score - 5.0]), np.random.default_rng(3))
    np.testing.assert_allclose(made.weight, [0.5, 0.5, 0.0], atol=1e-12)


def test_blocks_keep_what_lasts_together():
    """A difference that lasts for ten samples is ten times less sure than its samples would say."""
    slow = np.repeat(np.random.default_rng(4).standard_normal(40), 10)
    scores = np.array([slow, 0.0 * slow])
    rng = np.random.default_rng(5)
    ratio = weights(scores, rng, blocks=40).behind_se.max() / weights(scores, rng, blocks=400).behind_se.max()
    assert ratio == pytest.approx(np.sqrt(10.0), rel=0.05)


def test_scores_that_are_not_finite_are_refused():
    with pytest.raises(ValueError, match="must be finite"):
        weights(np.array([[0.0, np.nan], [0.0, 1.0]]), np.random.default_rng(0))


def test_counts_are_in_proportion():
    np.testing.assert_array_equal(counts(np.array([0.5, 0.3, 0.2]), 10), [5, 3, 2])
    np.testing.assert_array_equal(counts(np.array([0.996, 0.002, 0.002]), 100), [100, 0, 0])
    assert counts(np.array([1.0, 1.0, 1.0]) / 3.0, 100).sum() == 100
