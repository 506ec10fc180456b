"""Checks of a column map: variables of the record schema, units of their dimension, and what the model needs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace

from bayeschute.core.errors import Fault
from bayeschute.core.units import factor_to_si
from bayeschute.records.foreign.clocks import ISO
from bayeschute.records.foreign.translate import EARTH_LABELS, EULER, WEEK, WIND_POLAR, foreign_unit
from bayeschute.records.record import LABELS, VARIABLES, nearest
from bayeschute.study.schema.draft import Draft
from bayeschute.study.schema.reading.strict import UnknownValueError
from bayeschute.study.schema.reading.unit_meant import unit_meant
from bayeschute.study.schema.schema_faults import show
from bayeschute.study.schema.study_schema import Column, FlightTable

_WITH_NAMES = (".nc", ".nc4", ".netcdf", ".h5")  # files that may contain the names and units of the schema


def tells_columns(flight: FlightTable) -> bool:
    """Whether a flight has columns of its own, or a file that may name them."""
    return flight.columns is not None or (flight.file is not None and flight.file.endswith(_WITH_NAMES))


def _components(name: str) -> list[str]:
    """Names of the scalar columns that make up a variable, canopies left open as ``N``."""
    dims = VARIABLES[name].dims[1:]
    labels = [LABELS.get(dim, ("N",)) for dim in dims]
    names = [name]
    for choices in labels:
        names = [f"{prefix}.{label}" for prefix in names for label in choices]
    return names


def known_columns() -> list[str]:
    """Every name a column map may have; ``N`` stands for the number of a canopy."""
    return ["time", *(column for name in VARIABLES for column in _components(name))]


def _translated_columns() -> list[str]:
    """Names of what is translated into those: directions of the earth, Euler angles, wind by speed and direction."""
    firsts = [_components(name)[0] for name, variable in VARIABLES.items() if "axis" in variable.dims]
    vectors = [f"{column.rpartition('.')[0]}.{label}" for column in firsts for label in EARTH_LABELS]
    parts = {"capsule_attitude": EULER, "wind": WIND_POLAR}
    return [*vectors, *(f"{name}.{part}" for name, labels in parts.items() for part in labels), WEEK]


def _unit_of(name: str) -> str | None:
    """SI unit of a column; None where its name is unknown."""
    if name == "time":
        return "s"
    parts = name.split(".")
    foreign = foreign_unit(name)
    if foreign is not None:
        return foreign if len(parts) < 3 or (parts[1].isdecimal() and int(parts[1]) > 0) else None
    generic = ".".join("N" if part.isdecimal() and int(part) > 0 else part for part in parts)
    if parts[0] not in VARIABLES or generic not in _components(parts[0]):
        return None
    return VARIABLES[parts[0]].unit


def with_units_meant(faults: Iterable[Fault], units: Mapping[str, str]) -> list[Fault]:
    """Faults of a record's column map, with advice on units that are none or of something else.

    Args:
        faults: As reading the record found them.
        units: As written, by column.
    """
    advice = {
        f"[columns.{name}] unit": do
        for name, text in units.items()
        if (unit := _unit_of(name)) is not None and (do := unit_meant(text, unit))
    }
    return [replace(one, do=advice.get(one.where, one.do)) for one in faults]


def _map_faults(draft: Draft, columns: Mapping[str, Column], loc: tuple[int | str, ...]) -> Iterator[Fault]:
    """Faults of one column map, located at `loc`."""
    for name, spec in columns.items():
        unit = _unit_of(name)
        if unit is None:
            meant = dict.fromkeys([*known_columns(), *_translated_columns()])
            do = nearest(name, list(meant)) or f"Known are {', '.join(known_columns())}."
            yield Fault(draft.at(*loc, name, ""), f"the unknown variable {show(name)}", "a variable of a record", do)
            continue
        if name == "time" and spec.unit == ISO:
            continue
        try:
            factor_to_si(spec.unit, unit)
        except ValueError:
            do = unit_meant(spec.unit, unit)
            yield Fault(draft.at(*loc, name, "unit"), show(spec.unit), f"a unit convertible to {unit}", do)
    by_place: dict[str, str] = {}
    for name, spec in columns.items():
        if spec.column in by_place:
            got = f"{show(spec.column)}, which {by_place[spec.column]} takes already"
            yield Fault(draft.at(*loc, name, "column"), got, "a separate column")
        by_place[spec.column] = name
    if "time" not in columns:
        yield Fault(draft.at(*loc, ""), "no time", "a column for time", "Add time = { column = ..., unit = 's' }.")


def check_columns(draft: Draft) -> list[Fault]:
    """Faults of the column maps of a study, and of flights that lack one.

    Args:
        draft: The study as far as its tables could be read.
    """
    faults: list[Fault] = []
    shared: Mapping[str, Column] | None = draft.tables.get("columns")
    told = shared is not None or "columns" in draft.raw  # flights of a posterior have its columns
    if shared is not None:
        faults += _map_faults(draft, shared, ("columns",))
        if draft.model == "descent":
            faults += _lacks_altitude(draft, shared, ("columns",))
    for index, flight in draft.flights.items():
        with suppress(UnknownValueError):
            faults += [*_of_flight(draft, index, flight, told), *_windless(draft, index, flight, shared)]
    return list(dict.fromkeys(faults))  # one for conventions that flights share


def has_wind(columns: Iterable[str]) -> bool:
    """Whether some of the quantities that columns hold are of the wind."""
    return any(name.split(".")[0] == "wind" for name in columns)


def _windless(draft: Draft, index: int, flight: FlightTable, shared: Mapping[str, Column] | None) -> Iterator[Fault]:
    """Where winds come from, said of a record that has no column of the wind: it would change nothing."""
    own = flight.conventions is not None
    said = flight.conventions or draft.tables.get("conventions")
    columns = flight.columns if flight.columns is not None else shared
    if said is None or said.wind_is is None or not columns or has_wind(columns):
        return
    do = "Leave it out." if flight.wind_profile is None else "Say it in [flight.wind_profile.profile]."
    at = draft.at("flight", index, "conventions", "wind_is") if own else draft.at("conventions", "wind_is")
    yield Fault(at, f"{show(said.wind_is)} of a record without columns of the wind", "columns of the wind", do)


def _of_flight(draft: Draft, index: int, flight: FlightTable, told: bool) -> list[Fault]:
    """Faults of a flight's own columns, or that it has none where the study has none either."""
    loc = ("flight", index, "columns")
    if flight.columns is not None:
        lacks = _lacks_altitude(draft, flight.columns, loc) if draft.model == "descent" else []
        return [*_map_faults(draft, flight.columns, loc), *lacks]
    if flight.file is None or told or tells_columns(flight):
        return []
    wanted = "the columns of this record, here or for the whole study"
    return [Fault(draft.at(*loc, ""), "nothing", wanted, "Add a table [columns].")]


def _lacks_altitude(draft: Draft, columns: Mapping[str, Column], loc: tuple[int | str, ...]) -> list[Fault]:
    """The descent model is fitted to altitudes."""
    if "altitude" in columns or "pressure" in columns:
        return []
    return [Fault(draft.at(*loc, ""), "no altitude", "a column for altitude or pressure (model 'descent')")]
