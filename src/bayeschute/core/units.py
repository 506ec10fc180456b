"""Quantities with units, converted to SI where they enter."""

from __future__ import annotations

import math
import re
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pint import Unit, UnitRegistry

# Nothing else reaches pint, whose parser evaluates powers of any size.
_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,4})?)\s*(.*?)\s*", re.ASCII)
_UNIT = re.compile(r"(?:[A-Za-z_µμ°Ω%]+[0-9]?|\^-?[1-9]|\*\*-?[1-9]|[ */().]|1(?= ?/))+")
_LONGEST = 60
_SIGNS = str.maketrans({"²": "^2", "³": "^3", "·": "*"})
_OF_THE_TRADE = (
    "psf = pound_force / foot ** 2", "lbm = pound", "fpm = foot / minute", "kmh = kilometer / hour",
    "kmph = kilometer / hour",  # pint takes it for a thousand miles per hour
)  # fmt: skip


@cache
def registry() -> UnitRegistry:
    """The one pint registry of the package (built on first use: it is slow to make)."""
    import pint

    units: UnitRegistry = pint.UnitRegistry(autoconvert_offset_to_baseunit=True)
    for definition in _OF_THE_TRADE:
        units.define(definition)
    return units


@cache
def _unit(text: str) -> Unit:
    """A unit from its name; ``""`` and ``"1"`` are the unit of pure numbers.

    Raises:
        ValueError: If the text names no unit.
    """
    text = text.strip().replace("⁻¹", "^-1").replace("⁻²", "^-2").translate(_SIGNS)
    if text in ("", "1"):
        return registry().Unit("")
    if len(text) > _LONGEST or not _UNIT.fullmatch(text):
        raise ValueError(f"{text!r} is no unit")
    try:
        return registry().parse_units("degree" if text == "°" else text)
    except _not_a_unit() as error:
        raise ValueError(f"{text!r} is no unit") from error


@cache
def _not_a_unit() -> tuple[type[Exception], ...]:
    """Exceptions of pint's parser on text that is no unit."""
    from tokenize import TokenError

    from pint import PintError

    lapses = (ArithmeticError, AssertionError, AttributeError, LookupError, SyntaxError, TypeError, ValueError)
    return (PintError, TokenError, *lapses)


@cache
def _turns(unit: Unit) -> float:
    """Power of the radian in a unit: pint takes it for a pure number, a reader does not."""
    roots = registry().Quantity(1.0, unit).to_root_units()
    return sum(float(str(power)) for name, power in roots.unit_items() if name == "radian")


def _is_counted_in(unit: Unit, wanted: Unit) -> bool:
    """Whether a quantity in `unit` can be converted to `wanted` without ambiguity."""
    return unit.is_compatible_with(wanted) and _turns(unit) == _turns(wanted)


def to_si(text: str, unit: str) -> float:
    """Read a quantity and convert it to an SI unit.

    Angles are distinguished from pure numbers: ``"0.3"`` is no angle, and ``"0.2 Hz"`` no rate of turn.

    Args:
        text: Number and unit, e.g. ``"116 ft"``; ``"0.7"`` or ``"70 %"`` where `unit` is ``""``.
        unit: The SI unit wanted, e.g. ``"m"``; ``""`` for a pure number.

    Returns:
        The magnitude in `unit`; finite.

    Raises:
        ValueError: If the text is no quantity or has another dimension; the message says what was wanted.
    """
    wanted = f"a quantity convertible to {unit or 'a pure number'}"
    parts = _QUANTITY.fullmatch(text) if len(text) <= 2 * _LONGEST else None
    if parts is None:
        raise ValueError(f"{text[: 2 * _LONGEST]!r} is not a quantity; wanted {wanted}")
    if not parts[2] and _unit(unit) != _unit(""):
        raise ValueError(f"{text!r} has no unit; wanted {wanted}, for example '{parts[1]} {unit}'")
    try:
        given = _unit(parts[2])
    except ValueError as error:
        raise ValueError(f"{text!r} has no known unit; wanted {wanted}") from error
    if not _is_counted_in(given, _unit(unit)):
        raise ValueError(f"{text!r} is in {parts[2] or 'no unit'}; wanted {wanted}")
    value = float(registry().Quantity(float(parts[1]), given).to(_unit(unit)).magnitude)
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is not a finite number; wanted {wanted}")
    return value


def factor_to_si(unit: str, si: str) -> tuple[float, float]:
    """Scale and offset that take a column in `unit` to `si`: ``value_si = scale * value + offset``.

    Raises:
        ValueError: If `unit` is no unit or has another dimension than `si`.
    """
    zero = to_si(f"0 {unit}", si)
    return to_si(f"1 {unit}", si) - zero, zero
