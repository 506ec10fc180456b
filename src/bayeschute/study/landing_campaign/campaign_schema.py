"""Tables of a campaign file (`models/campaigns/*.toml`): starts and winds of landings, and what they must meet.

Nothing here imports JAX.
"""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import AfterValidator, BeforeValidator, model_validator

from bayeschute.landing.measures import MEASURES
from bayeschute.study.landing_campaign.campaign_ground import GroundTable
from bayeschute.study.landing_campaign.campaign_winds import WindTable
from bayeschute.study.landing_campaign.drawn_quantities import Altitudes, Angles, Rates, Shares, Speeds
from bayeschute.study.schema.quantities import (
    NOT_NEGATIVE,
    Azimuth,
    Bounds,
    Label,
    Limited,
    Mass,
    Name,
    NoiseAngle,
    NoiseAngularRate,
    PositiveLength,
    Speed,
    Text,
    number,
    one_of,
    read_quantity,
    whole,
)
from bayeschute.study.schema.reading.strict import Strict, refuse

_INSIDE = Annotated[float, number(Bounds(above=0.0, most=0.999999), "a probability")]


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
