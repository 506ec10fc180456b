"""A campaign file to a campaign: every fault of the file at once, all numbers in SI. Nothing here imports JAX."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.errors import InputError
from bayeschute.landing.climatology import DAYS, Scatter
from bayeschute.landing.surface import SurfacePlan
from bayeschute.landing.turbulence import Turbulence
from bayeschute.landing.wind_plan import Event, Profile, WindPlan
from bayeschute.study.landing_campaign.campaign_ground import GroundTable
from bayeschute.study.landing_campaign.campaign_schema import CampaignFile
from bayeschute.study.landing_campaign.campaign_winds import EventTable, WindTable
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


def surface_plan(table: GroundTable) -> SurfacePlan:
    """What a ground table says of the surface, as numbers."""
    return SurfacePlan(table.slope, table.slope_direction, None if table.waves is None else table.waves.waves)


def wind_plan(table: WindTable) -> WindPlan:
    """What a wind table says, as numbers."""
    profiles = [Profile(rows[:, 0], rows[:, 1:]) for rows in (one.rows() for one in table.profile)]
    weights: tuple[float, ...] = ()
    if table.ensemble is not None:
        months = table.ensemble.member_months
        weights = (1.0,) * len(profiles) + _by_days(months) if months else ()
        profiles += [_level(np.array(rows)) for rows in table.ensemble.members]
    scatter: tuple[Scatter, ...] = ()
    if table.climatology is not None:
        by_month = table.climatology.rows()
        profiles = [_level(rows[:, :3]) for _, rows in by_month]
        scatter = tuple(Scatter(rows[:, 0], rows[:, 3:5], rows[:, 5]) for _, rows in by_month)
        weights = _by_days([month for month, _ in by_month]) if len(by_month) > 1 else ()
    events = tuple(_event(kind, one) for kind in ("shear", "gust") for one in getattr(table, kind))
    t = table.turbulence
    gusts = None if t is None else Turbulence(t.kind, t.horizontal, t.vertical, t.length, t.vertical_length or t.length)
    return WindPlan(
        tuple(profiles), table.scale_sd, table.any_direction, table.error_sd, table.error_length, events, gusts,
        weights, scatter, 1000.0 if table.climatology is None else table.climatology.length,
    )  # fmt: skip


def _level(rows: NDArray[np.float64]) -> Profile:
    """A profile without vertical wind from rows of altitude, north, east (K, 3)."""
    return Profile(rows[:, 0], np.stack([rows[:, 1], rows[:, 2], 0.0 * rows[:, 1]], axis=1))


def _by_days(months: Sequence[int]) -> tuple[float, ...]:
    """Weights of members by their months, 1 on average: a month has as much as it has days."""
    each = np.array([DAYS[month - 1] / months.count(month) for month in months])
    return tuple((each / each.mean()).tolist())


def _event(kind: str, one: EventTable) -> Event:
    return Event(kind, one.middle, one.middle_sd, one.thickness, (one.north, one.east, one.down), one.probability)
