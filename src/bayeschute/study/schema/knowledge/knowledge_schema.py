"""``[[knowledge]]`` of a study: external knowledge of a coefficient or curve (wind tunnel, handbook, program)."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, ValidationInfo, field_validator, model_validator

from bayeschute.aero.curve_names import CURVES
from bayeschute.study.schema.quantities import (
    NOT_NEGATIVE,
    Bounds,
    Label,
    Number,
    PositiveNumber,
    Text,
    number,
    read_quantity,
)
from bayeschute.study.schema.reading.strict import Strict, refuse
from bayeschute.study.schema.sidecar import read_beside
from bayeschute.study.schema.wind_schema import SeriesColumn

MOST_POINTS = 200
_NEAREST = 1e-6  # of two points of a curve [rad or 1]
_WHERE = {"rad": Bounds(least=0.0, most=np.pi / 2), "1": Bounds(least=0.0, most=10.0)}
Sd = Annotated[float, number(NOT_NEGATIVE)]


def _rows(value: Any) -> Any:
    if not isinstance(value, list) or not value or not all(isinstance(row, list) for row in value):
        refuse("a list of points such as [['10 deg', 0.86, 0.03], ['20 deg', 0.84, 0.03]]")
    return tuple(tuple(row) for row in value)


class CurveColumns(Strict):
    """Where a curve stands in its file.

    Attributes:
        at: Column of the angle of attack, or of D_prox.
        value: Column of the coefficient.
        sd: Column of its standard deviation; None: `sd` holds at every point.
    """

    at: SeriesColumn
    value: SeriesColumn
    sd: SeriesColumn | None = None


class KnowledgeTable(Strict):
    """What others know about a coefficient or a curve.

    Attributes:
        name: Unique within the study, for the report.
        source: Where it comes from, in words.
        kind: ``coefficient`` (mean and sd) or ``curve`` (points, a file, or a published set).
        target: The coefficient, such as ``axial[alpha^2]``, or the curve: one of `CURVES`.
        use: ``prior`` multiplies the prior by it; ``compare`` only sets it beside what is found.
        mean: Of a coefficient [1].
        sd: Standard deviation of a coefficient, or of every point of a curve that has none of its own [1].
        common_sd: Standard deviation of an error that all points of a curve share, such as that of a scale [1].
        points: Of a curve: rows of angle (or D_prox), value and, where `sd` is not given, standard deviation.
        file: Of a curve: comma-separated values; path from the study.
        columns: Where the curve stands in the file.
        published: Of a curve: name of a published planar set, such as ``table-7.1-2``.
        samples: What points or file say: rows of angle [rad] or D_prox [1], value, sd [1]; not to be given.
    """

    name: Label
    source: Label
    kind: Literal["coefficient", "curve"]
    target: Text
    use: Literal["prior", "compare"] = "compare"
    mean: Number | None = None
    sd: PositiveNumber | None = None
    common_sd: Sd = 0.0
    points: Annotated[tuple[tuple[Any, ...], ...], BeforeValidator(_rows)] | None = None
    file: Text | None = None
    columns: CurveColumns | None = None
    published: Text | None = None
    samples: tuple[tuple[float, ...], ...] = ()

    @field_validator("samples", mode="before")
    @classmethod
    def _is_not_given(cls, _: Any) -> Any:
        refuse("points or a file", "samples, which come from these")

    @model_validator(mode="after")
    def _is_of_its_kind(self, info: ValidationInfo) -> KnowledgeTable:
        given = {key for key in type(self).model_fields if getattr(self, key) not in (None, ())} & self.model_fields_set
        if self.kind == "coefficient":
            extra = given & {"common_sd", "points", "file", "columns", "published"}
            if extra or not {"mean", "sd"} <= given:
                refuse("mean and sd, and nothing of a curve", ", ".join(sorted(given - {"name", "source"})))
            return self
        if self.target not in CURVES:
            refuse(f"a curve as target: one of {', '.join(CURVES)}", f"target {self.target!r}")
        if "mean" in given:
            refuse("points, a file or a published set", "a mean, which is of a coefficient")
        if len(given & {"points", "file", "published"}) != 1:
            refuse("exactly one of points, file and published", ", ".join(sorted(given)))
        if ("columns" in given) != ("file" in given):
            refuse("columns = { at = ..., value = ... } beside a file, and only there", ", ".join(sorted(given)))
        if self.published is not None:
            if given & {"sd", "common_sd"}:
                refuse("no sd: a published set has its own standard errors", ", ".join(sorted(given)))
            return self
        rows = _of_file(self, info) if self.file is not None else _of_points(self)
        return self.model_copy(update={"samples": _sound(rows)})


def _unit(table: KnowledgeTable) -> str:
    return CURVES[table.target].unit


def _of_points(table: KnowledgeTable) -> list[tuple[float, float, float]]:
    """Rows of what stands in the study itself."""
    made = []
    wide = 2 if table.sd is not None else 3
    for i, row in enumerate(table.points or (), 1):
        if len(row) != wide:
            with_sd = "angle or D_prox, value" + (", sd" if wide == 3 else ": sd holds for all")
            refuse(f"rows of {wide}: {with_sd}", f"{len(row)} entries in point {i}")
        values = [_number(value, f"point {i}") for value in row[1:]]
        made.append((_place(row[0], _unit(table), i), values[0], values[1] if wide == 3 else float(table.sd or 0.0)))
    return made


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e6:
        refuse("numbers for value and sd", f"{str(value)[:40]!r} in {where}")
    return float(value)


def _place(value: Any, unit: str, i: int) -> float:
    """Angle or D_prox of a point, SI."""
    if unit == "1":
        found = _number(value, f"point {i}")
        if not _WHERE[unit].hold(found):
            refuse(f"D_prox {_WHERE[unit].words('')}", f"{found:g} in point {i}")
        return found
    return read_quantity(value, unit, "10 deg", _WHERE[unit])


def _of_file(table: KnowledgeTable, info: ValidationInfo) -> list[tuple[float, float, float]]:
    """Rows of a file."""
    assert table.file is not None and table.columns is not None
    if (table.columns.sd is None) == (table.sd is None):
        refuse("a column of sd, or one sd for all points", "both" if table.sd is not None else "neither")
    c = table.columns
    wanted = {"at": c.at.wanted("at", _unit(table)), "value": c.value.wanted("value", "1")}
    if c.sd is not None:
        wanted["sd"] = c.sd.wanted("sd", "1")
    found = read_beside(table.file, wanted, info)
    sd = found.get("sd", np.full(found["at"].size, table.sd))
    outside = ~np.array([_WHERE[_unit(table)].hold(float(x)) for x in found["at"]])
    if outside.any():
        first = float(found["at"][outside][0])
        refuse(f"{CURVES[table.target].symbol} {_WHERE[_unit(table)].words(_unit(table))}", f"{first:g} in the file")
    return list(zip(*(map(float, part) for part in (found["at"], found["value"], sd)), strict=True))


def _sound(rows: list[tuple[float, float, float]]) -> tuple[tuple[float, ...], ...]:
    """Rows in order of the angle, each place once, with standard deviations above zero."""
    if not 1 <= len(rows) <= MOST_POINTS:
        refuse(
            f"1 to {MOST_POINTS} points",
            f"{len(rows)} of them",
            "Thin the curve out; errors of neighbours hang together.",
        )
    rows = sorted(rows)
    for (x, _, sd), (after, *_) in zip(rows, [*rows[1:], (np.inf,)], strict=True):
        if not sd > 0.0:
            refuse("standard deviations > 0", f"{sd:g} at {x:g}")
        if after - x < _NEAREST:
            refuse("each angle or distance once", f"{x:g} twice")
    return tuple(rows)
