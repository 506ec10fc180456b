"""Types of the values in study and vehicle files: quantities with units become SI numbers, bounds are told in words."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, TypeVar

from pydantic import AfterValidator, BeforeValidator, ValidationInfo, field_validator

from bayeschute.core.units import to_si
from bayeschute.study.schema.reading.strict import Strict, refuse, rule
from bayeschute.study.schema.reading.unit_meant import unit_meant

Terms = TypeVar("Terms", bound=Iterable[str])


def each(check: Callable[[str], str | None], wanted: str, none: str = "") -> AfterValidator:
    """Validator of terms in a list or of a table's keys, with the faults of all in one.

    Args:
        check: Gives the fault of a term, None where it is sound.
        wanted: What would be accepted.
        none: Fault of an empty list; empty where that is allowed.
    """

    def checked(terms: Terms) -> Terms:
        faults = [fault for term in terms if (fault := check(term))]
        if got := "; ".join(faults) or (none if not terms else ""):
            refuse(wanted, got)
        return terms

    return AfterValidator(checked)


@dataclass(frozen=True)
class Bounds:
    """Range of an SI number, with open or closed ends.

    Attributes:
        above: The number must be greater than this.
        least: The number must be at least this.
        most: The number must be at most this.
    """

    above: float = -math.inf
    least: float = -math.inf
    most: float = math.inf

    def hold(self, value: float) -> bool:
        """Whether a number lies within."""
        return self.above < value and self.least <= value <= self.most

    def words(self, unit: str) -> str:
        """The range in words, e.g. ``"> 0 m"``."""
        parts = ((">", self.above), (">=", self.least), ("<=", self.most))
        return " and ".join(f"{sign} {end:g} {unit}".rstrip() for sign, end in parts if math.isfinite(end))


POSITIVE = Bounds(above=0.0)
NOT_NEGATIVE = Bounds(least=0.0)


def read_quantity(value: Any, unit: str, example: str, bounds: Bounds = Bounds()) -> float:
    """A quantity of a file in SI.

    Args:
        value: The value in the file, which should be a string with a unit.
        unit: SI unit, e.g. ``"m"``.
        example: An example, e.g. ``"116 ft"``.
        bounds: Range in SI.

    Returns:
        The magnitude in `unit`.

    Raises:
        PydanticCustomError: With what was wanted and an example.
    """
    span = bounds.words(unit)
    wanted = f"a quantity in {unit} or convertible to it{f', {span}' if span else ''}, such as {example!r}"
    if isinstance(value, int | float) and not isinstance(value, bool):
        likely = f"{value:g} {unit}" if abs(value) < 1e100 else example
        refuse(wanted, "a bare number", f"Write it as a string with its unit, like '{likely}'.")
    if not isinstance(value, str):
        refuse(wanted)
    try:
        number_si = to_si(value, unit)
    except ValueError:
        refuse(wanted, do=unit_meant(value, unit))
    if not bounds.hold(number_si):
        refuse(wanted)
    return number_si


class Limited(Strict):
    """A table whose ``quantity`` has one limit, ``at_most`` or ``at_least``, read in the unit of that quantity.

    Attributes:
        UNITS_OF: SI unit and an example of a limit, by quantity.
    """

    UNITS_OF: ClassVar[Mapping[str, tuple[str, str]]]

    @field_validator("at_most", "at_least", mode="before", check_fields=False)
    @classmethod
    def _is_of_the_quantity(cls, value: object, info: ValidationInfo) -> object:
        """An unknown quantity has its own fault."""
        known = info.data.get("quantity")
        return read_quantity(value, *cls.UNITS_OF[known]) if known else None

    @rule
    def _has_one_limit(self) -> None:
        given = [name for name in ("at_most", "at_least") if getattr(self, name) is not None]
        if len(given) != 1:
            refuse("exactly one of at_most and at_least", "both" if given else "neither")


def quantity(unit: str, example: str, bounds: Bounds = Bounds()) -> BeforeValidator:
    """Validator of a quantity, see `read_quantity`."""
    return BeforeValidator(lambda value: read_quantity(value, unit, example, bounds))


def number(bounds: Bounds = Bounds(), what: str = "a number") -> BeforeValidator:
    """Validator of a pure number: no string, no boolean, finite."""
    span = bounds.words("")
    wanted = f"{what} {span}".rstrip()

    def check(value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            refuse(wanted)
        if not abs(value) <= 1e100 or not bounds.hold(value):  # also true of NaN
            refuse(wanted)
        return float(value)

    return BeforeValidator(check)


def whole(least: int, most: int) -> BeforeValidator:
    """Validator of a whole number within ends."""

    def check(value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
            refuse(f"a whole number from {least} to {most}")
        return value

    return BeforeValidator(check)


def one_of(*words: str) -> BeforeValidator:
    """Validator of a word from a list."""

    def check(value: Any) -> str:
        if not isinstance(value, str) or value not in words:
            refuse("one of " + ", ".join(repr(word) for word in words))
        return value

    return BeforeValidator(check)


def _text(value: Any) -> str:
    if not isinstance(value, str) or not value.strip() or len(value) > 500 or not value.isprintable():
        refuse("a short text")
    return value


def _label(value: Any) -> str:
    if _text(value)[0] in "=+-@":
        refuse("a short text that begins with none of = + - @", do="In a spreadsheet it would be a formula.")
    return str(value)


def _name(value: Any) -> str:
    if not isinstance(value, str) or not value or len(value) > 60 or not all(c.isalnum() or c in "-_." for c in value):
        refuse("a name of letters, digits, '-', '_' and '.'", do="It becomes a file name.")
    if value.startswith("."):
        refuse("a name that does not begin with a dot", do="It becomes a file name.")
    return value


@dataclass(frozen=True)
class Cut:
    """Time that splits a record in two: a share of its window or a time of the record.

    Attributes:
        share: Share of the window [1]; None where a time is given.
        time: Time of the record [s]; None where a share is given.
    """

    share: float | None = None
    time: float | None = None

    def at(self, start: float, end: float) -> float:
        """Time of the cut [s] in a window from `start` to `end` [s]."""
        return self.time if self.time is not None else start + (self.share or 0.0) * (end - start)


def _cut(value: Any) -> Cut:
    wanted = "a share of the window between 0 and 100 % such as '65 %', or a time of the record such as '58 s'"
    if not isinstance(value, str):
        refuse(wanted)
    try:
        if "%" not in value:
            return Cut(time=to_si(value, "s"))
        share = to_si(value, "")
    except ValueError:
        refuse(wanted)
    if not 0.0 < share < 1.0:
        refuse(wanted)
    return Cut(share=share)


def _sigmas(value: Any) -> float:
    wanted = "a multiple of the residual variance such as '25 sigma^2'"
    if not isinstance(value, str) or not value.endswith("sigma^2"):
        refuse(wanted)
    try:
        factor = to_si(value.removesuffix("sigma^2").strip() or "1", "")
    except ValueError:
        refuse(wanted)
    if not 0.0 < factor <= 1e6:
        refuse(wanted)
    return factor


LOWEST, HIGHEST = -1000.0, 80_000.0  # altitudes [m]

Text = Annotated[str, BeforeValidator(_text)]
Label = Annotated[str, BeforeValidator(_label)]
Name = Annotated[str, BeforeValidator(_name)]
Number = Annotated[float, number()]
PositiveNumber = Annotated[float, number(POSITIVE)]
Fraction = Annotated[float, number(Bounds(least=0.0, most=0.95))]

Length = Annotated[float, quantity("m", "116 ft")]
PositiveLength = Annotated[float, quantity("m", "116 ft", POSITIVE)]
Altitude = Annotated[float, quantity("m", "6500 ft", Bounds(least=LOWEST, most=HIGHEST))]
NoiseLength = Annotated[float, quantity("m", "0.15 m", NOT_NEGATIVE)]
Area = Annotated[float, quantity("m^2", "213.8 ft^2", POSITIVE)]
Volume = Annotated[float, quantity("m^3", "140164 ft^3", NOT_NEGATIVE)]
Mass = Annotated[float, quantity("kg", "648.44 slug", POSITIVE)]
InertiaProduct = Annotated[float, quantity("kg m^2", "250 kg m^2")]
Inertia = Annotated[float, quantity("kg m^2", "25000 kg m^2", POSITIVE)]
PositiveForce = Annotated[float, quantity("N", "50 lbf", POSITIVE)]
NoiseForce = Annotated[float, quantity("N", "50 lbf", NOT_NEGATIVE)]
Stiffness = Annotated[float, quantity("N/m", "15000 lbf/ft", POSITIVE)]
Damping = Annotated[float, quantity("N s/m", "10000 lbf s/ft", POSITIVE)]
AreaPerMass = Annotated[float, quantity("m^2/kg", "0.15 m^2/kg", POSITIVE)]

Time = Annotated[float, quantity("s", "10 s")]
PositiveTime = Annotated[float, quantity("s", "2 s", POSITIVE)]
NotNegativeTime = Annotated[float, quantity("s", "20 s", NOT_NEGATIVE)]
Duration = Annotated[float, quantity("s", "90 s", Bounds(above=0.0, most=86_400.0))]
Frequency = Annotated[float, quantity("Hz", "0.23 Hz", POSITIVE)]
Rate = Annotated[float, quantity("Hz", "10 Hz", Bounds(above=0.0, most=1000.0))]

Speed = Annotated[float, quantity("m/s", "5 ft/s", Bounds(least=-500.0, most=500.0))]
PositiveSpeed = Annotated[float, quantity("m/s", "32 ft/s", POSITIVE)]
NoiseSpeed = Annotated[float, quantity("m/s", "2 ft/s", NOT_NEGATIVE)]
NoiseAcceleration = Annotated[float, quantity("m/s^2", "0.02 m/s^2", NOT_NEGATIVE)]
Azimuth = Annotated[float, quantity("rad", "40 deg")]
Tilt = Annotated[float, quantity("rad", "17 deg", Bounds(least=-1.4, most=1.4))]
HalfAngle = Annotated[float, quantity("rad", "9 deg", Bounds(least=0.0, most=1.4))]
NoiseAngle = Annotated[float, quantity("rad", "0.1 deg", NOT_NEGATIVE)]
AngularRate = Annotated[float, quantity("rad/s", "3 deg/s", Bounds(least=-20.0, most=20.0))]
NoiseAngularRate = Annotated[float, quantity("rad/s", "0.1 deg/s", NOT_NEGATIVE)]

Until = Annotated[Cut, BeforeValidator(_cut)]
NoiseCeiling = Annotated[float, BeforeValidator(_sigmas)]
