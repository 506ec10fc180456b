"""Cache keys of the stages of a run: a hash of everything that a stage reads.

A stage is run again when its key changes, and only then. The key is a hash of the fields of the study that the stage
reads, the keys of the stages whose whole results it reads, the program's version, `ARTEFACT_VERSION` and whether the
run is quick. Some stages read parts of the results of others: the fit takes the records of its own flights from
`ingest`, and the priors take from `structure` the estimates of the flights with that role, not its tests on other
flights. Such a stage names the fields of the study from which that part follows.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from bayeschute.core.version import __version__
from bayeschute.study.study import Study, canonical

STAGES = ("ingest", "structure", "priors", "fit", "check", "predict", "risk", "report")
ARTEFACT_VERSION = 7
"""Version of the files that stages exchange; raised where files of an earlier version can't or mustn't be used."""
USES: dict[str, tuple[str, ...]] = {
    "ingest": (),
    "structure": (),
    "priors": (),
    "fit": ("priors",),
    "check": ("fit",),
    "predict": ("fit",),
    "risk": ("check", "predict"),
    "report": STAGES[:-1],
}
"""Stages whose whole results a stage reads."""


def reads(study: Study) -> dict[str, dict[str, Any]]:
    """Fields of a study that each stage reads: plain values in SI, by stage.

    Args:
        study: The study, at the sizes it is run with.
    """
    said = canonical(study)

    def part(*fields: str) -> dict[str, Any]:
        return {field: said[field] for field in fields}

    def flights(*roles: str, without: tuple[str, ...] = ("roles",)) -> list[dict[str, Any]]:
        some = [f for f in said["flights"] if not roles or {*roles} & {*f["roles"]}]
        return [{key: value for key, value in flight.items() if key not in without} for flight in some]

    def names(role: str) -> list[str]:
        return [flight.name for flight in study.with_role(role)]

    record = ("roles", "identify_until")  # do not change a record
    drop = part("model", "vehicle", "seed")
    selection: dict[str, Any] = {}
    if study.structure is not None:  # else nothing is selected
        selection = drop | part("structure") | {"flights": flights("structure", without=record)}
    tested = {"flights": flights(without=record), "selected on": names("structure")} | part("synthetic")
    known = [table for table in said.get("knowledge", ()) if table["use"] == "prior"]
    knowledge = {"knowledge": known} if known else {}
    channels = list(study.noise.channels())  # those that can't be fitted are listed in the record
    return {
        "ingest": drop | {"flights": flights(without=record), "fitted": names("identify"), "channels": channels},
        "structure": selection | tested if selection else {},
        "priors": selection | part("model", "priors") | knowledge,
        "fit": drop | part("structure", "noise", "sampler") | {"flights": flights("identify")},
        "check": {},
        "predict": part("predict") | {"flights": flights("identify", "predict")},
        "risk": part("requirements") | {"flights": names("predict")},
        "report": said,
    }


def stage_keys(study: Study, quick: bool, found: Mapping[str, Any]) -> dict[str, str]:
    """The key of every stage.

    Args:
        study: The study, at the sizes it is run with.
        quick: Whether sizes are cut.
        found: Inputs of a stage from outside the study and the run, plain values by stage.
    """
    keys: dict[str, str] = {}
    for stage, values in reads(study).items():
        used = [keys[other] for other in USES[stage]]
        inputs = [stage, values, found.get(stage), used, __version__, ARTEFACT_VERSION, quick]
        keys[stage] = hashlib.sha256(json.dumps(inputs, sort_keys=True).encode()).hexdigest()
    return keys


def readers(stage: str) -> tuple[str, ...]:
    """A stage and those that read its whole results, or results made from them, in order."""
    found = [stage]
    for later in STAGES[STAGES.index(stage) + 1 :]:
        if {*found} & {*USES[later]}:
            found.append(later)
    return tuple(found)
