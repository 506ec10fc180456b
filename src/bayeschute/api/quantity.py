"""Quantities as arguments: a text with its unit, or a number in SI."""

from __future__ import annotations

from bayeschute.core.errors import Fault, InputError
from bayeschute.core.units import to_si


def si(where: str, value: str | float, unit: str) -> float:
    """A quantity in SI.

    Args:
        where: The argument, for a fault.
        value: Such as ``"33 ft/s"``, or a number in `unit`.
        unit: The SI unit.

    Raises:
        InputError: If the text is no quantity of that dimension.
    """
    if not isinstance(value, str):
        return float(value)
    try:
        return to_si(value, unit)
    except ValueError as error:
        raise InputError(Fault(where, str(error), f"a quantity convertible to {unit}")) from None
