"""Recalibration of predicted bands by stored replicates of the configuration (``[predict] recalibrate``)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from bayeschute.calibration.promises import ENOUGH
from bayeschute.calibration.recalibration import FACTORS, learned
from bayeschute.core.errors import Fault, InputError
from bayeschute.study.evidence.identity import places, stored
from bayeschute.study.job import Job
from bayeschute.study.study import Study

NAME = "recalibration.json"
"""File of a run with the factors by which its bands were widened."""


class Widening(NamedTuple):
    """Recalibration: factors on the width of bands by quantity, number of replicates used, and flights widened."""

    factors: Mapping[str, float]
    replicates: int
    flights: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """The recalibration in words, for a label or a note."""
        parts = ", ".join(f"{name.replace('_', ' ')} widened by {factor:.2f}" for name, factor in self.factors.items())
        return f"bands of predicted flights are recalibrated ({parts}), learned on {self.replicates} replicates"


def plain(study: Study) -> Study:
    """The study without recalibration, as its replicates are flown."""
    return replace(study, predict=study.predict.model_copy(update={"recalibrate": None}))


def widening(job: Job) -> Widening | None:
    """Factors by which bands of a run are to be widened; None if the study doesn't ask for it or the run is quick.

    Raises:
        InputError: If no stored calibration of the configuration gives the factors.
    """
    if job.study.predict.recalibrate is None or job.quick:
        return None
    where, wanted = "[predict] recalibrate", f"a stored calibration of this configuration, {ENOUGH} replicates or more"
    do = f"`bayeschute calibrate`, the study without this line, into {job.out / 'calibration'}."
    both = stored(plain(job.study), False, places(job))
    found = both.current.get("none")
    if found is None or found["replicates"] < ENOUGH:
        got = "none is stored" if found is None else f"{found['replicates']} replicates are stored"
        got += ", those stored were made by other numerics" if found is None and "none" in both.older else ""
        raise InputError(Fault(where, got, wanted, do))
    factors = learned(found)
    asked = job.study.predict.quantities or ()
    faults = [
        Fault(where, f"coverage of widened bands of {name} is not stored: the rows are of an older version", wanted, do)
        if name not in factors
        else Fault(where, f"{name}: no factor up to {FACTORS[-1]:g} gives 90 % coverage", "a factor within that range")
        for name in asked
        if factors.get(name) is None
    ]
    if faults:
        raise InputError(faults)
    return Widening({name: f for name in asked if (f := factors[name]) is not None}, found["replicates"])


def applied_recalibration(job: Job) -> Widening | None:
    """The recalibration that a run applied, as stored; None if it applied none."""
    if not (job.out / NAME).exists():
        return None
    said: dict[str, Any] = job.load(NAME)
    return Widening(said["factors"], said["replicates"], tuple(said.get("flights", ())))
