"""Terms that leave a library: evidence against conjugate regressions, the true terms found, the rest as by conditioning."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from bayeschute.likelihood.priors import Prior, correlated, covariance, given_zero, working
from bayeschute.posterior import term_search
from bayeschute.posterior.term_search import PENALTY, choose, log_evidence_without

NOISE = 0.5
NAMES = tuple("abcdef")


def _priors(rng):
    """Correlated priors, none of them about zero."""
    count = len(NAMES)
    root = rng.standard_normal((count, count))
    law = 0.3 * root @ root.T / count + np.diag(0.5 + rng.random(count))
    blank = [Prior(name, 0.0, 1.0, False, "1", "") for name in NAMES]
    return correlated(blank, 0.5 * rng.standard_normal(count), law)


def _log_evidence(priors, x, y):
    """Of a linear regression, its coefficients integrated out."""
    total = x @ covariance(priors) @ x.T + NOISE**2 * np.eye(len(y))
    away = y - x @ working(priors)[0]
    return -0.5 * away @ np.linalg.solve(total, away) - 0.5 * np.linalg.slogdet(2.0 * np.pi * total)[1]


def _posterior(priors, x, y):
    prior = np.linalg.inv(covariance(priors))
    law = np.linalg.inv(prior + x.T @ x / NOISE**2)
    return law @ (prior @ working(priors)[0] + x.T @ y / NOISE**2), law


@pytest.fixture(scope="module")
def case():
    rng = np.random.default_rng(3)
    priors, x = _priors(rng), rng.standard_normal((30, len(NAMES)))
    x[:, 1] = 0.8 * x[:, 0] + 0.6 * x[:, 1]  # terms that resemble each other
    y = x @ [1.0, 0.0, -0.5, 0.0, 0.1, 0.0] + NOISE * rng.standard_normal(30)
    return priors, x, y, *_posterior(priors, x, y)


def test_evidence_of_every_smaller_model_is_the_exact_one(case):
    priors, x, y, mean, law = case
    whole = _log_evidence(priors, x, y)
    sizes = []
    for out in map(np.array, product([False, True], repeat=len(NAMES))):
        if out.all():
            continue
        left = given_zero(priors, [name for name, gone in zip(NAMES, out, strict=True) if gone])
        wanted = _log_evidence(left, x[:, ~out], y) - whole
        assert log_evidence_without(priors, mean, law, out) == pytest.approx(wanted, abs=1e-9)
        sizes.append(wanted)
    assert max(sizes) > 1.0 and min(sizes) < -10.0  # some models are better, some far worse


def test_a_model_without_any_term_is_that_of_the_noise(case):
    priors, x, y, mean, law = case
    nothing = -0.5 * y @ y / NOISE**2 - 0.5 * len(y) * np.log(2.0 * np.pi * NOISE**2)
    got = log_evidence_without(priors, mean, law, np.ones(len(NAMES), bool))
    assert got == pytest.approx(nothing - _log_evidence(priors, x, y), abs=1e-9)


def test_nothing_left_out_changes_nothing(case):
    priors, _, _, mean, law = case
    assert log_evidence_without(priors, mean, law, np.zeros(len(NAMES), bool)) == 0.0
    chosen = choose(priors, mean, law, ())
    assert chosen.kept.all() and chosen.evidence == {}
    np.testing.assert_array_equal(chosen.theta, mean)
    np.testing.assert_allclose(covariance(chosen.priors), covariance(priors), rtol=1e-12)


def test_the_chosen_model_is_that_of_its_own_regression(case):
    """Parameters and priors are those of a fit without the others; no term that left would pay, none that stays is dear."""
    priors, x, y, mean, law = case
    chosen = choose(priors, mean, law, NAMES[1:])
    gone = [name for name, kept in zip(NAMES, chosen.kept, strict=True) if not kept]
    assert 0 < len(gone) < len(NAMES) and chosen.kept[0]
    assert [p.name for p in chosen.priors] == [name for name in NAMES if name not in gone]
    wanted, _ = _posterior(given_zero(priors, gone), x[:, chosen.kept], y)
    np.testing.assert_allclose(chosen.theta, wanted, rtol=1e-9)
    assert set(chosen.evidence) == set(NAMES[1:])
    here = _log_evidence(given_zero(priors, gone), x[:, chosen.kept], y)
    for name, told in chosen.evidence.items():
        other = set(gone) ^ {name}
        columns = [i for i, n in enumerate(NAMES) if n not in other]
        there = _log_evidence(given_zero(priors, sorted(other)), x[:, columns], y)
        assert told == pytest.approx(there - here if name in gone else here - there, abs=1e-9)
        assert told < PENALTY if name in gone else told >= PENALTY


@pytest.mark.parametrize("penalty", [0.0, 1e6])
def test_the_penalty_is_the_price_of_a_term(case, penalty):
    """Without one the best neighbour of the model is itself; beyond all evidence, only what must stay stays."""
    priors, _, _, mean, law = case
    chosen = choose(priors, mean, law, NAMES[1:], penalty)
    if penalty:
        np.testing.assert_array_equal(chosen.kept, [True, *[False] * 5])
    else:
        for i, name in enumerate(NAMES[1:], 1):
            assert (chosen.evidence[name] > 0.0) == chosen.kept[i]


def test_a_term_that_left_is_taken_back_where_it_pays(monkeypatch):
    """By a made-up table of evidence: c alone pays most to lose, then a and b, without which c is wanted again."""
    told = {"": 0.0, "c": 5.0, "a": 1.0, "b": 1.0, "ac": 6.0, "bc": 5.5, "abc": 7.0, "ab": 9.0}

    def table(priors, mean, law, out):
        return told["".join(p.name for p, gone in zip(priors, out, strict=True) if gone)]

    monkeypatch.setattr(term_search, "log_evidence_without", table)
    priors = [Prior(name, 0.0, 1.0, False, "1", "") for name in "abc"]
    chosen = choose(priors, np.ones(3), np.eye(3), "abc", penalty=0.0)
    np.testing.assert_array_equal(chosen.kept, [False, False, True])
    assert chosen.evidence == {"a": 1.0 - 9.0, "b": 1.0 - 9.0, "c": 9.0 - 7.0}


def test_the_true_terms_are_found_and_the_core_is_kept():
    """Fifty regressions with the core, of which one term is none, two true terms and four that are none."""
    names, core = [*"abcdefgh"], {"a", "b"}
    true = np.array([1.0, 0.0, 0.6, 0.0, -0.5, 0.0, 0.0, 0.0])
    wanted = np.array([name in core for name in names]) | (true != 0.0)
    priors = [Prior(name, 0.0, 1.0, False, "1", "") for name in names]
    found, extra = 0, 0
    for seed in range(50):
        rng = np.random.default_rng(seed)
        x = rng.standard_normal((150, 8))
        x[:, 3] = 0.7 * x[:, 2] + 0.7 * x[:, 3]
        y = x @ true + NOISE * rng.standard_normal(150)
        kept = choose(priors, *_posterior(priors, x, y), set(names) - core).kept
        assert kept[[0, 1]].all()
        found += (kept == wanted).all()
        extra += (kept & ~wanted).sum()
    assert found >= 45 and extra <= 5


@pytest.mark.parametrize("zero", [(), ("b",), ("a", "d"), ("b", "c", "e", "f")])
def test_priors_given_that_terms_are_zero_are_those_of_conditioning(zero):
    rng = np.random.default_rng(8)
    priors = _priors(rng)
    law, centre = covariance(priors), working(priors)[0]
    out = np.array([name in zero for name in NAMES])
    left = given_zero([replace(p, unit="m", source="x") for p in priors], zero)
    precision = np.linalg.inv(law)[np.ix_(~out, ~out)]  # conditioning keeps the block of the precision
    np.testing.assert_allclose(covariance(left), np.linalg.inv(precision), rtol=1e-9, atol=1e-12)
    pull = np.linalg.inv(law)[np.ix_(~out, out)] @ centre[out]
    np.testing.assert_allclose(working(left)[0], centre[~out] + np.linalg.solve(precision, pull), rtol=1e-9)
    assert all((p.unit, p.source, p.logarithmic) == ("m", "x", False) for p in left)
    assert [p.name for p in left] == [name for name in NAMES if name not in zero]
    assert all(set(p.correlation) <= {q.name for q in left} for p in left)
