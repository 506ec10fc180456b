"""Stage `structure`: vector and polar equation error, and the simulation study with known terms."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from bayeschute.aero.published import load_published
from bayeschute.core.errors import InputError
from bayeschute.core.files import write_whole
from bayeschute.core.random import stream
from bayeschute.records.reconstruct import reconstruct
from bayeschute.regression.propagation import Propagated, propagate
from bayeschute.regression.stacked import Stack, stack_records
from bayeschute.regression.vector_equation import axial_problem, flow_along, transverse_problem
from bayeschute.report.structure_text import structure_text
from bayeschute.structure import data_adequacy
from bayeschute.structure.candidates import Pool
from bayeschute.structure.polar_equation import PolarPool, polar_candidates, polar_problem, polar_variables
from bayeschute.structure.polar_names import UNITS, canonical, coefficient_unit
from bayeschute.structure.search import Identified, Search, identify
from bayeschute.structure.structure_entry import entry
from bayeschute.structure.synthetic import Making, replicate
from bayeschute.structure.synthetic_entry import checks, synthetic_entry
from bayeschute.study.assembly import assemble
from bayeschute.study.assembly.canopy_wind import canopy_wind
from bayeschute.study.job import Job, load_flight
from bayeschute.study.load import Study
from bayeschute.study.schema.structure_schema import PolarPoolTable, StructureTable
from bayeschute.study.study import Flight

VECTOR = {"axial": axial_problem, "transverse": transverse_problem}
_NOISIER = 8  # times the positions' noise is added once more
_QUICK = 20  # replicates at most with --quick
_FLOWN = 0.95  # share of a record's samples below the angle of attack at which its powers level off


def structure(job: Job) -> str:
    """Select the aerodynamic terms by equation error; a descent has one term and skips this."""
    study = job.study
    if study.structure is None or study.vehicle is None:
        said = ["A descent has one coefficient; nothing is selected."]
        job.save("structure.json", {"coefficients": {}, "sufficiency": said})
        return "nothing to select"
    flights = study.with_role("structure")
    records = [load_flight(job, flight.name) for flight in flights]
    said = _before(study, flights, records)
    table, angle = _table(study), _saturation(study, flights, records)
    saturated = table.saturate == "always"
    entries, untested = _entries(job, flights, records, angle if saturated else None)
    said += data_adequacy.noise_sentences({name: e["snr"] for name, e in entries.items()})
    for name, e in entries.items():
        said += data_adequacy.rival_sentences(name, e["rivals"])
    found: dict[str, Any] = {
        "coefficients": {name: entries[name] for name in VECTOR},
        "polar": {name: e for name, e in entries.items() if name not in VECTOR},
        "sufficiency": [*said, *untested],
    }
    if table.saturate == "auto":
        found["saturated"] = {
            name: e for name, e in _entries(job, flights, records, angle)[0].items() if name in VECTOR
        }
    if study.synthetic is not None:
        found["synthetic"] = _synthetic(job, flights, records, _step(records))
    job.save("structure.json", found)
    write_whole(job.out / "structure.txt", partial(Path.write_text, data=structure_text(found), encoding="utf-8"))
    return ", ".join(f"{len(e['selected'])} of {len(e['candidates'])} {name} terms" for name, e in entries.items())


def _step(records: Sequence[xr.Dataset]) -> float:
    return float(records[0]["time"][1] - records[0]["time"][0])


def _entries(
    job: Job, flights: Sequence[Flight], records: Sequence[xr.Dataset], saturation: float | None
) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """What is selected for every coefficient, with powers of the angle of attack that level off at one [rad], or none.

    Returns:
        Entries by coefficient, and notes on records that can't test them.
    """
    study, dt = job.study, _step(records)
    stacks = _stacked(study, flights, records, saturation)
    tests, untested = _checks(job, flights, records, saturation)
    rng = stream(study.seed, "selection of terms")
    made: dict[str, Identified] = {}
    for i, (name, stack) in enumerate(stacks.items()):
        names, indices = _candidates(study, name)
        made[name] = identify(stack, names, dt, _how(job, name), rng, indices)
        job.say("structure")((i + 1) / (len(stacks) + 2), name)
    spread = propagate(
        records,
        lambda noisy: _stacked(study, flights, noisy, saturation),
        {name: one.found.columns for name, one in made.items()},
        rng,
        _NOISIER,
    )
    entries = {name: _entry(job, name, one, dt, tests, spread[name], records) for name, one in made.items()}
    if saturation is not None:
        entries |= {name: entries[name] | {"saturation": saturation} for name in VECTOR}
    return entries, untested


def _table(study: Study) -> StructureTable:
    assert study.structure is not None
    return study.structure


def _reconstructed(study: Study, flight: Flight, record: xr.Dataset) -> xr.Dataset:
    aloft = None if flight.wind_profile is None else canopy_wind(record, flight.wind_profile)
    return reconstruct(record, assemble.geometry(study.vehicle_of(flight), flight.capsule_mass), canopy_wind=aloft)


def _pool(table: PolarPoolTable) -> PolarPool:
    return PolarPool(table.variables, table.order, table.extra)


def _along(study: Study, table: PolarPoolTable, made: xr.Dataset, canopy: int) -> Pool:
    """Polar candidates of one canopy along a record."""
    assert study.vehicle is not None
    scale = study.vehicle.canopies
    return polar_candidates(_pool(table), polar_variables(made, canopy, scale.reference_length, scale.reference_speed))


def _saturation(study: Study, flights: Sequence[Flight], records: Sequence[xr.Dataset]) -> float | None:
    """The angle of attack at which its powers level off in terms where they do, of all canopies [rad]; None: never."""
    if _table(study).saturate is None:
        return None
    angles = []
    for flight, record in zip(flights, records, strict=True):
        scale, made = study.vehicle_of(flight).canopies, _reconstructed(study, flight, record)
        flow = flow_along(record, made, scale.reference_length, scale.reference_speed)
        angles.append(np.sqrt(np.ravel(np.asarray(flow.alpha_squared))))
    every = np.concatenate(angles)
    return float(np.quantile(every[np.isfinite(every)], _FLOWN))


def _problems(
    study: Study, flight: Flight, record: xr.Dataset, canopies: Sequence[int], saturation: float | None
) -> dict[str, list[Stack]]:
    """Regressions of every coefficient on the canopies (from 0) of one flight."""
    table, scale, made = _table(study), study.vehicle_of(flight).canopies, _reconstructed(study, flight, record)
    flow = flow_along(record, made, scale.reference_length, scale.reference_speed, saturation)
    found = {
        name: [problem(getattr(table, name), flow, made, canopy) for canopy in canopies]
        for name, problem in VECTOR.items()
    }
    for name, pool in table.polar.pools().items():
        found[name] = [polar_problem(name, _along(study, pool, made, c), made, c) for c in canopies]
    return found


def _stacked(
    study: Study, flights: Sequence[Flight], records: Sequence[xr.Dataset], saturation: float | None
) -> dict[str, Stack]:
    """The regression of every coefficient on all canopies and flights that the structure is found on."""
    canopies = [canopy - 1 for canopy in _table(study).canopies]
    parts: dict[str, list[Stack]] = {}
    for flight, record in zip(flights, records, strict=True):
        for name, stacks in _problems(study, flight, record, canopies, saturation).items():
            parts.setdefault(name, []).extend(stacks)
    return {name: stack_records(stacks) for name, stacks in parts.items()}


def _candidates(study: Study, name: str) -> tuple[list[str], list[str] | None]:
    """Names of the candidates of a coefficient, and the report's indices of polar ones."""
    table = _table(study)
    if name in VECTOR:
        return list(getattr(table, name)), None
    nowhere = dict.fromkeys(UNITS, np.zeros(1))  # names and indices don't depend on values
    pool = polar_candidates(_pool(table.polar.pools()[name]), nowhere)
    return list(pool.names), list(pool.indices)


def _how(job: Job, name: str) -> Search:
    """Options of the search for one coefficient."""
    table = _table(job.study)
    sigma = getattr(table.sigma, name)
    first: tuple[str, ...] = ()
    if name not in VECTOR:
        pool = table.polar.pools()[name]
        first = tuple(pool.candidates()[canonical(term)] for term in pool.first)
    return Search(
        sigma_max=table.sigma_max,
        noise=table.noise if sigma is None else "given",
        sigma=sigma,
        penalty_factor=table.penalty_factor,
        exchange=table.exchange,
        first=first,
        replicates=min(table.replicates, _QUICK) if job.quick else table.replicates,
    )


def _before(study: Study, flights: Sequence[Flight], records: Sequence[xr.Dataset]) -> list[str]:
    """Data adequacy in words, before any fit."""
    assert study.vehicle is not None
    scale, said = study.vehicle.canopies, list[str]()
    for flight, record in zip(flights, records, strict=True):
        made = _reconstructed(study, flight, record)
        said += data_adequacy.record_sentences(flight.name, made)
        for canopy in _table(study).canopies:
            values = polar_variables(made, canopy - 1, scale.reference_length, scale.reference_speed)
            said += data_adequacy.variable_sentences(f"{flight.name}, canopy {canopy}", values)
    return said


def _checks(
    job: Job, flights: Sequence[Flight], records: Sequence[xr.Dataset], saturation: float | None
) -> tuple[dict[str, dict[str, Stack]], list[str]]:
    """Regressions of canopies and flights that were not fitted, by coefficient and label; notes on those that fail."""
    study, said = job.study, list[str]()
    assert study.vehicle is not None
    every = range(study.vehicle.canopies.number)
    rest = [canopy for canopy in every if canopy + 1 not in _table(study).canopies]
    found: dict[str, dict[str, Stack]] = {}
    others = [(flight, load_flight(job, flight.name), list(every)) for flight in study.flights if flight not in flights]
    for flight, record, canopies in [(f, r, rest) for f, r in zip(flights, records, strict=True)] + others:
        if not canopies:
            continue
        try:
            problems = _problems(study, flight, record, canopies, saturation)
        except InputError as error:
            if flight in flights:
                raise
            said.append(f"{flight.name} can't be used to test the structure: {error}")
            continue
        for name, stacks in problems.items():
            labels = [f"{flight.name}, canopy {canopy + 1}" for canopy in canopies]
            found.setdefault(name, {}).update(zip(labels, stacks, strict=True))
    return found, said


def _entry(
    job: Job,
    name: str,
    made: Identified,
    dt: float,
    tests: dict[str, dict[str, Stack]],
    spread: Propagated,
    records: Sequence[xr.Dataset],
) -> dict[str, Any]:
    study, names = job.study, _candidates(job.study, name)[0]
    pressure = None
    if name in ("axial", "C_A"):
        flights = study.with_role("structure")
        q = [
            _reconstructed(study, flight, record)["dynamic_pressure"].values[:, canopy - 1]
            for flight, record in zip(flights, records, strict=True)
            for canopy in _table(study).canopies
        ]
        pressure = np.concatenate(q)
    units = None if name in VECTOR else [coefficient_unit(term) for term in names]
    return entry(
        made,
        names,
        _how(job, name),
        dt,
        checks=tests.get(name, {}),
        truth=_flown_with(study, name),
        pressure=pressure,
        units=units,
        propagated=spread,
    )


def _flown_with(study: Study, name: str) -> dict[str, float] | None:
    """Coefficients that the study's flights are flown with; None for measured flights and polar coefficients."""
    if name not in VECTOR or study.vehicle is None or not all(flight.virtual for flight in study.flights):
        return None
    return dict(getattr(study.vehicle.aero, name))


def _say(job: Job, name: str, share: float) -> None:
    job.say("structure")(0.9 + 0.09 * share, f"synthetic {name}")


def _synthetic(job: Job, flights: Sequence[Flight], records: Sequence[xr.Dataset], dt: float) -> dict[str, Any]:
    """Data of published terms on a flight's own variables, searched as real data are."""
    study, table = job.study, job.study.synthetic
    assert table is not None
    index = 0 if table.flight is None else [flight.name for flight in flights].index(table.flight)
    made = _reconstructed(study, flights[index], records[index])
    published = load_published(table.published, table.reading)
    count = min(table.replicates, _QUICK) if job.quick else table.replicates
    entries = {}
    for name, snr in table.snr.by_name().items():
        pool = _along(study, _table(study).polar.pools()[name], made, table.canopy - 1)
        making = Making(snr, table.time_constant, count)
        rng = stream(study.seed, "data of published terms", name)
        found = replicate(
            pool,
            published.of(name),
            making,
            dt,
            _how(job, name),
            rng,
            where=f"synthetic {name}",
            progress=partial(_say, job, name),
        )
        entries[name] = synthetic_entry(found, making, pool.matrix())
    return {
        "source": published.source,
        "reading": table.reading,
        "flight": flights[index].name,
        "canopy": table.canopy,
        "time_constant": table.time_constant,
        "replicates": count,
        "exchange": _table(study).exchange,
        "sigma_max": _table(study).sigma_max,
        "coefficients": entries,
        "checks": checks(entries),
    }
