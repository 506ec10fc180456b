"""Results of campaigns as one page of Markdown: what was promised, what was held, where it was not and by how much."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from scipy.stats import t

from bayeschute.calibration.promises import ENOUGH, MOST_FAILED, NOMINAL, WANTED, promised, verdict
from bayeschute.calibration.recalibration import learned
from bayeschute.calibration.scores import LEVELS

Result = dict[str, Any]
_LEAST, _MOST, _FAILED = (f"{100 * share:.0f} %" for share in (*WANTED, MOST_FAILED))
_WANTED = f"{100 * WANTED[0]:.0f} to {100 * WANTED[1]:.0f}"
_CHANCE, _DOUBT = 0.05, 0.003  # two-sided, by Student's t of the replicates
_MARKS = {"too narrow": " **narrow**", "too wide": " **wide**", "too many failed": " **failed**"}


def _cells(values: Iterable[str]) -> str:
    return "| " + " | ".join(values) + " |"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    return [_cells(head), _cells(["---"] * len(head)), *(_cells(row) for row in rows), ""]


def _share(result: Result, name: str) -> str:
    if name not in result["coverage"]:
        return ""
    return f"{100 * result['coverage'][name]:.0f} ± {100 * result['standard_error'][name]:.0f}"


def _marked(result: Result, name: str) -> str:
    """A share with its standard error; what lies more than two of these outside what counts as kept is marked."""
    if name not in result["coverage"]:
        return ""
    share, se = result["coverage"][name], result["standard_error"][name]
    off = share + 2.0 * se < WANTED[0] or share - 2.0 * se > WANTED[1]
    return f"**{_share(result, name)}**" if off else _share(result, name)


def _name(result: Result) -> str:
    return f"`{result['noise']}`, {result['disturbance']}"


def _pooled(result: Result) -> str:
    names = [name for name in promised(result) if name in result["parameters"] and "[" in name]
    if not names:
        return "no true values"
    counts = [result["parameters"][name]["replicates"] for name in names]
    shares = [result["coverage"][name] for name in names]
    pooled = sum(n * share for n, share in zip(counts, shares, strict=True)) / sum(counts)
    common = [share for n, share in zip(counts, shares, strict=True) if 2 * n >= max(counts)]
    return f"{100 * pooled:.0f} ({100 * min(common):.0f} to {100 * max(common):.0f})"


def _failed(result: Result) -> str:
    """How many replicates of a rank test failed; earlier results have the number alone."""
    return str(len(result["failed"]) if isinstance(result["failed"], dict) else result["failed"])


def _made_by(result: Result) -> str:
    """Commit and date; results of version 0.1.0 state neither."""
    if "commit" not in result:
        return f"version {result['versions']['bayeschute']}"
    return f"`{result['commit'][:7]}`, {result['date']}"


def overview(results: Sequence[Result]) -> list[str]:
    """One row per configuration and disturbance: shares of nominal 90 % held.

    Args:
        results: As written by ``bayeschute calibrate``.
    """
    bands = list(dict.fromkeys(n for r in results for n, b in r["bands"].items() if b["role"] == "predict"))
    parameters = "aerodynamic parameters (least to most)"
    head = ["noise model, disturbance", "replicates", "failed", parameters, *bands, "made by"]
    rows = [
        [
            _name(r),
            str(r["replicates"]),
            str(len(r["failed"])),
            _pooled(r),
            *(_marked(r, b) for b in bands),
            _made_by(r),
        ]
        for r in results
    ]
    return _table(head, rows)


def whole(result: Result) -> list[str]:
    """Everything about one configuration: all levels, widths, scores, time since the start.

    Args:
        result: As written by ``bayeschute calibrate``.
    """
    levels = [f"{100 * level:.0f} %" for level in LEVELS]
    named = promised(result)

    def shares(entry: dict[str, Any]) -> list[str]:
        return [f"{100 * entry['coverage'][str(level)]:.0f}" for level in LEVELS]

    made = [f"### {_name(result)}: {result['says']}", ""]
    failed = f"{len(result['failed'])} failed" if result["failed"] else "none failed"
    missed = ", ".join(f"`{k}` {v} times" for k, v in result["missed_checks"].items()) or "none"
    seeds = f"seeds {result['seeds'][0]} to {result['seeds'][1]}"
    made += [
        f"{result['replicates']} replicates, {failed} ({seeds}); checks of single runs that were missed: {missed}."
    ]
    tails = result.get("pareto_k", {})
    if tails.get("below"):
        made += [f"Pareto k of the sampler's correction was below 0.7 in {tails['below']} of {tails['replicates']}."]
    made += [""]
    rows = []
    for name, entry in result["parameters"].items():
        z = "" if entry["rms_z"] is None else f"{entry['mean_z']:+.2f}, {entry['rms_z']:.2f}"
        says = _MARKS.get(verdict(result, name), "") if name in named else ""
        left = str(entry["left_out"]) if entry["left_out"] else ""
        s_e = f"{100 * entry['standard_error']:.1f}"
        rows.append([f"`{name}`", str(entry["replicates"]), *shares(entry), s_e + says, z, left])
    head = ["parameter", "replicates", *levels, "s.e. at 90 %", "z: mean, rms", "left out"]
    if rows:
        made += _table(head, rows)
    rows = []
    for name, entry in result["bands"].items():
        by_time = ", ".join(f"{w}: {100 * share:.0f}" for w, share in entry["by_time"].items())
        says = _MARKS.get(verdict(result, name), "") if name in named else ""
        s_e = f"{100 * entry['standard_error']:.1f}"
        numbers = ["" if entry[key] is None else f"{entry[key]:.3g}" for key in ("width", "interval_score", "crps")]
        lost = f"; not flown by any draw: {entry['not_flown']} times" if entry.get("not_flown") else ""
        rows.append([name, *shares(entry), s_e + says, *numbers, by_time + lost])
    head = [
        "flight/quantity",
        *levels,
        "s.e. at 90 %",
        "mean width",
        "interval score",
        "CRPS",
        "90 % by time since start",
    ]
    return [*made, *_table(head, rows), *_widening(result), *by_mode(result)]


def _widening(result: Result) -> list[str]:
    """By how much bands of unseen flights would have to be widened; nothing where a result doesn't tell."""
    factors = learned(result)
    if not factors:
        return []
    said = ", ".join(f"{name} {'too far off' if f is None else format(f, '.2f')}" for name, f in factors.items())
    return [f"Factors by which `[predict] recalibrate` would widen bands of unseen flights: {said}.", ""]


def by_mode(result: Result) -> list[str]:
    """What the modes of a flight do: shares of replicates; nothing where a result has none.

    Args:
        result: As written by ``bayeschute calibrate``.
    """
    rows = []
    for name, entry in result.get("modes", {}).items():
        shares = [f"{100 * entry['coverage'][str(level)]:.0f}" for level in LEVELS]
        z = "" if entry["rms_z"] is None else f"{entry['mean_z']:+.2f}, {entry['rms_z']:.2f}"
        s_e = f"{100 * entry['standard_error']:.1f}"
        pit = "" if entry["pit"] is None else f"{entry['pit']:.2f}"
        rows.append([name, str(entry["replicates"]), *shares, s_e, z, pit])
    if not rows:
        return []
    levels = [f"{100 * level:.0f} %" for level in LEVELS]
    head = ["by mode", "replicates", *levels, "s.e. at 90 %", "z: mean, rms", "mean PIT"]
    words = "By mode, over the samples that count: amplitude is root two times the rms, frequency rms rate over rms."
    return [words, "", *_table(head, rows)]


def diagnosis(results: Sequence[Result]) -> list[str]:
    """In words: which promised quantity is off, under which disturbance or setting, by how many standard errors.

    Args:
        results: As written by ``bayeschute calibrate``.
    """
    found: dict[str, list[str]] = {}
    left = 0
    for result in results:
        for name in (name for name in promised(result) if name in result["coverage"]):
            share, se = result["coverage"][name], result["standard_error"][name]
            if WANTED[0] <= share <= WANTED[1]:
                continue
            away = abs(share - NOMINAL) / se if se else float("inf")
            by_chance = 2.0 * float(t.sf(away, max(result["replicates"] - 1, 1)))
            if by_chance > _CHANCE:
                left += 1
                continue
            sure = "beyond doubt" if by_chance < _DOUBT else "probably"
            off = "too narrow" if share < NOMINAL else "too wide"
            found.setdefault(f"{_name(result)}, {off} ({sure})", []).append(f"`{name}` {_share(result, name)} %")
    made = [f"- {where}: {', '.join(names)}." for where, names in found.items()]
    if left:
        made.append(f"- {left} more lie outside {_WANTED} %, by no more than chance may do with as few replicates.")
    return made or [f"Nothing that is promised lies outside {_WANTED} %."]


def on_the_clock(results: Sequence[Result]) -> list[str]:
    """How long results took to make; nothing where one of them doesn't tell, or they were made by unlike machinery.

    Args:
        results: With ``clock``, minutes and the number of processes, as ``benchmarks/calibration.py`` adds it.
    """
    clocks = [r.get("clock", {}) for r in results]
    workers = {c.get("workers") for c in clocks}
    if len(workers) != 1 or None in workers:
        return []
    minutes = [c["minutes"] for c in clocks]
    said = f"{sum(minutes) / 60.0:.1f} hours on the clock with {workers.pop()} processes, {max(minutes):.0f} minutes of"
    return [f"All of it took {said} it for the longest part.", ""]


def page(results: Sequence[Result], ranks: Sequence[Result], command: str) -> str:
    """The page.

    Args:
        results: As written by ``bayeschute calibrate``, in the order of the page.
        ranks: As stored by ``benchmarks/ranks.py``.
        command: What makes it.
    """
    text = [
        "# What intervals and bands hold",
        "",
        f"Written by `{command}`; do not edit. Numbers behind it: `models/reference/calibration/*.json`.",
        "",
        "Every replicate flies a study anew from another seed, identifies and predicts it as a run would, and counts.",
        "A share is that of replicates whose nominal 90 % interval holds the true parameter, or the mean share of",
        "samples of a flight whose true value lies in the 90 % band; ± is one standard error, replicates being",
        "the independent units. Widths, interval scores and CRPS are in SI units: rad and m/s.",
        f"A promise is kept where {ENOUGH} replicates or more show it, of which no more than {_FAILED} failed: the",
        f"one-sided 95 % lower confidence limit of the share is {_LEAST} or more, and the upper side does not show",
        f"more than {_MOST}. In the overview what lies two standard errors outside is bold; of aerodynamic parameters",
        "it has the share of all intervals together, with the least and the most of those parameters that half of",
        "the replicates or more have fitted. *made by*: the code that flew them, and the day (UTC).",
        "",
        *on_the_clock([*results, *ranks]),
    ]
    if results:
        text += ["## Overview", "", *overview(results), "## What is off", "", *diagnosis(results), ""]
    if ranks:
        text += ["## Ranks of truths drawn from what is believed", ""]
        text += [
            "Records come from the model itself, so this tests the inference alone (`benchmarks/ranks.py`).",
            "Truths come from the priors, or from the posterior of a fit to one record; that record and the",
            "replicate's are then fitted together, the priors as they were (posterior simulation-based calibration).",
            "Draws that were moved are a sampler broken on purpose: the test has to notice it.",
            "",
        ]
        rows = []
        for r in ranks:
            moved = f"its draws moved by {r['spoiled']['shift']:g} sd"
            for sampler, made in (("as it is", r), (moved, r["spoiled"])):
                off = [q for q, t in made["quantities"].items() if not t["passed"]]
                says = "all inside" if made["passed"] else "outside: " + ", ".join(off)
                count = str(len(made["quantities"]))
                rows.append([r["study"], sampler, str(r["replicates"]), _failed(r), count, says])
        text += _table(["model", "sampler", "replicates", "failed", "quantities", "95 % simultaneous bands"], rows)
    if results:
        text += ["## Configurations", ""]
        for result in results:
            text += whole(result)
    return "\n".join(text).rstrip() + "\n"
