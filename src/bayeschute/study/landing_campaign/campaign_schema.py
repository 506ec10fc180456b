"""Tables of a campaign file (`models/campaigns/*.toml`): starts and winds of landings, and what they must meet.

Nothing here imports JAX.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, ValidationInfo, model_validator

from bayeschute.landing.measures import MEASURES
from bayeschute.study.schema.quantities import (
    HIGHEST,
    LOWEST,
    NOT_NEGATIVE,
    Altitude,
    Azimuth,
    Bounds,
    Label,
    Limited,
    Mass,
    Name,
    NoiseAngle,
    NoiseAngularRate,
    NoiseLength,
    NoiseSpeed,
    PositiveLength,
    Speed,
    Strict,
    Text,
    number,
    one_of,
    read_quantity,
    refuse,
    whole,
)
from bayeschute.study.schema.sidecar import Wanted, read_beside
from bayeschute.study.schema.wind_schema import FASTEST, ProfileTable, SeriesColumn, check_winds

MOST_MEMBERS = 1000
_SHARE = Bounds(above=0.0, most=1.0)
_INSIDE = Annotated[float, number(Bounds(above=0.0, most=0.999999), "a probability")]


def _spread(unit: str, example: str, most: float, least: float | None = None) -> BeforeValidator:
    """Validator of a quantity, or of ``{ mean = .., sd = .. }`` of one: mean and standard deviation in SI.

    The mean is at least `least`, or minus `most`.
    """
    bounds = Bounds(least=-most if least is None else least, most=most)

    def read(value: Any) -> tuple[float, float]:
        if not isinstance(value, dict):
            return read_quantity(value, unit, example, bounds), 0.0
        if not {"mean", "sd"} >= set(value) or "mean" not in value:
            refuse("a quantity, or a table of mean and sd", f"a table of {', '.join(map(str, value)) or 'nothing'}")
        spread = read_quantity(value["sd"], unit, example, Bounds(least=0.0, most=most)) if "sd" in value else 0.0
        return read_quantity(value["mean"], unit, example, bounds), spread

    return BeforeValidator(read)


def _pure(value: Any) -> tuple[float, float]:
    wanted = "a number >= 0, or a table of mean and sd of one"
    if isinstance(value, dict) and not {"mean", "sd"} >= set(value):
        refuse(wanted, f"a table of {', '.join(map(str, value))}"[:200])
    parts: tuple[Any, Any] = (value.get("mean"), value.get("sd", 0.0)) if isinstance(value, dict) else (value, 0.0)
    if not all(isinstance(p, int | float) and not isinstance(p, bool) and 0.0 <= p <= 1e6 for p in parts):
        refuse(wanted)
    return float(parts[0]), float(parts[1])


Pair = tuple[float, float]
Altitudes = Annotated[Pair, _spread("m", "4000 ft", HIGHEST, LOWEST)]
Angles = Annotated[Pair, _spread("rad", "5 deg", 2.0 * np.pi)]
Rates = Annotated[Pair, _spread("rad/s", "1 deg/s", 20.0)]
Speeds = Annotated[Pair, _spread("m/s", "5 ft/s", FASTEST)]
Shares = Annotated[Pair, BeforeValidator(_pure)]


class StartTable(Strict):
    """Where landings begin; quantities may be drawn: ``{ mean = .., sd = .. }``. See `landing.start_plan.StartPlan`."""

    altitude: Altitudes
    swing: Angles = (0.0, 0.0)
    azimuth: Azimuth | None = None
    swing_rate: Rates = (0.0, 0.0)
    cone_rate: Rates = (0.0, 0.0)
    flyout: Angles = (0.15, 0.0)
    turn_rate: Rates = (0.0, 0.0)
    tilt: NoiseAngle = 0.0
    body_rate: NoiseAngularRate = 0.0
    speed: Shares = (1.0, 0.0)
    horizontal: Speeds = (0.0, 0.0)


class GroundTable(Strict):
    """The ground: its altitude, and the height of the capsule's centre of mass over it at touchdown [m]."""

    altitude: Altitude = 0.0
    contact_height: NoiseLength = 0.0


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


class EnsembleTable(Strict):
    """Many winds by altitude in one file of comma-separated values: a column tells which member a row is of.

    Attributes:
        file: Path of the file, from the campaign.
        member: Name of the column with the members' numbers.
        altitude: Column of the altitude.
        north: Column of the velocity to the north.
        east: To the east.
        members: What the file says: a table of altitude, north, east [SI] for each; not to be given.
    """

    file: Text
    member: Text
    altitude: SeriesColumn
    north: SeriesColumn
    east: SeriesColumn
    members: tuple[tuple[tuple[float, ...], ...], ...] = ()

    @model_validator(mode="after")
    def _is_read(self, info: ValidationInfo) -> EnsembleTable:
        if "members" in self.model_fields_set:
            refuse("file, member, altitude and columns of the wind", "members, which come from the file")
        wanted = {"member": Wanted(self.member, "1", "")}
        for name, si in (("altitude", "m"), ("north", "m/s"), ("east", "m/s")):
            wanted[name] = getattr(self, name).wanted(name, si)
        found = read_beside(self.file, wanted, info)
        check_winds(found, self.file)
        made = []
        for member in np.unique(found["member"]):
            rows = np.stack([found[name][found["member"] == member] for name in ("altitude", "north", "east")], axis=1)
            rows = rows[np.argsort(rows[:, 0], kind="stable")]
            if (np.diff(rows[:, 0]) <= 0.0).any():
                refuse("altitudes that differ within a member", f"one twice in member {member:g} of {self.file!r}")
            made.append(tuple(map(tuple, rows.tolist())))
        if len(made) > MOST_MEMBERS:
            refuse(f"at most {MOST_MEMBERS} members", f"{len(made)} in {self.file!r}")
        return self.model_copy(update={"members": tuple(made)})


class WindTable(Strict):
    """Winds of a campaign: a landing takes one profile or member, and what else is given adds up.

    Attributes:
        profile: Winds by altitude, each as likely as any other; none: calm.
        ensemble: More of them from one file.
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
    scale_sd: Annotated[float, number(Bounds(least=0.0, most=2.0))] = 0.0
    any_direction: bool = False
    error_sd: NoiseSpeed = 0.0
    error_length: PositiveLength = 500.0
    shear: tuple[EventTable, ...] = ()
    gust: tuple[EventTable, ...] = ()
    turbulence: TurbulenceTable | None = None


class LimitTable(Limited):
    """A limit on one number of a landing, see `landing.decisions.requirements.Limit`."""

    UNITS_OF: ClassVar = {name: (unit, f"10 {unit}") for name, (unit, _) in MEASURES.items()}

    quantity: Annotated[str, one_of(*MEASURES)]
    at_most: float | None = None
    at_least: float | None = None


def _some(limits: tuple[LimitTable, ...]) -> tuple[LimitTable, ...]:
    return limits or refuse("at least one limit", "none")


class RequirementTable(Strict):
    """What a landing must meet, see `landing.decisions.requirements.Requirement`."""

    name: Label
    limits: Annotated[tuple[LimitTable, ...], AfterValidator(_some)]
    probability: _INSIDE = 0.95
    confidence: _INSIDE = 0.9


class PlacardTable(Strict):
    """Winds and payloads by which a day is judged, see `landing.decisions.onset.PlacardPlan`.

    Attributes:
        capsule_mass: Payloads [kg]; none: the vehicle's.
    """

    shear: tuple[Speed, ...]
    capsule_mass: tuple[Mass, ...] = ()
    middle: PositiveLength = 300.0
    thickness: PositiveLength = 100.0
    landings: Annotated[int, whole(64, 1_000_000)] = 512
    amplitude: Annotated[float, BeforeValidator(lambda v: read_quantity(v, "rad", "10 deg", NOT_NEGATIVE))] = 0.17


class DesignTable(Strict):
    """Drops that might be flown next.

    Attributes:
        candidates: Path of a file of ``[[flight]]`` tables with virtual drops, from the campaign.
        interval: A parameter by whose interval they are ranked, in place of the first requirement's probability.
    """

    candidates: Text
    interval: Text | None = None


class CampaignFile(Strict):
    """A campaign file, table by table.

    Attributes:
        title: For tables and figures.
        name: Good as a file name.
        vehicle: Path of the vehicle file, from the campaign; None: the posterior's.
        capsule_mass: Replaces the vehicle's [kg].
        canopy_sd: Relative standard deviation of a canopy's axial coefficient about the draw's [1].
        seed: Of every random number.
        draws: Of the posterior.
        landings: At most so many.
        start: Where landings begin.
        ground: Where they end.
        wind: What they meet.
        requirement: What they must meet.
        placard: Winds and payloads by which a day is judged; None: no such table.
        design: Drops that might be flown next; None: none.
    """

    title: Text
    name: Name = "landings"
    vehicle: Text | None = None
    capsule_mass: Mass | None = None
    canopy_sd: Annotated[float, number(Bounds(least=0.0, most=0.5))] = 0.0
    seed: Annotated[int, whole(0, 2**32 - 1)]
    draws: Annotated[int, whole(2, 100_000)] = 200
    landings: Annotated[int, whole(64, 10_000_000)] = 20_000
    start: StartTable
    ground: GroundTable = GroundTable()
    wind: WindTable = WindTable()
    requirement: tuple[RequirementTable, ...] = ()
    placard: PlacardTable | None = None
    design: DesignTable | None = None

    @model_validator(mode="after")
    def _falls(self) -> CampaignFile:
        if self.start.altitude[0] - 6.0 * self.start.altitude[1] <= self.ground.altitude + 50.0:
            refuse("starts 50 m over the ground or higher, six standard deviations below their mean", "lower starts")
        return self
