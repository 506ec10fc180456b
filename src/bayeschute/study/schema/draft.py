"""A study file as far as its tables are valid, for the checks across them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from bayeschute.study.schema.schema_faults import place
from bayeschute.study.schema.study_schema import FlightTable
from bayeschute.study.schema.vehicle_schema import Vehicle


@dataclass(frozen=True)
class Draft:
    """A study as far as its tables could be read.

    Attributes:
        file: Path of the study file, as given by the user.
        raw: Its content.
        tables: Its valid tables by key, except flights.
        flights: Its flights by their position in the file, as far as they are valid.
        vehicle: The vehicle as far as its file is valid; None where that could not be read.
        own_vehicles: Those of single flights, likewise, by their position.

    A flight or a vehicle in part raises `UnknownValueError` of `quantities` where it is asked for what is not valid.
    """

    file: str
    raw: Mapping[str, Any]
    tables: Mapping[str, Any]
    flights: Mapping[int, FlightTable] = field(default_factory=dict)
    vehicle: Vehicle | None = None
    own_vehicles: Mapping[int, Vehicle] = field(default_factory=dict)

    def vehicle_of(self, index: int) -> Vehicle | None:
        """The vehicle that flew a flight, if it could be read."""
        return self.vehicle if self.flights[index].vehicle is None else self.own_vehicles.get(index)

    def at(self, *loc: int | str) -> str:
        """Location of a value."""
        return place(self.file, loc, self.raw)

    @property
    def model(self) -> str | None:
        """The study's model, if it could be read."""
        return self.tables.get("model")

    @property
    def flights_complete(self) -> bool:
        """Whether every flight of the file is there, at least in part."""
        listed = self.raw.get("flight")
        return isinstance(listed, list) and len(listed) == len(self.flights)
