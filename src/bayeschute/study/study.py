"""A valid study, and its identity: a hash of everything that results depend on, whatever the layout of its files."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bayeschute.study.schema.belief_schema import NoiseTable, PriorsTable
from bayeschute.study.schema.knowledge.knowledge_schema import KnowledgeTable
from bayeschute.study.schema.quantities import Cut
from bayeschute.study.schema.reading.strict import Strict
from bayeschute.study.schema.structure_schema import StructureTable, SyntheticTable
from bayeschute.study.schema.study_schema import Column, ConventionsTable, PredictTable, RequirementTable, SamplerTable
from bayeschute.study.schema.vehicle_schema import Vehicle
from bayeschute.study.schema.virtual_schema import VirtualFlight
from bayeschute.study.schema.wind_schema import ProfileTable


@dataclass(frozen=True)
class Flight:
    """A flight, ready to be read or flown: `FlightTable` with what its file and its study say.

    Attributes:
        path: The record; None for a virtual drop.
        columns: Column and unit by variable; empty for a virtual drop or a record in the schema's own names.
        conventions: Axes, senses and clock of the record; None: those of the schema.
        vehicle: Its vehicle, where that is not the study's.
    """

    name: str
    roles: tuple[str, ...]
    path: Path | None = None
    virtual: VirtualFlight | None = None
    columns: Mapping[str, Column] = field(default_factory=dict)
    conventions: ConventionsTable | None = None
    window: tuple[float, float] | None = None
    rate: float | None = None
    capsule_mass: float | None = None
    skip_first: float = 0.0
    identify_until: Cut | None = None
    remove_velocity_bias: bool = False
    wind_profile: ProfileTable | None = None
    vehicle: Vehicle | None = None
    accept_implausible: tuple[str, ...] = ()
    simulated_by: str | None = None


@dataclass(frozen=True)
class Study:
    """A study whose files are valid; all numbers in SI: `StudyFile` with its vehicle and the files as read.

    Attributes:
        path: The study file.
        flights: In the order of the file.
        predict: Predictions; `quantities` is never None here.
        structure: Selection of the structure; None in the descent model.
        vehicle: The vehicle; None in the descent model.
        vehicle_path: The vehicle file.
        text: The study file as read.
        vehicle_text: The vehicle file as read.
    """

    path: Path
    title: str
    model: str
    seed: int
    flights: tuple[Flight, ...]
    priors: PriorsTable
    noise: NoiseTable
    sampler: SamplerTable
    predict: PredictTable
    requirements: tuple[RequirementTable, ...] = ()
    structure: StructureTable | None = None
    synthetic: SyntheticTable | None = None
    vehicle: Vehicle | None = None
    vehicle_path: Path | None = None
    text: str = ""
    vehicle_text: str = ""
    knowledge: tuple[KnowledgeTable, ...] = ()

    def with_role(self, role: str) -> tuple[Flight, ...]:
        """Flights that have a role."""
        return tuple(flight for flight in self.flights if role in flight.roles)

    def vehicle_of(self, flight: Flight) -> Vehicle:
        """The vehicle that flew a flight: its own, or the study's."""
        vehicle = flight.vehicle or self.vehicle
        assert vehicle is not None, "a flight of a point mass has no vehicle"
        return vehicle


def apparent_mass_taken_as_known(study: Study) -> list[str]:
    """What it means to fit recorded flights without the canopies' apparent mass; empty where it is fitted."""
    flown = [one for one in study.with_role("identify") if one.virtual is None]
    if study.model != "cluster" or study.priors.given.enclosed_air_factor is not None or not flown:
        return []
    return [
        "The apparent mass of a canopy, of the air that moves with it, is taken as known: density times the vehicle "
        "file's enclosed_volume. Coefficients of transverse force scale with it, and it sets the period of the swing: "
        "where it is not known to a few per cent, bands are too narrow without enclosed_air_factor in [priors.given]."
    ]


def canonical(study: Study) -> dict[str, Any]:
    """Content of a study in SI, independent of layout, comments and units of its files: plain values for JSON."""

    def plain(value: Any) -> Any:
        # Unset options are omitted, so that options added later do not change the hashes of present studies.
        return value.model_dump(exclude_none=True) if isinstance(value, Strict) else vars(value)

    layout, usual = ("path", "vehicle_path", "text", "vehicle_text"), ("vehicle", "conventions", "simulated_by")
    of_no_result = ("path", "accept_implausible")
    said = {key: value for key, value in vars(study).items() if key not in layout}
    if not study.knowledge:
        del said["knowledge"]
    else:  # a file's layout is no part of what it says
        named = {"columns", "points"}
        said["knowledge"] = [k.model_dump(exclude_none=True, exclude=named) for k in study.knowledge]
    said["flights"] = [
        {k: v for k, v in vars(flight).items() if k not in of_no_result and not (k in usual and v is None)}
        | {"record": file_hash(flight.path) if flight.path else None}
        for flight in study.flights
    ]
    return dict(_without_files(json.loads(json.dumps(said, default=plain))))


def _without_files(value: Any) -> Any:
    """Plain values without the paths of files whose content stands beside them."""
    if isinstance(value, dict):
        return {key: _without_files(one) for key, one in value.items() if key != "file"}
    return [_without_files(one) for one in value] if isinstance(value, list) else value


def study_hash(study: Study) -> str:
    """SHA-256 of everything a study's results depend on: its content in SI, its vehicle, its records' bytes."""
    text = json.dumps(canonical(study), sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def file_hash(path: Path) -> str:
    """SHA-256 of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
