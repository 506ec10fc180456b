"""Tables of a campaign file: winds by month, and their statistics by altitude. Nothing here imports JAX."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, ValidationInfo, field_validator, model_validator

from bayeschute.core.errors import Fault
from bayeschute.study.schema.quantities import Altitude, Bounds, PositiveLength, Speed, Text, number, quantity
from bayeschute.study.schema.reading.strict import Strict, refuse
from bayeschute.study.schema.sidecar import MONTH, Wanted, read_beside, refuse_all
from bayeschute.study.schema.wind_schema import FASTEST, SeriesColumn, check_winds

Array = NDArray[np.float64]
Rows = tuple[tuple[float, ...], ...]
_YEAR = range(1, 13)


def _months(value: Any) -> tuple[int, ...]:
    """Months of a list, or a single one."""
    given = value if isinstance(value, list | tuple) else [value]
    numbers = [month for month in given if isinstance(month, int) and not isinstance(month, bool) and month in _YEAR]
    if not given or len(numbers) < len(given) or len(set(numbers)) < len(numbers):
        refuse("months from 1 to 12, each once, such as [6, 7, 8]")
    return tuple(numbers)


Months = Annotated[tuple[int, ...], BeforeValidator(_months)]
_Correlation = Annotated[float, number(Bounds(least=-0.999, most=0.999), "a correlation")]
_Spread = Annotated[float, quantity("m/s", "2 ft/s", Bounds(least=0.0, most=FASTEST))]


class ByMonth(Strict):
    """A file of comma-separated values some of whose rows are of months that are wanted.

    Attributes:
        file: Path of the file, from the campaign.
        month: Name of its column of months (1 to 12) or dates; None: none.
        months: Those that are wanted; none: all that the file has.
    """

    file: Text
    month: Text | None = None
    months: Months = ()

    @field_validator("months", mode="after")
    @classmethod
    def _has_a_column(cls, value: tuple[int, ...], info: ValidationInfo) -> tuple[int, ...]:
        if value and info.data.get("month", "") is None:
            refuse("months beside the name of their column, such as month = 'month'", "months without month")
        return value

    def wanted_months(self) -> dict[str, Wanted]:
        """The column of months as the reader of files takes it; nothing where there is none."""
        return {} if self.month is None else {"month": Wanted(self.month, MONTH, MONTH)}

    def picked(self, found: Array) -> tuple[tuple[int, ...], list[Fault]]:
        """Months whose rows are taken, of those of the file (T,), and the fault of those that it lacks."""
        held = sorted({int(month) for month in found})
        lacking = [month for month in self.months if month not in held]
        if lacking:
            got = f"no row of month {', '.join(map(str, lacking))}; it has {', '.join(map(str, held))}"
            return (), [Fault(self.file, got, "rows of every month in months")]
        return self.months or tuple(held), []


class StatisticsFile(ByMonth):
    """Mean and standard deviation of the wind by altitude, and by month, in a file of comma-separated values.

    Rows of a month go upwards or downwards.

    Attributes:
        altitude: Column of the altitude.
        north: Column of the mean velocity to the north.
        east: To the east.
        north_sd: Column of the standard deviation of the velocity to the north.
        east_sd: To the east.
        correlation: Name of the column of the correlation of both; None: none.
        found: What the file says: for each month its number (0: none) and a table of altitude, north, east, north_sd,
            east_sd [SI], correlation; not to be given.
    """

    COLUMNS: ClassVar = {"altitude": "m", "north": "m/s", "east": "m/s", "north_sd": "m/s", "east_sd": "m/s"}

    altitude: SeriesColumn
    north: SeriesColumn
    east: SeriesColumn
    north_sd: SeriesColumn
    east_sd: SeriesColumn
    correlation: Text | None = None
    found: tuple[tuple[int, Rows], ...] = ()

    @model_validator(mode="after")
    def _is_read(self, info: ValidationInfo) -> StatisticsFile:
        if "found" in self.model_fields_set:
            refuse("file, altitude and columns of the statistics", "found, which comes from the file")
        wanted = {name: getattr(self, name).wanted(name, si) for name, si in self.COLUMNS.items()}
        wanted |= {} if self.correlation is None else {"correlation": Wanted(self.correlation, "1", "")}
        found = read_beside(self.file, wanted | self.wanted_months(), info)
        check_winds(found, self.file)
        of = found.get("month", np.zeros(len(found["altitude"])))
        months, faults = self.picked(of)
        faults += self._out_of_bounds(found)
        made = []
        for month in months:
            here = of == month
            columns = [found[name][here] for name in self.COLUMNS]
            rows = np.stack([*columns, found["correlation"][here] if self.correlation else 0.0 * columns[0]], axis=1)
            rows = rows[::-1] if rows[0, 0] > rows[-1, 0] else rows
            back = np.flatnonzero(np.diff(rows[:, 0]) <= 0.0)
            if back.size:
                first, second = rows[back[0] : back[0] + 2, 0]
                got = f"{first:g} m followed by {second:g} m" + (f" in month {month}" if self.month else "")
                faults.append(Fault(self.file, got, "altitudes that increase"))
            made.append((month, tuple(map(tuple, rows.tolist()))))
        if faults:
            refuse_all(faults)
        return self.model_copy(update={"found": tuple(made)})

    def _out_of_bounds(self, found: dict[str, Array]) -> list[Fault]:
        """Faults of standard deviations and correlations that can't be."""
        faults = []
        for name in ("north_sd", "east_sd"):
            least, most = found[name].min(), found[name].max()
            if not (least >= 0.0 and most <= FASTEST):
                where = f"{self.file} column {getattr(self, name).column!r}"
                got = f"{least if least < 0.0 else most:g} m/s"
                faults.append(Fault(where, got, f"standard deviations from 0 to {FASTEST:g} m/s", "Is the unit right?"))
        worst = np.abs(found["correlation"]).max() if self.correlation else 0.0
        if worst > 0.999:
            where = f"{self.file} column {self.correlation!r}"
            faults.append(Fault(where, f"one of size {worst:g}", "correlations between -0.999 and 0.999"))
        return faults


class ClimatologyTable(Strict):
    """Mean and scatter of the wind by altitude, from the table itself or from a file; see `landing.climatology`.

    Attributes:
        length: Of the wind's correlation in altitude [m].
        altitude: Increasing; constant extrapolation [m].
        north: Mean velocity to the north [m/s].
        east: To the east [m/s].
        north_sd: Standard deviation of the velocity to the north [m/s].
        east_sd: To the east [m/s].
        correlation: Of both [1]; none: 0.
        statistics: The same from a file, by month; None: from the table itself.
    """

    length: PositiveLength
    altitude: tuple[Altitude, ...] = ()
    north: tuple[Speed, ...] = ()
    east: tuple[Speed, ...] = ()
    north_sd: tuple[_Spread, ...] = ()
    east_sd: tuple[_Spread, ...] = ()
    correlation: tuple[_Correlation, ...] = ()
    statistics: StatisticsFile | None = None

    @model_validator(mode="after")
    def _is_given_once(self) -> ClimatologyTable:
        faults = []
        names = [*StatisticsFile.COLUMNS, *(("correlation",) if self.correlation else ())]
        sizes = {name: len(getattr(self, name)) for name in names}
        if len(set(sizes.values())) > 1:
            got = ", ".join(f"{size} of {name}" for name, size in sizes.items())
            faults.append(("as many values of each as altitudes", got))
        if any(b <= a for a, b in zip(self.altitude, self.altitude[1:], strict=False)):
            faults.append(("altitudes that increase", "altitudes that don't increase"))
        if bool(any(sizes.values())) == (self.statistics is not None):
            got = "both" if self.statistics is not None else "neither"
            faults.append(("altitude, north, east and their standard deviations, or statistics", got))
        if faults:
            refuse("; ".join(wanted for wanted, _ in faults), "; ".join(got for _, got in faults))
        return self

    def rows(self) -> list[tuple[int, Array]]:
        """For each month its number (0: none) and rows as of `StatisticsFile.found` (K, 6)."""
        if self.statistics is not None:
            return [(month, np.array(rows)) for month, rows in self.statistics.found]
        columns = [np.array(getattr(self, name)) for name in StatisticsFile.COLUMNS]
        return [(0, np.stack([*columns, np.array(self.correlation) if self.correlation else 0.0 * columns[0]], axis=1))]
