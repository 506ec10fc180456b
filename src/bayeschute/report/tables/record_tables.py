"""Tables of the input data: flights, faults of their records, and preparation of the records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from bayeschute.report.run_results import Results, entries, mappings
from bayeschute.report.sentences import plain
from bayeschute.report.tables.summary_tables import Cell, Table, cells, table_of
from bayeschute.report.wording import MISSING, ROLES, is_number, listed, short, whole

PREPARATION = ("resampled", "derived", "assumed")  # kinds that are steps of the work and no faults of a record
MOST_ROWS = 60
MOST_ALIKE = 3  # more faults of one kind in one variable become one row

Repairs = Sequence[Mapping[str, Any]]


def faults_of(repairs: Repairs) -> list[Mapping[str, Any]]:
    """Repairs that concern missing or faulty data."""
    return [r for r in repairs if r.get("kind") not in PREPARATION]


def _flights(results: Results) -> dict[str, tuple[Mapping[str, Any], list[Mapping[str, Any]]]]:
    """Flight name to its facts and its repairs."""
    names, named = dict.fromkeys([*results.part("flights"), *results.flights]), entries(results.part("flights"))
    facts = {name: named.get(name, {}) for name in names}
    return {name: (said, mappings(said.get("repairs"))) for name, said in facts.items()}


def flight_table(results: Results) -> Table | None:
    """Input data: flights, their use, length and number of faults found."""
    rows = []
    for name, (facts, repairs) in _flights(results).items():
        roles = facts.get("roles") or []
        source = facts.get("source")
        rows.append(
            cells(
                Cell(name, "strong", str(source) if source else ""),
                listed([ROLES.get(str(r), str(r)) for r in roles]) if roles else MISSING,
                whole(facts.get("samples")),
                short(facts.get("duration_s")),
                str(len(faults_of(repairs))),
            )
        )
    return table_of("Flight:text|Used for:text|Samples:num|Length [s]:num|Faults found:num", rows)


def _length(repair: Mapping[str, Any]) -> float:
    """How long a repair lasts [s]; 0 where it has no times."""
    start, end = repair.get("start"), repair.get("end")
    return float(end) - float(start) if is_number(start) and is_number(end) else 0.0


def _together(alike: Repairs) -> Mapping[str, Any]:
    """Many faults of one kind in one variable as one."""
    longest = max(alike, key=_length)
    starts = [r["start"] for r in alike if is_number(r.get("start"))]
    ends = [r["end"] for r in alike if is_number(r.get("end"))]
    counts = [r["count"] for r in alike if is_number(r.get("count"))]
    detail = (
        f"{longest.get('detail') or ''} (longest: {short(_length(longest), 3)} s at {_clock(longest.get('start'))} s)"
    )
    return {
        "kind": f"{plain(str(alike[0].get('kind', MISSING)))}, {len(alike)} times",
        "variable": alike[0].get("variable"),
        "start": min(starts, default=None),
        "end": max(ends, default=None),
        "count": sum(counts) if counts else None,
        "detail": detail.strip(),
    }


def _grouped(repairs: Repairs) -> list[Mapping[str, Any]]:
    """Repairs with those of one kind and variable put together where they are many."""
    groups: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for repair in repairs:
        groups.setdefault((str(repair.get("kind")), str(repair.get("variable"))), []).append(repair)
    found: list[Mapping[str, Any]] = []
    for alike in groups.values():
        found += [_together(alike)] if len(alike) > MOST_ALIKE else alike
    return found


def _clock(time: Any) -> str:
    """A time on the record's clock, which may count from the beginning of the week, to a tenth of a second."""
    return f"{float(time):,.1f}" if is_number(time) else MISSING


def _rows(results: Results, preparation: bool) -> list[tuple[Cell, ...]]:
    """Rows of faults, or of the steps of preparation."""
    rows = []
    for name, (_, repairs) in _flights(results).items():
        faults = faults_of(repairs)
        for repair in _grouped([r for r in repairs if r not in faults] if preparation else faults):
            rows.append(
                cells(
                    name,
                    plain(str(repair.get("kind", MISSING))),
                    Cell(str(repair.get("variable") or "all"), "code"),
                    _clock(repair.get("start")),
                    _clock(repair.get("end")),
                    whole(repair.get("count")),
                    Cell(str(repair.get("detail") or ""), "wrap"),
                )
            )
    return rows


def _table(rows: list[tuple[Cell, ...]], label: str) -> Table | None:
    """A table of repairs; the number of rows that were omitted is in the caption."""
    columns = f"Flight:text|{label}:text|Variable:code|From [s]:num|To [s]:num|Samples:num|Detail:text"
    more = len(rows) - MOST_ROWS
    caption = f"The first {MOST_ROWS}; {more} more are listed in the records under flights/." if more > 0 else ""
    return table_of(columns, rows[:MOST_ROWS], caption)


def repair_table(results: Results) -> Table | None:
    """Gaps, outliers and jumps that were found in the records."""
    return _table(_rows(results, preparation=False), "Fault")


def preparation_table(results: Results) -> Table | None:
    """What was resampled, derived or assumed."""
    return _table(_rows(results, preparation=True), "Step")
