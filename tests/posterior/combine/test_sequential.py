"""Drop by drop: equal to the fit of all drops where all is Gaussian, and on descents within Monte Carlo error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayeschute.likelihood.priors import Prior, correlated, covariance, values, working
from bayeschute.posterior.combine.sequential import as_priors, divergence, moments, taught
from bayeschute.posterior.fit.laplace_fit import find
from bayeschute.posterior.joint_mode import fit
from bayeschute.posterior.noise_evidence import NoisePrior
from bayeschute.posterior.sampler import sample


def _posterior(flights, linear, priors):
    best = fit(flights, linear.hyper, priors, np.zeros(2), tolerance=1e-9)
    return best.theta, best.covariance


@pytest.fixture(scope="module")
def drops(linear):
    return [linear.simulate(linear.flight, linear.hyper, linear.theta, seed)[0] for seed in (21, 22, 23)]


def test_one_drop_after_the_other_is_the_fit_of_all(linear, drops):
    """The law of sequential use: update(A then B then C) = fit(A + B + C), exactly, in a linear Gaussian model."""
    priors = linear.priors
    for drop in drops:
        priors = as_priors(linear.priors, *_posterior([drop], linear, priors), "posterior")
    mean, law = _posterior(drops, linear, linear.priors)
    np.testing.assert_allclose(working(priors)[0], mean, atol=1e-6 * np.sqrt(np.diag(law)).min())
    np.testing.assert_allclose(covariance(priors), law, rtol=1e-6)


def test_without_their_correlation_it_would_not_be(linear, drops):
    first = as_priors(linear.priors, *_posterior(drops[:1], linear, linear.priors), "posterior")
    alone = [replace(p, correlation={}) for p in first]
    _, law = _posterior(drops[1:2], linear, alone)
    _, wanted = _posterior(drops[:2], linear, linear.priors)
    assert np.abs(law / wanted - 1.0).max() > 1e-4


def test_draws_carry_mean_and_covariance(linear, drops):
    mean, law = _posterior(drops[:1], linear, linear.priors)
    draws = np.random.default_rng(3).multivariate_normal(mean, law, (4, 5000))
    made = as_priors(linear.priors, *moments(draws), "posterior")
    np.testing.assert_allclose(working(made)[0], mean, atol=4.0 * np.sqrt(np.diag(law).max() / 20_000))
    np.testing.assert_allclose(covariance(made), law, atol=0.05 * np.abs(law).max())


def test_what_drops_teach_one_by_one_adds_up_over_their_order(linear, drops):
    """Expected gains add; of one set of data the chain rule holds for log det, which is what the gain is made of."""
    first = as_priors(linear.priors, *_posterior(drops[:1], linear, linear.priors), "posterior")
    halves = [covariance(linear.priors), covariance(first), _posterior(drops[:2], linear, linear.priors)[1]]
    logs = [np.linalg.slogdet(law)[1] for law in halves]
    assert logs[0] > logs[1] > logs[2]


def test_the_gain_of_one_parameter_in_closed_form():
    prior = Prior("a", 1.0, 2.0, False, "1", "")
    (row,), joint = taught([prior], np.array([2.0]), np.array([[0.25]]))
    wanted = np.log(2.0 / 0.5) + (0.25 + 1.0) / 8.0 - 0.5
    assert row.gain == pytest.approx(wanted) and joint == pytest.approx(wanted)
    assert (row.shift, row.prior_sd, row.sd) == (0.5, 2.0, 0.5)


def test_a_drop_that_says_nothing_teaches_nothing():
    law = np.array([[0.04, 0.03], [0.03, 0.09]])
    priors = correlated([Prior(n, 0.0, 1.0, False, "1", "") for n in "ab"], np.array([1.0, 2.0]), law)
    rows, joint = taught(priors, np.array([1.0, 2.0]), law)
    assert joint == pytest.approx(0.0, abs=1e-12) and all(abs(r.gain) < 1e-12 for r in rows)


def test_what_is_learned_of_a_sum_shows_in_the_joint_gain_only():
    priors = [Prior(n, 0.0, 1.0, False, "1", "") for n in "ab"]
    law = np.linalg.inv(np.eye(2) + 1e4 * np.ones((2, 2)))  # the sum is known, the difference is not
    rows, joint = taught(priors, np.zeros(2), law)
    assert joint > 3.0 and all(r.gain < 0.2 for r in rows)


def test_the_divergence_is_that_of_samples():
    rng = np.random.default_rng(0)
    a, b = (np.cov(rng.standard_normal((3, 8))) for _ in range(2))
    ma, mb = rng.standard_normal((2, 3))
    x = rng.multivariate_normal(ma, a, 200_000)

    def log_density(x, m, s):
        return -0.5 * np.einsum("ni,ij,nj->n", x - m, np.linalg.inv(s), x - m) - 0.5 * np.linalg.slogdet(s)[1]

    sampled = np.mean(log_density(x, ma, a) - log_density(x, mb, b))
    assert divergence(ma, a, mb, b) == pytest.approx(sampled, rel=0.02)


def test_two_descents_one_by_one_are_two_descents_at_once(descent, found):
    """Fitted and sampled as a study is: noise parameters begin anew, so equal up to what they and chance leave open."""
    noise = NoisePrior(descent.hyper, 0.4)

    def draws(made):
        xi = sample(made.marginal, "nuts", 2, 100, 300, seed=3).xi
        return np.asarray(made.marginal.centre) + xi @ np.asarray(made.marginal.scale).T

    first = draws(find(descent.flights[:1], descent.priors, noise, rounds=1))
    told = as_priors(descent.priors, *moments(first), "the first descent")
    one_by_one, at_once = draws(find(descent.flights[1:], told, noise, rounds=1)), draws(found)
    assert one_by_one.std() == pytest.approx(at_once.std(), rel=0.2)
    assert one_by_one.mean() == pytest.approx(at_once.mean(), abs=0.35 * at_once.std())
    assert abs(values(told, one_by_one).mean() / 0.2 - 1.0) < 0.1


def test_the_next_drop_s_terms_are_held_where_those_before_were(linear):
    """A coefficient means what it meant: its term keeps its angle, whatever the next record flies."""
    held = [replace(linear.priors[0], saturation=0.4), *linear.priors[1:]]
    law = covariance(linear.priors)
    assert [p.saturation for p in as_priors(held, np.zeros(len(held)), law, "posterior")] == [
        p.saturation for p in held
    ]
