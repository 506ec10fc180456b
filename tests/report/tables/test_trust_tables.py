"""Tables of trust: coverage of bands without draws, limits on either side, tolerance, warnings that no check tells."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from bayeschute.report.run_results import Results
from bayeschute.report.tables import trust_tables
from bayeschute.report.wording import MISSING


def results(summary, **risk):
    return Results(Path(), summary, {}, {}, {}, {}, {}, risk, ())


def texts(row):
    return [cell.text for cell in row]


def test_coverage_is_of_truth_record_and_the_inner_band_in_this_order():
    shares = {"truth": 0.91, "truth_p": 0.52, "record": 0.85, "record_p": 0.3, "draws": 90, "failed": 10}
    found = results({"coverage": {"a": {"swing_angle": shares, "descent_rate": {"draws": 0, "failed": 100}}}})
    swing, descent = trust_tables.coverage_table(found, {("a", "swing_angle"): 0.48}).rows
    assert texts(swing) == ["a", "swing angle", "91 %", "85 %", "48 %", "0.52"]
    assert swing[1].small == "10 of 100 simulations failed"
    assert texts(descent)[2:] == ["none"] * 4 and {cell.kind for cell in descent[2:]} == {"bad"}
    assert trust_tables.coverage_table(results({}), {}) is None
    recorded = {"truth": None, "record": 0.85, "record_p": 0.0025, "draws": 90, "failed": 0}
    (row,) = trust_tables.coverage_table(results({"coverage": {"a": {"swing_angle": recorded}}}), {}).rows
    assert texts(row)[2:] == [MISSING, "85 %", MISSING, "0.0025"]


def test_a_check_is_passed_failed_or_not_judged():
    checks = {
        "rhat": {"passed": True, "value": 1.002, "bound": 1.01, "detail": "Do the chains agree?"},
        "ess_bulk": {"passed": False, "value": 90, "bound": 400},
        "mode": {"passed": None, "value": None},
    }
    rows = trust_tables.check_table(results({"checks": checks})).rows
    assert [(row[-1].text, row[-1].kind) for row in rows] == [
        ("passed", "good"), ("failed", "bad"), ("not judged", "weak"),
    ]  # fmt: skip
    assert texts(rows[0])[1:4] == ["Do the chains agree?", "1.002", "at most 1.01"]
    assert texts(rows[1])[2:4] == ["90", "at least 400"] and texts(rows[2])[2:4] == [MISSING, MISSING]


def test_a_requirement_has_its_limits_on_the_right_sides_and_in_the_shown_unit():
    one = {
        "name": "upright", "quantity": "swing_angle", "statistic": "maximum", "unit": "rad", "at_most": 0.5,
        "probability_met": 0.9, "simulation_low": 0.88, "simulation_high": 0.92, "posterior_q05": 0.7,
        "posterior_q95": 0.97, "q05": 0.1, "median": 0.2, "q95": 0.4, "simulations": 1000, "failed": 3, "run": "a",
    }  # fmt: skip
    (row,) = trust_tables.requirement_table(results({"requirements": [one]})).rows
    assert texts(row)[2:] == ["11.5 deg", "0.90", "0.88 … 0.92", "0.70 … 0.97", "1,000"]
    assert row[2].small == "90 %: 5.73 … 22.9" and row[6].small == "3 failed"
    assert row[0].small == "swing angle, maximum over the window, a"
    bare = {key: one[key] for key in ("name", "quantity", "statistic", "unit", "probability_met")}
    (row,) = trust_tables.requirement_table(results({"requirements": [bare]})).rows
    assert texts(row)[4:6] == [MISSING, MISSING]


def test_what_requirements_ask_for_comes_before_the_usual_and_only_what_is_there():
    pairs = [("descent_rate", "final"), ("descent_rate", "mean"), ("swing_angle", "maximum"), ("x", "mean")]
    there = pd.DataFrame(pairs, columns=["quantity", "statistic"])
    asked = [{"quantity": "descent_rate", "statistic": s} for s in ("mean", "maximum")]
    shown = trust_tables.shown_statistics(results({"requirements": asked}), there)
    assert list(shown.itertuples(index=False, name=None)) == [
        ("descent_rate", "mean"), ("swing_angle", "maximum"), ("descent_rate", "final"),
    ]  # fmt: skip


def tolerance(rows):
    columns = ["failures", "needed", "enough", "limit"]
    frame = pd.DataFrame(rows, columns=columns)
    same = {
        "run": "a",
        "quantity": "descent_rate",
        "statistic": "final",
        "share": 0.95,
        "confidence": 0.9,
        "unit": "m/s",
    }
    return frame.assign(**same)


def told(rows):
    (row,) = trust_tables.tolerance_report(results({}, tolerance=tolerance(rows))).rows
    return texts(row)[2:]


def test_the_tightest_tolerance_limit_that_the_draws_allow_is_told():
    """More failures allowed: more draws needed, and a lower limit."""
    rows = [(0, 45, True, 12.0), (1, 77, True, 11.5), (2, 105, False, 11.0)]
    assert told(rows) == ["95 / 90", "77", "1", "11.5 m/s (37.7 ft/s)"]
    assert told([(0, 45, False, 12.0), (1, 77, False, 11.5)]) == ["95 / 90", "45", "0", "too few draws"]
    assert told([(0, 45, True, float("nan"))])[-1] == "none: failed simulations"


def test_quantiles_of_a_marginal_stand_in_order_in_si_and_below_in_us_units():
    row = {
        "parameter": "m", "unit": "kg", "family": "normal", "location": 1.0, "scale": 0.5, "ks_distance": 0.0123,
        "q00135": 1.0, "q05": 2.0, "q50": 3.0, "q95": 4.0, "q99865": 5.0,
    }  # fmt: skip
    (told,) = trust_tables.marginal_report(results({}, marginals=pd.DataFrame([row]))).rows
    assert [float(cell.text) for cell in told[3:]] == pytest.approx([1.0, 0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 0.012])
    assert [float(cell.small) for cell in told[5:10]] == pytest.approx([2.205, 4.409, 6.614, 8.818, 11.02], rel=1e-3)


def test_only_counts_that_no_check_tells_are_told_beside_failed_checks():
    sampling = {"divergences": 3, "failed_solves": 1}
    assert trust_tables.warnings_of(results({"sampling": sampling})) == [
        "3 transitions of the sampling diverged; see “Checks and diagnostics”.",
        "1 simulation of the sampling failed; see “Checks and diagnostics”.",
    ]
    checks = {"divergences": {"passed": False, "detail": "too many"}, "failed_solves": {"passed": True}}
    assert trust_tables.warnings_of(results({"sampling": sampling, "checks": checks})) == [
        "Failed check: too many.", "1 simulation of the sampling failed; see “Checks and diagnostics”.",
    ]  # fmt: skip
    calm = {"divergences": {"passed": True, "detail": "none"}}
    assert trust_tables.warnings_of(results({"sampling": {"divergences": 0}, "checks": calm})) == []
