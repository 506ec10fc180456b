"""Calibration status of a run: "verified" only if its checks pass and stored replicates show nominal coverage."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bayeschute.calibration.coverage_tables import ENOUGH, WANTED, promised, verdict
from bayeschute.calibration.label import label_of
from bayeschute.study.evidence.identity import places, stored
from bayeschute.study.evidence.recalibrate import applied_recalibration
from bayeschute.study.job import Job
from bayeschute.study.study import Study

NONE_STORED = "no calibration of this configuration is stored"


def calibration_check(job: Job) -> dict[str, Any]:
    """The check `calibration`: coverage of 90 % intervals over stored replicates of the run's configuration.

    Returns:
        ``passed`` (None where nothing is stored), ``value`` the share at 90 % farthest from it, ``bound``, ``detail``
        in words, and ``held``: share, standard error and verdict by name.
    """
    by = applied_recalibration(job)
    if by is not None:
        says = f"{by.words}; the coverage of the widened bands was not tested on other replicates"
        return {"passed": False, "value": None, "bound": None, "detail": says, "held": {}}
    found = stored(job.study, job.quick, places(job))
    if found is None:
        return {"passed": None, "value": None, "bound": None, "detail": NONE_STORED, "held": {}}
    names = promised(found)
    held = {
        name: {
            "share": found["coverage"][name],
            "standard_error": found["standard_error"][name],
            "verdict": verdict(found, name),
        }
        for name in names
    }
    off = [name for name, entry in held.items() if entry["verdict"] != "kept"]
    worst = max(names, key=lambda name: abs(found["coverage"][name] - 0.9))
    counts = f"{found['replicates']} replicate flights, {len(found['failed'])} failed; "
    if found["replicates"] < ENOUGH:
        says = f"only {found['replicates']} replicates are stored, at least {ENOUGH} are needed"
    elif held[worst]["verdict"] == "too many failed":
        says = counts + "with so many failures the others may not be representative"
    elif off:
        each = (f"of {n} is {100 * held[n]['share']:.0f} % ({held[n]['verdict']})" for n in off)
        says = counts + "coverage of nominal 90 % intervals " + ", ".join(each)
    else:
        low, high = min(h["share"] for h in held.values()), max(h["share"] for h in held.values())
        says = counts + f"coverage of nominal 90 % intervals is {100 * low:.0f} to {100 * high:.0f} %"
    return {"passed": not off, "value": held[worst]["share"], "bound": WANTED[0], "detail": says, "held": held}


def hint(study: Study) -> str:
    """How to calibrate a study; true values are known of virtual cluster flights only."""
    if study.model != "cluster":
        return "calibration is not available for the descent model"
    if all(flight.virtual is not None for flight in study.flights):
        return f"run `bayeschute calibrate {study.path}`"
    return "run `bayeschute calibrate` on a study with the same tables and with virtual flights like these"


def verification(checks: Mapping[str, Mapping[str, Any]], study: Study) -> str:
    """The label of a run's intervals: ``verified``, or what is missing and the command that produces it."""
    missed = [name for name, entry in checks.items() if entry["passed"] is False and name != "calibration"]
    calibration = checks["calibration"]
    lacking = [] if calibration["passed"] else [calibration["detail"]]
    if calibration["passed"] is None:
        lacking[0] += f" ({hint(study)})"
    if missed:
        lacking.append(f"failed checks: {', '.join(missed)}")
    return label_of(lacking, calibration["detail"])
