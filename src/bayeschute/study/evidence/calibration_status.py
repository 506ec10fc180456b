"""Calibration status of a run: stored replicates, their domain, held-out shares, and its own checks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from bayeschute.calibration.domain import outside
from bayeschute.calibration.label import Claim, Level, Rung, claim
from bayeschute.calibration.promises import (
    ENOUGH,
    ENOUGH_FLIGHTS,
    KEPT,
    NARROW,
    NOMINAL,
    WANTED,
    WIDE,
    Promise,
    enough,
    is_headline,
    judge,
    promises,
    shown,
)
from bayeschute.study.evidence.conditions import ORIGIN, OTHER_PROGRAM, RECORD, VIRTUAL, conditions, origin
from bayeschute.study.evidence.extrapolation import extrapolated
from bayeschute.study.evidence.identity import Stored, places, stored
from bayeschute.study.evidence.recalibrate import applied_recalibration
from bayeschute.study.evidence.scenarios import SCENARIOS
from bayeschute.study.job import Job
from bayeschute.study.study import Study

NONE_STORED = "no calibration of this configuration is stored"
OLDER = "not checked with these numerics"
LEAST_HELD = 0.5
"""Share of an unseen flight in its 90 % band below which the band is contradicted, where no replicates tell."""
RARE = 0.01
"""How often a right forecast may be contradicted by how rare a share is among its draws, over all held-out flights."""
OF_THE_DATA = ("innovations", "predictive")
"""Checks that compare the record with the model; others are about the computation."""
_LANDINGS = "landings"


class Status(NamedTuple):
    """What a run may claim, and the check `calibration` behind it."""

    claim: Claim
    check: dict[str, Any]


def status(job: Job, checks: Mapping[str, Mapping[str, Any]], coverage: Mapping[str, Any]) -> Status:
    """What a run may claim of its intervals.

    Args:
        job: The run, its predictions done.
        checks: Its own checks.
        coverage: Shares inside the 90 % bands, as in ``coverage.json``.
    """
    study = job.study
    both = stored(study, job.quick, places(job))
    found = both.current.get("none")
    lacking = replicates_lacking(job, both)
    held = promises(found) if found is not None else {}
    check = {
        "passed": None if found is None and "none" not in both.older else not lacking,
        "value": min((one.share for one in held.values()), default=None),
        "bound": WANTED[0],
        "detail": "; ".join(lacking) or _kept(found, held),
        "held": {name: one._asdict() for name, one in held.items()},
    }
    rungs = [
        Rung(Level.SELF_CONSISTENT, tuple(lacking), _kept(found, held), study.model == "cluster"),
        _held_out(study, coverage, OTHER_PROGRAM, Level.OTHER_PROGRAMS),
        _held_out(study, coverage, RECORD, Level.RECORDED),
    ]
    made = claim(
        _of_records(study, rungs),
        contradictions(study, checks, coverage, found),
        worst_misspecification(both),
        not_promised(job, held),
        [n for n, one in checks.items() if one["passed"] is False and n not in (*OF_THE_DATA, "calibration")],
    )
    return Status(replace(made, extrapolated=extrapolated(job.out)), check)


def _of_records(study: Study, rungs: list[Rung]) -> list[Rung]:
    """The rungs of a run: flights that are not simulated by this program need more than its replicates."""
    replicates, others, recorded = rungs
    origins = {origin(flight) for flight in study.with_role("identify") + study.with_role("predict")}
    for kind, rung in ((OTHER_PROGRAM, others), (RECORD, recorded)):
        if kind in origins and rung.lacking and not replicates.lacking:
            less = f"the flights are {kind}, the {replicates.kept.split(',')[0]} are {VIRTUAL}"
            replicates = replace(replicates, lacking=(less, *rung.lacking))
    return [replicates, others, recorded]


def replicates_lacking(job: Job, both: Stored) -> list[str]:
    """Why stored replicates do not support the run's intervals, in words; empty where they do."""
    by, found, study = applied_recalibration(job), both.current.get("none"), job.study
    if by is not None:
        return [f"{by.words}; the coverage of the widened bands was not tested on other replicates"]
    if found is None and "none" in both.older:
        old = both.older["none"]
        version = old.get("versions", {}).get("bayeschute", "unknown")
        return [f"{OLDER}; the {old['replicates']} replicates stored were made by other code or libraries ({version})"]
    if found is None:
        return [f"{NONE_STORED} ({hint(study)})"]
    counts = f"{found['replicates']} replicates, {len(found['failed'])} failed"
    bands = [one for name, one in promises(found).items() if name.startswith("predict/") and is_headline(name)]
    why = enough(found)
    if why:
        few = f"at least {ENOUGH} are needed{_so_far(bands)}"
        many = "with so many failures the others may not be representative"
        return [f"{counts}: {few if why == 'too few replicates' else many}"]
    wanted, lacking = requirement_names(study), []
    for name, one in promises(found).items():
        if is_headline(name, wanted) and one.verdict in (NARROW, WIDE):
            lacking.append(f"nominal 90 % intervals of {shown(name)} held {one.words} ({one.verdict})")
    lacking += [
        f"nominal 90 % bands of unseen flights held {one.words}, which {found['replicates']} replicates do not decide"
        for one in bands
        if one.verdict not in (KEPT, NARROW, WIDE)
    ]
    run = conditions(job)
    away = outside(run._replace(names={k: v for k, v in run.names.items() if k != ORIGIN}), found.get("domain"))
    return lacking + ([f"outside of the {found['replicates']} replicates stored: {'; '.join(away)}"] if away else [])


def _kept(found: Mapping[str, Any] | None, held: Mapping[str, Promise]) -> str:
    """Number of replicates and range of coverage of what is promised."""
    shares = [one.share for one in held.values() if one.verdict == KEPT]
    if found is None or not shares:
        return ""
    failed = f" ({len(found['failed'])} failed)" if found["failed"] else ""
    return f"{found['replicates']} replicates{failed}, coverage of nominal 90 % intervals {_range(shares)}"


def _so_far(bands: list[Promise]) -> str:
    """Coverage that replicates show which are still too few for a promise."""
    if not bands:
        return ""
    return f" (so far nominal 90 % bands of unseen flights held {_range([one.share for one in bands])})"


def _range(shares: Sequence[float]) -> str:
    """Lowest and highest share in percent, once where both are the same."""
    ends = [f"{100.0 * share:.0f}" for share in (min(shares), max(shares))]
    return f"{' to '.join(dict.fromkeys(ends))} %"


def _held_out(study: Study, coverage: Mapping[str, Any], kind: str, level: Level) -> Rung:
    """Evidence of held-out parts of the run's own flights that this program did not simulate."""
    shares = _record_shares(study, coverage, kind)
    flights = len(shares)
    if flights < ENOUGH_FLIGHTS:
        less = f"held-out parts of {flights} {kind}, at least {ENOUGH_FLIGHTS} are needed"
        return Rung(level, (less,), applies=False)
    held = _held(shares)
    words = f"{held.words} of the held-out parts of {flights} {kind} in their 90 % bands"
    lacking = () if held.verdict == KEPT else (f"{words} ({held.verdict})",)
    return Rung(level, lacking, f"{flights} flights, {words}", True)


def _held(shares: Mapping[str, float]) -> Promise:
    """Mean share of the held-out parts of flights in their bands, by the share of every flight."""
    several = list(shares.values())
    mean, error = float(np.mean(several)), float(np.std(several, ddof=1) / np.sqrt(len(several)))
    return Promise(mean, error, judge(mean, error))


def _record_shares(study: Study, coverage: Mapping[str, Any], kind: str) -> dict[str, float]:
    """Mean share of the record in the bands of every held-out flight of a kind."""
    made = {}
    for flight in study.flights:
        partly = "predict" in flight.roles or flight.identify_until is not None
        table = coverage.get(flight.name, {}) if partly and origin(flight) == kind else {}
        known = [e["record"] for e in table.values() if e.get("record") is not None and e.get("draws", 1)]
        if known:
            made[flight.name] = float(np.mean(known))
    return made


def contradictions(
    study: Study,
    checks: Mapping[str, Mapping[str, Any]],
    coverage: Mapping[str, Any],
    found: Mapping[str, Any] | None,
) -> list[str]:
    """What in the run itself contradicts its intervals: checks of the record against the model, and held-out shares.

    Args:
        study: The study.
        checks: The run's own checks.
        coverage: Shares inside the 90 % bands.
        found: Stored replicates, whose lowest share of a flight is the bound; None: `LEAST_HELD`, and `RARE`.
    """
    made = []
    if checks.get("innovations", {}).get("passed") is False:
        share = 100.0 * float(checks["innovations"]["value"])
        made.append(f"{share:.0f} % of the standardised innovations lie inside their 90 % interval")
    if checks.get("predictive", {}).get("passed") is False:
        made.append(str(checks["predictive"]["detail"]))
    for kind in (OTHER_PROGRAM, RECORD):
        shares = _record_shares(study, coverage, kind)
        if len(shares) >= ENOUGH_FLIGHTS and (held := _held(shares)).verdict == NARROW:
            made.append(f"90 % bands contain only {100 * held.share:.0f} % of the held-out {kind}")
    return [*made, *_low_shares(study, coverage, found)]


def _low_shares(study: Study, coverage: Mapping[str, Any], found: Mapping[str, Any] | None) -> Iterator[str]:
    """Held-out flights of which bands contain less than of any replicate's; without these, less than is usual."""
    lowest: dict[str, float] = {}
    many = found is not None and int(found["replicates"]) >= ENOUGH
    for name, entry in found["bands"].items() if found is not None and many else ():
        if entry["role"] == "predict" and "lowest" in entry:
            quantity = name.split("/", 1)[1]
            lowest[quantity] = min(entry["lowest"], lowest.get(quantity, 1.0))
    flights = [f for f in study.flights if "predict" in f.roles or f.identify_until is not None]
    for flight in flights:
        for quantity, entry in coverage.get(flight.name, {}).items():
            kind = "truth" if entry.get("truth") is not None else "record"
            share, p = entry.get(kind), entry.get(f"{kind}_p")
            if share is None or not entry.get("draws", 1):
                continue
            rare = quantity not in lowest and p is not None and p < RARE / len(flights)
            if rare or share < min(lowest.get(quantity, LEAST_HELD), NOMINAL):
                words = f"the 90 % band of the {quantity.replace('_', ' ')} of {flight.name} contains"
                yield f"{words} only {100 * share:.0f} % of it{f' (p {p:.2g})' if rare else ''}"


def worst_misspecification(both: Stored) -> str:
    """Lowest stored coverage of bands of unseen flights under a misspecification, in words; empty if none is stored."""
    for results, words in ((both.current, ""), (both.older, ", by earlier numerics")):
        worst: tuple[float, float, str, int] | None = None
        for scenario, result in results.items():
            for name, one in promises(result).items() if scenario != "none" else ():
                if name.startswith("predict/") and is_headline(name) and (worst is None or one.share < worst[0]):
                    says = SCENARIOS[scenario].says if scenario in SCENARIOS else str(result.get("says", scenario))
                    worst = (one.share, one.standard_error, f"{shown(name)} with {says}", int(result["replicates"]))
        if worst is not None:
            share, error, says, count = worst
            held = f"nominal 90 % bands held {100 * share:.0f} ± {100 * error:.0f} %"
            return f"{held} of the {says} ({count} replicates{words})"
    return ""


def requirement_names(study: Study) -> list[str]:
    """Statistics that the study's requirements refer to, as in `promises`."""
    return [f"predict/{one.statistic} {one.quantity}" for one in study.requirements]


def not_promised(job: Job, held: Mapping[str, Promise]) -> list[str]:
    """What the run shows and the replicates do not promise: not in the calibration, or without sufficient coverage."""
    study = job.study
    names = [str(one["name"]) for one in job.load("fit/priors.json" if _revised(job) else "priors.json")]
    for role in ("identify", "predict"):
        if study.with_role(role):
            names += [f"{role}/{quantity}" for quantity in study.predict.quantities or ()]
    names += requirement_names(study) + [n for n in held if n.startswith("predict/") and " " in n and n not in names]
    made = []
    for name in dict.fromkeys(names):
        one = held.get(name)
        if one is None:
            made.append(shown(name))
        elif one.verdict != KEPT:
            made.append(f"{shown(name)} ({one.words}, {one.verdict})")
    return [*dict.fromkeys(made), _LANDINGS]


def _revised(job: Job) -> bool:
    return (job.out / "fit" / "priors.json").exists()


def hint(study: Study) -> str:
    """How to calibrate a study; true values are known of virtual cluster flights only."""
    if study.model != "cluster":
        return "calibration is not available for the descent model"
    if all(flight.virtual is not None for flight in study.flights):
        return f"run `bayeschute calibrate {study.path}`"
    return "run `bayeschute calibrate` on a study with the same tables and with virtual flights like these"
