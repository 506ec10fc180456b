"""Loading of studies: TOML to a `Study`, with every fault of every file at once; free of JAX."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, TypeVar

import numpy as np
from pydantic import BaseModel, TypeAdapter, ValidationError

from bayeschute.aero.term_names import is_pairwise
from bayeschute.core.errors import Fault, InputError
from bayeschute.records.descent_window import DescentWindow
from bayeschute.records.foreign.conventions import Conventions
from bayeschute.records.plausibility.verdict import Verdict
from bayeschute.study.plausible import axes_said, judge, noise_told, told, warned, window_used
from bayeschute.study.schema.belief_schema import NoiseTable
from bayeschute.study.schema.columns import check_columns, tells_columns
from bayeschute.study.schema.crosscheck import OF_NO_TABLE, as_far_as_known, check_span, check_vehicles, crosscheck
from bayeschute.study.schema.draft import Draft
from bayeschute.study.schema.reading.strict import UnknownValueError, part_of
from bayeschute.study.schema.schema_faults import validated
from bayeschute.study.schema.sidecar import context
from bayeschute.study.schema.study_files import read_toml, record_paths
from bayeschute.study.schema.study_schema import (
    CandidatesFile,
    Column,
    ConventionsTable,
    FlightsFile,
    FlightTable,
    StudyFile,
    predictable,
)
from bayeschute.study.schema.vehicle_schema import NOT_FLOWN, Vehicle
from bayeschute.study.study import Flight, Study, apparent_mass_taken_as_known
from bayeschute.study.templates import template

if TYPE_CHECKING:
    import xarray as xr

_LENGTH_SHARE, _LENGTH_LEAST = 0.006, 0.2  # sd of a riser's length where nobody tells it: share of it, and [m]
_SENSED = (
    "canopy_position", "capsule_velocity", "capsule_attitude", "capsule_rate", "capsule_specific_force",
    "riser_tension", "swing_angle", "descent_rate", "canopy_velocity",
)  # fmt: skip


Flights = TypeVar("Flights", bound=FlightsFile)


class _Reading(NamedTuple):
    """Result of reading a study: the study if it is valid, every fault, and the valid parts."""

    study: Study | None
    faults: list[Fault]
    draft: Draft | None = None
    paths: Mapping[int, Path] = {}


def load_study(path: Path | str, data_dir: Path | str | None = None) -> Study:
    """Read a study and its vehicle.

    Args:
        path: The study file.
        data_dir: Folder that replaces ``${DATA}``; default: the environment variable BAYESCHUTE_DATA.

    Returns:
        The study.

    Raises:
        InputError: With every fault of the study file and the vehicle file, and of records that aren't there.
    """
    reading = _read_study(Path(path), data_dir)
    if reading.study is None or reading.faults:
        raise InputError(reading.faults)
    return reading.study


class _VehicleFile(NamedTuple):
    """A vehicle file: the vehicle if it is valid, the text, every fault, and the vehicle as far as it is sound."""

    whole: Vehicle | None
    text: str
    faults: list[Fault]
    sound: Vehicle | None


class Examined(NamedTuple):
    """What an examination of a study with its records found.

    Attributes:
        faults: Every fault.
        warnings: What is to be looked at.
        records: Records as read, by flight.
        verdicts: What the laws of plausibility say of them, by flight.
        study: The study, where its tables are sound.
        windows: First and last time used [s], by flight, given or found.
        said: How the record is used, by flight: window, rate, channels, the law that is nearest to its limit.
    """

    faults: list[Fault]
    warnings: list[str]
    records: dict[str, Any]
    verdicts: dict[str, Verdict]
    study: Study | None
    windows: dict[str, tuple[float, float]]
    said: dict[str, str]


def check_study(path: Path | str, data_dir: Path | str | None = None) -> list[Fault]:
    """Every fault of a study, its vehicle and its records, which are read in full and tried for their physics.

    Args:
        path: The study file.
        data_dir: Folder that replaces ``${DATA}``; default: the environment variable BAYESCHUTE_DATA.
    """
    return examine_study(path, data_dir).faults


def examine_study(path: Path | str, data_dir: Path | str | None = None) -> Examined:
    """Read a study, its vehicle and its records in full, and try the laws of plausibility on every record.

    Args:
        path: The study file.
        data_dir: What ``${DATA}`` stands for; default: the environment variable BAYESCHUTE_DATA.
    """
    study, faults, draft, paths = _read_study(Path(path), data_dir)
    assumed = apparent_mass_taken_as_known(study) if study is not None else []
    found = Examined(faults, assumed, {}, {}, study, {}, {})
    if draft is not None:
        for index, record in paths.items():
            with suppress(UnknownValueError):  # its columns or its window have faults, which are told already
                _examine_record(draft, index, record, found)
    faults = list({(fault.where, fault.got): fault for fault in reversed(found.faults)}.values())[::-1]
    return found._replace(faults=faults)


def _examine_record(draft: Draft, index: int, path: Path, found: Examined) -> None:
    """Read a record in full and test it against the laws; faults of the column map refer to the study file."""
    from bayeschute.records.read import read_record

    flight = draft.flights[index]
    own = flight.columns is not None
    columns = (flight.columns if own else draft.tables.get("columns")) or {}
    specs = {name: column.spec() for name, column in columns.items()}
    said = flight.conventions or draft.tables.get("conventions")
    try:
        record = read_record(path, specs, flight.window, conventions=said.spec() if said else Conventions())
    except InputError as error:
        heading, of = ("[flight.columns", f" (flight {flight.name!r})") if own else ("[columns", "")
        found.faults.extend(
            replace(fault, where=f"{draft.file} {fault.where.replace('[columns', heading, 1)}{of}")
            if fault.where.startswith(("[columns", "[conventions"))
            else fault
            for fault in error.faults
            if specs or not fault.where.startswith("[columns")
        )
        return
    used = window_used(record, flight.window, flight.skip_first, flight.roles)
    if flight.window is None:
        found.faults.extend(check_span(draft, index, used.start, used.end))
    found.windows[flight.name] = (used.start, used.end)
    found.said[flight.name] = f"flight {flight.name!r}: {_understood(draft, index, record, used)}"
    found.records[flight.name] = record
    vehicle, profile = draft.vehicle_of(index), flight.wind_profile
    if profile is not None and not profile.is_read:  # its faults are told already
        return
    turned = axes_said(record, path, said)
    verdict = judge(record, vehicle, flight.capsule_mass, (used.start, used.end), profile, turned)
    where, accepted = f"{draft.file} flight {flight.name!r}", flight.accept_implausible
    found.verdicts[flight.name] = verdict
    found.faults.extend(told(verdict, where, accepted))
    found.warnings.extend(warned(verdict, where, accepted))
    if "identify" in flight.roles and draft.tables.get("noise") is not None:
        found.warnings.extend(noise_told(record, draft.tables["noise"], vehicle, (used.start, used.end), where))
    if verdict.readings:
        near = max(verdict.readings, key=lambda one: one.excess)
        closest = f"the nearest to its limit {near.law} ({100.0 * near.excess:.0f} % of it)"
        found.said[flight.name] += f"; {len(verdict.readings)} laws tried, {closest}"


def _understood(draft: Draft, index: int, record: xr.Dataset, used: DescentWindow) -> str:
    """How a record is used: its window, rate and channels."""
    flight, noise = draft.flights[index], draft.tables.get("noise")
    time = record["time"].values
    rate = flight.rate or 1.0 / float(np.median(np.diff(time)))
    words = [used.words] if used.words else []
    words.append(f"{used.start:.1f} to {used.end:.1f} s ({used.end - used.start:.0f} s) at {rate:g} Hz")
    if noise is not None and "identify" in flight.roles:
        fitted = [name for name in noise.channels() if name in record or name == "descent_rate"]
        others = [str(name) for name in record.data_vars if name not in fitted and name in _SENSED]
        words.append(f"fitted: {', '.join(fitted)}" + (f"; read, not fitted: {', '.join(others)}" if others else ""))
    return "; ".join(words)


def load_vehicle(path: Path | str) -> Vehicle:
    """Read a vehicle file.

    Raises:
        InputError: With every fault of the file.
    """
    read = _read_vehicle(Path(path))
    if read.whole is None:
        raise InputError(read.faults)
    return read.whole


def load_study_or_vehicle(path: Path | str) -> Study:
    """Read a study; or a vehicle, in which case the study is one virtual drop of it, as shipped with the package.

    Raises:
        InputError: With every fault of the file.
    """
    path = Path(path)
    raw, text, _ = read_toml(path)
    if raw is None or "capsule" not in raw or "flight" in raw:
        return load_study(path)
    shipped, vehicle = load_study(template("virtual.toml")), load_vehicle(path)
    if vehicle.aero == NOT_FLOWN:
        raise InputError(Fault(str(path), "no table [aero]", "[aero], with which virtual drops fly", "Add it."))
    return replace(shipped, vehicle=vehicle, vehicle_path=path, vehicle_text=text)


def load_flights(path: Path | str, study: Study, data_dir: Path | str | None = None) -> Study:
    """Read a file of flights to be predicted by a posterior of a study.

    Args:
        path: TOML with ``[[flight]]`` tables as in a study; ``vehicle``, ``[columns]`` with their ``[conventions]``,
            ``[predict]`` and ``[[requirement]]`` where they are not those of the study.
        study: That the posterior is of.
        data_dir: Folder that replaces ``${DATA}``.

    Returns:
        The study with these flights, all to be predicted, instead of its own.

    Raises:
        InputError: With every fault of the file, and of records that aren't there.
    """
    return _read_flights(Path(path), study, data_dir, FlightsFile)[0]


def load_candidates(
    path: Path | str, study: Study, data_dir: Path | str | None = None
) -> tuple[Study, dict[str, NoiseTable]]:
    """Read a file of drops that might be flown next.

    Args:
        path: As of `load_flights`; ``noise`` of a flight has what is not as in the study's ``[noise]``.
        study: That the posterior is of.
        data_dir: Folder that replaces ``${DATA}``.

    Returns:
        The study with these flights instead of its own, and the whole noise of each, by name.

    Raises:
        InputError: As of `load_flights`.
    """
    made, found = _read_flights(Path(path), study, data_dir, CandidatesFile)
    noise = {}
    for one in found.flight:
        own = one.noise or NoiseTable()
        noise[one.name] = study.noise.model_copy(update={n: getattr(own, n) for n in own.model_fields_set})
    return made, noise


def _read_flights(
    path: Path, study: Study, data_dir: Path | str | None, schema: type[Flights]
) -> tuple[Study, Flights]:
    raw, _, faults = read_toml(path)
    if raw is None:
        raise InputError(faults)
    listed = raw.get("flight")
    with_roles = [{"roles": ["predict"], **one} if isinstance(one, dict) else one for one in listed or ()]
    said = {**raw, "flight": with_roles} if isinstance(listed, list) else raw
    named, read = raw.get("vehicle"), _VehicleFile(study.vehicle, "", [], study.vehicle)
    if isinstance(named, str) and study.model != "descent":
        read = _read_vehicle(Path(os.path.normpath(path.parent / named)), data_dir)
        faults += read.faults
    try:
        found = validated(schema, str(path), said, context(path.parent, data_dir))
    except InputError as error:
        raise InputError([*error.faults, *faults]) from None
    stated = found.columns, found.conventions
    usual = _format_of(study, found.conventions) if found.columns is None else stated
    predict = found.predict or study.predict
    predict = predict.model_copy(update={"quantities": predictable(study.model, read.whole, predict.quantities)})
    tables = {"model": study.model, "noise": study.noise, "columns": usual[0], "predict": predict}
    tables |= {"requirement": found.requirement}
    listed_flights = dict(enumerate(found.flight))
    own, sound, more = _own_vehicles(listed_flights, path.parent, study.model, data_dir)
    faults = [*faults, *(one for one in more if one not in faults)]
    draft = Draft(str(path), said, tables, listed_flights, read.sound, sound)
    paths, path_faults = record_paths(draft, path.parent, data_dir)
    faults += [*as_far_as_known(check_vehicles(draft)), *check_columns(draft), *path_faults]
    if faults:
        raise InputError(faults)
    flights = tuple(
        _flight(table, paths.get(i), *(stated if tells_columns(table) else usual), own.get(i))
        for i, table in enumerate(found.flight)
    )
    flights = tuple(replace(flight, roles=("predict",)) for flight in flights)
    made = replace(study, flights=flights, vehicle=read.whole, predict=predict, requirements=found.requirement)
    return made, found


def _format_of(
    study: Study, stated: ConventionsTable | None
) -> tuple[Mapping[str, Column] | None, ConventionsTable | None]:
    """Columns of a study's records, with their conventions where no other are stated; none where records differ."""
    formats = [(flight.columns, flight.conventions) for flight in study.flights if flight.columns]
    if not formats or any(one != formats[0] for one in formats):
        return None, stated
    columns, conventions = formats[0]
    return columns, stated or conventions


def usual_study(model: str, vehicle: Vehicle | None = None) -> Study:
    """A study of no flight with the tables that the package's commented studies have, for flights without a study.

    Args:
        model: ``cluster`` or ``descent``.
        vehicle: Priors of risers and of the capsule's drag are then about its values, those of what a table of the
            capsule tells are left out, and a single canopy has no terms of a neighbour.
    """
    study = _read_study(template(f"{model}.toml"), None).study  # its record is the user's, and not there
    assert study is not None
    study = replace(study, flights=(), vehicle=None, vehicle_path=None, requirements=(), text="", vehicle_text="")
    return study if vehicle is None else _of_vehicle(study, vehicle)


def _of_vehicle(study: Study, vehicle: Vehicle) -> Study:
    """The study with the priors and candidate terms that suit a vehicle."""
    given, risers, capsule, structure = study.priors.given, vehicle.risers, vehicle.capsule, study.structure
    told: dict[str, Any] = {
        "riser_stiffness": {"median": risers.stiffness},
        "riser_damping": {"median": risers.damping},
        "capsule_axial_force": {"mean": capsule.axial_force},
    }
    if given.riser_length is not None and risers.length != given.riser_length.mean:
        told["riser_length"] = {"mean": risers.length, "sd": max(_LENGTH_SHARE * risers.length, _LENGTH_LEAST)}
    priors = {name: getattr(given, name).model_copy(update=values) for name, values in told.items()}
    priors |= dict.fromkeys(OF_NO_TABLE) if capsule.table is not None else {}
    if structure is not None and vehicle.canopies.number == 1:
        alone = [tuple(t for t in terms if not is_pairwise(t)) for terms in (structure.axial, structure.transverse)]
        structure = structure.model_copy(update=dict(zip(("axial", "transverse"), alone, strict=True)))
    table = study.priors.model_copy(update={"given": given.model_copy(update=priors)})
    return replace(study, priors=table, structure=structure)


def _read_vehicle(path: Path, data_dir: Path | str | None = None) -> _VehicleFile:
    raw, text, faults = read_toml(path)
    if raw is None:
        return _VehicleFile(None, text, faults, None)
    here = context(path.parent, data_dir)
    try:
        whole = validated(Vehicle, str(path), raw, here)
    except InputError as error:
        return _VehicleFile(None, text, list(error.faults), part_of(Vehicle, raw, here))
    return _VehicleFile(whole, text, [], whole)


def _own_vehicles(
    flights: Mapping[int, FlightTable], folder: Path, model: str | None, data_dir: Path | str | None
) -> tuple[dict[int, Vehicle], dict[int, Vehicle], list[Fault]]:
    """Vehicles of single flights by position, valid ones and as far as sound, and the faults of each file once."""
    named = {i: name for i, one in flights.items() if (name := getattr(one, "vehicle", None)) and model != "descent"}
    read = {
        name: _read_vehicle(Path(os.path.normpath(folder / name)), data_dir) for name in dict.fromkeys(named.values())
    }
    whole = {i: vehicle for i, name in named.items() if (vehicle := read[name].whole) is not None}
    sound = {i: vehicle for i, name in named.items() if (vehicle := read[name].sound) is not None}
    return whole, sound, [fault for one in read.values() for fault in one.faults]


def _read_study(path: Path, data_dir: Path | str | None) -> _Reading:
    raw, text, faults = read_toml(path)
    if raw is None:
        return _Reading(None, faults)
    whole: StudyFile | None
    here = context(path.parent, data_dir)
    try:
        whole = validated(StudyFile, str(path), raw, here)
        tables, flights = {key: getattr(whole, key) for key in raw}, dict(enumerate(whole.flight))
    except InputError as error:
        whole, faults = None, list(error.faults)
        tables, flights = _sound_tables(raw, here)
    vehicle_path, read = None, _VehicleFile(None, "", [], None)
    if isinstance(raw.get("vehicle"), str) and tables.get("model") != "descent":
        vehicle_path = Path(os.path.normpath(path.parent / raw["vehicle"]))
        read = _read_vehicle(vehicle_path, data_dir)
    own, sound, more = _own_vehicles(flights, path.parent, tables.get("model"), data_dir)
    faults += dict.fromkeys((*read.faults, *more))
    draft = Draft(str(path), raw, tables, flights, read.sound, sound)
    paths, path_faults = record_paths(draft, path.parent, data_dir)
    faults += [*crosscheck(draft), *check_columns(draft), *path_faults]
    if whole is None:
        return _Reading(None, faults, draft, paths)
    quantities = predictable(whole.model, read.whole, whole.predict.quantities)
    changed = {
        "path": path,
        "flights": tuple(
            _flight(table, paths.get(index), whole.columns, whole.conventions, own.get(index))
            for index, table in flights.items()
        ),
        "predict": whole.predict.model_copy(update={"quantities": quantities}),
        "requirements": whole.requirement,
        "vehicle": read.whole,
        "vehicle_path": vehicle_path,
        "text": text,
        "vehicle_text": read.text,
    }
    return _Reading(Study(**_same(whole, Study) | changed), faults, draft, paths)


def _same(table: BaseModel, kind: type) -> dict[str, Any]:
    """Values of a table that a dataclass has under the same names."""
    return {one.name: getattr(table, one.name) for one in fields(kind) if one.name in type(table).model_fields}


def _sound_tables(raw: Mapping[str, Any], here: Mapping[str, str]) -> tuple[dict[str, Any], dict[int, FlightTable]]:
    """The valid tables of a study with faults, so that checks across tables still run on them."""
    tables: dict[str, Any] = {}
    for key, info in StudyFile.model_fields.items():
        if key in raw and key != "flight":
            kind = Annotated[info.annotation, *info.metadata] if info.metadata else info.annotation
            sound = _sound(kind, raw[key], here)
            if sound is not None:
                tables[key] = sound
    listed = raw.get("flight")
    listed = listed if isinstance(listed, list) else []
    return tables, {
        i: part_of(FlightTable, flight, here) for i, flight in enumerate(listed) if isinstance(flight, dict)
    }


def _sound(annotation: Any, value: Any, here: Mapping[str, str]) -> Any:
    """A value read as a type, or None where that fails; the failure was reported when the whole was read."""
    try:
        return TypeAdapter(annotation).validate_python(value, context=dict(here))
    except ValidationError:
        return None


def _flight(
    table: FlightTable,
    path: Path | None,
    columns: Mapping[str, Column] | None,
    conventions: ConventionsTable | None,
    vehicle: Vehicle | None,
) -> Flight:
    own = table.columns if table.columns is not None else columns
    changed = {
        "path": path,
        "columns": dict(own or {}) if table.file is not None else {},
        "conventions": (table.conventions or conventions) if table.file is not None else None,
        "vehicle": vehicle,
    }
    return Flight(**_same(table, Flight) | changed)
