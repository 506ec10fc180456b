"""Tables of the input data: faults apart from preparation, and many alike as one row that loses nothing."""

from __future__ import annotations

from pathlib import Path

from bayeschute.report.run_results import Results
from bayeschute.report.tables import record_tables
from bayeschute.report.wording import MISSING


def results(**repairs):
    facts = {name: {"repairs": rows} for name, rows in repairs.items()}
    return Results(Path(), {"flights": facts}, {}, {}, {}, {}, {}, {}, ())


def gap(start, end, **more):
    return {"kind": "gap", "variable": "altitude", "start": start, "end": end, "count": 2, "detail": "bridged"} | more


def texts(table):
    return [[cell.text for cell in row] for row in table.rows]


def test_steps_of_preparation_are_no_faults():
    rows = [gap(1.0, 2.0), {"kind": "resampled", "detail": "to 10 Hz"}, {"kind": "assumed", "variable": "density"}]
    found = results(a=rows)
    assert texts(record_tables.repair_table(found)) == [["a", "gap", "altitude", "1.0", "2.0", "2", "bridged"]]
    assert [row[1:3] for row in texts(record_tables.preparation_table(found))] == [
        ["resampled", "all"], ["assumed", "density"],
    ]  # fmt: skip
    (row,) = texts(record_tables.flight_table(found))
    assert row == ["a", MISSING, MISSING, MISSING, "1"]
    assert record_tables.repair_table(results(a=[])) is None


def test_three_alike_stay_and_four_become_one_that_spans_and_counts_them_all():
    few = [gap(10.0 * i, 10.0 * i + 1.0) for i in range(3)]
    assert len(record_tables.repair_table(results(a=few)).rows) == 3
    longest = gap(95.0, 98.5, detail="held")
    (row,) = texts(record_tables.repair_table(results(a=[few[2], few[0], longest, few[1]])))
    assert row == ["a", "gap, 4 times", "altitude", "0.0", "98.5", "8", "held (longest: 3.5 s at 95.0 s)"]


def test_other_variables_and_other_flights_are_not_put_together():
    some = [gap(10.0 * i, 10.0 * i + 1.0, variable=name) for i in range(2) for name in ("altitude", "wind")]
    assert len(record_tables.repair_table(results(a=some, b=some)).rows) == 8


def test_faults_without_times_are_counted_all_the_same():
    (row,) = texts(record_tables.repair_table(results(a=[{"kind": "time_jump", "count": 1}] * 5)))
    assert row == ["a", "time jump, 5 times", "all", MISSING, MISSING, "5", f"(longest: 0 s at {MISSING} s)"]


def test_a_clock_of_the_week_is_told_to_a_tenth_of_a_second():
    (row,) = texts(record_tables.repair_table(results(a=[gap(345678.94, 345679.06)])))
    assert row[3:5] == ["345,678.9", "345,679.1"]


def test_what_a_long_table_leaves_out_is_said():
    table = record_tables.repair_table(results(**{f"f{i}": [gap(1.0, 2.0)] for i in range(63)}))
    assert len(table.rows) == 60 and "; 3 more are listed" in table.caption


def test_roles_are_words_and_a_record_without_facts_is_listed():
    facts = {"a": {"roles": ["identify", "predict"], "samples": 1200, "duration_s": 60.0, "source": "a.csv"}}
    found = Results(Path(), {"flights": facts}, {}, {}, {}, {}, {"b": None}, {}, ())
    first, second = record_tables.flight_table(found).rows
    assert [cell.text for cell in first] == ["a", "identification and prediction", "1,200", "60", "0"]
    assert first[0].small == "a.csv" and second[0].text == "b"
