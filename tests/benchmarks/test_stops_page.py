"""The page of stopped runs and changed code: it is that of the stored files, and its counts are those of the rows."""

from __future__ import annotations

import copy
import json

import mutations
import pytest
import stops_page

MADE = {"command": "benchmarks/hard_stops.py", "commit": "0123456789", "date": "2026-01-02", "machine": "two cores",
        "versions": {}, "numerics": "ab"}  # fmt: skip


def _stop(what, ok=True, identical=True, share=0.5):
    return {"what": what, "ok": ok, "identical": identical, "traceback": False, "of_reference": share}


def _change(number, result, room="records", **more):
    told = {"file": f"src/bayeschute/{room}/a.py", "line": number, "before": "a + b", "after": "a - b"}
    return {"number": number, "room": room, "result": result} | told | more


CHANGES = {"samples": [
    {"provenance": MADE, "harmless": [3], "sample": {"seed": 1},
     "rows": [_change(1, "caught"), _change(2, "survived"), _change(3, "survived"), _change(4, "timeout", "core")]},
    {"provenance": MADE, "harmless": [], "sample": {"seed": 2}, "rows": [_change(3, "caught", at_first="survived")]},
]}  # fmt: skip


def _cells(lines, name):
    (line,) = [line for line in lines if line.startswith(f"| {name} ")]
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_the_shipped_page_is_that_of_the_stored_files():
    stops, changes = stops_page.stored(stops_page.STOPS), stops_page.stored(stops_page.CHANGES)
    assert stops is not None
    assert stops_page.PAGE.read_text(encoding="utf-8") == stops_page.page(stops, changes), (
        "python benchmarks/stops_page.py writes it anew"
    )


def test_a_kind_of_stop_replaces_its_own_only_and_what_was_not_tried_is_told_apart(tmp_path):
    path = tmp_path / "trust" / "stops.json"
    stops_page.kept_stops(path, MADE, [_stop("kill"), _stop("kill", False, False, 0.3), _stop("disk")])
    stops_page.kept_stops(path, MADE | {"date": "2026-03-04"}, [_stop("disk", False), {"what": "disk", "ok": None}])
    held = json.loads(path.read_text())
    assert [held["kill"][name] for name in ("tried", "identical", "sound")] == [2, 1, 1]
    assert held["kill"]["resumed_in"] == pytest.approx(0.4)
    assert [held["disk"][name] for name in ("tried", "not_tried", "sound")] == [1, 1, 0]
    assert held["kill"]["provenance"]["date"] == "2026-01-02" and held["disk"]["provenance"]["date"] == "2026-03-04"
    assert _cells(stops_page.stops_table(held), "`kill`")[1:5] == ["2", "1", "0", "1"]


def test_changes_are_counted_by_room_and_harmless_ones_leave_the_share():
    """And those of one sample are no others' of the same number."""
    rows = stops_page.pooled(CHANGES["samples"])
    lines = stops_page.changes_table(rows)
    assert _cells(lines, "all")[1:5] == ["5", "1", "2", "3"] and _cells(lines, "all")[5].startswith("75%")
    assert _cells(lines, "core")[1:5] == ["1", "0", "1", "1"]
    assert _cells(lines, "records")[1:5] == ["4", "1", "1", "2"]
    said = stops_page.survivors(rows)
    assert [line.split(":")[0] for line in said] == ["- not noticed", "- harmless"]


def test_a_room_of_harmless_changes_alone_has_no_share():
    alone = [_change(3, "survived", harmless=True)]
    assert _cells(stops_page.changes_table(alone), "all")[5] == "–"


def test_every_stored_count_is_on_the_page():
    stops = {"kill": {"tried": 7, "not_tried": 0, "identical": 6, "traceback": 1, "sound": 5, "resumed_in": 0.25,
                      "provenance": MADE}}  # fmt: skip
    before = stops_page.page(stops, CHANGES)
    for name in ("tried", "identical", "traceback", "sound", "resumed_in"):
        changed = copy.deepcopy(stops)
        changed["kill"][name] += 30
        assert stops_page.page(changed, CHANGES) != before, name


def test_a_change_that_is_tried_again_tells_what_was_found_first(tmp_path):
    rows = mutations.Rows(tmp_path / "rows.jsonl", {"seed": 1})
    for result in ("survived", "survived", "caught"):
        rows.keep({"number": 4, "result": result})
    rows.keep({"number": 5, "result": "caught"})
    assert rows.done[4]["at_first"] == "survived" and "at_first" not in rows.done[5]
    again = mutations.Rows(tmp_path / "rows.jsonl", {"seed": 1})
    assert again.done[4] == rows.done[4]
