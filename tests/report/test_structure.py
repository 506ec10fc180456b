"""The search for a structure in words, tables and a page."""

from __future__ import annotations

import json

import pytest

from bayeschute.report.page import build_report
from bayeschute.report.structure_text import grid, print_out, structure_text
from bayeschute.report.tables import structure_tables, summary_tables
from bayeschute.report.wording import MISSING
from tests.report import structure_found as _module


@pytest.fixture(scope="module")
def found():
    return _module.structure_found()


def column(table, label):
    return [row[[c.label for c in table.columns].index(label)].text for row in table.rows]


def test_the_print_out_has_the_columns_of_the_report(found):
    entry = found["coefficients"]["axial"]
    lines = print_out(entry["ranking"], entry["pse_minimum_at"])
    assert lines[0].split() == "o.f. # index sqrt(mse) dmse perr R2 pe n F term".split()
    first = lines[1].split()
    assert first[0] == "1" and first[1] == "0" and first[3].startswith("-") and first[-1] == "1"
    assert len(lines) == 1 + len(entry["ranking"]) == 7
    marked = [i for i, line in enumerate(lines) if "minimum PSE" in line]
    assert marked == [entry["pse_minimum_at"]]
    start = lines[0].index("  term")
    assert [line[start:].split()[0] for line in lines[1:]] == [row["term"] for row in entry["ranking"]]


def test_a_row_that_required_terms_keep_from_the_least_is_not_called_the_least(found):
    entry = found["coefficients"]["axial"]
    rows = entry["ranking"]
    (marked,) = [line for line in print_out(rows, entry["pse_minimum_at"]) if "<-" in line]
    assert marked.endswith("<- minimum PSE")
    (marked,) = [line for line in print_out(rows, len(rows)) if "<-" in line]
    assert marked.endswith("<- minimum PSE with the required terms")


def test_the_text_has_every_part(found):
    text = structure_text(found)
    for words in (
        "Data adequacy", "So far.", "axial: 2 of 6 candidates selected", "C_A: 2 of 6 candidates selected",
        "prediction of other: residual 1.00 times that of the fit; 1.00 with these terms refitted",
        "as good as these terms allow", "Simulation study with known terms (a table; signs conventional)",
        "C_A: 6 candidates, 600 samples, signal-to-noise ratio 10", "then exchange of terms", "true terms selected",
    ):  # fmt: skip
        assert words in text
    assert max(map(len, text.splitlines())) < 400
    assert structure_text({"coefficients": {}, "sufficiency": ["Nothing."]}) == "Data adequacy\nNothing.\n"


def test_a_failed_criterion_is_marked(found):
    missed = json.loads(json.dumps(found))
    missed["synthetic"]["checks"]["true terms selected"]["passed"] = False
    assert "bound 0.8: FAILED" in structure_text(missed)
    table = structure_tables.target_table(missed["synthetic"])
    assert column(table, "Result")[0] == "failed" and table.rows[0][-1].kind == "bad"


def test_grid():
    assert grid(["a", "bb"], [["xyz", "1"]]) == ["a    bb", "xyz   1"]


def test_stability_of_the_terms_are(found):
    facts = found["coefficients"]["axial"]
    table = structure_tables.stability_table(facts)
    assert column(table, "Term")[:2] == ["1", "alpha^2"] and table.marked >= {0, 1}
    assert column(table, "Selected")[0] == "100 %" and {"0.25 ×", "4 ×"} <= {c.label for c in table.columns}
    assert sum(span for _, span in table.groups) == len(table.columns) == len(table.rows[0])
    assert all(structure_tables.stability_table(nothing) is None for nothing in ({}, {"frequency": None}))
    structures = structure_tables.structures_table(facts)
    assert "alpha^2" in structures.rows[0][1].text and structure_tables.structures_table({}) is None


def test_predictions_and_known_terms(found):
    table = structure_tables.prediction_table(found["coefficients"]["axial"])
    assert column(table, "Data not fitted") == ["other"] and column(table, "Predicted") == ["1.00"]
    assert float(column(table, "Refitted")[0]) == 1.0 and column(table, "True") == [MISSING]
    assert sum(span for _, span in table.groups) == len(table.columns) == len(table.rows[0])
    spoilt = {"rms": 0.1, "rms_ratio": 1.3, "least_ratio": 1.0, "without": {"term": "alpha^2", "rms_ratio": 1.1}}
    facts = found["coefficients"]["axial"] | {"check": {"other": spoilt}}
    assert column(structure_tables.prediction_table(facts), "Better without") == ["alpha^2: 1.10"]
    text = structure_text({"coefficients": {"axial": facts}})
    assert "; 1.10 without alpha^2" in text and "as good as" not in text
    known = structure_tables.known_table(found["synthetic"]["coefficients"]["C_A"])
    assert column(known, "Term") == ["1", "alpha^2"] and known.rows[1][0].small == "1/rad^2"
    assert sum(span for _, span in known.groups) == len(known.columns) == len(known.rows[0])
    assert structure_tables.known_table({}) is None and structure_tables.false_table({}) is None


def test_the_ceiling_that_was_used_stands_out(found):
    facts = found["coefficients"]["axial"]
    table = summary_tables.ceiling_table(facts)
    (row,) = table.marked
    assert table.rows[row][1].text == str(facts["pse_minimum_at"])


def test_the_page_shows_all_of_it(found, tmp_path):
    (tmp_path / "summary.json").write_text('{"title": "Known terms"}', encoding="utf-8")
    (tmp_path / "structure.json").write_text(json.dumps(found), encoding="utf-8")
    page = build_report(tmp_path).read_text(encoding="utf-8")
    for words in (
        "Data adequacy: which terms", "Prediction of data that were not fitted: axial coefficient",
        "Stability of the axial selection", "in the polar form of the NASA report",
        "are known terms selected on this motion?", "C_A with known terms", "Ranking of the C_A candidates",
    ):  # fmt: skip
        assert words in page
    del found["polar"], found["synthetic"]
    (tmp_path / "structure.json").write_text(json.dumps(found), encoding="utf-8")
    page = build_report(tmp_path).read_text(encoding="utf-8")
    assert "polar form" not in page and "are known terms" not in page
