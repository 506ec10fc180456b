"""Shares, coverages and verdicts of a simulation study, counted by hand on made-up replicates."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.regression.noise_ceiling import REPORT_SAFETY
from bayeschute.regression.orthogonal import select
from bayeschute.structure.confusable_terms import Rival
from bayeschute.structure.synthetic import Making, Replicates
from bayeschute.structure.synthetic_entry import checks, synthetic_entry

NAMES = ("1", "alpha", "q", "alpha*q")
RNG = np.random.default_rng(2)
X = np.column_stack([np.ones(80), RNG.normal(size=(80, 3))])


class _Numbers:
    """Whatever is asked for by name."""

    def __init__(self, **values):
        self.__dict__.update(values)


@pytest.fixture(scope="module")
def told():
    """Ten replicates; true are 1 and alpha*q."""
    kept = np.zeros((10, 4), bool)
    kept[:, 0], kept[:7, 3], kept[:3, 1], kept[:0, 2] = True, True, True, True
    ranked = kept.copy()
    ranked[9, 0], ranked[:6, 2] = False, True
    inside = np.ones((10, 2), bool)
    inside[:2, 1] = False
    estimate = np.tile([0.9, 0.4], (10, 1))
    estimate[0] += [-3.0 * 0.3, 2.4 * 0.6]
    first = _Numbers(selection=select(X, X @ [1.0, 0.2, 0.0, 0.5] + 0.1 * RNG.normal(size=80), NAMES, sigma_max2=0.3))
    given = dict.fromkeys(Replicates._fields) | dict(
        names=NAMES, true=(0, 3), value=np.array([0.9, 0.4]), sigma=0.1, memory=4.0, ranked=ranked, kept=kept,
        estimate=estimate, se=np.full((10, 2), 0.3) * [1.0, 2.0], white_se=np.full((10, 2), 0.1), inside=inside,
        white_inside=np.zeros((10, 2), bool), kept_inside=kept[:, [0, 3]] & inside, ceiling=np.full(10, 0.08),
        rivals=(Rival(*[None] * len(Rival._fields))._replace(rival="q", correlation=0.5, chance=0.1),
                Rival(*[None] * len(Rival._fields))._replace(rival="", correlation=0.0, chance=0.0)),
        first=first, first_fit=_Numbers(se=np.array([0.3, 0.6])), bootstrap_se=np.array([0.33, 0.3]),
        seen=_Numbers(with_mean=20.0, about_mean=5.0, sd=1.0),
    )  # fmt: skip
    return synthetic_entry(Replicates(**given), Making(12.0, 0.5, 10), X)


def test_shares_are_counts_of_replicates(told):
    assert [t["share"] for t in told["true"]] == [1.0, 0.7] and [t["ranked"] for t in told["true"]] == [0.9, 0.7]
    assert (told["least_true"], told["most_false"]) == (0.7, 0.3)
    assert (told["least_true_ranked"], told["most_false_ranked"]) == (0.7, 0.6)
    assert told["false"] == [{"term": "alpha", "share": 0.3, "ranked": 0.3}]  # q, never selected, is not listed


def test_coverages_and_distances(told):
    assert told["coverage"] == 0.9 and told["white_coverage"] == 0.0
    assert told["selected_coverage"] == pytest.approx(15 / 17)  # 10 and 7 selected, 2 of the latter don't cover
    assert told["exact"] == 0.4  # replicates 4 to 7
    assert told["largest_z"] == pytest.approx(3.0) and told["beyond"] == pytest.approx(1 / 20)
    assert told["ceiling_over_truth"] == pytest.approx([2.0, 2.0, 2.0])  # 0.08 / (0.1^2 * 4)


def test_a_true_term_has_the_numbers_of_its_own_column(told):
    one, other = told["true"]
    assert (one["term"], other["term"]) == ("1", "alpha*q")
    assert other["mean"] == pytest.approx(0.4 + 0.144) and other["sd"] == pytest.approx(1.44 / np.sqrt(10.0))
    assert (one["se"], other["se"]) == (pytest.approx(0.3), pytest.approx(0.6)) and other["white_se"] == pytest.approx(
        0.1
    )
    assert one["bootstrap_ratio"] == pytest.approx(1.1) and other["bootstrap_ratio"] == pytest.approx(0.5)
    assert (one["coverage"], other["coverage"]) == (1.0, 0.8) and [
        one["largest_z"],
        other["largest_z"],
    ] == pytest.approx([3.0, 2.4])
    assert one["rival"] == "q" and one["rival_share"] == 0.0 and other["rival_share"] == 0.0


def test_the_report_s_rule_is_asked_at_its_own_ceiling(told):
    assert told["report_rule"]["sigma_max2"] == REPORT_SAFETY
    assert told["report_rule"]["terms"] < told["pse_minimum_at"]


def _entry(**changes):
    sound = {
        "least_true": 0.8, "most_false": 0.2, "replicates": 100, "true": [0, 1], "coverage": 0.9, "white_coverage": 0.5,
        "beyond": 0.02, "penalty_per_term": [1.0, 1.0],
    }  # fmt: skip
    return sound | changes


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"least_true": 0.799}, "true terms selected"),
        ({"most_false": 0.201}, "false terms selected"),
        ({"coverage": 0.84}, "coverage of 90 % intervals"),
        ({"coverage": 0.96}, "coverage of 90 % intervals"),
        ({"beyond": 0.026}, "estimates beyond 2.5 standard errors"),
        ({"penalty_per_term": [1.0, 1.0 + 1e-8]}, "penalty per term constant"),
    ],
)
def test_a_criterion_that_is_missed_is_the_only_one(changes, name):
    assert all(one["passed"] for one in checks({"C_A": _entry()}).values())
    assert [key for key, one in checks({"C_A": _entry(**changes)}).items() if not one["passed"]] == [name]


def test_coverage_is_over_all_intervals_of_all_coefficients():
    """Three hundred intervals that cover in 0.9, and one hundred that do in 0.6."""
    both = {"C_A": _entry(true=[0, 1, 2]), "C_N": _entry(true=[0], coverage=0.6, white_coverage=0.1, beyond=0.1)}
    made = checks(both)
    assert made["coverage of 90 % intervals"]["value"] == pytest.approx(0.825)
    assert made["coverage of 90 % intervals"]["white"] == pytest.approx(0.4)
    assert made["estimates beyond 2.5 standard errors"]["value"] == pytest.approx(0.04)
