"""What stopped runs and changed lines of code ended in, as one page of Markdown.

From what ``hard_stops.py`` and ``mutations.py`` have kept by their option ``--store``.

python benchmarks/stops_page.py
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from calibration_page import _table as table

from bayeschute.prediction.binomial_limits import clopper_pearson

Result = dict[str, Any]
ROOT = Path(__file__).parents[1]
STOPS = ROOT / "models/reference/trust/hard-stops.json"
CHANGES = ROOT / "models/reference/trust/changes.json"
PAGE = ROOT / "docs/stops-and-changes.md"
LIMITS = 0.95  # two-sided confidence of the shares
_STOPS = """\
# Stops and changes

Written by `python benchmarks/stops_page.py`; do not edit. Numbers behind it, with the command, machine and versions of
each: `models/reference/trust/*.json`.

## Runs that were stopped

Runs with `--quick` are stopped at random moments and resumed (`benchmarks/hard_stops.py`). *identical*: of those that
were stopped, how many end with the same numbers, to the last bit, as a run that nothing stopped; *without fault*: no
file half-written under its own name, none left over, no traceback, exit code 0; *resumed in*: median time over that of
the whole run.
"""
_CHANGES = """\
## Mutation tests: random changes in the code

Lines of the numerics, records, prediction and study are changed at random, one at a time (`benchmarks/mutations.py`);
the test file that mirrors the module and the four nearest that import it must notice. *harmless*: survivors that change
nothing anyone could see, judged by a reader, and left out of the shares; *caught now*: with the tests that were written
for survivors since, tried again.
"""


def kept_stops(path: Path, reference: Mapping[str, Any], rows: Iterable[Mapping[str, Any]]) -> None:
    """Merge the totals of each kind of stop into a file: a kind replaces its own only.

    Args:
        path: JSON file.
        reference: Row of the run that nothing stopped, with provenance.
        rows: Of stopped runs.
    """
    held: Result = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    made = {name: reference[name] for name in ("command", "commit", "date", "machine", "versions", "numerics")}
    kinds: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        kinds.setdefault(row["what"], []).append(row)
    for kind, some in kinds.items():
        ran = [row for row in some if row["ok"] is not None]
        held[kind] = {
            "tried": len(ran), "not_tried": len(some) - len(ran), "identical": sum(row["identical"] for row in ran),
            "traceback": sum(row["traceback"] for row in ran), "sound": sum(row["ok"] for row in ran),
            "resumed_in": float(np.median([row["of_reference"] for row in ran])) if ran else None, "provenance": made,
        }  # fmt: skip
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(held, indent=1) + "\n", encoding="utf-8")


def _made(told: Mapping[str, Any]) -> str:
    return f"`{(told['commit'] or 'no checkout')[:7]}`, {told['date']}, {told['machine']}"


def stops_table(stops: Mapping[str, Result]) -> list[str]:
    """Table of the kinds of stops.

    Args:
        stops: As stored.
    """
    head = ["stop", "tried", "identical", "with a traceback", "without fault", "resumed in", "made by"]
    rows = []
    for kind, one in stops.items():
        numbers = [str(one[name]) for name in ("tried", "identical", "traceback", "sound")]
        took = "–" if one["resumed_in"] is None else f"{one['resumed_in']:.2f}"
        rows.append([f"`{kind}`", *numbers, took, _made(one["provenance"])])
    return table(head, rows)


def pooled(samples: Iterable[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Rows of all samples, each with whether it is ``harmless``.

    Args:
        samples: As stored: rows, numbers of harmless ones, provenance.
    """
    return [row | {"harmless": row["number"] in one["harmless"]} for one in samples for row in one["rows"]]


def changes_table(changes: Sequence[Mapping[str, Any]]) -> list[str]:
    """Table of changes by room.

    Args:
        changes: Rows of `pooled`.
    """
    rooms: dict[str, list[Mapping[str, Any]]] = {"all": list(changes)}
    for row in changes:
        rooms.setdefault(row["room"], []).append(row)
    rows = []
    for room, some in [("all", rooms.pop("all")), *sorted(rooms.items())]:
        left_out = sum(row["harmless"] for row in some)
        caught, counted = sum(row["result"] != "survived" for row in some), len(some) - left_out
        share = "–"
        if counted:
            limits = clopper_pearson(caught, counted, LIMITS)
            share = f"{caught / counted:.0%} ({limits.low:.0%} to {limits.high:.0%})"
        first = sum(row.get("at_first", row["result"]) != "survived" for row in some)
        rows.append([room, str(len(some)), str(left_out), str(first), str(caught), share])
    head = ["room", "changes", "harmless", "caught at first", "caught now", f"share now ({LIMITS:.0%} limits)"]
    return table(head, rows)


def survivors(changes: Sequence[Mapping[str, Any]]) -> list[str]:
    """Every change that nothing noticed, as a list.

    Args:
        changes: Rows of `pooled`.
    """
    said = []
    for row in changes:
        if row["result"] == "survived":
            why = "harmless" if row["harmless"] else "not noticed"
            said.append(f"- {why}: `{row['file']}:{row['line']}`, `{row['before']}` became `{row['after']}`")
    return said


def page(stops: Mapping[str, Result] | None, changes: Mapping[str, Any] | None) -> str:
    """The page.

    Args:
        stops: As stored; None where there are none.
        changes: Likewise.
    """
    text: Sequence[str] = [_STOPS, *(stops_table(stops) if stops else ["None are stored.", ""]), _CHANGES]
    if changes is None:
        return "\n".join([*text, "None are stored."]) + "\n"
    for one in changes["samples"]:
        head = f"{len(one['rows'])} changes by {_made(one['provenance'])}"
        text = [*text, f"- {head}: `{one['provenance']['command']}`. {one.get('note', '')}".rstrip()]
    rows = pooled(changes["samples"])
    text = [*text, "", *changes_table(rows), *survivors(rows)]
    return "\n".join(text).rstrip() + "\n"


def stored(path: Path) -> Any:
    """What a file holds; None where there is none."""
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None


if __name__ == "__main__":
    PAGE.write_text(page(stored(STOPS), stored(CHANGES)), encoding="utf-8")
