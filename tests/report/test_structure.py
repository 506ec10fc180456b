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
    marked = [i for i, line in enumerate(lines) if "least predicted error" in line]
    assert marked == [entry["pse_minimum_at"]]
    start = lines[0].index("  term")
    assert [line[start:].split()[0] for line in lines[1:]] == [row["term"] for row in entry["ranking"]]


def test_a_row_that_required_terms_keep_from_the_least_is_not_called_the_least(found):
    entry = found["coefficients"]["axial"]
    rows = entry["ranking"]
    (marked,) = [line for line in print_out(rows, entry["pse_minimum_at"]) if "<-" in line]
    assert marked.endswith("<- least predicted error")
    (marked,) = [line for line in print_out(rows, len(rows)) if "<-" in line]
    assert marked.endswith("<- least predicted error with the terms required")


def test_the_text_tells_every_part(found):
    text = structure_text(found)
    for words in (
        "What the records can tell", "So far.", "axial: 2 of 6 candidates kept", "C_A: 2 of 6 candidates kept",
        "on other: residual 1.00 times that of the fit; 1.00 at the least", "as good as these terms can be there", "Data of known terms (a table; signs conventional)",
        "C_A: 6 candidates, 600 samples, signal over noise 10", "then exchange of terms", "true terms selected",
    ):  # fmt: skip
        assert words in text
    assert max(map(len, text.splitlines())) < 400
    assert structure_text({"coefficients": {}, "sufficiency": ["Nothing."]}) == "What the records can tell\nNothing.\n"


def test_a_missed_target_is_shouted(found):
    missed = json.loads(json.dumps(found))
    missed["synthetic"]["checks"]["true terms selected"]["passed"] = False
    assert "bound 0.8: MISSED" in structure_text(missed)
    table = structure_tables.target_table(missed["synthetic"])
    assert column(table, "Result")[0] == "missed" and table.rows[0][-1].kind == "bad"


def test_grid():
    assert grid(["a", "bb"], [["xyz", "1"]]) == ["a    bb", "xyz   1"]


def test_how_sure_the_terms_are(found):
    facts = found["coefficients"]["axial"]
    table = structure_tables.sureness_table(facts)
    assert column(table, "Term")[:2] == ["1", "alpha^2"] and table.marked >= {0, 1}
    assert column(table, "Kept")[0] == "100 %" and {"0.25 ×", "4 ×"} <= {c.label for c in table.columns}
    assert sum(span for _, span in table.groups) == len(table.columns) == len(table.rows[0])
    assert structure_tables.sureness_table({}) is None and structure_tables.sureness_table({"frequency": None}) is None
    structures = structure_tables.structures_table(facts)
    assert "alpha^2" in structures.rows[0][1].text and structure_tables.structures_table({}) is None


def test_predictions_and_known_terms(found):
    table = structure_tables.prediction_table(found["coefficients"]["axial"])
    assert column(table, "Not used") == ["other"] and column(table, "Residual / fit's") == ["1.00"]
    assert float(column(table, "at the least")[0]) == 1.0 and column(table, "true") == [MISSING]
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
        "What the records can tell, before any fit", "How the axial fit predicts what it has not seen",
        "How sure the axial terms are", "in the polar form of the NASA report", "Would this motion tell known terms?",
        "C_A made of known terms", "Ranking of the C_A candidates", "it has not seen",
    ):  # fmt: skip
        assert words in page
    del found["polar"], found["synthetic"]
    (tmp_path / "structure.json").write_text(json.dumps(found), encoding="utf-8")
    page = build_report(tmp_path).read_text(encoding="utf-8")
    assert "polar form" not in page and "known terms?" not in page
