"""Bands of unseen flights widened by what replicates of the configuration held (``[predict] recalibrate``)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from bayeschute.calibration.coverage_tables import ENOUGH
from bayeschute.calibration.recalibration import FACTORS, learned
from bayeschute.core.errors import Fault, InputError
from bayeschute.study.evidence.identity import places, stored
from bayeschute.study.job import Job
from bayeschute.study.study import Study

NAME = "recalibration.json"
"""File of a run that says by how much its bands were widened."""


class Widening(NamedTuple):
    """Factors on the width of bands by quantity, on how many replicates they were learned, and flights so widened."""

    factors: Mapping[str, float]
    replicates: int
    flights: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """What was done, for a label or a note."""
        parts = ", ".join(f"{name.replace('_', ' ')} by {factor:.2f}" for name, factor in self.factors.items())
        return f"bands of unseen flights are widened ({parts}), learned on {self.replicates} replicates"


def plain(study: Study) -> Study:
    """The study without recalibration: that of which replicates are flown."""
    return replace(study, predict=study.predict.model_copy(update={"recalibrate": None}))


def widening(job: Job) -> Widening | None:
    """By how much bands of a run are to be widened; None where the study doesn't ask for it, or the run is a quick one.

    Raises:
        InputError: If no calibration of the configuration is stored that tells it.
    """
    if job.study.predict.recalibrate is None or job.quick:
        return None
    where, wanted = "[predict] recalibrate", f"a stored calibration of this configuration, {ENOUGH} replicates or more"
    do = f"`bayeschute calibrate`, the study without this line, into {job.out / 'calibration'}."
    found = stored(plain(job.study), False, places(job))
    if found is None or found["replicates"] < ENOUGH:
        got = "none is stored" if found is None else f"{found['replicates']} replicates are stored"
        raise InputError(Fault(where, got, wanted, do))
    factors = learned(found)
    asked = job.study.predict.quantities or ()
    faults = [
        Fault(where, f"its shares of widened bands of {name} are not kept: rows of an older version", wanted, do)
        if name not in factors
        else Fault(where, f"{name}: no factor up to {FACTORS[-1]:g} would hold 90 %", "bands that are nearly right")
        for name in asked
        if factors.get(name) is None
    ]
    if faults:
        raise InputError(faults)
    return Widening({name: f for name in asked if (f := factors[name]) is not None}, found["replicates"])


def told(job: Job) -> Widening | None:
    """What a run did, as it was stored; None where it did nothing."""
    if not (job.out / NAME).exists():
        return None
    said: dict[str, Any] = job.load(NAME)
    return Widening(said["factors"], said["replicates"], tuple(said.get("flights", ())))
