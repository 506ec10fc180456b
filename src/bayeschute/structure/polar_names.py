"""Syntax of the names of polar explanatory variables and their products, free of JAX.

The variables are those of the report's polar form (7.3-2..5) and two more (`closing`, splines). The angle of proximity
runs from the airflow across the axis to the direction away from the other canopy (6.1-13).

| variable | meaning | unit |
|---|---|---|
| ``speed`` | airspeed over reference speed, minus one | 1 |
| ``alpha`` | total angle of attack alpha_T | rad |
| ``alpha_rate`` | alpha_T' l/(2 V) | 1 |
| ``azimuth_rate`` | phi_a' sin(alpha_T) l/(2 V) | 1 |
| ``q`` | dynamic pressure | Pa |
| ``distance`` | D_prox | 1 |
| ``closing`` | V_prox | 1/s |
| ``overlap`` | (0.8 - D_prox) where positive | 1 |
| ``sin_proximity``, ``cos_proximity`` | of the angle of proximity | 1 |
| ``(1.2-distance)_+``, ``(alpha-16deg)_+``, ``(0.5-q)_+^2`` ... | one-sided splines of a variable | of the variable |
"""

from __future__ import annotations

import re
from collections import Counter
from typing import NamedTuple

UNITS: dict[str, dict[str, int]] = {
    "speed": {},
    "alpha": {"rad": 1},
    "alpha_rate": {},
    "azimuth_rate": {},
    "q": {"Pa": 1},
    "distance": {},
    "closing": {"s": -1},
    "overlap": {},
    "sin_proximity": {},
    "cos_proximity": {},
}  # fmt: skip
_NAMES = "|".join(UNITS)
_NUMBER = r"\d*\.?\d+"
_BELOW = rf"(?P<below>{_NUMBER})(?P<below_deg>deg)?-(?P<of>{_NAMES})"
_ABOVE = rf"(?P<over>{_NAMES})-(?P<above>{_NUMBER})(?P<above_deg>deg)?"
_SPLINE = re.compile(rf"\((?:{_BELOW}|{_ABOVE})\)_\+(?:\^(?P<power>[1-9]))?")
_POWER = re.compile(r"(?P<base>.+?)\^(?P<power>[1-9])")
OVERLAP = "(0.8-distance)_+"


class Spline(NamedTuple):
    """A one-sided spline.

    Attributes:
        variable: The variable of the spline.
        knot: Where it begins, as written.
        degrees: Whether the knot is in degrees.
        side: ``"above"`` or ``"below"``: where it isn't zero.
        power: Its power.
    """

    variable: str
    knot: float
    degrees: bool
    side: str
    power: int


def parse_spline(name: str) -> Spline | None:
    """The spline that a name means; None if it isn't one."""
    match = _SPLINE.fullmatch(name)
    if match is None:
        return None
    below = match["below"] is not None
    variable = match["of"] if below else match["over"]
    degrees = bool(match["below_deg"] if below else match["above_deg"])
    knot = float(match["below"] if below else match["above"])
    return Spline(variable, knot, degrees, "below" if below else "above", int(match["power"] or 1))


def check_variable(name: str) -> str | None:
    """Error in the name of a variable, in words; None if it is valid."""
    if name in UNITS:
        return None
    made = parse_spline(name)
    if made is None:
        return f"{name!r} is no variable; known are {', '.join(UNITS)} and splines such as '(1.2-distance)_+'"
    if made.degrees != (made.variable == "alpha"):
        return f"{name!r}: knots of alpha are written in degrees, such as '(alpha-16deg)_+', others without unit"
    return None


def factors(term: str) -> tuple[tuple[str, int], ...]:
    """Variables of a product and their powers, in the order written; none for the constant ``1``.

    Raises:
        ValueError: If a factor is unknown; the message says what is wrong.
    """
    found = []
    for part in (p.strip() for p in term.split("*")):
        if part == "1":
            continue
        split = None if check_variable(part) is None else _POWER.fullmatch(part)
        base, power = (part, 1) if split is None else (split["base"], int(split["power"]))
        wrong = check_variable(base)
        if wrong:
            raise ValueError(wrong)
        found.append((base, power))
    return tuple(found)


def check_term(term: str) -> str | None:
    """Error in the name of a product, in words; None if it is valid."""
    try:
        factors(term)
    except ValueError as error:
        return str(error)
    return None


def canonical(term: str) -> tuple[tuple[str, int], ...]:
    """The same for all ways to write a product: factors sorted, powers added, ``overlap`` as the spline that it is."""
    powers: Counter[str] = Counter()
    for base, power in factors(term):
        made = parse_spline(OVERLAP if base == "overlap" else base)
        powers[base if made is None else _spelled(made)] += power * (1 if made is None else made.power)
    return tuple(sorted(powers.items()))


def _spelled(made: Spline) -> str:
    """The first power of a spline, its knot in the shortest way."""
    knot = f"{made.knot:g}{'deg' if made.degrees else ''}"
    inside = f"{knot}-{made.variable}" if made.side == "below" else f"{made.variable}-{knot}"
    return f"({inside})_+"


def coefficient_unit(term: str) -> str:
    """Unit of a term's coefficient, the force coefficient being a pure number; ``1`` if it has none."""
    powers: Counter[str] = Counter()
    for base, power in factors(term):
        made = parse_spline(base)
        variable, times = (base, power) if made is None else (made.variable, power * made.power)
        for unit, exponent in UNITS[variable].items():
            powers[unit] -= exponent * times
    above = [_raised(unit, n) for unit, n in powers.items() if n > 0]
    below = [_raised(unit, -n) for unit, n in powers.items() if n < 0]
    over = " ".join(above) or "1"
    return over if not below else f"{over}/{below[0]}" if len(below) == 1 else f"{over}/({' '.join(below)})"


def _raised(unit: str, power: int) -> str:
    return unit if power == 1 else f"{unit}^{power}"
