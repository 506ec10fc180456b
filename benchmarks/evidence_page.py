"""Results on flights that this simulator did not make as one page of Markdown.

From what ``other_flights.py``, ``optimum.py`` and ``measured_flights.py`` have kept by their option ``--store``.

python benchmarks/evidence_page.py
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

from calibration_page import _table as table
from other_flights import QUANTITIES
from other_stored import ROOT, present

Result = dict[str, Any]
STORED = ROOT / "models/reference/other_flights"
INDEPENDENT = ROOT / "models/reference/independent_flights"
STARTS = ROOT / "models/reference/starts"
MEASURED = ROOT / "models/reference/measured_flights"
PAGE = ROOT / "docs/other-flights.md"
SCORES = (("held", 100.0, ".0f"), ("width_over_replicates", 1.0, ".2f"), ("wis_over_climatology", 1.0, ".2f"))
NOTHING = "–"
_WORDS = """\
# Flights of another program

Written by `python benchmarks/evidence_page.py`; do not edit. Numbers behind it, with the command, machine and versions
of each: `models/reference/other_flights/*.json`.

Each set is a vehicle with physics that this program does not know of (`benchmarks/other_flights.py`). Its first flight
is fitted, the others are predicted from that fit. Sets and parts that are not listed have no stored result.

- *converged*: whether the fit found its optimum; *checks missed*: of the run, which then has no level of trust.
- *processor*: seconds of the command and its children; *terms*: aerodynamic terms that were fitted.
- *made by*: commit, whose rules wrote the study and whose checks judged it (`+`: with uncommitted changes), and date
  (UTC); *numerics*: whether the code that computes is the present one by its hash, or gives the same numbers but
  for rounding in the runs of `models/reference/numerics`.
"""
_FORETOLD = """\
## Predicted flights

- *held*: percent of the true samples inside the nominal 90 % band, pooled over the flight and its replicates;
  *against*: what the truth is. Where there are no true histories it is the record of the flight itself.
- *width*: mean width of the band over that of the replicates' own 5 to 95 %; one is as wide as chance alone.
- *score*: weighted interval score over climatology's, the constant band of what the fitted record shows; below one is
  better.
- Descent is the descent rate at sea level. The mean is over flights that have true histories, each counting alike.
"""
_TURNED = """\
## Turned round

The same sets with another flight fitted and the first one predicted (`--identify 2`).
"""
_WINDOWS = """\
## Windows

Fits of the first so many seconds of the first flight, up to the checks.
"""
_INDEPENDENT = """\
## Flights of an independent simulator

Sets that `benchmarks/independent_flights.py` makes, by kind and seed, treated like the others
(`benchmarks/other_flights.py --independent`; numbers: `models/reference/independent_flights/*.json`). That simulator
was written beside this program, by the same people, but shares no code with it: tables for coefficients, a wake that
lags, canopies that are not in line with their risers, apparent mass that differs along and across. Its flights say more
than those of the program's own simulator, and less than those of others.
"""
_STARTS = """\
## Starts from the prior

Whether a fit finds its mode wherever it starts (`benchmarks/optimum.py`, studies by `other_flights.py --prepare`;
numbers: `models/reference/starts/*.json`).
The model that a run has fitted is fitted anew from the prior means and from draws of the whole prior, with the noise
parameters found anew from each; then each start goes on to the mode of the marginal posterior under the run's noise
parameters. *found*: starts whose search converged within 0.3 posterior standard deviations, in every parameter, of the
run's mode; *not converged*: starts whose next step would be longer than 0.2 standard deviations; *farthest*: the
largest distance of any start's end from the run's mode; *cost*: the largest difference of minus the log density.
"""
_MEASURED = """\
## Measured descents

Shipped studies of descents that were flown (`benchmarks/measured_flights.py`; numbers:
`models/reference/measured_flights/*.json`). The first part of every record is fitted, the rest predicted: *held*,
*width*, *bias* and *score* are of the recorded descent rate against the nominal 90 % band of what would be recorded;
climatology is the constant band of the fitted part.
"""


def stored(place: Path = STORED) -> list[Result]:
    """Stored sets, by name.

    Args:
        place: Folder of the stored files.
    """
    return [json.loads(path.read_text(encoding="utf-8")) for path in sorted(place.glob("*.json"))]


def _fit(one: Result) -> list[str]:
    said = "yes" if one["converged"] else f"**no**: {one['reason']}".removesuffix(": ")
    return [said, ", ".join(f"`{name}`" for name in one["failed"]) or "none", f"{one['processor_s']:.0f}"]


def _made(one: Result) -> list[str]:
    told = one["provenance"]
    commit = told["commit"] or "no checkout"
    mark = "+" if commit.endswith("+") else ""
    return [f"`{commit[:7]}{mark}`, {told['date']}", "present" if present(told) else "older numerics"]


def _cells(scores: Iterable[Result]) -> list[str]:
    """Means of each score over some flights."""
    made, scores = list[str](), list(scores)
    for name, factor, form in SCORES:
        values = [factor * s[name] for s in scores if s.get(name) is not None]
        made.append(format(sum(values) / len(values), form) if values else NOTHING)
    return made


def foretold(wholes: Sequence[Result]) -> list[str]:
    """Table of predicted flights, with the mean over those that have true histories.

    Args:
        wholes: Results of whole flights.
    """
    rows, pooled = list[list[str]](), list[Result]()
    for whole in wholes:
        for flight, scores in whole["flights"].items():
            against = next((s["against"] for s in scores.values()), "not predicted")
            cells = [cell for name in QUANTITIES for cell in _cells([scores[name]] if name in scores else [])]
            rows.append([flight, against, *cells, *_made(whole)])
            if scores and all(s["true"] for s in scores.values()):
                pooled.append(scores)
    if pooled:
        cells = [cell for name in QUANTITIES for cell in _cells(s[name] for s in pooled if name in s)]
        rows.append([f"mean of {len(pooled)}", "true histories", *cells, "", ""])
    head = ["flight", "against", "swing: held, %", "width", "score", "descent: held, %", "width", "score"]
    return table([*head, "made by", "numerics"], rows)


def measured_tables(studies: Sequence[Result]) -> list[str]:
    """Fits of measured records, and scores of their held-out parts.

    Args:
        studies: As stored.
    """
    fits = [[f"`{one['study']}.toml`", str(len(one["flights"])), *_fit(one), *_made(one)] for one in studies]
    rows = [
        [f"{one['study']}: {name}", f"{100 * s['held']:.0f}", f"{s['width']:.2f}", f"{s['bias']:+.2f}",
         f"{s['wis_over_climatology']:.2f}"]
        for one in studies
        for name, s in one["flights"].items()
    ]  # fmt: skip
    head = ["study", "records", "converged", "checks missed", "processor, s", "made by", "numerics"]
    scores = ["record", "held, %", "width, m/s", "bias, m/s", "score"]
    return [*table(head, fits), *table(scores, rows)]


def starts_table(records: Sequence[Result]) -> list[str]:
    """Records fitted from many starts.

    Args:
        records: As stored.
    """
    rows = []
    for one in records:
        found = f"{round(one['share_found'] * one['starts'])} of {one['starts']}"
        lost = sum(not row["converged"] for row in one["rows"])
        ended = [row for row in one["rows"] if isfinite(row["away"])]  # others failed
        off, cost = (max((abs(row[key]) for row in ended), default=0.0) for key in ("away", "worse"))
        rows.append([one["study"], found, str(lost), f"{off:.2g}", f"{cost:.2g}", *_made(one)])
    return table(["record", "found", "not converged", "farthest", "cost", "made by", "numerics"], rows)


def _of_set(name: str, whole: Result) -> Result:
    """A result whose flights, which have the same names in every set, are told by that of the set too."""
    return whole | {"flights": {f"{name}, {flight}": scores for flight, scores in whole["flights"].items()}}


def _whole_tables(name: str, wholes: Sequence[tuple[str, Result]]) -> list[str]:
    """Fits of whole flights, and scores of the flights that they foretell."""
    head = [name, "converged", "checks missed", "processor, s", "terms", "made by", "numerics"]
    fits = [[of, *_fit(w), str(len(w["terms"])), *_made(w)] for of, w in wholes]
    return [*table(head, fits), *foretold([whole for _, whole in wholes])]


def page(
    sets: Sequence[Result], independent: Sequence[Result], starts: Sequence[Result], measured: Sequence[Result]
) -> str:
    """The page.

    Args:
        sets: As stored.
        independent: Sets of an independent simulator, as stored.
        starts: Records fitted from many starts, as stored.
        measured: Studies of measured records, as stored.
    """
    wholes = [(one["set"], one["whole"]) for one in sets if "whole" in one]
    windows = [
        [one["set"], length, *_fit(w), *_made(w)]
        for one in sets
        for length, w in sorted(one.get("windows", {}).items(), key=lambda item: float(item[0]))
    ]
    fits = [[name, *_fit(w), str(len(w["terms"])), *_made(w)] for name, w in wholes]
    others = [
        (f"{one['set']}_{number}", whole) for one in sets for number, whole in sorted(one.get("turned", {}).items())
    ]
    head = ["converged", "checks missed", "processor, s"]
    text = [_WORDS, "## Whole flights", "", *table(["set", *head, "terms", "made by", "numerics"], fits)]
    text += [_FORETOLD, *foretold([whole for _, whole in wholes])]
    if others:
        text += [_TURNED, *_whole_tables("fitted", others)]
    text += [_WINDOWS, *table(["set", "seconds", *head, "made by", "numerics"], windows)]
    if independent:
        named = [(one["set"], _of_set(one["set"], one["whole"])) for one in independent]
        text += [_INDEPENDENT, *_whole_tables("set", named)]
    text += [_STARTS, *starts_table(starts), _MEASURED, *measured_tables(measured)]
    return "\n".join(text).rstrip() + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(stored(), stored(INDEPENDENT), stored(STARTS), stored(MEASURED)), encoding="utf-8")
