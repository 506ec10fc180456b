"""Agreement of what others know with a posterior: p-values, words, and a prior that is taken out again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2
from tests.study.aerodynamics.knowledge_tables import NAMES, TRUTH, curve, table, told

from bayeschute.likelihood.priors import covariance, working
from bayeschute.study.aerodynamics.agreement import agreement, verdict
from bayeschute.study.aerodynamics.known import informed


def _jitter(seed):
    return 1e-3 * np.random.default_rng(seed).standard_normal((2, 50))


def _draws(priors, seed=0):
    drawn = np.random.default_rng(seed).multivariate_normal(working(priors)[0], covariance(priors), (4, 4000))
    return {p.name: drawn[..., i] for i, p in enumerate(priors)}


def test_knowledge_that_agrees_is_in_agreement_and_other_is_in_conflict(study, priors):
    rows = [(a, float(0.85 - 0.5 * a**2), 0.02) for a in (0.1, 0.2, 0.3)]
    good, bad = curve("C_A", rows), curve("C_A", [(a, v + 0.6, s) for a, v, s in rows])
    found = agreement(told(study, good, bad), _draws(priors))
    assert [f["verdict"] for f in found] == ["agreement", "conflict"]
    assert found[0]["p_value"] > 0.9 and found[1]["p_value"] < 1e-6 and found[1]["z"][0] > 5.0
    assert [verdict(p) for p in (0.2, 0.03, 0.001)] == ["agreement", "tension", "conflict"]


def test_conflict_of_a_prior_is_judged_without_it(study, priors):
    """As sharp as the data: judged with it inside, ten standard deviations would look like half of them."""
    off = table(kind="coefficient", target="transverse[rate]", mean=-0.4 + 1.0, sd=0.1, use="prior")
    sharp = [replace(p, scale=0.1) if p.name == "transverse[rate]" else p for p in priors]
    held = informed(told(study, off), sharp)
    (entry,) = agreement(told(study, off), _draws(held))
    assert entry["z"][0] == pytest.approx(1.0 / np.hypot(0.1, 0.1), rel=0.06)
    assert not entry["counted"] and entry["found"][0] == pytest.approx(-0.4, abs=0.02)


def test_a_published_set_stands_beside_what_was_found(study, priors):
    known = table(kind="curve", target="C_N_rate", published="table-7.1-2")
    (entry,) = agreement(told(study, known), _draws(priors))
    assert entry["values"][0] == pytest.approx(-0.545, abs=0.01) and entry["freedom"] >= 1 and entry["unit"] == "rad"


def test_a_term_that_the_model_lacks_is_said(study):
    known = told(study, table(kind="coefficient", target="axial[alpha^4]", mean=1.0, sd=0.1, use="prior"))
    (entry,) = agreement(
        known, {n: np.full((2, 50), t) + _jitter(i) for i, (n, t) in enumerate(zip(NAMES, TRUTH, strict=True))}
    )
    assert not entry["in_model"] and entry["z"][0] == pytest.approx(10.0)


def test_what_is_compared_stands_beside_the_posterior_s_own_moments(study):
    """One coefficient: z is the distance over the root of both variances; chi-square is its square."""
    rng = np.random.default_rng(3)
    draws = {name: value + 0.1 * rng.standard_normal((2, 200)) for name, value in zip(NAMES, TRUTH, strict=True)}
    x = draws["axial[1]"].ravel()
    (one,) = agreement(told(study, table(kind="coefficient", target="axial[1]", mean=1.05, sd=0.05)), draws)
    sd = x.std(ddof=1)
    z = (1.05 - x.mean()) / np.hypot(0.05, sd)
    assert one["values"] == [1.05] and one["sd"] == pytest.approx([0.05]) and one["found"] == pytest.approx([x.mean()])
    assert one["found_sd"] == pytest.approx([sd], rel=5e-3) and np.abs(one["z"]) == pytest.approx([abs(z)], rel=5e-3)
    assert one["chi_square"] == pytest.approx(z**2, rel=1e-2) and one["freedom"] == 1
    assert one["p_value"] == pytest.approx(chi2.sf(one["chi_square"], 1), rel=1e-9)
    assert one["in_model"] and not one["counted"] and one["unit"] == "" and one["use"] == "compare"
    assert (one["name"], one["source"], one["kind"], one["target"]) == ("k", "tunnel", "coefficient", "axial[1]")


def test_a_prior_that_says_all_there_is_to_say_can_not_be_taken_out(study, priors):
    """The posterior is as wide as the knowledge itself: without it nothing is left, and it stays in."""
    known = table(kind="coefficient", target="axial[1]", mean=0.85, sd=0.1, use="prior")
    rng = np.random.default_rng(5)
    draws = {n: t + 0.1 * rng.standard_normal((2, 2000)) for n, t in zip(NAMES, TRUTH, strict=True)}
    draws["axial[1]"] = 0.85 + 0.12 * rng.standard_normal((2, 2000))
    (one,) = agreement(told(study, known), draws)
    assert one["counted"] and one["in_model"]


def test_words_change_at_a_twentieth_and_at_a_hundredth():
    assert [verdict(p) for p in (0.05, 0.0499, 0.01, 0.0099)] == ["agreement", "tension", "tension", "conflict"]


def test_without_shared_coefficients_or_knowledge_there_is_nothing_to_compare(study):
    known = told(study, table(kind="coefficient", target="axial[1]", mean=1.0, sd=0.1))
    draws = {"riser_length": np.ones((2, 5)), "axial[1]@a.canopy1": np.ones((2, 5))}
    assert agreement(known, draws) == [] and agreement(study, {"axial[1]": np.ones((2, 5))}) == []
