"""Table of a virtual drop, `[flight.virtual]`: start, wind, disturbances unknown to the identification, sensors."""

from __future__ import annotations

from typing import Annotated, Generic, TypeVar

from bayeschute.study.schema.quantities import (
    NOT_NEGATIVE,
    Altitude,
    AngularRate,
    Azimuth,
    Bounds,
    Duration,
    Fraction,
    Frequency,
    HalfAngle,
    NoiseAcceleration,
    NoiseAngle,
    NoiseAngularRate,
    NoiseForce,
    NoiseLength,
    NoiseSpeed,
    Number,
    PositiveTime,
    Rate,
    Tilt,
    number,
)
from bayeschute.study.schema.reading.strict import Strict, refuse, rule
from bayeschute.study.schema.wind_schema import WindTable

Q = TypeVar("Q")
FEWEST_SAMPLES, MOST_SAMPLES = 50, 1_000_000


class TurbulenceTable(Strict):
    """Ornstein-Uhlenbeck turbulence: standard deviations [m/s] and time constant [s]."""

    horizontal: NoiseSpeed
    vertical: NoiseSpeed
    time_constant: PositiveTime


class BreathingTable(Strict):
    """Random breathing of the canopies (6.3.2-27, -28).

    Attributes:
        frequency: [Hz].
        amplitude: Standard deviation of the axial coefficient's relative change [1].
        damping_ratio: [1].
    """

    frequency: Frequency
    amplitude: Fraction
    damping_ratio: Annotated[float, number(Bounds(above=0.0, most=1.0))]


class Sensor(Strict, Generic[Q]):
    """Errors of a channel: standard deviations of a white and a correlated part [its unit], time constant [s]."""

    white: Q = 0.0  # type: ignore[assignment]
    correlated: Q = 0.0  # type: ignore[assignment]
    time_constant: PositiveTime | None = None

    @rule
    def _has_time_constant(self) -> None:
        if self.correlated and self.time_constant is None:
            refuse("a time_constant together with a correlated error", "no time_constant")


class DropoutsTable(Strict):
    """Missing samples of the canopies' position: their share [1] and mean length [s]."""

    share: Fraction
    mean_length: PositiveTime


class SensorsTable(Strict):
    """Sensor model of a virtual record; a channel left out is recorded without error.

    Riser tensions, swing angle, descent rate and canopies' velocities follow from the others: left out, they are not
    recorded at all.
    """

    canopy_position: Sensor[NoiseLength] = Sensor()
    capsule_position: Sensor[NoiseLength] = Sensor()
    capsule_velocity: Sensor[NoiseSpeed] = Sensor()
    capsule_attitude: Sensor[NoiseAngle] = Sensor()
    capsule_rate: Sensor[NoiseAngularRate] = Sensor()
    capsule_specific_force: Sensor[NoiseAcceleration] = Sensor()
    wind: Sensor[NoiseSpeed] = Sensor()
    riser_tension: Sensor[NoiseForce] | None = None
    swing_angle: Sensor[NoiseAngle] | None = None
    descent_rate: Sensor[NoiseSpeed] | None = None
    canopy_velocity: Sensor[NoiseSpeed] | None = None
    dropouts: DropoutsTable | None = None


class VirtualFlight(Strict):
    """A virtual drop.

    Attributes:
        duration: [s].
        rate: Samples per second [Hz].
        altitude: At the first sample [m].
        swing: Angle of the cluster off the vertical at the first sample [rad].
        swing_azimuth: From north [rad].
        swing_rate: [rad/s].
        flyout: Half the angle between the risers [rad].
        flyout_azimuth: [rad].
        shape: eta of each canopy at the first sample, for canopies that breathe in the vehicle file; empty: all 0.
        wind: By altitude, by time, shears and gusts.
        turbulence: Unknown to the identification; None: still air around the steady wind.
        breathing: Unknown to the identification; None: none.
        canopy_sd: Standard deviation from canopy to canopy of coefficients, about those of the vehicle; None: all fly
            with the vehicle's.
        sensors: Errors of the record.
    """

    duration: Duration
    rate: Rate
    altitude: Altitude
    swing: Tilt
    swing_azimuth: Azimuth
    swing_rate: AngularRate
    flyout: HalfAngle
    flyout_azimuth: Azimuth
    shape: tuple[Number, ...] = ()
    wind: WindTable
    turbulence: TurbulenceTable | None = None
    breathing: BreathingTable | None = None
    canopy_sd: dict[str, Annotated[float, number(NOT_NEGATIVE)]] | None = None
    sensors: SensorsTable = SensorsTable()

    @rule
    def _has_samples(self) -> None:
        samples = self.duration * self.rate
        if not FEWEST_SAMPLES <= samples <= MOST_SAMPLES:
            refuse(f"{FEWEST_SAMPLES} to {MOST_SAMPLES:,} samples", f"duration times rate of {samples:.3g} samples")
