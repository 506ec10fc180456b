"""Tables of a campaign file: winds of landings, by profile, ensemble or climatology. Nothing here imports JAX."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import ValidationInfo, field_validator, model_validator

from bayeschute.core.errors import Fault
from bayeschute.study.landing_campaign.campaign_climatology import ByMonth, ClimatologyTable, Rows
from bayeschute.study.schema.quantities import (
    Altitude,
    Bounds,
    NoiseLength,
    NoiseSpeed,
    PositiveLength,
    Speed,
    Text,
    number,
)
from bayeschute.study.schema.reading.strict import Strict, refuse
from bayeschute.study.schema.sidecar import Wanted, read_beside, refuse_all
from bayeschute.study.schema.wind_schema import ProfileTable, SeriesColumn, check_winds

MOST_MEMBERS = 1000
_SHARE = Bounds(above=0.0, most=1.0)


class TurbulenceTable(Strict):
    """Gusts along the way down, in place of those that the posterior knows.

    Attributes:
        kind: ou, dryden or von-karman.
        horizontal: Standard deviation of each horizontal component [m/s].
        vertical: Of the vertical one [m/s].
        length: Scale of the horizontal components, and of the vertical one unless that is given [m].
        vertical_length: Scale of the vertical component [m].
    """

    kind: Literal["ou", "dryden", "von-karman"]
    horizontal: NoiseSpeed
    vertical: NoiseSpeed
    length: PositiveLength
    vertical_length: PositiveLength | None = None


class EventTable(Strict):
    """A layer of shear, or a gust, met at an altitude that is drawn.

    Attributes:
        middle: Mean altitude of its middle [m].
        middle_sd: Standard deviation of that [m].
        thickness: [m].
        north: Change of the wind to the north [m/s].
        east: To the east [m/s].
        down: Downwards [m/s].
        probability: That a landing meets it [1].
    """

    middle: Altitude
    middle_sd: NoiseLength = 0.0
    thickness: PositiveLength
    north: Speed = 0.0
    east: Speed = 0.0
    down: Speed = 0.0
    probability: Annotated[float, number(_SHARE, "a probability")] = 1.0


class EnsembleTable(ByMonth):
    """Many winds by altitude in one file of comma-separated values: a column tells which member a row is of.

    Where it has a column of months, those months are as likely as they have days, and their members equally.

    Attributes:
        member: Name of the column with the members' numbers.
        altitude: Column of the altitude.
        north: Column of the velocity to the north.
        east: To the east.
        members: What the file says: a table of altitude, north, east [SI] for each; not to be given.
        member_months: Month of each; none without a column of months; not to be given.
    """

    member: Text
    altitude: SeriesColumn
    north: SeriesColumn
    east: SeriesColumn
    members: tuple[Rows, ...] = ()
    member_months: tuple[int, ...] = ()

    @model_validator(mode="after")
    def _is_read(self, info: ValidationInfo) -> EnsembleTable:
        if {"members", "member_months"} & self.model_fields_set:
            refuse("file, member, altitude and columns of the wind", "members, which come from the file")
        wanted = {"member": Wanted(self.member, "1", ""), **self.wanted_months()}
        for name, si in (("altitude", "m"), ("north", "m/s"), ("east", "m/s")):
            wanted[name] = getattr(self, name).wanted(name, si)
        found = read_beside(self.file, wanted, info)
        check_winds(found, self.file)
        months, faults = self.picked(found.get("month", np.zeros(0)))
        made, of = [], []
        for member in np.unique(found["member"]):
            here = found["member"] == member
            if self.month is not None:
                own = np.unique(found["month"][here]).astype(int).tolist()
                if len(own) > 1:
                    got = f"member {member:g} in months {', '.join(map(str, own))}"
                    faults.append(Fault(self.file, got, "one month for each member"))
                if own[0] not in months:
                    continue
                of.append(own[0])
            rows = np.stack([found[name][here] for name in ("altitude", "north", "east")], axis=1)
            rows = rows[np.argsort(rows[:, 0], kind="stable")]
            if (np.diff(rows[:, 0]) <= 0.0).any():
                got = f"one twice in member {member:g} of {self.file!r}"
                faults.append(Fault(self.file, got, "altitudes that differ within a member"))
            made.append(tuple(map(tuple, rows.tolist())))
        if len(made) > MOST_MEMBERS:
            faults.append(Fault(self.file, f"{len(made)} members", f"at most {MOST_MEMBERS} members"))
        if faults:
            refuse_all(faults)
        return self.model_copy(update={"members": tuple(made), "member_months": tuple(of)})


class WindTable(Strict):
    """Winds of a campaign: a landing takes one profile or member, and what else is given adds up.

    Attributes:
        profile: Winds by altitude, each as likely as any other; none: calm.
        ensemble: More of them from one file.
        climatology: In place of profiles: a mean by altitude, from which every landing's wind differs.
        scale_sd: Standard deviation of the logarithm of a factor on a profile [1].
        any_direction: Whether winds are turned to any azimuth.
        error_sd: Of each horizontal component about the profile: how far a forecast may be off [m/s].
        error_length: Length over which that error is correlated in altitude [m].
        shear: Layers of shear.
        gust: Gusts.
        turbulence: None: gusts as the posterior knows them from the drops it is of.
    """

    profile: tuple[ProfileTable, ...] = ()
    ensemble: EnsembleTable | None = None
    climatology: ClimatologyTable | None = None
    scale_sd: Annotated[float, number(Bounds(least=0.0, most=2.0))] = 0.0
    any_direction: bool = False
    error_sd: NoiseSpeed = 0.0
    error_length: PositiveLength = 500.0
    shear: tuple[EventTable, ...] = ()
    gust: tuple[EventTable, ...] = ()
    turbulence: TurbulenceTable | None = None

    @field_validator("climatology", mode="after")
    @classmethod
    def _stands_alone(cls, value: ClimatologyTable | None, info: ValidationInfo) -> ClimatologyTable | None:
        others = [name for name in ("profile", "ensemble") if info.data.get(name, True)]  # a faulty one isn't there
        if value is not None and others:
            refuse("a climatology, or profiles and an ensemble", f"a climatology and {' and '.join(others)}")
        return value
