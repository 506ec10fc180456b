"""Verdicts with standard errors: what a campaign of a given size calls kept, by exact binomial probabilities."""

from __future__ import annotations

import pytest
from scipy.stats import binom

from bayeschute.calibration.promises import is_headline, judge, promised, promises, verdict
from bayeschute.calibration.scores import standard_error


def probability(coverage: float, replicates: int, word: str) -> float:
    """Probability that replicates of a true coverage get a verdict."""
    counts = range(replicates + 1)
    said = [judge(k / replicates, standard_error(k / replicates, replicates)) == word for k in counts]
    return float(sum(binom.pmf(k, replicates, coverage) for k, yes in zip(counts, said, strict=True) if yes))


def test_a_true_coverage_of_82_percent_seldom_passes():
    assert probability(0.82, 100, "kept") < 0.03
    assert probability(0.82, 400, "kept") < 0.01


def test_a_right_inference_is_seldom_refused_and_passes_with_enough_replicates():
    assert probability(0.9, 100, "too narrow") < 0.005 and probability(0.9, 100, "too wide") < 0.02
    assert probability(0.9, 400, "kept") > 0.9


@pytest.mark.parametrize(
    ("share", "error", "word"),
    [(0.9, 0.01, "kept"), (0.82, 0.01, "too narrow"), (0.98, 0.01, "too wide"), (0.87, 0.03, "undecided")],
)
def test_judge(share, error, word):
    assert judge(share, error) == word


def summary(replicates=200, failed=0, **shares):
    held = {"axial[1]": 0.91, "riser_length": 0.9, "a/swing_angle": 0.9, "b/swing_angle": 0.89, "f/swing_angle": 0.9}
    held |= shares
    bands = {n: {"role": "identify" if n.startswith("f/") else "predict"} for n in held if "/" in n}
    value = {"role": "predict", "share": 0.92, "standard_error": 0.02}
    return {
        "replicates": replicates, "failed": {str(i): "lost" for i in range(failed)}, "coverage": held,
        "standard_error": dict.fromkeys(held, 0.01), "parameters": {"axial[1]": {}, "riser_length": {}}, "bands": bands,
        "modes": {"a/pendulum amplitude": value}, "statistics": {"a/mean descent_rate": value},
    }  # fmt: skip


def test_everything_that_is_shown_is_judged():
    names = promised(summary())
    assert {"riser_length", "f/swing_angle", "a/pendulum amplitude", "a/mean descent_rate"} <= set(names)


def test_promises_do_not_depend_on_what_flights_are_called():
    made = promises(summary())
    assert set(made) == {
        "axial[1]", "riser_length", "predict/swing_angle", "identify/swing_angle", "predict/pendulum amplitude",
        "predict/mean descent_rate",
    }  # fmt: skip
    assert made["predict/swing_angle"].share == 0.89 and made["predict/swing_angle"].words == "89 ± 1 %"


@pytest.mark.parametrize(
    ("count", "failed", "word"),
    [(100, 5, "kept"), (99, 0, "too few replicates"), (100, 6, "too many failed")],
)
def test_few_or_failed_replicates_support_no_verdict(count, failed, word):
    assert verdict(summary(count, failed), "axial[1]") == word


def test_a_term_that_few_replicates_fitted_is_judged_by_none():
    """One miss of one is no evidence; a term that flies and is left out counts as fitted, and as missed."""
    rare, known = {"replicates": 2, "left_out": 0}, {"replicates": 60, "left_out": 40}
    made = summary() | {"parameters": {"axial[closing]": rare, "axial[1]": known}}
    made["coverage"] = made["coverage"] | {"axial[closing]": 0.0, "axial[1]": 0.55}
    made["standard_error"] = made["standard_error"] | {"axial[closing]": 0.33}
    assert verdict(made, "axial[closing]") == "fitted by too few replicates"
    assert verdict(made, "axial[1]") == "too narrow"


def test_results_stored_before_statistics_were_scored_are_read():
    old = {key: value for key, value in summary().items() if key not in ("statistics", "modes")}
    assert "axial[1]" in promises(old) and "a/mean descent_rate" not in promised(old)


def test_headlines_are_aerodynamic_parameters_unseen_bands_and_requirements():
    named = ["predict/mean descent_rate"]
    for name in ("axial[1]", "predict/swing_angle", *named):
        assert is_headline(name, named)
    for name in ("riser_length", "identify/swing_angle", "predict/pendulum amplitude", "predict/final descent_rate"):
        assert not is_headline(name, named)
