"""A campaign file to a campaign: every fault of the file at once, all numbers in SI. Nothing here imports JAX."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bayeschute.core.errors import InputError
from bayeschute.landing.turbulence import Turbulence
from bayeschute.landing.wind_plan import Event, Profile, WindPlan
from bayeschute.study.landing_campaign.campaign_schema import CampaignFile, EventTable, WindTable
from bayeschute.study.load import load_vehicle
from bayeschute.study.schema.schema_faults import validated
from bayeschute.study.schema.sidecar import context
from bayeschute.study.schema.study_files import read_toml
from bayeschute.study.schema.vehicle_schema import Vehicle


@dataclass(frozen=True)
class Campaign:
    """A campaign whose file is sound.

    Attributes:
        path: The file.
        tables: Its tables.
        vehicle: That lands; None: the posterior's.
    """

    path: Path
    tables: CampaignFile
    vehicle: Vehicle | None

    def with_landings(self, most: int) -> Campaign:
        """The same campaign of at most so many landings."""
        return replace(self, tables=self.tables.model_copy(update={"landings": most}))

    @property
    def identity(self) -> str:
        """Hash of all that landings depend on beside the posterior; not of what is asked about them, nor how many."""
        asked = {"title", "name", "landings", "requirement", "placard", "design", "vehicle"}
        said = self.tables.model_dump(exclude=asked)
        said["vehicle"] = None if self.vehicle is None else self.vehicle.model_dump()
        return hashlib.sha256(json.dumps(said, sort_keys=True, default=str).encode()).hexdigest()


def load_campaign(path: Path | str, data_dir: Path | str | None = None) -> Campaign:
    """Read a campaign.

    Args:
        path: TOML, see `campaign_schema.CampaignFile`.
        data_dir: What ``${DATA}`` stands for; default: the environment variable BAYESCHUTE_DATA.

    Raises:
        InputError: With every fault of the file and of its vehicle.
    """
    path = Path(path)
    raw, _, faults = read_toml(path)
    if raw is None:
        raise InputError(faults)
    vehicle = None
    if isinstance(raw.get("vehicle"), str):
        try:
            vehicle = load_vehicle(os.path.normpath(path.parent / raw["vehicle"]))
        except InputError as error:
            faults += error.faults
    try:
        tables = validated(CampaignFile, str(path), raw, context(path.parent, data_dir))
    except InputError as error:
        raise InputError([*error.faults, *faults]) from None
    if faults:
        raise InputError(faults)
    return Campaign(path, tables, vehicle)


def wind_plan(table: WindTable) -> WindPlan:
    """What a wind table says, as numbers."""
    profiles = [Profile(rows[:, 0], rows[:, 1:]) for rows in (one.rows() for one in table.profile)]
    for rows in table.ensemble.members if table.ensemble is not None else ():
        altitude, north, east = (np.array(v) for v in zip(*rows, strict=True))
        profiles.append(Profile(altitude, np.stack([north, east, 0.0 * north], axis=1)))
    events = tuple(_event(kind, one) for kind in ("shear", "gust") for one in getattr(table, kind))
    t = table.turbulence
    gusts = None if t is None else Turbulence(t.kind, t.horizontal, t.vertical, t.length, t.vertical_length or t.length)
    return WindPlan(
        tuple(profiles), table.scale_sd, table.any_direction, table.error_sd, table.error_length, events, gusts
    )


def _event(kind: str, one: EventTable) -> Event:
    return Event(kind, one.middle, one.middle_sd, one.thickness, (one.north, one.east, one.down), one.probability)
