"""Knowledge of a study: how it enters priors, and whether conflict with what was found is told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bayeschute.aero.coefficient import terms_of
from bayeschute.likelihood.priors import Prior, correlated, covariance, working
from bayeschute.study.aerodynamics.agreement import agreement, verdict
from bayeschute.study.aerodynamics.known import informed, observed, points
from bayeschute.study.load import load_study
from bayeschute.study.schema.knowledge.knowledge_schema import KnowledgeTable
from bayeschute.study.templates import template

NAMES = ("axial[1]", "axial[alpha^2]", "transverse[e]", "transverse[rate]", "riser_length")
TRUTH = np.array([0.85, -0.5, 0.2, -0.4, 71.0])


@pytest.fixture(scope="module")
def study():
    return load_study(Path(template("virtual.toml")))


@pytest.fixture
def priors():
    law = np.diag([0.1, 0.5, 0.1, 0.2, 0.3]) ** 2
    law[0, 1] = law[1, 0] = -0.03
    return correlated([Prior(n, 0.0, 1.0, False, "1", "test") for n in NAMES], TRUTH, law)


def table(**values):
    said = {"name": "k", "source": "tunnel", **values}
    return KnowledgeTable.model_validate(said)


def curve(target, rows, **values):
    return table(kind="curve", target=target, points=[[f"{a!r} rad", v, s] for a, v, s in rows], **values)


def told(study, *tables):
    return replace(study, knowledge=tables)


def test_terms_are_found_among_parameters():
    assert terms_of(["riser_length", "transverse[e]", "axial[1]", "axial[1]@a.canopy1", "sd(axial[1])"]) == (
        ["1"], ["e"], [2, 1],
    )  # fmt: skip


def test_a_curve_of_the_truth_is_met_exactly_by_the_truth(study):
    alpha = [0.1, 0.3, 0.5]
    for target, values in (
        ("C_A", 0.85 - 0.5 * np.square(alpha)),
        ("C_N", 0.2 * np.sin(alpha)),
        ("C_N_rate", -0.4 * np.cos(alpha)),
    ):
        known = observed(study, curve(target, [(a, float(v), 0.01) for a, v in zip(alpha, values, strict=True)]), NAMES)
        np.testing.assert_allclose(known.design @ TRUTH, known.values, atol=1e-12)
        assert not known.design[:, 4].any()


def test_an_error_that_all_points_share_is_in_all_covariances(study):
    made = points(study, curve("C_A", [(0.1, 0.8, 0.01), (0.2, 0.8, 0.02)], common_sd=0.05))
    np.testing.assert_allclose(made.covariance, [[0.0026, 0.0025], [0.0025, 0.0029]])


def test_a_coefficient_multiplies_its_prior_and_moves_those_that_hang_together_with_it(study, priors):
    known = told(study, table(kind="coefficient", target="axial[1]", mean=0.9, sd=0.02, use="prior"))
    made = informed(known, priors)
    weight = 0.1**2 / (0.1**2 + 0.02**2)
    assert made[0].centre == pytest.approx(0.85 + weight * 0.05)
    assert made[0].scale == pytest.approx(0.1 * np.sqrt(1.0 - weight))
    assert made[1].centre == pytest.approx(-0.5 - 0.03 / (0.1**2 + 0.02**2) * 0.05)
    assert "and k (tunnel)" in made[0].source and made[3] == replace(priors[3])


def test_what_is_only_compared_leaves_priors_as_they_are(study, priors):
    assert informed(told(study, curve("C_A", [(0.1, 0.5, 0.01)])), priors) == priors


def test_a_term_that_the_model_lacks_is_left_out_and_said(study, priors):
    known = told(study, table(kind="coefficient", target="axial[alpha^4]", mean=1.0, sd=0.1, use="prior"))
    assert informed(known, priors) == priors
    (entry,) = agreement(
        known, {n: np.full((2, 50), t) + _jitter(i) for i, (n, t) in enumerate(zip(NAMES, TRUTH, strict=True))}
    )
    assert not entry["in_model"] and entry["z"][0] == pytest.approx(10.0)


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
