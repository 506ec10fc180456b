"""`Flight` and `Flights`: flights with their records, vehicles and winds."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from pydantic import ValidationError

from bayeschute.api import html
from bayeschute.api.workspace import workspace
from bayeschute.core.errors import Fault, InputError
from bayeschute.records.record import Repair, nearest, repairs
from bayeschute.study.job import load_truth
from bayeschute.study.load import load_vehicle, usual_study
from bayeschute.study.schema.belief_schema import NoiseTable
from bayeschute.study.schema.schema_faults import faults_of
from bayeschute.study.schema.study_schema import FlightTable
from bayeschute.study.schema.vehicle_schema import NOT_FLOWN, Vehicle
from bayeschute.study.schema.wind_schema import ProfileTable
from bayeschute.study.study import Flight as FlightSpec
from bayeschute.study.study import Study as StudySpec

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from bayeschute.api.beliefs import Priors
    from bayeschute.api.views.plausibility import Plausibility


def _vehicle(told: Vehicle | Path | str | None) -> Vehicle | None:
    """A vehicle, read where its file is told."""
    return load_vehicle(told) if isinstance(told, Path | str) else told


def wind_profile(
    altitude: ArrayLike,
    north: ArrayLike,
    east: ArrayLike,
    down: ArrayLike | None = None,
    *,
    units: tuple[str, str] = ("m", "m/s"),
) -> ProfileTable:
    """Wind by altitude; air moves *towards* north, east and down.

    Args:
        altitude: Geometric altitude, increasing (K,) [m].
        north: Velocity of the air to the north (K,) [m/s].
        east: To the east (K,) [m/s].
        down: Downwards (K,) [m/s]; zero where None.
        units: Of altitudes and of velocities, where they differ from these, such as ``("ft", "kt")``.

    Raises:
        InputError: If altitudes don't increase, columns differ in length, or a unit is none of its kind.

    Example:
        >>> import bayeschute as bc
        >>> wind = bc.wind_profile([0.0, 2000.0], [3.0, 6.0], [1.0, -2.0])
        >>> wind.north
        (3.0, 6.0)
    """
    columns = {"altitude": altitude, "north": north, "east": east} | ({} if down is None else {"down": down})
    rows = {name: np.asarray(values, float).ravel() for name, values in columns.items()}
    unit = {name: units[name != "altitude"] for name in rows}
    written = {name: [f"{value!r} {unit[name]}" for value in values.tolist()] for name, values in rows.items()}
    try:
        return ProfileTable.model_validate(written)
    except ValidationError as error:
        raise InputError(faults_of("wind_profile", ProfileTable, error, written)) from None


class Repairs(tuple[Repair, ...]):
    """What was changed in a record; prints a line for each."""

    __slots__ = ()

    def __repr__(self) -> str:
        """A line for each: kind, variable, times on the record's clock, samples, detail."""
        lines = [
            f"{one.kind:13} {one.variable:28} {one.start:10.1f} to {one.end:10.1f} s {one.count:6} samples {one.detail}"
            for one in self
        ]
        return "\n".join(lines) or "nothing was changed"


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Flight:
    """A flight: its record, the vehicle that flew it, the wind it met.

    Attributes:
        spec: The flight's table of the study file.
        study: The study it belongs to; for a single flight, one with the default tables: the risers' priors are about
            the vehicle's values, and `fit` takes the noise from the record (`usual_noise`).
        raw: The record as read, where it does not come from a file.

    Example:
        >>> import bayeschute as bc
        >>> flight = bc.Study.example().flights[0]
        >>> flight.record.sizes["time"] > 100
        True
    """

    spec: FlightSpec
    study: StudySpec
    raw: xr.Dataset | None

    def __init__(
        self,
        record: xr.Dataset,
        vehicle: Vehicle | Path | str | None = None,
        *,
        name: str = "flight",
        wind: ProfileTable | None = None,
        window: tuple[str | float, str | float] | None = None,
        rate: str | float | None = None,
        capsule_mass: str | float | None = None,
        identify_until: str | None = None,
        roles: Sequence[str] = ("structure", "identify"),
        accept_implausible: Sequence[str] = (),
    ) -> None:
        """A flight from a record in memory.

        Args:
            record: From `read_record`.
            vehicle: From `load_vehicle`, or its file; None: a point mass, of which altitude or descent rate is enough.
            name: Its name, which becomes that of files: no slash, no dot first, at most 60 characters.
            wind: From `wind_profile`: how the wind changes with altitude, and the wind itself where none is recorded.
            window: First and last time used, such as ``("5 s", "95 s")``; bare numbers are seconds.
            rate: Sampling rate to which the record is resampled [Hz]; None: that of the record.
            capsule_mass: Replaces the vehicle's [kg].
            identify_until: End of the fitted part, such as ``"75 s"`` or ``"65 %"``; the rest is held out.
            roles: Of ``structure``, ``identify``, ``predict``.
            accept_implausible: Laws of plausibility, or groups of them, that the record may break.

        Raises:
            InputError: If an argument is no quantity of its kind, or a vehicle's file has faults.
        """
        vehicle = _vehicle(vehicle)
        usual = usual_study("cluster" if vehicle is not None else "descent", vehicle)
        spec = FlightSpec(**_fields({
            "name": name, "roles": roles, "wind": wind, "window": window, "rate": rate, "capsule_mass": capsule_mass,
            "identify_until": identify_until, "accept_implausible": accept_implausible,
        }))  # fmt: skip
        self._set(spec, replace(usual, flights=(spec,), vehicle=vehicle, title=name), record)

    def _set(self, spec: FlightSpec, study: StudySpec, raw: xr.Dataset | None) -> None:
        for key, value in (("spec", spec), ("study", study), ("raw", raw)):
            object.__setattr__(self, key, value)

    @classmethod
    def of_study(cls, study: StudySpec, spec: FlightSpec, raw: xr.Dataset | None = None) -> Flight:
        """A flight of a study."""
        made = cls.__new__(cls)
        made._set(spec, study, raw)
        return made

    def changed(self, *, vehicle: Vehicle | Path | str | None = None, **values: Any) -> Flight:
        """The flight with another vehicle, or with other values of the arguments by which a flight is made.

        Args:
            vehicle: From `load_vehicle`, or its file; None: its own.
            **values: ``name``, ``capsule_mass``, ``window``, ``wind``, ``rate``, ``identify_until``, ``roles``,
                ``accept_implausible``, as a flight takes them; ``skip_first``, the time left out at its beginning.

        Raises:
            InputError: If an argument is none of these, or no quantity of its kind; if a vehicle's file has faults, or
                a virtual drop gets a vehicle that has no aerodynamics to fly with.

        Warns:
            UserWarning: If a recorded flight gets another payload: a forecast starts from the record's first seconds.

        Example:
            >>> heavy = study.flights["high"].changed(name="heavy", rate="2 Hz")
            >>> heavy.name, heavy.spec.rate
            ('heavy', 2.0)
        """
        vehicle = _vehicle(vehicle)
        if self.spec.virtual is not None and vehicle is not None and vehicle.aero == NOT_FLOWN:
            raise InputError(
                Fault("vehicle", f"{vehicle.name!r} without [aero]", "one that virtual drops can fly with")
            )
        spec = replace(self.spec, **_fields(values), vehicle=vehicle or self.spec.vehicle)
        made = Flight.of_study(self.study, spec, self.raw)
        before, after = self._payload, made._payload
        if self.spec.virtual is None and before is not None and after is not None and before != after:
            warnings.warn(
                f"flight {self.name!r} was flown with {before:g} kg. A forecast with {after:g} kg starts from the "
                "first seconds of its record, at that descent rate, and takes tens of seconds to come to its "
                "own: judge it from then on, by forecast.between(start, end). check() would compare two payloads.",
                stacklevel=2,
            )
        return made

    @property
    def _payload(self) -> float | None:
        """Mass of the capsule [kg]; None of a point mass."""
        if self.spec.capsule_mass is not None:
            return self.spec.capsule_mass
        return None if self.vehicle is None else self.vehicle.capsule.mass

    @property
    def name(self) -> str:
        """Its name."""
        return self.spec.name

    @property
    def roles(self) -> tuple[str, ...]:
        """Roles of the flight: structure, identify, predict."""
        return self.spec.roles

    @property
    def vehicle(self) -> Vehicle | None:
        """The vehicle that flew it; a payload of the flight's own is in `spec.capsule_mass` [kg], not in this."""
        return self.spec.vehicle or self.study.vehicle

    @property
    def source(self) -> str:
        """Where its record comes from."""
        if self.spec.virtual is not None:
            return "virtual drop"
        return self.spec.path.name if self.spec.path is not None else "in memory"

    @cached_property
    def _prepared(self) -> tuple[xr.Dataset, xr.Dataset | None]:
        from bayeschute.study.run.stage_data import ingest_flight

        with workspace(replace(self.study, flights=_with(self.study.flights, self.spec))) as job:
            record = ingest_flight(job, self.spec, self.raw).load()
            return record, load_truth(job, self.name)

    @property
    def record(self) -> xr.Dataset:
        """Its record: cleaned, uniformly sampled, in SI; `repairs` lists all changes."""
        return self._prepared[0]

    @property
    def truth(self) -> xr.Dataset | None:
        """The truth of a virtual drop; None of a measured flight."""
        return self._prepared[1]

    @property
    def repairs(self) -> Repairs:
        """Samples and variables that were dropped, interpolated, derived or assumed."""
        return Repairs(repairs(self.record))

    @property
    def priors(self) -> Priors:
        """Priors from outside: its study's, or where it has none the commented study's about the vehicle's values.

        They are of risers, apparent mass, moments and constant errors. A fit with another one besides takes
        ``found | flight.priors | bc.Priors.given(...)``, with `found` by `Priors.from_structure`.

        Example:
            >>> "riser_length" in bc.Study.example().flights[0].priors.names
            True
        """
        from bayeschute.api.beliefs import Priors

        return Priors.of_study(self.study)

    def plausibility(self, noise: NoiseTable | None = None) -> Plausibility:
        """What looks wrong about the record's axes, units, signs, clocks and sizes, before anything is fitted.

        Args:
            noise: From `noise`, with which it will be fitted: what is far from what the record shows is told, as by
                `check`; None: that of its study file, or only what the record shows where there is none.

        Example:
            >>> bc.Study.example().flights[0].plausibility().ok
            True
        """
        from bayeschute.api.views.plausibility import Plausibility
        from bayeschute.study.plausible import axes_said, judge, noise_shown, noise_told, window_used
        from bayeschute.study.run.stage_data import as_read

        spec = self.spec
        virtual = spec.virtual is not None
        record = self.record if virtual else (as_read(spec) if self.raw is None else self.raw)
        vehicle = self.vehicle if self.study.model == "cluster" else None
        used = window_used(record, spec.window, spec.skip_first, () if virtual else spec.roles)
        window = None if virtual else (used.start, used.end)
        said = None if virtual else axes_said(record, spec.path, spec.conventions)
        found = judge(record, vehicle, spec.capsule_mass, window, spec.wind_profile, said)
        fitted = "identify" in spec.roles
        if noise is None and fitted and self.study.text:
            noise = self.study.noise
        told = noise_shown(record) if fitted else []
        told = told if noise is None else noise_told(record, noise, vehicle, window)
        return Plausibility(self.name, found, record, spec.accept_implausible, tuple(told))

    def usual_noise(self) -> NoiseTable:
        """Noise to begin with: what `fit` takes for a flight without a study, where no other is given.

        The white part of a channel is the scatter of the record's own samples, the correlated part as many times that
        as in the commented study of `bayeschute init`; breathing goes with the canopies' speed over their diameter.
        Wind and forces are those of that study. These are medians of priors: the fit finds the noise, and moves them by
        a factor of two with ease, not of ten.

        Example:
            >>> noise = bc.Study.example().flights[0].usual_noise()
            >>> 0.1 < noise.canopy_position.white < 0.2  # [m], 0.15 were flown
            True
        """
        from bayeschute.study.plausible import usual_noise
        from bayeschute.study.run.stage_data import as_read

        record = self.record if self.spec.virtual is not None else as_read(self.spec) if self.raw is None else self.raw
        return usual_noise(record, self.study.noise, self.vehicle if self.study.model == "cluster" else None)

    def plot(self) -> Figure:
        """The record over time, one panel a channel; shaded where samples were missing, faulty or excluded."""
        from bayeschute.report.figures.record_figures import record_figure
        from bayeschute.report.tables.record_tables import faults_of

        return record_figure(self.record, faults_of([vars(one) for one in self.repairs]))

    def __repr__(self) -> str:
        """Name, roles and source."""
        return f"Flight({self.name!r}, {'+'.join(self.roles)}, {self.source})"

    def _repr_html_(self) -> str:
        """Channels of the record as a table."""
        record = self.record
        rows = [
            (name, "x".join(map(str, one.shape)), one.attrs.get("units", "1"), one.attrs.get("long_name", ""))
            for name, one in record.data_vars.items()
        ]
        time = record["time"].values
        note = f"{time.size} samples from {time[0]:g} s to {time[-1]:g} s, {len(self.repairs)} repairs"
        return html.table(self.name, ("channel", "shape", "unit", "meaning"), rows, note)


_UNITS = {"window": "s", "rate": "Hz", "capsule_mass": "kg", "skip_first": "s"}  # of plain numbers
_ARGUMENTS = ("name", "roles", "accept_implausible", "wind", *_UNITS, "identify_until")
_LONGEST = 60  # name of a flight, as in a study file


def _fields(given: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a flight's table from arguments of `Flight`: what a study file takes, or plain numbers in SI."""
    unknown = sorted(set(given) - set(_ARGUMENTS))
    if unknown:
        wanted = f"one of {', '.join(_ARGUMENTS)}"
        raise InputError([Fault("flight", name, wanted, nearest(name, _ARGUMENTS)) for name in unknown])
    if not isinstance(given.get("wind"), ProfileTable | None):
        raise InputError(Fault("flight wind", repr(given["wind"])[:60], "a wind by altitude, from bc.wind_profile"))
    if not _is_file_name(given.get("name", "flight")):
        wanted = f"a text of at most {_LONGEST} characters without slashes and control characters, no dot first"
        raise InputError(Fault("flight name", repr(given["name"])[:80], wanted, "It becomes a file name."))
    own = {"wind_profile" if key == "wind" else key: given[key] for key in ("name", "wind") if key in given}
    values = {key: value for key, value in given.items() if key not in ("name", "wind")}
    raw: dict[str, Any] = {"name": "flight", "roles": ("predict",), "file": "record"}
    raw |= {key: _with_unit(value, _UNITS.get(key, "")) for key, value in values.items() if value is not None}
    if not raw.get("accept_implausible"):  # a study file leaves out what names no law
        raw.pop("accept_implausible", None)
    try:
        read = FlightTable.model_validate(raw)
    except ValidationError as error:
        raise InputError(faults_of("flight", FlightTable, error, raw)) from None
    return own | {key: getattr(read, key) if key in raw else value for key, value in values.items()}


def _is_file_name(name: Any) -> bool:
    """Whether records of a flight of this name lie in their folder, each in a file of its own."""
    if not isinstance(name, str) or not 0 < len(name) <= _LONGEST or name.startswith("."):
        return False
    return name.isprintable() and not {"/", "\\"} & set(name)


def _with_unit(value: Any, unit: str) -> Any:
    """Plain numbers as quantities of a study file."""
    if unit and isinstance(value, tuple | list | np.ndarray):
        return tuple(_with_unit(one, unit) for one in value)
    plain = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    return f"{float(value)!r} {unit}" if unit and plain else value


def _with(flights: tuple[FlightSpec, ...], spec: FlightSpec) -> tuple[FlightSpec, ...]:
    """Flights of a study with one that may be a changed one of them, or a new one."""
    names = [flight.name for flight in flights]
    if spec.name not in names:
        return (*flights, spec)
    return tuple(spec if flight.name == spec.name else flight for flight in flights)


def flight_rows(flights: Iterable[Flight]) -> list[tuple[str, str, str]]:
    """Name, roles and source of each flight."""
    return [(f.name, ", ".join(f.roles), f.source) for f in flights]


class Flights(Sequence["Flight"]):
    """The flights of a study, by place or by name.

    Example:
        >>> [flight.name for flight in study.flights]
        ['low', 'high']
    """

    def __init__(self, flights: Sequence[Flight]) -> None:
        """Keep flights in their order."""
        self._flights = tuple(flights)

    def __getitem__(self, key: Any) -> Any:
        """A flight by name or place, or several by a slice."""
        if not isinstance(key, str):
            return self._flights[key]
        for flight in self._flights:
            if flight.name == key:
                return flight
        raise KeyError(f"no flight {key!r}; there are {', '.join(f.name for f in self._flights)}")

    def _ipython_key_completions_(self) -> list[str]:
        """Names, for tab completion."""
        return [flight.name for flight in self._flights]

    def __len__(self) -> int:
        """How many."""
        return len(self._flights)

    def __iter__(self) -> Iterator[Flight]:
        """One after the other."""
        return iter(self._flights)

    def __repr__(self) -> str:
        """Names and roles."""
        return f"Flights({', '.join(f.name for f in self._flights)})"

    def _repr_html_(self) -> str:
        """Names, roles and sources as a table."""
        return html.table("Flights", ("flight", "roles", "record"), flight_rows(self))
