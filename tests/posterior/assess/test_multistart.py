"""Several starts of a fit: one optimum is called one, two are told apart, a start that fails is counted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayeschute.core.errors import FitError
from bayeschute.posterior.assess import multistart
from bayeschute.posterior.assess.multistart import Start, Told, begin, best_of, compare, judge, settle_from
from bayeschute.posterior.fit.joint_fit import joint_fit
from bayeschute.posterior.noise_evidence import NoisePrior


@pytest.fixture(scope="module")
def settled(descent):
    """The falling bodies from the prior means and from two draws."""
    prior = NoisePrior(descent.hyper, 0.4)
    return [settle_from(descent.flights, descent.priors, prior, i, 7, rounds=1) for i in range(3)]


def test_the_first_start_is_the_fit_from_the_prior_means(settled, descent):
    plain = joint_fit(descent.flights, descent.priors, NoisePrior(descent.hyper, 0.4), rounds=1)
    assert settled[0].settled.evidence == plain.evidence
    np.testing.assert_array_equal(settled[0].settled.optimum.theta, plain.optimum.theta)


def test_starts_of_an_easy_flight_agree(settled, descent):
    best = best_of(settled)
    told = compare(descent.flights, descent.priors, best, [s for s in settled if s is not best])
    assert len(told) == 2 and all(t.converged and t.away < 0.05 and abs(t.worse) < 0.01 for t in told)
    verdict = judge(told, True)
    assert verdict.passed and verdict.away < 0.05 and "3 of 3 starts" in verdict.words


def test_starts_are_draws_of_the_priors_at_half_their_width(descent):
    priors = [replace(descent.priors[0], name=str(i), centre=float(i), scale=1.0 + i) for i in range(400)]
    at = begin(priors, 1, 7)
    off = (np.array([begin(priors, i, 7) for i in range(1, 11)]) - np.arange(400.0)) / (1.0 + np.arange(400.0))
    assert abs(off.std() - 0.5) < 0.02 and abs(off.mean()) < 0.03  # standard errors 0.006 and 0.008
    np.testing.assert_array_equal(at, begin(priors, 1, 7))
    assert np.abs(at - begin(priors, 2, 7)).min() > 0.0 and np.abs(at - begin(priors, 1, 8)).min() > 0.0
    np.testing.assert_array_equal(begin(priors, 0, 7), np.arange(400.0))


@pytest.mark.parametrize("kind", [FloatingPointError, FitError])
def test_a_start_that_fails_is_told_and_the_others_go_on(settled, descent, monkeypatch, kind):
    def fails(*given, **more):
        raise kind("lost in its last samples")

    monkeypatch.setattr(multistart, "joint_fit", fails)
    bad = settle_from(descent.flights, descent.priors, NoisePrior(descent.hyper, 0.4), 4, 7, rounds=1)
    assert bad.settled is None
    told = compare(descent.flights, descent.priors, settled[0], [bad, settled[1]])
    verdict = judge(told, True)
    assert verdict.passed and "1 failed (start 4: lost in its last samples)" in verdict.words
    assert "2 of 3 starts" in verdict.words
    with pytest.raises(FloatingPointError, match=r"lost in its last samples \(none of 2 starts"):
        best_of([bad, bad])


def test_the_best_start_is_the_converged_one_of_greatest_evidence(settled):
    one = settled[0].settled
    worse = Start(1, one._replace(evidence=one.evidence + 3.0))
    stuck = Start(2, one._replace(evidence=one.evidence - 3.0, optimum=replace(one.optimum, converged=False)))
    assert best_of([worse, stuck, settled[0]]) is settled[0]
    assert best_of([stuck, Start(3, None, "lost")]) is stuck


def test_an_optimum_that_is_another_is_measured_from_the_one_kept(settled, descent, monkeypatch):
    """The comparison moves an optimum to where it lies under the kept one's noise parameters, and measures there."""
    kept = settled[0].settled.optimum
    se = float(np.sqrt(kept.covariance[0, 0]))
    other = replace(kept, theta=kept.theta - 3.0 * se, cost=kept.cost + 2.5)
    optima = iter([kept, other])
    monkeypatch.setattr(multistart, "joint", lambda *given: next(optima))
    (told,) = compare(descent.flights, descent.priors, settled[0], [settled[1]])
    assert told.away == pytest.approx(3.0) and told.worse == pytest.approx(2.5)
    assert told.parameter == "cds_over_mass" and told.converged


@pytest.mark.parametrize("kind", [FloatingPointError, FitError])
def test_an_optimum_that_follows_no_record_under_the_kept_noise_is_told(settled, descent, monkeypatch, kind):
    def fails(*given):
        raise kind("no flight follows the record")

    monkeypatch.setattr(multistart, "joint", fails)
    (told,) = compare(descent.flights, descent.priors, settled[0], [settled[1]])
    assert told.why == "the optimum that is kept: no flight follows the record" and np.isnan(told.away)
    assert not judge([told], False).passed
    optima = iter([settled[0].settled.optimum])
    monkeypatch.setattr(multistart, "joint", lambda *given: next(optima, None) or fails())
    (told,) = compare(descent.flights, descent.priors, settled[0], [settled[1]])
    assert told.why == "no flight follows the record" and np.isnan(told.away)


def test_the_best_that_stopped_short_of_its_optimum_is_refined_as_well(settled, descent):
    """Else the others would be told as rivals of an optimum that is theirs too."""
    one = settled[0].settled
    short = one.optimum.theta + 0.35 * np.sqrt(np.diag(one.optimum.covariance))
    best = Start(0, one._replace(optimum=replace(one.optimum, theta=short)))
    (told,) = compare(descent.flights, descent.priors, best, [settled[1]])
    assert told.converged and told.away < 0.01 and abs(told.worse) < 1e-3


@pytest.mark.parametrize(
    ("told", "passed", "words"),
    [
        (Told(1, "", True, 20.0, 8.0, "e", 30.0), True, "8 standard errors off in e, log density -30"),
        (Told(1, "", True, 1.0, 8.0, "e", 30.0), False, "log evidence -1 (a rival)"),
        (Told(1, "", True, 20.0, 8.0, "e", -2.0), False, "log density +2"),
        (Told(1, "", False, np.nan, 8.0, "e", 1.0), False, "not converged: start 1"),
        (Told(1, "lost", False, np.nan, np.nan, "", np.nan), False, "1 failed (start 1: lost)"),
    ],
)
def test_verdicts(told, passed, words):
    """Beside a start that disagrees, or alone; one start alone proves nothing."""
    verdict = judge([told], True)
    assert verdict.passed is passed and words in verdict.words
    assert not judge([told._replace(converged=True, why="", away=0.0)], False).passed
