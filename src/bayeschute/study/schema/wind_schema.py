"""Tables of wind by altitude, and of a virtual drop's wind: by altitude, by time, layers of shear and gusts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, ValidationInfo, model_validator

from bayeschute.core.units import factor_to_si
from bayeschute.study.schema.quantities import (
    HIGHEST,
    LOWEST,
    Altitude,
    NotNegativeTime,
    PositiveLength,
    PositiveTime,
    Speed,
    Text,
)
from bayeschute.study.schema.reading.strict import Strict, refuse, rule
from bayeschute.study.schema.reading.unit_meant import unit_meant
from bayeschute.study.schema.sidecar import Wanted, read_beside

AXES = ("north", "east", "down")
MOST_PARTS, FASTEST = 50, 500.0  # layers or gusts; [m/s]


def _unit(value: Any) -> str:
    if not isinstance(value, str):
        refuse("a unit")
    return value


def _yes_or_no(value: Any) -> bool:
    if not isinstance(value, bool):
        refuse("true or false")
    return value


class SeriesColumn(Strict):
    """Column of a series in a file: its name, and its unit there."""

    column: Text
    unit: Annotated[str, BeforeValidator(_unit)]

    def wanted(self, name: str, si: str) -> Wanted:
        """The column as the reader of files takes it; a unit that can't become `si` is refused.

        Args:
            name: Of the column in the table, for the fault.
            si: SI unit it comes out in.
        """
        try:
            factor_to_si(self.unit, si)
        except ValueError:
            refuse(f"a unit convertible to {si}", f"{name} in {self.unit[:60]!r}", unit_meant(self.unit[:60], si))
        return Wanted(self.column, self.unit, si)


class _WindFile(Strict):
    """Wind along time or altitude, from a file of comma-separated values.

    Attributes:
        file: Path of the file, from the study.
        north: Column of the velocity to the north; None: none.
        east: To the east.
        down: Downwards.
        wind_is: ``towards`` or ``from``, of north and east; None: towards.
        samples: Content of the file: rows of time [s] or altitude [m], upwards, north, east, down [m/s]; not to be
            given.
    """

    ALONG: ClassVar[str]
    UNIT: ClassVar[str]

    file: Text
    north: SeriesColumn | None = None
    east: SeriesColumn | None = None
    down: SeriesColumn | None = None
    wind_is: Literal["towards", "from"] | None = None
    samples: tuple[tuple[float, ...], ...] = ()

    @model_validator(mode="after")
    def _is_read(self, info: ValidationInfo) -> Self:
        along, file = self.ALONG, self.file
        if "samples" in self.model_fields_set:
            refuse(f"file, {along} and columns of the wind", "samples, which come from the file")
        given: dict[str, SeriesColumn] = {axis: column for axis in AXES if (column := getattr(self, axis)) is not None}
        if not given:
            refuse("a column of the wind, such as north = { column = 'w_n', unit = 'm/s' }", "none")
        wanted = {along: getattr(self, along).wanted(along, self.UNIT)}
        wanted |= {axis: column.wanted(axis, "m/s") for axis, column in given.items()}
        found = read_beside(file, wanted, info)
        x = found[along]
        if along == "altitude" and x.size > 1 and x[0] > x[-1]:  # a dropped sonde comes from above
            found = {name: values[::-1] for name, values in found.items()}
            x = found[along]
        back = np.flatnonzero(np.diff(x) <= 0.0)
        if back.size:
            first, second = x[back[0] : back[0] + 2]
            got = f"{first:g} {self.UNIT} followed by {second:g} {self.UNIT} in {file!r}"
            refuse(f"{along}s that increase", got)
        zero = np.zeros_like(x)
        check_winds(found, file)
        if self.wind_is == "from":  # a vertical wind is always told as where the air moves
            found |= {axis: -found[axis] for axis in ("north", "east") if axis in found}
        rows = np.stack([x, *(found.get(axis, zero) for axis in AXES)], axis=1)
        return self.model_copy(update={"samples": tuple(map(tuple, rows.tolist()))})


class HistoryTable(_WindFile):
    """Wind by time, from a file; it adds to the wind by altitude.

    Attributes:
        time: Column of the time since the first sample; constant extrapolation.
    """

    ALONG, UNIT = "time", "s"

    time: SeriesColumn


class ProfileFile(_WindFile):
    """Wind by altitude, from a file with its rows upwards or downwards.

    Attributes:
        altitude: Column of the altitude; constant extrapolation.
    """

    ALONG, UNIT = "altitude", "m"

    altitude: SeriesColumn


def check_winds(found: Mapping[str, NDArray[np.float64]], file: str) -> None:
    """Refuse winds [m/s] and altitudes [m] of a file that no table would be allowed to have."""
    if max(np.abs(values).max() for axis, values in found.items() if axis in AXES) > FASTEST:
        refuse(f"winds up to {FASTEST:g} m/s", f"faster ones in {file!r}", "Is the unit right?")
    if "altitude" in found and not (found["altitude"].min() >= LOWEST and found["altitude"].max() <= HIGHEST):
        refuse(f"altitudes from {LOWEST:g} to {HIGHEST:g} m", f"others in {file!r}", "Is the unit right?")


class LayerTable(Strict):
    """A layer of shear: the wind changes linearly across it, by so much from above it to below.

    Attributes:
        middle: Its altitude [m].
        thickness: [m].
        north: Change to the north [m/s].
        east: To the east [m/s].
        down: Downwards [m/s].
    """

    middle: Altitude
    thickness: PositiveLength
    north: Speed = 0.0
    east: Speed = 0.0
    down: Speed = 0.0


class GustTable(Strict):
    """A gust that comes and goes as one minus a cosine; unknown to the identification.

    Attributes:
        start: After the first sample [s].
        duration: [s].
        north: Largest change to the north [m/s].
        east: To the east [m/s].
        down: Downwards [m/s].
    """

    start: NotNegativeTime
    duration: PositiveTime
    north: Speed = 0.0
    east: Speed = 0.0
    down: Speed = 0.0


class _ByAltitude(Strict):
    """Wind by altitude, in the table itself or in a file; the air moves towards north, east and down.

    Attributes:
        altitude: Increasing; constant extrapolation [m].
        north: [m/s].
        east: [m/s].
        down: [m/s]; None: none.
        profile: The same from a file; None: from the table itself.
    """

    altitude: tuple[Altitude, ...] = ()
    north: tuple[Speed, ...] = ()
    east: tuple[Speed, ...] = ()
    down: tuple[Speed, ...] | None = None
    profile: ProfileFile | None = None

    @rule
    def _is_given_once(self) -> None:
        sizes = [len(self.altitude), len(self.north), len(self.east)]
        if len(set(sizes)) > 1:
            got = "altitude, north and east of {}, {} and {} values".format(*sizes)
            refuse("as many winds as altitudes", got)
        if self.down is not None and len(self.down) != sizes[0]:
            refuse("as many winds as altitudes", f"altitude and down of {sizes[0]} and {len(self.down)} values")
        if any(b <= a for a, b in zip(self.altitude, self.altitude[1:], strict=False)):
            refuse("altitudes that increase", "altitudes that don't increase")
        if self.altitude and self.profile:
            refuse("altitude, north and east, or a profile", "both", "Remove one of them.")


class ProfileTable(_ByAltitude):
    """Wind by altitude alone."""

    @rule
    def _is_by_altitude(self) -> None:
        if not (self.altitude or self.profile):
            refuse("altitude, north and east, or a profile", "no wind")

    @property
    def is_read(self) -> bool:
        """Whether it has rows: a table whose file or columns have faults has none, or columns of several lengths."""
        if self.profile is not None:
            return bool(self.profile.samples)
        return 0 < len(self.altitude) == len(self.north) == len(self.east) == len(self.down or self.altitude)

    def rows(self) -> NDArray[np.float64]:
        """Rows of altitude [m], north, east, down [m/s], upwards (K, 4)."""
        if self.profile is not None:
            return np.array(self.profile.samples)
        down = self.down or (0.0,) * len(self.altitude)
        return np.stack([self.altitude, self.north, self.east, down], axis=1)


class WindTable(_ByAltitude):
    """Wind of a virtual drop; all parts add up.

    Attributes:
        history: Wind by time; None: none.
        layer: Layers of shear.
        gust: Gusts.
        every_body: Whether the wind at capsule and canopies is that at their altitudes; otherwise all have the
            capsule's.
    """

    history: HistoryTable | None = None
    layer: tuple[LayerTable, ...] = ()
    gust: tuple[GustTable, ...] = ()
    every_body: Annotated[bool, BeforeValidator(_yes_or_no)] = False

    @rule
    def _is_a_table(self) -> None:
        if max(len(self.layer), len(self.gust)) > MOST_PARTS:
            refuse(f"up to {MOST_PARTS} layers and as many gusts", f"{len(self.layer)} and {len(self.gust)}")
        if not (self.altitude or self.profile or self.history or self.layer or self.gust):
            refuse("altitude, north and east; or a profile, a history, a layer or a gust", "no wind")
