"""Tables of the structure selection: order of the terms, doubts that count, bounds of one side and of two."""

from __future__ import annotations

from bayeschute.report.tables import structure_tables
from bayeschute.report.wording import MISSING


def texts(row):
    return [cell.text for cell in row]


def facts(rivals=()):
    terms = {"1": 0.5, "alpha": 0.9, "alpha^2": 0.7}
    return {
        "frequency": {"terms": terms, "ceilings": [1.0, 4.0], "by_ceiling": {"alpha": [0.8, 0.6]}},
        "selected": [{"term": "alpha^2", "se": 0.012, "bootstrap_se": 0.034, "differentiation_sd": 0.056}],
        "rivals": list(rivals),
    }


def test_selected_terms_come_first_then_the_most_frequent():
    table = structure_tables.stability_table(facts())
    assert [row[0].text for row in table.rows] == ["alpha^2", "alpha", "1"] and table.marked == {0}
    assert texts(table.rows[0])[1:] == ["70 %", "0.012", "0.034", "0.056", ""]
    assert texts(table.rows[1])[1:4] == ["90 %", "80 %", "60 %"]


def test_a_rival_is_named_from_one_per_cent_on():
    rivals = [{"term": t, "rival": "q", "chance": c} for t, c in (("alpha^2", 0.01), ("alpha", 0.0099), ("1", None))]
    rows = structure_tables.stability_table(facts(rivals)).rows
    assert [row[-1].text for row in rows] == ["q (1 %)", "", ""]


def test_no_selected_term_is_left_out_of_a_long_table():
    names = [f"t{i}" for i in range(20)]
    many = {"frequency": {"terms": dict.fromkeys(names, 0.5)}, "selected": [{"term": n} for n in names[3:]]}
    shown = [row[0].text for row in structure_tables.stability_table(many).rows]
    assert shown == names[3:]
    assert len(structure_tables.stability_table(many | {"selected": []}).rows) == 14


def test_estimates_of_a_structure_go_with_their_terms_at_their_precision():
    found = [{"share": 0.4, "terms": ["1", "alpha"], "estimate": [0.85312, -0.5], "se": [0.012, 0.31], "rms": 0.0456}]
    (row,) = structure_tables.structures_table({"structures": found}).rows
    assert texts(row) == ["40 %", "0.853 1, −0.50 alpha", "0.0456"]


def test_a_criterion_has_one_bound_or_two():
    checks = {
        "coverage": {"value": 0.91, "bound": [0.85, 0.95], "passed": True, "white": 0.5},
        "missed": {"value": 0.3, "bound": 0.2, "passed": False},
        "unknown": {"value": None, "bound": 0.2},
    }
    rows = [texts(row) for row in structure_tables.target_table({"checks": checks}).rows]
    assert rows == [
        ["coverage", "0.910 (as if white: 0.500)", "0.85 to 0.95", "passed"],
        ["missed", "0.300", "0.20", "failed"],
        ["unknown", MISSING, "0.20", "failed"],
    ]


def test_predictions_that_could_not_be_made_have_no_row():
    checks = {"a": {"rms": None}, "b": {"rms": 0.1, "rms_ratio": 1.2, "least_ratio": 1.1, "expected_ratio": 1.3,
              "true_ratio": 1.4, "r2": 0.5, "theil": 0.06, "bias": 0.07, "extrapolated": 0.08}}  # fmt: skip
    (row,) = structure_tables.prediction_table({"check": checks}).rows
    assert texts(row) == ["b", "1.20", "1.10", "1.30", "1.40", "50 %", "0.060", "0.070", "8 %", ""]


def test_the_two_intervals_and_the_two_selections_of_a_known_term_are_not_swapped():
    term = {"term": "alpha", "value": 1.0, "mean": 1.1, "sd": 0.21, "se": 0.22, "white_se": 0.23, "coverage": 0.9,
            "white_coverage": 0.6, "share": 0.8, "ranked": 0.7, "unit": "1/rad"}  # fmt: skip
    (row,) = structure_tables.known_table({"true": [term]}).rows
    assert texts(row) == ["alpha", "1.00", "1.10", "0.21", "0.22", "0.23", "90 %", "60 %", "80 %", "70 %", ""]
    (row,) = structure_tables.known_table({"true": [term | {"rival": "q", "rival_correlation": 0.987}]}).rows
    assert row[-1].text == f"q: 0.987, {MISSING}"
    (row,) = structure_tables.false_table({"false": [{"term": "q", "share": 0.1, "ranked": 0.2}]}).rows
    assert texts(row) == ["q", "10 %", "20 %"]
