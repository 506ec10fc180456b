"""Stages before the fit: records in, priors out (between them: `bayeschute.study.work_structure`)."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from bayeschute.errors import Fault, InputError
from bayeschute.flight.clean import clean
from bayeschute.flight.derive import derive
from bayeschute.flight.read import ColumnSpec, read_record
from bayeschute.flight.record import load_record, repairs, write_record
from bayeschute.forecast.virtual import fly
from bayeschute.inference.priors import Prior, from_equation_error
from bayeschute.study import setup
from bayeschute.study.load import Study
from bayeschute.study.study import Flight

if TYPE_CHECKING:
    from bayeschute.study.stages import Job


def flown(study: Study, flight: Flight, seed: int, quick: bool = False) -> tuple[xr.Dataset, xr.Dataset]:
    """Record and truth of a virtual flight.

    Raises:
        InputError: If the simulated flight fails.
    """
    assert study.vehicle is not None and flight.virtual is not None
    model, structure_ = setup.cluster(study.vehicle, flight.capsule_mass)
    try:
        return fly(setup.drop(flight.virtual, quick), model, structure_, seed)
    except FloatingPointError as error:
        do = "Check the vehicle's [aero]: rate terms may make the canopies unstable beyond bounds."
        raise InputError(Fault(f"flight {flight.name}", str(error), "a flight that stays finite", do)) from error


def simulate_study(
    study: Study,
    out: Path | str,
    draws: int = 1,
    seed: int | None = None,
    progress: Callable[[str, float, str], None] | None = None,
) -> list[Path]:
    """Fly the virtual flights of a study, or the drop of a vehicle, and store records and truth.

    Args:
        study: The study.
        out: A folder; files are ``<flight>.nc`` and ``<flight>.truth.nc``, numbered where `draws` > 1.
        draws: Virtual drops of each flight, with seeds of their own.
        seed: Replaces the study's.
        progress: Called with a name, the share done and words.

    Returns:
        The files written.
    """
    folder, written = Path(out), []
    flights = [f for f in study.flights if f.virtual is not None]
    if not flights:
        raise InputError(
            Fault(str(study.path), "no virtual flight", "a [flight.virtual] table", "Add one, or use run.")
        )
    first = study.seed if seed is None else seed
    folder.mkdir(parents=True, exist_ok=True)
    for i, flight in enumerate(flights):
        for draw in range(draws):
            number = (
                np.random.SeedSequence([first, i, draw]).generate_state(1)[0]
                if draw
                else _first_seed(study, flight, seed)
            )
            record, truth = flown(study, flight, int(number))
            stem = flight.name if draws == 1 else f"{flight.name}.{draw:05d}"
            written += [write_record(record, folder / f"{stem}.nc"), _write_truth(truth, folder / f"{stem}.truth.nc")]
            if progress is not None:
                progress("simulate", (i * draws + draw + 1) / (len(flights) * draws), stem)
    return written


def _first_seed(study: Study, flight: Flight, seed: int | None) -> int:
    from dataclasses import replace

    return setup.flight_seed(study if seed is None else replace(study, seed=seed), flight)


def _write_truth(truth: xr.Dataset, path: Path) -> Path:
    truth.drop_attrs(deep=False).to_netcdf(path, engine="h5netcdf")
    return path


def load_truth(job: Job, name: str) -> xr.Dataset | None:
    """Truth of a virtual flight; None for a measured one."""
    path = job.out / "flights" / f"{name}.truth.nc"
    return xr.load_dataset(path, engine="h5netcdf") if path.exists() else None


def load_flight(job: Job, name: str) -> xr.Dataset:
    """The ingested record of a flight."""
    return load_record(job.out / "flights" / f"{name}.nc")


def ingest(job: Job) -> str:
    """Read or fly every record, clean it, derive what it implies, store it."""
    from bayeschute.study.stages import write_whole

    study, listed = job.study, 0
    for i, flight in enumerate(study.flights):
        truth = None
        if flight.virtual is not None:
            raw, truth = flown(study, flight, setup.flight_seed(study, flight), job.quick)
        else:
            assert flight.path is not None
            columns = {k: ColumnSpec(c.column, c.unit) for k, c in flight.columns.items()}
            raw = read_record(flight.path, columns or None, flight.window)
        rate = flight.rate or 1.0 / float(np.median(np.diff(raw["time"].values)))
        record = clean(raw, rate, flight.window, flight.skip_first)
        record = record if study.model == "cluster" and flight.virtual is not None else derive(record)
        listed += sum(r.kind not in ("resampled", "derived", "assumed") for r in repairs(record))
        if truth is not None:
            truth = truth.interp(time=record["time"].values)
            write_whole(job.out / "flights" / f"{flight.name}.truth.nc", partial(_write_truth, truth))
        write_whole(job.out / "flights" / f"{flight.name}.nc", partial(write_record, record))
        job.say("ingest")((i + 1) / len(study.flights), flight.name)
    return f"{len(study.flights)} flights, {listed} repairs listed"


def priors(job: Job) -> str:
    """Priors of every parameter: from equation error, or given from outside."""
    study, made = job.study, []
    found = job.load("structure.json")["coefficients"]
    source = ", ".join(f.name for f in study.with_role("structure"))
    for kind, entry in found.items():
        for term in entry["selected"]:
            made.append(
                from_equation_error(
                    f"{kind}[{term['term']}]",
                    term["estimate"],
                    term["se"],
                    study.priors.inflation,
                    study.priors.floor,
                    flight=source,
                )
            )
    given = study.priors.given
    for name, unit in _GIVEN.items():
        table = getattr(given, name)
        if table is not None:
            made.append(_given(name, table, unit))
    job.save("priors.json", [p.__dict__ for p in made])
    return f"{len(made)} parameters"


_GIVEN = {"riser_stiffness": "N/m", "riser_damping": "N s/m", "riser_length": "m", "cds_over_mass": "m^2/kg"}
_POSITIVE = ("riser_stiffness", "riser_damping", "cds_over_mass")


def _given(name: str, table: Any, unit: str) -> Prior:
    """A prior from outside in its working coordinate; one that must be positive keeps its moments as a log-normal."""
    source = "given in the study"
    if table.log_normal:
        log_mean, log_sd = float(np.log(table.median)), float(table.log_sd)
    else:
        log_sd = float(np.sqrt(np.log1p((table.sd / table.mean) ** 2)))
        log_mean = float(np.log(table.mean) - 0.5 * log_sd**2)
    if name in _POSITIVE:
        return Prior(name, log_mean, log_sd, True, unit, source)
    if table.log_normal:
        mean = float(np.exp(log_mean + 0.5 * log_sd**2))
        return Prior(name, mean, mean * float(np.sqrt(np.expm1(log_sd**2))), False, unit, source)
    return Prior(name, float(table.mean), float(table.sd), False, unit, source)


def load_priors(job: Job) -> list[Prior]:
    """The priors of all parameters: those that the stage left, or with the terms that the fit asked for in addition."""
    revised = "fit/priors.json" if (job.out / "fit" / "priors.json").exists() else "priors.json"
    return [Prior(**entry) for entry in job.load(revised)]
