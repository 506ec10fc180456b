"""Table of a capsule's aerodynamics by total angle of attack and roll, `[capsule.table]` of a vehicle file."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, ValidationInfo, model_validator

from bayeschute.aero.capsule_grid import COEFFICIENTS, grid_faults
from bayeschute.core.units import factor_to_si
from bayeschute.study.schema.quantities import Azimuth, Number, Text
from bayeschute.study.schema.reading.strict import Strict, refuse
from bayeschute.study.schema.sidecar import Wanted, read_beside, refuse_all


def _angle_unit(value: Any) -> str:
    try:
        if isinstance(value, str):
            factor_to_si(value, "rad")
            return value
    except ValueError:
        pass
    refuse("a unit of angles, 'deg' or 'rad'")


Rows = tuple[tuple[Number, ...], ...]
AngleUnit = Annotated[str, BeforeValidator(_angle_unit)]


class CapsuleAeroTable(Strict):
    """Coefficients of a capsule in body axes (6.3.3-11, -12), in the file itself or in one of comma-separated values.

    In the file itself, a coefficient has one row for each total angle of attack, with one number for each roll. A file
    of values has the columns ``total_angle``, ``roll`` and those coefficients that aren't zero, one row for each pair.

    Attributes:
        file: Path of the file of values, from the vehicle file.
        angle_unit: Unit of its angles.
        total_angle: Increasing, within 0 and 180 deg [rad].
        roll: A whole turn in even steps without its end, or 0 alone for a body of revolution [rad].
        C_A: Against the body's x axis.
        C_Y: Along y.
        C_N: Against z.
        C_l: Moment about x.
        C_m: Moment about y.
        C_n: Moment about z.
    """

    file: Text | None = None
    angle_unit: AngleUnit | None = None
    total_angle: tuple[Azimuth, ...] = ()
    roll: tuple[Azimuth, ...] = ()
    C_A: Rows | None = None
    C_Y: Rows | None = None
    C_N: Rows | None = None
    C_l: Rows | None = None
    C_m: Rows | None = None
    C_n: Rows | None = None

    @model_validator(mode="after")
    def _is_a_grid(self, info: ValidationInfo) -> CapsuleAeroTable:
        read = self
        if self.file is not None:
            own = self.model_fields_set - {"file", "angle_unit"}
            if own or self.angle_unit is None:
                wanted = "file and angle_unit alone, or total_angle, roll and coefficients"
                refuse(wanted, ", ".join(sorted(own)) or "file without angle_unit")
            read = self.model_copy(update=_from_file(self.file, self.angle_unit, info))
        elif self.angle_unit is not None:
            refuse("angle_unit only together with file: other angles carry their unit", "angle_unit without file")
        ragged = [name for name, rows in read.given().items() if len({len(row) for row in rows}) > 1]
        if ragged:
            refuse("rows of equal length", f"rows of different lengths in {', '.join(ragged)}")
        faults = grid_faults(np.array(read.total_angle), np.array(read.roll), read.arrays(), "the table's")
        if faults:
            refuse_all(faults)
        return read

    def given(self) -> dict[str, Rows]:
        """Rows of the coefficients that are given."""
        return {name: rows for name in COEFFICIENTS if (rows := getattr(self, name)) is not None}

    def arrays(self) -> dict[str, np.ndarray]:
        """The same as arrays (K, R)."""
        return {name: np.array(rows, float).reshape(len(rows), -1) for name, rows in self.given().items()}


def _from_file(name: str, unit: str, info: ValidationInfo) -> dict[str, Any]:
    """Fields of a grid from a file of values with one row for each pair of angles."""
    angles = {key: Wanted(key, unit, "rad") for key in ("total_angle", "roll")}
    found = read_beside(name, angles | {key: Wanted(key, "", "", True) for key in COEFFICIENTS}, info)
    total, row = np.unique(found["total_angle"], return_inverse=True)
    roll, column = np.unique(found["roll"], return_inverse=True)
    times = np.zeros((total.size, roll.size), int)
    np.add.at(times, (row, column), 1)
    if (times != 1).any():
        i, j = np.argwhere(times != 1)[0]
        pair = f"total_angle {np.rad2deg(total[i]):g} deg, roll {np.rad2deg(roll[j]):g} deg"
        refuse("every pair of the file's angles once", f"{pair} {times[i, j]} times in {name!r}")
    fields: dict[str, Any] = {"total_angle": tuple(total.tolist()), "roll": tuple(roll.tolist())}
    for key in COEFFICIENTS:
        if key in found:
            grid = np.zeros(times.shape)
            grid[row, column] = found[key]
            fields[key] = tuple(map(tuple, grid.tolist()))
    return fields
