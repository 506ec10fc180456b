"""Scores of left-out terms: where all is linear, one step is the whole way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayeschute.posterior.assess.score_test import scores
from bayeschute.posterior.joint_mode import fit


@pytest.fixture(scope="module")
def without(linear):
    """The fit with the second parameter held at zero."""
    held = [linear.priors[0], replace(linear.priors[1], centre=0.0, scale=1e-7)]
    return fit([linear.flight], linear.hyper, held, np.zeros(2), tolerance=1e-8)


def _scores(linear, without):
    theta = np.array([without.theta[0], 0.0])
    kept = np.array([True, False])
    return scores([linear.flight], linear.hyper, linear.priors, theta, without.flights, kept)


def test_the_step_leads_to_the_estimate_without_a_prior(linear, without):
    free = [linear.priors[0], replace(linear.priors[1], centre=0.0, scale=1e5)]
    wanted = fit([linear.flight], linear.hyper, free, np.zeros(2), tolerance=1e-8)
    step, se = _scores(linear, without)
    assert step[1] == pytest.approx(wanted.theta[1], rel=1e-4)
    assert without.theta[0] + step[0] == pytest.approx(wanted.theta[0], rel=1e-4)
    np.testing.assert_allclose(se, np.sqrt(np.diag(wanted.covariance)), rtol=1e-4)


@pytest.mark.parametrize(("flown", "asked"), [(-4.0, True), (0.0, False)])
def test_a_term_that_is_needed_stands_out_and_one_that_is_not_does_not(linear, flown, asked):
    flight, _ = linear.simulate(linear.flight, linear.hyper, np.array([0.7, flown]), 8)
    held = [linear.priors[0], replace(linear.priors[1], centre=0.0, scale=1e-7)]
    best = fit([flight], linear.hyper, held, np.zeros(2), tolerance=1e-8)
    theta, kept = np.array([best.theta[0], 0.0]), np.array([True, False])
    step, se = scores([flight], linear.hyper, linear.priors, theta, best.flights, kept)
    assert (abs(step[1] / se[1]) > 4.0) == asked
