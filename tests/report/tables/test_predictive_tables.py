"""Table of predictive checks: smallest p-values first, those below the corrected bound marked."""

from __future__ import annotations

from pathlib import Path

from bayeschute.report.run_results import Results
from bayeschute.report.tables.predictive_tables import error_table, predictive_table


def results(summary):
    return Results(Path(), summary, {}, {}, {}, None, {}, {}, {}, ())


def entry(p, what="innovations of swing"):
    return {"flight": "a", "what": what, "statistic": "mean", "value": 0.1, "expected": 0.0, "p": p}


def test_the_smallest_come_first_and_are_marked_below_the_bound():
    table = predictive_table(results({"predictive": {"bound": 0.01, "checks": [entry(0.5), entry(1e-6, "wind")]}}))
    assert [row[1].text for row in table.rows] == ["wind", "innovations of swing"]
    assert [row[5].kind for row in table.rows] == ["bad", ""]
    assert "of 2 p-values" in table.caption and "below 0.005" in table.caption


def error(p, matters):
    size = {"what": "the mass of the capsule", "unit": "%", "estimate": 5.4321, "se": 0.567, "moves": 7.0}
    return {"flight": "a", **size, "p": p, "matters": matters, "do": "Weigh it."}


def test_errors_that_count_are_marked_and_told_with_what_to_do():
    """Two checks: a p-value below 0.005 is one that chance does not make."""
    rows = [error(1e-9, True), error(1e-9, False), error(0.2, True)]
    part = {"bound": 0.01, "checks": [entry(0.5), entry(0.6)], "errors": rows}
    table = error_table(results({"predictive": part}))
    assert [row[3].kind for row in table.rows] == ["bad", "", ""]
    assert [row[5].text for row in table.rows] == ["Weigh it.", "Weigh it.", ""]
    assert table.rows[0][2].text == "5.43 ± 0.57 %" and "below 0.005" in table.caption
    assert error_table(results({"predictive": {"checks": [entry(0.5)]}})) is None


def test_a_small_p_value_that_does_not_count_is_not_marked():
    part = {"bound": 0.01, "checks": [entry(1e-6) | {"matters": False, "unit": "m"}]}
    (row,) = predictive_table(results({"predictive": part})).rows
    assert row[5].kind == "" and row[3].text == "0.100 m"


def test_a_run_without_checks_has_no_table():
    assert predictive_table(results({})) is None
    assert predictive_table(results({"predictive": {"checks": [{"p": None}, 3]}})) is None
