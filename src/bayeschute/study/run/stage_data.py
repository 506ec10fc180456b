"""Stages `ingest` and `priors`: records in, priors out (between them: `bayeschute.study.run.stage_structure`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from bayeschute.aero.coefficient import is_coefficient
from bayeschute.core.errors import Fault, InputError
from bayeschute.core.files import write_whole
from bayeschute.core.netcdf_files import write_netcdf
from bayeschute.dynamics.parameters import BIASES
from bayeschute.likelihood.channels import fitted_channels
from bayeschute.likelihood.priors import Prior
from bayeschute.records.back_driving import remove_velocity_bias
from bayeschute.records.clean import clean
from bayeschute.records.derive import derive
from bayeschute.records.foreign.conventions import Conventions
from bayeschute.records.read import read_record
from bayeschute.records.record import Repair, repairs, with_repairs, write_record
from bayeschute.study.aerodynamics.known import informed
from bayeschute.study.assembly import assemble, canopies
from bayeschute.study.assembly.canopy_wind import with_wind
from bayeschute.study.assembly.fitted_terms import at_own_apparent_mass, in_order, of_library, of_selected
from bayeschute.study.assembly.flight_parameters import is_bias
from bayeschute.study.job import Job
from bayeschute.study.load import Study
from bayeschute.study.plausible import refuse_implausible, window_used
from bayeschute.study.study import Flight
from bayeschute.virtual.drop import fly


def flown(study: Study, flight: Flight, seed: int, quick: bool = False) -> tuple[xr.Dataset, xr.Dataset]:
    """Record and truth of a virtual flight; where its outcome isn't ok, the record's list of repairs says so.

    Raises:
        InputError: If the simulated flight leaves the finite numbers.
    """
    assert flight.virtual is not None
    sewn = canopies.flown(study, flight, seed)
    model, structure_ = assemble.cluster(study.vehicle_of(flight), flight.capsule_mass, sewn)
    try:
        record, truth = fly(assemble.drop(flight.virtual, quick), model, structure_, seed)
    except FloatingPointError as error:
        do = "Check the vehicle's [aero]: rate terms may make the canopies unstable beyond bounds."
        raise InputError(Fault(f"flight {flight.name}", str(error), "a flight that stays finite", do)) from error
    if "failed_at_s" in record.attrs:
        time = record["time"].values
        since = float(record.attrs["failed_at_s"])
        detail = f"{record.attrs['outcome']}: not to be relied on from here"
        note = Repair("simulation", "", since, float(time[-1]), int((time >= since).sum()), detail)
        record = with_repairs(record, [note])
    return record, truth


def write_truth(truth: xr.Dataset, path: Path) -> Path:
    """Write the true motion next to a record."""
    kept = {name: value for name, value in truth.attrs.items() if name != "repairs"}
    write_netcdf(truth.drop_attrs(deep=False).assign_attrs(kept), path)
    return path


def ingest(job: Job) -> str:
    """Read or simulate every record, clean it, derive further quantities, store it."""
    listed, flights = 0, job.study.flights
    for i, flight in enumerate(flights):
        raw = read_and_judge(job, flight)
        record = ingest_flight(job, flight, raw)
        listed += sum(r.kind not in ("resampled", "derived", "assumed") for r in repairs(record))
        job.say("ingest")((i + 1) / len(flights), flight.name)
    return f"{len(flights)} flights, {listed} repairs listed"


def read_and_judge(job: Job, flight: Flight, raw: xr.Dataset | None = None) -> xr.Dataset | None:
    """A flight's record as read, refused where it can't be true; warnings go to the log. None of a virtual flight.

    Args:
        job: The run.
        flight: The flight.
        raw: Its record as read; None: it is read from its file.

    Raises:
        InputError: Where the record breaks physical laws that its flight does not accept, with the likely causes.
    """
    if flight.virtual is not None:
        return None
    record = as_read(flight) if raw is None else raw
    for line in refuse_implausible(job.study, flight, record):
        job.say("ingest")(0.0, f"warning: {line}")
    return record


def as_read(flight: Flight) -> xr.Dataset:
    """The record of a flight's file, at its own times."""
    assert flight.path is not None
    columns = {name: column.spec() for name, column in flight.columns.items()}
    said = Conventions() if flight.conventions is None else flight.conventions.spec()
    return read_record(flight.path, columns or None, flight.window, conventions=said)


def ingest_flight(job: Job, flight: Flight, raw: xr.Dataset | None = None) -> xr.Dataset:
    """Read or simulate a flight's record, clean it, derive further quantities, store it with the truth if known.

    Args:
        job: The run.
        flight: The flight.
        raw: Its record as read; None: it is read from its file, or flown.

    Returns:
        The record as stored.
    """
    study, truth = job.study, None
    if flight.virtual is not None:
        raw, truth = flown(study, flight, assemble.flight_seed(study, flight), job.quick)
    elif raw is None:
        raw = as_read(flight)
    record = prepared(study, flight, raw)
    if truth is not None:
        last = truth["time"].values[[0, -1]]  # rounding may put a record's last time beyond the truth's
        at = record["time"].values
        truth = truth.interp(time=np.clip(at, *last)).assign_coords(time=at)
        write_whole(job.out / "flights" / f"{flight.name}.truth.nc", partial(write_truth, truth))
    write_whole(job.out / "flights" / f"{flight.name}.nc", partial(write_record, record))
    return record


def prepared(study: Study, flight: Flight, raw: xr.Dataset) -> xr.Dataset:
    """A record prepared for use: cleaned, uniformly sampled, with derived quantities."""
    rate = flight.rate or 1.0 / float(np.median(np.diff(raw["time"].values)))
    window = flight.window
    if flight.virtual is None:
        used = window_used(raw, flight.window, flight.skip_first, flight.roles)
        window = (used.start, used.end)
        if used.words:
            raw = with_repairs(raw, [Repair("skipped", "", used.start, used.end, 0, used.words)])
    record = clean(raw, rate, window, flight.skip_first)
    if flight.remove_velocity_bias:
        record, _ = remove_velocity_bias(record)
    record = record if study.model == "cluster" and flight.virtual is not None else derive(record)
    if flight.wind_profile is not None:
        record = with_wind(record, flight.wind_profile)
    if study.model == "cluster" and "identify" in flight.roles:
        record = with_repairs(record, _not_fitted(record, tuple(study.noise.channels())))
    return record


def _not_fitted(record: xr.Dataset, channels: tuple[str, ...]) -> list[Repair]:
    """Notes on channels that have noise in the study but can't be fitted to this record."""
    used, time = fitted_channels(record, channels), record["time"].values
    reasons = {name: "not recorded" for name in channels if name not in record}
    reasons |= {name: "without a value" for name in channels if name in record and not record[name].notnull().any()}
    return [
        Repair("assumed", name, float(time[0]), float(time[-1]), 0, f"{reasons.get(name, 'derived')}: it is not fitted")
        for name in channels
        if name not in used
    ]


def priors(job: Job) -> str:
    """Priors of every parameter: from equation error, or given from outside."""
    study, found = job.study, job.load("structure.json")["coefficients"]
    made = in_order(study, informed(study, [*of_structure(study, found), *given_priors(study)]))
    _check_varying(study, [p.name for p in made])
    job.save("priors.json", [p.__dict__ for p in made])
    return f"{len(made)} parameters"


def of_structure(study: Study, found: Mapping[str, Any]) -> list[Prior]:
    """Priors of coefficients from ``coefficients`` of structure.json: of all candidates, or of the selected terms."""
    source = ", ".join(f.name for f in study.with_role("structure"))
    whole = study.structure is not None and study.structure.fit != "selected"
    made = of_library if whole else of_selected
    return at_own_apparent_mass(study, [p for kind, entry in found.items() for p in made(study, kind, entry, source)])


def given_priors(study: Study) -> list[Prior]:
    """Priors that the study gives from outside, ``[priors.given]``."""
    given = study.priors.given
    tables = {name: getattr(given, name) for name in _GIVEN}
    made = [_given(name, table, _GIVEN[name]) for name, table in tables.items() if table is not None]
    for name, (unit, axes) in BIASES.items():
        if (bias := getattr(given, name)) is not None:
            made += [Prior(f"{name}.{axis}", 0.0, bias.sd, False, unit, _FROM_STUDY) for axis in axes]
    return made


def _check_varying(study: Study, names: Sequence[str]) -> None:
    """Check that what varies between drops is a parameter of the fit, and between canopies a coefficient."""
    table, faults = study.priors, []
    of_drops = [name for name in names if not is_bias(name)]
    wanted = {"vary": of_drops, "vary_canopies": [name for name in names if is_coefficient(name)]}
    for key, known in wanted.items():
        if unknown := sorted(set(getattr(table, key) or ()) - set(known)):
            of_the_fit = f"{'parameters' if key == 'vary' else 'coefficients'} of the fit: {', '.join(known)}"
            do = "Name those, or widen the structure."
            faults.append(Fault(f"[priors] {key}", ", ".join(unknown), of_the_fit, do))
    if faults:
        raise InputError(faults)


_GIVEN = {
    "riser_stiffness": "N/m",
    "riser_damping": "N s/m",
    "riser_length": "m",
    "capsule_axial_force": "1",
    "capsule_normal_force_slope": "1",
    "capsule_pitch_moment_slope": "1",
    "capsule_pitch_damping": "1",
    "capsule_inertia_factor_y": "1",
    "capsule_inertia_factor_z": "1",
    "enclosed_air_factor": "1",
    "canopy_pitch_moment_slope": "1",
    "canopy_pitch_damping": "1",
    "canopy_position_scale": "1",
    "capsule_mass": "kg",
    "canopy_mass": "kg",
    "cds_over_mass": "m^2/kg",
}
_FROM_STUDY = "given in the study"
_POSITIVE = ("riser_stiffness", "riser_damping", "enclosed_air_factor", "cds_over_mass")


def _given(name: str, table: Any, unit: str) -> Prior:
    """A prior from outside in its working coordinate; one that must be positive keeps its moments as a log-normal."""
    source = _FROM_STUDY
    if name not in _POSITIVE and not table.log_normal:
        return Prior(name, float(table.mean), float(table.sd), False, unit, source)
    if table.log_normal:
        log_mean, log_sd = float(np.log(table.median)), float(table.log_sd)
    else:
        log_sd = float(np.sqrt(np.log1p((table.sd / table.mean) ** 2)))
        log_mean = float(np.log(table.mean) - 0.5 * log_sd**2)
    if name in _POSITIVE:
        return Prior(name, log_mean, log_sd, True, unit, source)
    mean = float(np.exp(log_mean + 0.5 * log_sd**2))
    return Prior(name, mean, mean * float(np.sqrt(np.expm1(log_sd**2))), False, unit, source)
