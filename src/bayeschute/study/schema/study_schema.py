"""Tables of a study file (`models/studies/*.toml`), with the checks a table can make on its own.

Checks across tables and files are in `bayeschute.study.schema.crosscheck`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator

from bayeschute.records.foreign.conventions import Conventions
from bayeschute.records.plausibility.reading import NAMES
from bayeschute.records.read import ColumnSpec
from bayeschute.study.schema.belief_schema import NoiseTable, PriorsTable
from bayeschute.study.schema.knowledge.knowledge_schema import KnowledgeTable
from bayeschute.study.schema.quantities import (
    Bounds,
    Label,
    Limited,
    Mass,
    Name,
    NotNegativeTime,
    Rate,
    Text,
    Time,
    Until,
    number,
    one_of,
    whole,
)
from bayeschute.study.schema.reading.strict import Strict, refuse, rule
from bayeschute.study.schema.structure_schema import StructureTable, SyntheticTable, distinct
from bayeschute.study.schema.vehicle_schema import Vehicle
from bayeschute.study.schema.virtual_schema import VirtualFlight
from bayeschute.study.schema.wind_schema import ProfileTable, SeriesColumn

UNITS = {  # of the quantities that a study can predict
    "swing_angle": ("rad", "30 deg"),
    "descent_rate": ("m/s", "33 ft/s"),
    "sea_level_descent_rate": ("m/s", "33 ft/s"),
    "flyout_angle": ("rad", "15 deg"),
}
QUANTITIES = {"cluster": tuple(UNITS), "descent": ("descent_rate", "sea_level_descent_rate")}


def predictable(model: str, vehicle: Vehicle | None, asked: Sequence[str] | None = None) -> tuple[str, ...]:
    """Quantities that a study predicts: those asked for, or all of its model; one canopy has no flyout angle."""
    one = vehicle is not None and vehicle.canopies.number == 1
    return tuple(name for name in asked or QUANTITIES[model] if not (one and name == "flyout_angle"))


Role = Literal["structure", "identify", "predict"]
Quantity = Annotated[str, one_of(*UNITS)]
Statistic = Literal["final", "maximum", "mean"]


class Column(SeriesColumn):
    """Column of a variable in a record: its name, and its unit there."""

    scale: Annotated[float, number()] | None = None
    offset: Annotated[float, number()] | None = None

    def spec(self) -> ColumnSpec:
        """As the reader of records takes it."""
        scale, offset = (usual if x is None else x for x, usual in ((self.scale, 1.0), (self.offset, 0.0)))
        return ColumnSpec(self.column, self.unit, scale, offset)


class ConventionsTable(Strict):
    """What columns of a record don't tell by name and unit, see `bayeschute.records.foreign.conventions`.

    Attributes:
        axes: Earth axes of the attitude and of columns named x, y, z, such as ``ENU``.
        body_axes: The vehicle's x, y, z in terms of the record's body axes, such as ``-z y x``.
        attitude: ``body to earth`` or ``earth to body``.
        euler: Order of yaw, pitch and roll, such as ``zyx``.
        wind_is: ``towards`` or ``from``.
        repeated_times: Which row of several of one time is kept: ``first``, ``last``, ``mean``; None: refused.
        sort_times: Whether rows are sorted by time.
        clock_wraps: After how long the clock begins anew [s].
        lacks: Components without a column, such as ``capsule_rate.y``.
    """

    axes: Text = "NED"
    body_axes: Text = "x y z"
    attitude: Text = "body to earth"
    euler: Text = "zyx"
    wind_is: Text | None = None
    repeated_times: Text | None = None
    sort_times: bool = False
    clock_wraps: Time | None = None
    lacks: tuple[Text, ...] = ()

    def spec(self) -> Conventions:
        """As the reader of records takes it."""
        return Conventions(**self.model_dump())


def _laws(names: tuple[str, ...]) -> tuple[str, ...]:
    known = {part for law in NAMES for part in (law, law.split(".")[0], law.rpartition(".")[0]) if part}
    for name in distinct(names):
        if name not in known:
            refuse(f"names of laws or of their groups: {', '.join(sorted(known))}", repr(name))
    return names


class FlightTable(Strict):
    """A flight: a record in a file, or a virtual drop.

    Attributes:
        name: Unique within the study.
        roles: Uses of the flight.
        file: Path of the record, relative to the study; ``${DATA}`` is replaced by the data folder.
        virtual: The drop to fly.
        columns: Columns of the record; None: those of the study.
        conventions: Axes, senses and clock of the record; None: those of the study.
        window: First and last time used [s].
        rate: Sampling rate to which the record is resampled [Hz]; None: that of the record.
        vehicle: Path of its vehicle file, relative to this file; None: the study's vehicle.
        capsule_mass: Replaces the vehicle's [kg].
        skip_first: Left out at the start of the window [s] (descent).
        identify_until: End of the fitted part; the rest is held out and predicted (descent).
        remove_velocity_bias: Whether constant biases of the recorded velocity, found against positions, are removed.
        wind_profile: Wind by altitude, which gives the wind at the canopies relative to the recorded one at the capsule
            (cluster); where no wind is recorded it replaces it. None: canopies meet the capsule's wind.
        accept_implausible: Laws of plausibility, or groups of them, that the record may break.
        simulated_by: The other program that simulated the flight in `file`; None: a recorded flight.
    """

    name: Name
    roles: Annotated[tuple[Role, ...], AfterValidator(distinct)]
    file: Text | None = None
    virtual: VirtualFlight | None = None
    columns: dict[str, Column] | None = None
    conventions: ConventionsTable | None = None
    window: tuple[Time, Time] | None = None
    rate: Rate | None = None
    vehicle: Text | None = None
    capsule_mass: Mass | None = None
    skip_first: NotNegativeTime = 0.0
    identify_until: Until | None = None
    remove_velocity_bias: bool = False
    wind_profile: ProfileTable | None = None
    accept_implausible: Annotated[tuple[Text, ...], AfterValidator(_laws)] = ()
    simulated_by: Text | None = None

    @rule
    def _comes_from_somewhere(self) -> None:
        if self.file is None and self.virtual is None:
            refuse("either a file or a [flight.virtual] table", "neither")
        if self.file is not None and self.virtual is not None:
            refuse("either a file or a [flight.virtual] table", "both")

    @rule
    def _says_nothing_of_a_record_there_is_none_of(self) -> None:
        if self.virtual is not None:
            for key in ("columns", "conventions", "rate", "simulated_by", "vehicle"):
                if getattr(self, key) is not None:
                    refuse(f"no {key} together with [flight.virtual]", f"{key} of a virtual flight")

    @rule
    def _has_a_window_that_lasts(self) -> None:
        if self.window is not None and not self.window[0] < self.window[1]:
            refuse("a window whose start is before its end", "window of {:g} s to {:g} s".format(*self.window))


class SamplerTable(Strict):
    """Sampler, and how long it runs.

    Attributes:
        kind: Which.
        chains: Chains.
        warmup: Warm-up steps.
        draws: Draws per chain.
        starts: From how many places the optimum is sought: the prior means, and draws about them; None: from the means.
    """

    kind: Literal["nuts", "emcee", "both"] = "nuts"
    chains: Annotated[int, whole(2, 64)] = 4
    warmup: Annotated[int, whole(50, 100_000)] = 300
    draws: Annotated[int, whole(50, 1_000_000)] = 500
    starts: Annotated[int, whole(2, 100)] | None = None


class PredictTable(Strict):
    """Predictions.

    Attributes:
        draws: How many.
        quantities: Quantities to predict; None: all of the model.
        disturbance_log_sd: Standard deviation of the logarithm by which disturbances beyond the data (other air, nearer
            to the ground) may be stronger or weaker than those that were fitted; 0: they are the same.
        recalibrate: ``replicates``: bands of unseen flights are widened by what stored replicates of the configuration
            held; None: they stay as predicted.
    """

    draws: Annotated[int, whole(50, 1_000_000)] = 400
    disturbance_log_sd: Annotated[float, number(Bounds(least=0.0, most=3.0))] = 0.0
    quantities: Annotated[tuple[Quantity, ...], AfterValidator(distinct)] | None = None
    recalibrate: Literal["replicates"] | None = None


class RequirementTable(Limited):
    """A requirement on a statistic of a predicted quantity over the window.

    Attributes:
        name: For the report.
        quantity: Name of the quantity.
        statistic: final, maximum or mean.
        at_most: Upper limit [SI unit of the quantity]; this or `at_least`.
        at_least: Lower limit [SI unit of the quantity].
    """

    UNITS_OF: ClassVar = UNITS

    name: Label
    quantity: Quantity
    statistic: Statistic
    at_most: float | None = None
    at_least: float | None = None


def _some(flights: tuple[FlightTable, ...]) -> tuple[FlightTable, ...]:
    return flights or refuse("at least one [[flight]]", "none")


class StudyFile(Strict):
    """A study file, table by table.

    Attributes:
        title: For the report.
        model: The flight model.
        vehicle: Path of the vehicle file, relative to the study.
        seed: Of every random number.
        columns: Columns of all records that don't name their own.
        conventions: Axes, senses and clocks of all records that don't tell their own.
        flight: The flights.
        structure: Selection of the structure (cluster).
        synthetic: Simulation study with published terms, to test whether a flight identifies them (cluster).
        priors: Priors.
        noise: Noise.
        sampler: Sampler.
        predict: Predictions.
        requirement: Requirements.
        knowledge: What others know about coefficients and curves (cluster).
    """

    title: Text
    model: Literal["cluster", "descent"]
    vehicle: Text | None = None
    seed: Annotated[int, whole(0, 2**32 - 1)]
    columns: dict[str, Column] | None = None
    conventions: ConventionsTable | None = None
    flight: tuple[FlightTable, ...]
    structure: StructureTable | None = None
    synthetic: SyntheticTable | None = None
    priors: PriorsTable
    noise: NoiseTable
    sampler: SamplerTable = SamplerTable()
    predict: PredictTable = PredictTable()
    requirement: tuple[RequirementTable, ...] = ()
    knowledge: tuple[KnowledgeTable, ...] = ()


class FlightsFile(Strict):
    """A file of flights to be predicted by a posterior.

    Attributes:
        vehicle: Path of the vehicle file, relative to this one; None: the posterior's vehicle.
        columns: Columns of all records that don't name their own.
        conventions: Axes, senses and clocks of all records that don't tell their own.
        flight: The flights.
        predict: Predictions; None: as the posterior's study has them.
        requirement: Requirements.
    """

    vehicle: Text | None = None
    columns: dict[str, Column] | None = None
    conventions: ConventionsTable | None = None
    flight: Annotated[tuple[FlightTable, ...], AfterValidator(_some)]
    predict: PredictTable | None = None
    requirement: tuple[RequirementTable, ...] = ()


class CandidateTable(FlightTable):
    """A drop that might be flown next.

    Attributes:
        noise: Tables of ``[noise]`` that differ from the study's, as for a load cell or another wind sounding.
    """

    noise: NoiseTable | None = None


class CandidatesFile(FlightsFile):
    """A file of drops that might be flown next: as flights to be predicted, and how each would be recorded."""

    flight: Annotated[tuple[CandidateTable, ...], AfterValidator(_some)]
