"""What a run may claim of its 90 %: verified only where its own checks pass and replicates of its configuration did."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bayeschute.calibration.coverage_tables import ENOUGH, WANTED, promised, verdict
from bayeschute.calibration.label import label_of
from bayeschute.study.evidence.identity import places, stored
from bayeschute.study.evidence.recalibrate import told as told_widening
from bayeschute.study.job import Job
from bayeschute.study.study import Study

NONE_STORED = "no calibration of this configuration is stored"


def calibration_check(job: Job) -> dict[str, Any]:
    """The check `calibration`: what replicates of the run's configuration held.

    Returns:
        ``passed`` (None where nothing is stored), ``value`` the share at 90 % farthest from it, ``bound``, ``detail``
        in words, and ``held``: share, standard error and verdict by name.
    """
    by = told_widening(job)
    if by is not None:
        says = f"{by.words}; what they hold then was tried on no others"
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
    told = f"{found['replicates']} replicate flights, {len(found['failed'])} failed; nominal 90 % intervals of "
    if found["replicates"] < ENOUGH:
        says = f"only {found['replicates']} replicates are stored, {ENOUGH} are wanted"
    elif held[worst]["verdict"] == "too many failed":
        says = f"{found['replicates']} replicate flights, {len(found['failed'])} failed: too many to speak for all"
    elif off:
        says = told + ", ".join(f"{n} held {100 * held[n]['share']:.0f} % ({held[n]['verdict']})" for n in off)
    else:
        low, high = min(h["share"] for h in held.values()), max(h["share"] for h in held.values())
        says = told + f"all promised quantities held {100 * low:.0f} to {100 * high:.0f} %"
    return {"passed": not off, "value": held[worst]["share"], "bound": WANTED[0], "detail": says, "held": held}


def hint(study: Study) -> str:
    """How to make a study's calibration: truths are known of virtual flights of a cluster only."""
    if study.model != "cluster":
        return "none can be made yet of a descent"
    if all(flight.virtual is not None for flight in study.flights):
        return f"`bayeschute calibrate {study.path}` makes one"
    return "`bayeschute calibrate` makes one, given the same tables with virtual flights like these"


def verification(checks: Mapping[str, Mapping[str, Any]], study: Study) -> str:
    """The label of a run's intervals: ``verified``, or what is missing and the command that makes it."""
    missed = [name for name, entry in checks.items() if entry["passed"] is False and name != "calibration"]
    calibration = checks["calibration"]
    lacking = [] if calibration["passed"] else [calibration["detail"]]
    if calibration["passed"] is None:
        lacking[0] += f" ({hint(study)})"
    if missed:
        lacking.append(f"missed {', '.join(missed)}")
    return label_of(lacking, calibration["detail"])
