"""Tables of a campaign file: the ground or the water that landings touch. Nothing here imports JAX."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import model_validator

from bayeschute.landing.surface import STEEPEST, Waves
from bayeschute.study.landing_campaign.drawn_quantities import Pair, spread
from bayeschute.study.schema.quantities import Altitude, Azimuth, Bounds, NoiseLength, quantity
from bayeschute.study.schema.reading.strict import Strict, refuse

_BREAKING = 1.0 / 7.0  # height over length from which on a wave in deep water breaks (Michell 1893)

WaveHeight = Annotated[float, quantity("m", "2 m", Bounds(above=0.0, most=40.0))]
WavePeriod = Annotated[float, quantity("s", "8 s", Bounds(above=0.0, most=60.0))]


class WavesTable(Strict):
    """A sea: long-crested waves of one frequency in deep water, see `landing.surface`.

    Attributes:
        significant_height: Four standard deviations of the elevation [m].
        peak_period: Of the spectrum's peak [s]; this or the next.
        mean_period: Of upward zero crossings [s].
        direction: Azimuth that waves travel to [rad]; None: any.
    """

    significant_height: WaveHeight
    peak_period: WavePeriod | None = None
    mean_period: WavePeriod | None = None
    direction: Azimuth | None = None

    @model_validator(mode="after")
    def _is_a_sea(self) -> WavesTable:
        periods = [period for period in (self.peak_period, self.mean_period) if period is not None]
        if len(periods) != 1:
            refuse("exactly one of peak_period and mean_period", "both" if periods else "neither")
        if (steep := self.significant_height * self.waves.number / (2.0 * np.pi)) >= _BREAKING:
            got = f"a height of {steep:.2g} wave lengths"
            refuse(f"a significant height below {_BREAKING:.3f} wave lengths", got, "Is the period right?")
        return self

    @property
    def waves(self) -> Waves:
        """The same as numbers."""
        period = self.mean_period if self.peak_period is None else self.peak_period
        assert period is not None, "a sea without a period is refused"
        return Waves(self.significant_height, period, self.direction)


class GroundTable(Strict):
    """Where landings end.

    Attributes:
        altitude: Of the ground, or of the water at rest [m].
        contact_height: Of the capsule's centre of mass over it at touchdown [m].
        slope: Of the ground [rad]; may be drawn.
        slope_direction: Azimuth of its steepest descent [rad]; None: any.
        waves: Of water; None: ground.
    """

    altitude: Altitude = 0.0
    contact_height: NoiseLength = 0.0
    slope: Annotated[Pair, spread("rad", "5 deg", STEEPEST, 0.0)] = (0.0, 0.0)
    slope_direction: Azimuth | None = None
    waves: WavesTable | None = None

    @model_validator(mode="after")
    def _is_ground_or_water(self) -> GroundTable:
        faults = []
        if self.waves is not None and "slope" in self.model_fields_set:
            faults.append(("a slope, or waves", "both"))
        if self.slope_direction is not None and "slope" not in self.model_fields_set:
            faults.append(("slope_direction beside a slope", "slope_direction without slope"))
        if faults:
            refuse("; ".join(wanted for wanted, _ in faults), "; ".join(got for _, got in faults))
        return self
