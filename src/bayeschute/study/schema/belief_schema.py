"""Tables of a study for the priors: parameters, noise of the channels, error of the wind."""

from __future__ import annotations

from typing import Annotated, Generic, Literal, TypeVar

from pydantic import AfterValidator, ValidationInfo, field_validator

from bayeschute.study.schema.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    AreaPerMass,
    Bounds,
    Damping,
    Frequency,
    Mass,
    Number,
    PositiveForce,
    PositiveLength,
    PositiveNumber,
    PositiveSpeed,
    PositiveTime,
    Stiffness,
    Text,
    number,
    quantity,
)
from bayeschute.study.schema.reading.strict import Strict, refuse, rule
from bayeschute.study.schema.structure_schema import distinct

Q = TypeVar("Q")
NoiseModel = Literal["latent", "ar1", "ar1+white", "white", "sandwich"]
NoiseKind = Literal["ar1+white", "ar1", "white"]
_LEAST_WEIGHED = 0.2  # largest prior sd of a mass or a factor on moments of inertia, as a share of it
PositiveAngle = Annotated[float, quantity("rad", "0.1 deg", POSITIVE)]


class Prior(Strict, Generic[Q]):
    """A prior of a parameter: normal (mean, sd) or, of a positive one, log-normal (median, log_sd) [its unit]."""

    mean: Q | None = None
    sd: Q | None = None
    median: Q | None = None
    log_sd: Annotated[float, number(Bounds(above=0.0, most=5.0))] | None = None

    @rule
    def _is_one_law(self) -> None:
        given = {key for key in ("mean", "sd", "median", "log_sd") if getattr(self, key) is not None}
        if given not in ({"mean", "sd"}, {"median", "log_sd"}):
            refuse("either mean and sd, or median and log_sd", " and ".join(sorted(given)) or "an empty table")
        for key in ("sd", "median"):
            value = getattr(self, key)
            if value is not None and value <= 0.0:
                refuse(f"a positive {key}", f"{value:g}")

    @property
    def log_normal(self) -> bool:
        """Whether the distribution is log-normal."""
        return self.median is not None


class Bias(Strict, Generic[Q]):
    """Prior of a constant error of what was recorded, the same along each axis: normal about zero.

    Attributes:
        sd: Standard deviation [its unit].
    """

    sd: Q


class GivenTable(Strict):
    """Priors from other sources, of parameters that a record alone can't determine; others are fixed at the vehicle's.

    Attributes:
        riser_stiffness: [N/m].
        riser_damping: [N s/m].
        riser_length: [m].
        capsule_axial_force: C_A of the capsule [1]; this and the next two not where the capsule has a table.
        capsule_normal_force_slope: See `CapsuleTable` [1/rad].
        capsule_pitch_moment_slope: Slope of the static moment about the reference centre [1/rad].
        capsule_pitch_damping: C_mq, and C_nr where the vehicle has no other [1].
        capsule_inertia_factor_y: Times the moment of inertia of a flight's capsule about its body axis y [1].
        capsule_inertia_factor_z: Likewise about z [1].
        enclosed_air_factor: Times the enclosed air of the vehicle's canopies [1].
        canopy_pitch_moment_slope: C_m_alpha of a canopy about its reference point [1/rad]; see `CanopiesTable`.
        canopy_pitch_damping: C_mq of a canopy [1].
        canopy_position_scale: Recorded over true distance between canopies and capsule [1].
        wind_bias: Constant error of a flight's recorded wind, north and east, each flight's own [m/s].
        canopy_position_bias: Likewise of the recorded distance from capsule to canopies, north, east and down, the same
            for all canopies [m].
        capsule_attitude_bias: Likewise of the recorded attitude, a small turn about the body's axes y and z [rad].
        capsule_mass: Of the vehicle's capsule [kg]; not used for a flight with its own mass.
        canopy_mass: Dry mass of one canopy, the same for all [kg].
        cds_over_mass: C_D S/m of a descent [m^2/kg].
    """

    riser_stiffness: Prior[Stiffness] | None = None
    riser_damping: Prior[Damping] | None = None
    riser_length: Prior[PositiveLength] | None = None
    capsule_axial_force: Prior[Number] | None = None
    capsule_normal_force_slope: Prior[Number] | None = None
    capsule_pitch_moment_slope: Prior[Number] | None = None
    capsule_pitch_damping: Prior[Number] | None = None
    capsule_inertia_factor_y: Prior[PositiveNumber] | None = None
    capsule_inertia_factor_z: Prior[PositiveNumber] | None = None
    enclosed_air_factor: Prior[PositiveNumber] | None = None
    canopy_pitch_moment_slope: Prior[Number] | None = None
    canopy_pitch_damping: Prior[Number] | None = None
    canopy_position_scale: Prior[PositiveNumber] | None = None
    wind_bias: Bias[PositiveSpeed] | None = None
    canopy_position_bias: Bias[PositiveLength] | None = None
    capsule_attitude_bias: Bias[PositiveAngle] | None = None
    capsule_mass: Prior[Mass] | None = None
    canopy_mass: Prior[Mass] | None = None
    cds_over_mass: Prior[AreaPerMass] | None = None

    @field_validator("capsule_mass", "canopy_mass", "capsule_inertia_factor_y", "capsule_inertia_factor_z")
    @classmethod
    def _is_weighed(cls, prior: Prior[float] | None, seen: ValidationInfo) -> Prior[float] | None:
        """Masses and moments of inertia are normal in the fit: their prior keeps well away from zero."""
        if prior is not None:
            share = prior.log_sd if prior.log_sd is not None else (prior.sd or 0.0) / (prior.mean or 1.0)
            if share > _LEAST_WEIGHED:
                mass = str(seen.field_name).endswith("mass")
                what, do = ("mass", "Weigh it.") if mass else ("mean", "Swing the capsule on a cable.")
                refuse(f"an sd of at most {_LEAST_WEIGHED:.0%} of the {what}", f"{share:.0%}", do)
        return prior


class PriorsTable(Strict):
    """Priors.

    Attributes:
        inflation: Times the colored standard error of the equation error [1].
        floor: Least prior sd of a force coefficient [1].
        given: Priors from outside.
        vary: Parameters that differ from drop to drop about a population; the others are the same in all drops, and so
            are these where it is None (cluster).
        vary_canopies: Coefficients that differ from canopy to canopy about a population; those of all canopies are the
            same where it is None (cluster).
        spread: By parameter that varies, the scale of the half-normal prior of its population's standard deviation (of
            the logarithm where its prior is log-normal); that of the prior of its mean where none is given.
    """

    inflation: Annotated[float, number(Bounds(least=1.0, most=1e3))] = 3.0
    floor: Annotated[float, number(NOT_NEGATIVE)] = 0.02
    given: GivenTable = GivenTable()
    vary: Annotated[tuple[Text, ...], AfterValidator(distinct)] | None = None
    vary_canopies: Annotated[tuple[Text, ...], AfterValidator(distinct)] | None = None
    spread: dict[str, Annotated[float, number(POSITIVE)]] | None = None

    @property
    def hierarchical(self) -> bool:
        """Whether some parameters are those of members of a population, in a cluster."""
        return bool(self.vary or self.vary_canopies)


class ChannelNoise(Strict, Generic[Q]):
    """Residual noise of a channel; medians of log-normal priors.

    Attributes:
        white: Standard deviation of the white part [the channel's unit].
        correlated: Standard deviation of the correlated part [the channel's unit].
        time_constant: Of the correlated part [s].
        kind: Noise model.
    """

    white: Q | None = None
    correlated: Q | None = None
    time_constant: PositiveTime | None = None
    kind: NoiseKind = "ar1+white"

    @rule
    def _is_its_kind(self) -> None:
        wanted = {
            "ar1+white": {"white", "correlated", "time_constant"},
            "ar1": {"correlated", "time_constant"},
            "white": {"white"},
        }[self.kind]
        given = {key for key in ("white", "correlated", "time_constant") if getattr(self, key) is not None}
        if given != wanted:
            got = ", ".join(sorted(given)) or "an empty table"
            refuse(f"{', '.join(sorted(wanted))} and nothing else for the kind {self.kind!r}", got)


class WindNoise(Strict):
    """Latent wind error: an Ornstein-Uhlenbeck process per axis.

    Attributes:
        horizontal: Standard deviation of north and east [m/s]; None in the descent model.
        vertical: Standard deviation of down [m/s].
        time_constant: [s].
        vertical_time_constant_at_most: Longest that is sought for the vertical part [s]; None: as the prior allows.
            What lasts for a whole record can't be told from drag.
    """

    horizontal: PositiveSpeed | None = None
    vertical: PositiveSpeed
    time_constant: PositiveTime
    vertical_time_constant_at_most: PositiveTime | None = None

    @rule
    def _bounds_what_is_expected(self) -> None:
        most = self.vertical_time_constant_at_most
        if most is not None and most < self.time_constant:
            refuse(
                f"vertical_time_constant_at_most no shorter than time_constant, {self.time_constant:g} s", f"{most:g} s"
            )


class ForceNoise(Strict):
    """Latent fluctuation of a force or moment: an Ornstein-Uhlenbeck process per body and direction.

    Attributes:
        sd: Standard deviation of the relative change of the canopies' axial force, of their transverse coefficient, or
            of the capsule's angular acceleration in roll over gravity over the risers' length [1].
        time_constant: [s].
    """

    sd: Annotated[float, number(Bounds(above=0.0, most=0.5))]
    time_constant: PositiveTime


class BreathingNoise(Strict):
    """Latent breathing of each canopy's axial force: a randomly driven oscillator per canopy (6.3.2-27).

    Attributes:
        sd: Standard deviation of the relative change [1].
        frequency: Undamped frequency, sought within a factor of two [Hz].
        damping_ratio: Share of critical damping, sought up to 0.3 or twice this [1].
    """

    sd: Annotated[float, number(Bounds(above=0.0, most=0.5))]
    frequency: Frequency
    damping_ratio: Annotated[float, number(Bounds(above=0.0, most=0.9))]


FORCES = ("canopy_force", "transverse_force", "roll", "breathing")
_LATENT = ("wind", "slow_wind", *FORCES)
NOISE_UNITS = {
    "canopy_position": "m", "capsule_velocity": "m/s", "capsule_attitude": "rad", "descent_rate": "m/s",
    "swing_angle": "rad", "riser_tension": "N", "canopy_velocity": "m/s", "wind": "m/s", "slow_wind": "m/s",
}  # fmt: skip


class NoiseTable(Strict):
    """Noise of the record's channels, of the wind and of the canopies' force; a channel left out is not fitted.

    The air moves on more than one scale: gusts last seconds, thermals and errors of a wind profile minutes. `slow_wind`
    adds a second process to `wind`.

    Channels are treated as independent measurements: one that was computed from another must not be fitted with it.

    Attributes:
        model: ``latent`` (the default) models unknown disturbances where they arise, in wind and canopies.
            The others leave all of it to the residuals, for comparison, and have no use for the latent tables:
            ``ar1``, ``ar1+white``, ``white`` (teaching only, not for use) and ``sandwich``, white noise whose standard
            errors are corrected for colored residuals (classical output error).
    """

    model: NoiseModel = "latent"
    canopy_position: ChannelNoise[PositiveLength] | None = None
    capsule_velocity: ChannelNoise[PositiveSpeed] | None = None
    capsule_attitude: ChannelNoise[PositiveAngle] | None = None
    descent_rate: ChannelNoise[PositiveSpeed] | None = None
    swing_angle: ChannelNoise[PositiveAngle] | None = None
    riser_tension: ChannelNoise[PositiveForce] | None = None
    canopy_velocity: ChannelNoise[PositiveSpeed] | None = None
    wind: WindNoise | None = None
    slow_wind: WindNoise | None = None
    canopy_force: ForceNoise | None = None
    transverse_force: ForceNoise | None = None
    roll: ForceNoise | None = None
    breathing: BreathingNoise | None = None

    def channels(self) -> dict[str, ChannelNoise[float]]:
        """The channels that are fitted, by name."""
        names = (name for name in type(self).model_fields if name not in (*_LATENT, "model"))
        return {name: channel for name in names if (channel := getattr(self, name)) is not None}

    def has_latent(self) -> bool:
        """Whether a table of latent disturbances is given."""
        return any(getattr(self, name) is not None for name in _LATENT)

    def __repr__(self) -> str:
        """The model, and a line for each channel and latent disturbance, in SI."""
        lines = [f"NoiseTable of model {self.model!r}, SI"]
        for name in (n for n in type(self).model_fields if n != "model" and getattr(self, n) is not None):
            values = getattr(self, name).model_dump(exclude_none=True)
            unit = NOISE_UNITS.get(name, "1")
            units = dict.fromkeys(("time_constant", "vertical_time_constant_at_most"), "s")
            units |= {"frequency": "Hz", "damping_ratio": "1"}
            said = [f"{k} {v:.4g} {units.get(k, unit)}" for k, v in values.items() if isinstance(v, float)]
            lines.append(f"  {name:17} {', '.join(said)}")
        return "\n".join(lines)

    __str__ = __repr__
