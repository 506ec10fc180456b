"""Table of predictive checks: smallest p-values first, those below the corrected bound marked."""

from __future__ import annotations

from pathlib import Path

from bayeschute.report.run_results import Results
from bayeschute.report.tables.predictive_tables import predictive_table


def results(summary):
    return Results(Path(), summary, {}, {}, {}, None, {}, {}, {}, ())


def entry(p, what="innovations of swing"):
    return {"flight": "a", "what": what, "statistic": "mean", "value": 0.1, "expected": 0.0, "p": p}


def test_the_smallest_come_first_and_are_marked_below_the_bound():
    table = predictive_table(results({"predictive": {"bound": 0.01, "checks": [entry(0.5), entry(1e-6, "wind")]}}))
    assert [row[1].text for row in table.rows] == ["wind", "innovations of swing"]
    assert [row[5].kind for row in table.rows] == ["bad", ""]
    assert "of 2 p-values" in table.caption and "below 0.005" in table.caption


def test_a_run_without_checks_has_no_table():
    assert predictive_table(results({})) is None
    assert predictive_table(results({"predictive": {"checks": [{"p": None}, 3]}})) is None
