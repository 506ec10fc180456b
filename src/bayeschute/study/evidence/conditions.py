"""Conditions of a run, to be compared with those of the replicates of a calibration (`calibration.domain`)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from bayeschute.calibration.domain import Conditions
from bayeschute.posterior.sampler import EMCEE_DREW, INDEPENDENCE_DREW
from bayeschute.records.reconstruct import reconstruct
from bayeschute.records.record import VARIABLES
from bayeschute.study.assembly import assemble
from bayeschute.study.assembly.fits import groups, load_noise_parameters
from bayeschute.study.job import Job, load_flight
from bayeschute.study.study import Flight

ORIGIN = "origin of the flights"
"""Kind of name that says whether flights are virtual drops or records."""
VIRTUAL, RECORD, OTHER_PROGRAM = "virtual drops", "records", "flights of another program"
_ROLES = {"identify": "fitted", "predict": "predicted"}
_LARGE = 0.95  # quantile over the record in the place of the maximum, which one outlier makes


def conditions(job: Job) -> Conditions:
    """Conditions of a run whose fit is done: its flights, the noise found, and which sampler drew."""
    numbers: dict[str, list[float]] = {}
    units: dict[str, str] = {}
    of_flights = (
        (f"{name} of {word} flights", value, unit)
        for role, word in _ROLES.items()
        for flight in job.study.with_role(role)
        for name, value, unit in _of_flight(job, flight)
    )
    for name, value, unit in (*of_flights, *_of_noise(job)):
        numbers.setdefault(name, []).append(float(value))
        units[name] = unit
    names = {
        "channels": list(job.study.noise.channels()),
        "sampler": _samplers(job),
        ORIGIN: sorted({origin(flight) for flight in job.study.flights if {*_ROLES} & {*flight.roles}}),
    }
    return Conditions(numbers, names, units)


def origin(flight: Flight) -> str:
    """Where the data of a flight come from."""
    if flight.virtual is not None:
        return VIRTUAL
    return OTHER_PROGRAM if flight.simulated_by is not None else RECORD


def _of_flight(job: Job, flight: Flight) -> Iterator[tuple[str, float, str]]:
    """Name, value and unit of what a flight had."""
    record = load_flight(job, flight.name)
    time = record["time"].values
    yield "duration", time[-1] - time[0], "s"
    yield "time between samples", float(np.median(np.diff(time))), "s"
    channels = [name for name in job.study.noise.channels() if name in record]
    missing = [float(np.isnan(record[name].values).mean()) for name in channels]
    yield "share of missing samples", round(max(missing, default=0.0), 1), "1"
    if job.study.model != "cluster":
        return
    vehicle = job.study.vehicle_of(flight)
    yield "number of canopies", vehicle.canopies.number, "1"
    yield "capsule mass", vehicle.capsule.mass if flight.capsule_mass is None else flight.capsule_mass, "kg"
    seen = reconstruct(record, assemble.geometry(vehicle, flight.capsule_mass))
    yield from _of_motion(seen)


def _of_motion(seen: xr.Dataset) -> Iterator[tuple[str, float, str]]:
    """Amplitudes of the recorded motion."""
    for name, words in (("swing_angle", "swing angle"), ("flyout_angle", "flyout angle")):
        values = seen[name].values
        if name in seen and np.isfinite(values).any():
            yield f"largest {words}", float(np.nanquantile(values, _LARGE)), "rad"


def _of_noise(job: Job) -> Iterator[tuple[str, float, str]]:
    """Noise parameters as fitted, by fit."""
    for group in groups(job):
        hyper = load_noise_parameters(job, group)
        for i, name in enumerate(job.study.noise.channels()):
            total = float(np.hypot(hyper.noise.white[i], hyper.noise.correlated[i]))
            unit = VARIABLES[name].unit if name in VARIABLES else "1"
            yield f"fitted noise of {name.replace('_', ' ')}", total, unit
        winds: dict[str, float] = {}  # gusts and slow error of an axis share its variance, in changing proportions
        for name, law in zip(assemble.noise_parameter_names(job.study), hyper.disturbance_parameters, strict=True):
            if "wind" in name:
                axis = name.split(", ")[-1]
                winds[axis] = winds.get(axis, 0.0) + float(law[0]) ** 2
            else:
                yield f"fitted standard deviation of the {name}", float(law[0]), "1"
        for axis, variance in winds.items():
            yield f"fitted standard deviation of the {axis} wind", float(np.sqrt(variance)), "m/s"


def _samplers(job: Job) -> list[str]:
    """The samplers whose draws were kept."""
    study, facts = job.study, job.load("fit/facts.json")
    notes: list[str] = [str(note) for note in facts.get("notes", ())]
    if study.noise.model == "sandwich":
        return ["sandwich"]
    for ending, name in ((EMCEE_DREW, "emcee"), (INDEPENDENCE_DREW, "independence sampler")):
        if any(note.endswith(ending) for note in notes):
            return [name]
    return [str(study.sampler.kind)]


def stored_conditions(rows: list[dict[str, Any]]) -> list[Conditions]:
    """Conditions in the rows of a campaign; rows of older versions have none."""
    return [Conditions(**row["conditions"]) for row in rows if row.get("ok") and "conditions" in row]
