"""Coverage of intervals and bands over replicates: shares with standard errors, as tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from bayeschute.calibration.promises import NOMINAL, promised, verdict
from bayeschute.calibration.scores import LEVELS, standard_error
from bayeschute.posterior.sampling.sampler_checks import MOST_K

Row = dict[str, Any]


def _share(values: Sequence[Any], of_shares: bool) -> dict[str, float]:
    held = np.array(values, float)
    mean = float(held.mean())
    spread = float(held.std(ddof=1)) if of_shares and held.size > 1 else None
    return {"share": mean, "standard_error": standard_error(mean, held.size, spread), "replicates": held.size}


def _mean(values: Iterable[Any]) -> Any:
    """Mean over the replicates that have a value, None where none has."""
    known = [value for value in values if value is not None]
    return np.mean(known, axis=0).tolist() if known else None


def coverage_of_parameters(rows: Sequence[Row]) -> dict[str, dict[str, Any]]:
    """Coverage of intervals over replicates, by parameter; a true term that was not selected counts as outside.

    Args:
        rows: Rows of a campaign that are ok.

    Returns:
        Per parameter: ``coverage`` by level, ``share``, ``standard_error`` and ``replicates`` at 90 %, ``left_out``,
        mean and root mean square of ``(mean - truth)/sd``.
    """
    made: dict[str, dict[str, Any]] = {}
    names = dict.fromkeys(name for row in rows for name in (*row["parameters"], *row["left_out"]))
    at = LEVELS.index(NOMINAL)
    for name in names:
        fitted = [row["parameters"][name] for row in rows if name in row["parameters"]]
        missing = sum(name in row["left_out"] for row in rows)
        inside = [p["inside"] for p in fitted] + [[False] * len(LEVELS)] * missing
        z = np.array([(p["mean"] - p["truth"]) / p["sd"] for p in fitted])
        made[name] = {
            **_share([i[at] for i in inside], False),
            "coverage": dict(zip(map(str, LEVELS), np.mean(inside, axis=0).tolist(), strict=True)),
            "left_out": missing,
            "mean_z": float(z.mean()) if z.size else None,
            "rms_z": float(np.sqrt(np.mean(z**2))) if z.size else None,
        }
    return made


def coverage_of_bands(rows: Sequence[Row]) -> dict[str, dict[str, Any]]:
    """Coverage of bands: share of samples inside, per ``flight/quantity``; replicates are the independent units.

    Args:
        rows: Rows of a campaign that are ok.

    Returns:
        Per flight and quantity: as `coverage_of_parameters`, the ``lowest`` share of a replicate, the means of width
        and interval score (at 90 %), CRPS and PIT, coverage at 90 % ``by_time``, and in how many replicates the flight
        was ``not_flown`` by any draw: these hold nothing and have no width. Where rows have it, shares by
        `recalibration.FACTORS` (``scaled``).
    """
    made: dict[str, dict[str, Any]] = {}
    at = LEVELS.index(NOMINAL)
    for flight, quantities in rows[0]["bands"].items() if rows else ():
        for name in quantities:
            seen = [row["bands"][flight][name] for row in rows]
            windows = dict.fromkeys(w for s in seen for w in s["by_time"])
            made[f"{flight}/{name}"] = {
                **_share([s["coverage"][at] for s in seen], True),
                "role": seen[0]["role"],
                "lowest": float(np.min([s["coverage"][at] for s in seen])),
                "coverage": dict(
                    zip(map(str, LEVELS), np.mean([s["coverage"] for s in seen], axis=0).tolist(), strict=True)
                ),
                "width": _mean(s["width"] and s["width"][at] for s in seen),
                "interval_score": _mean(s["interval_score"] and s["interval_score"][at] for s in seen),
                "crps": _mean(s["crps"] for s in seen),
                "pit": _mean(s["pit"] for s in seen),
                "not_flown": sum(s["crps"] is None for s in seen),
                "by_time": {
                    w: float(np.mean([s["by_time"][w][at] for s in seen if w in s["by_time"]])) for w in windows
                },
            }
            if all("scaled" in s for s in seen):  # rows of older versions keep none
                made[f"{flight}/{name}"]["scaled"] = np.mean([s["scaled"] for s in seen], axis=0).tolist()
    return made


def coverage_of_values(rows: Sequence[Row], kind: str) -> dict[str, dict[str, Any]]:
    """Coverage of intervals of single values of a flight over replicates, per ``flight/name``.

    Args:
        rows: Rows of a campaign that are ok; those without these scores are left out.
        kind: ``modes`` (amplitude and frequency) or ``statistics`` (those that requirements, exceedance and tolerance
            are about).

    Returns:
        Per flight and name: ``coverage`` by level, ``share``, ``standard_error`` and ``replicates`` at 90 %, ``role``
        of the flight, mean and root mean square of ``(mean - truth)/sd``, and ``pit``, mean share of draws below the
        truth.
    """
    made: dict[str, dict[str, Any]] = {}
    at = LEVELS.index(NOMINAL)
    scored = [row for row in rows if row.get(kind)]
    for flight, name in dict.fromkeys((f, n) for row in scored for f, found in row[kind].items() for n in found):
        seen = [row[kind][flight][name] for row in scored if name in row[kind].get(flight, {})]
        z = np.array([(s["mean"] - s["truth"]) / s["sd"] for s in seen if s["sd"]])
        inside = np.mean([s["inside"] for s in seen], axis=0).tolist()
        made[f"{flight}/{name}"] = {
            **_share([s["inside"][at] for s in seen], False),
            "role": next(iter(scored[0]["bands"][flight].values()))["role"],
            "coverage": dict(zip(map(str, LEVELS), inside, strict=True)),
            "mean_z": float(z.mean()) if z.size else None,
            "rms_z": float(np.sqrt(np.mean(z**2))) if z.size else None,
            "pit": _mean(s["pit"] for s in seen),
        }
    return made


def summarise(rows: Sequence[Row]) -> dict[str, Any]:
    """Everything about a campaign in one object for JSON.

    Returns:
        ``replicates`` that are ok, ``failed`` with the reasons, ``nominal``, ``coverage`` and ``standard_error`` by
        name, the full tables of ``parameters``, ``bands``, ``modes`` and ``statistics`` of flights, how often each of
        a run's own checks was missed, in how many replicates Pareto k of the sampler's correction was ``below`` 0.7 of
        those that told it, and the mean ``wall_s``.
    """
    good = [row for row in rows if row["ok"]]
    parameters, bands = coverage_of_parameters(good), coverage_of_bands(good)
    every = parameters | bands
    missed = [name for row in good for name in row["missed_checks"]]
    tails = [row["pareto_k"] for row in good if "pareto_k" in row]  # None where emcee drew, or nothing was corrected
    return {
        "replicates": len(good),
        "failed": {str(row["seed"]): row["error"] for row in rows if not row["ok"]},
        "nominal": NOMINAL,
        "coverage": {name: entry["share"] for name, entry in every.items()},
        "standard_error": {name: entry["standard_error"] for name, entry in every.items()},
        "parameters": parameters,
        "bands": bands,
        "modes": coverage_of_values(good, "modes"),
        "statistics": coverage_of_values(good, "statistics"),
        "missed_checks": {name: missed.count(name) for name in sorted(set(missed))},
        "pareto_k": {"replicates": len(tails), "below": sum(k is not None and k < MOST_K for k in tails)},
        "wall_s": float(np.mean([row["wall_s"] for row in rows])) if rows else None,
    }


def lines(summary: dict[str, Any]) -> list[str]:
    """The table for the terminal: name, coverage at all levels, standard error at 90 %, verdict."""
    entries = summary["parameters"] | summary["bands"] | summary.get("modes", {}) | summary.get("statistics", {})
    wide = max((len(name) for name in entries), default=0)
    head = "  ".join(f"{100 * level:>3.0f} %" for level in LEVELS)
    made = [f"{'':{wide}}  {head}   s.e. at 90 %"]
    for name, entry in entries.items():
        shares = "  ".join(f"{100 * entry['coverage'][str(level)]:5.1f}" for level in LEVELS)
        says = verdict(summary, name) if name in promised(summary) else ""
        left = f"  left out {entry['left_out']} times" if entry.get("left_out") else ""
        left += f"  not flown by any draw {entry['not_flown']} times" if entry.get("not_flown") else ""
        made.append(f"{name:{wide}}  {shares}   {100 * entry['standard_error']:4.1f}  {says}{left}")
    return made
