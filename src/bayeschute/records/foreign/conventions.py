"""What a column map can't say by names and units: axes, senses and clocks of a record."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.errors import Fault

Array = NDArray[np.float64]

DIRECTIONS = {  # of earth axes: axis of the schema (north, east, down) and sign
    "N": (0, 1.0),
    "S": (0, -1.0),
    "E": (1, 1.0),
    "W": (1, -1.0),
    "D": (2, 1.0),
    "U": (2, -1.0),
}
SENSES = ("body to earth", "earth to body")
WINDS = ("towards", "from")
REPEATED = ("first", "last", "mean")
ORDERS = ("xyz", "xzy", "yxz", "yzx", "zxy", "zyx")
_SIGNED = re.compile(r"\s*([+-]?)([xyz])[\s,]+([+-]?)([xyz])[\s,]+([+-]?)([xyz])\s*")


@dataclass(frozen=True)
class Conventions:
    """How a record is to be read; the defaults are those of the schema.

    Attributes:
        axes: Earth axes of the attitude and of columns named x, y, z: three of N S E W U D, such as ``ENU``.
        body_axes: The vehicle's x, y, z in terms of the record's body axes, such as ``-z y x``.
        attitude: What the attitude turns into what: ``body to earth`` (components in body axes into those in earth
            axes) or its inverse, ``earth to body``.
        euler: Order of yaw (about z), pitch (about y) and roll (about x), each about axes turned by those before.
        wind_is: Whether winds are told as where the air moves ``towards`` or comes ``from``; None: not said.
        repeated_times: Which of several rows of one time is kept: ``first``, ``last`` or their ``mean``; None: refused.
        sort_times: Whether rows are put in the order of time.
        clock_wraps: After how long the clock begins at zero again [s]; None: it does not.
        lacks: Components that the record has no column for, such as ``capsule_rate.y``.
    """

    axes: str = "NED"
    body_axes: str = "x y z"
    attitude: str = "body to earth"
    euler: str = "zyx"
    wind_is: str | None = None
    repeated_times: str | None = None
    sort_times: bool = False
    clock_wraps: float | None = None
    lacks: tuple[str, ...] = ()

    def earth(self) -> Array:
        """Takes components along the record's earth axes into NED (3, 3)."""
        matrix = np.zeros((3, 3))
        for column, letter in enumerate(self.axes):
            row, sign = DIRECTIONS[letter]
            matrix[row, column] = sign
        return matrix

    def body(self) -> Array:
        """Takes components along the record's body axes into the vehicle's (3, 3)."""
        found = _SIGNED.fullmatch(self.body_axes)
        assert found is not None, "checked by convention_faults"
        matrix = np.zeros((3, 3))
        for row, (sign, letter) in enumerate(zip(found.groups()[::2], found.groups()[1::2], strict=True)):
            matrix[row, "xyz".index(letter)] = -1.0 if sign == "-" else 1.0
        return matrix


USUAL = Conventions()
"""Those of the schema."""


def convention_faults(said: Conventions, where: str) -> list[Fault]:
    """Faults of conventions by themselves.

    Args:
        said: The conventions.
        where: Place for messages.
    """
    faults = []
    letters = said.axes
    if len(letters) != 3 or {DIRECTIONS[c][0] for c in letters if c in DIRECTIONS} != {0, 1, 2}:
        wanted = "one of N or S, one of E or W, one of U or D, in the order of the axes"
        faults.append(Fault(f"{where} axes", repr(letters)[:60], wanted, "For example 'NED', 'ENU' or 'NWU'."))
    found = _SIGNED.fullmatch(said.body_axes)
    if found is None or len(set(found.groups()[1::2])) < 3:
        wanted = "the vehicle's x, y and z in terms of the record's, such as '-z y x'"
        faults.append(Fault(f"{where} body_axes", repr(said.body_axes)[:60], wanted))
    elif np.linalg.det(said.body()) < 0.0:
        do = "Mind the signs."
        faults.append(Fault(f"{where} body_axes", repr(said.body_axes), "axes that make a right-handed system", do))
    for key, value, known in (
        ("attitude", said.attitude, SENSES),
        ("euler", said.euler, ORDERS),
        ("wind_is", said.wind_is or WINDS[0], WINDS),
        ("repeated_times", said.repeated_times or REPEATED[0], REPEATED),
    ):
        if value not in known:
            faults.append(Fault(f"{where} {key}", repr(value)[:60], f"one of {', '.join(known)}"))
    if said.clock_wraps is not None and not said.clock_wraps > 0.0:
        faults.append(Fault(f"{where} clock_wraps", f"{said.clock_wraps:g} s", "a positive time, such as 604800 s"))
    return faults
