"""Arguments of the door: quantities as text with their unit or as numbers in SI, and levels of intervals."""

from __future__ import annotations

from bayeschute.core.errors import Fault, InputError
from bayeschute.core.units import to_si
from bayeschute.study.schema.reading.unit_meant import unit_meant


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
        raise InputError(
            Fault(where, str(error), f"a quantity convertible to {unit}", unit_meant(value, unit))
        ) from None


def central(level: float) -> tuple[float, float, float]:
    """Probabilities of the lower end, the median and the upper end of a central interval.

    Args:
        level: Probability in the interval [1].

    Raises:
        InputError: If it is none.
    """
    if not 0.0 < level < 1.0:
        raise InputError(Fault("level", repr(level), "a probability between 0 and 1"))
    return 0.5 - 0.5 * level, 0.5, 0.5 + 0.5 * level
