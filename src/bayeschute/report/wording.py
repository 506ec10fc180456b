"""Formatting of numbers, units and names for the report."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import cache
from typing import Any, TypeGuard

from bayeschute.aero.coefficient import Coefficient
from bayeschute.core.units import factor_to_si

MISSING = "–"
SHOWN_IN = {  # SI unit: unit of the report
    "rad": "deg",
    "rad/s": "deg/s",
    "N/m": "kN/m",
    "N s/m": "kN s/m",
    "N*s/m": "kN s/m",
    "N": "kN",
}
ALSO_IN = {  # SI unit: US unit beside it
    "m": "ft",
    "m/s": "ft/s",
    "m/s^2": "ft/s^2",
    "m^2": "ft^2",
    "m^3": "ft^3",
    "kg": "lb",
    "kg/m^3": "slug/ft^3",
    "m^2/kg": "ft^2/lb",
    "N": "lbf",
    "N/m": "lbf/ft",
    "N s/m": "lbf s/ft",
    "N*s/m": "lbf s/ft",
}
QUANTITIES = {
    "swing_angle": "swing angle",
    "descent_rate": "descent rate",
    "sea_level_descent_rate": "sea-level-equivalent descent rate",
    "flyout_angle": "flyout angle",
    "horizontal_speed": "horizontal speed",
}
STATISTICS = {
    "final": "at the end of the record",
    "maximum": "maximum over the window",
    "mean": "mean over the window",
}
ROLES = {"structure": "structure selection", "identify": "identification", "predict": "prediction"}
_PARAMETERS = {
    "riser_stiffness": "stiffness of a riser",
    "riser_damping": "damping of a riser",
    "riser_length": "unstretched length of a riser",
    "capsule_mass": "mass of the capsule",
    "capsule_axial_force": "axial force of the capsule",
    "capsule_normal_force_slope": "slope of the capsule's normal force",
    "capsule_pitch_moment_slope": "slope of the capsule's pitching moment",
    "capsule_pitch_damping": "pitch damping of the capsule",
    "capsule_inertia_factor_y": "factor on the capsule's moment of inertia about y",
    "capsule_inertia_factor_z": "factor on the capsule's moment of inertia about z",
    "canopy_pitch_moment_slope": "slope of a canopy's pitching moment",
    "canopy_pitch_damping": "pitch damping of a canopy",
    "canopy_position_scale": "scale of the recorded canopy positions",
    "wind_bias": "constant error of the recorded wind",
    "canopy_position_bias": "constant error of the recorded canopy positions",
    "capsule_attitude_bias": "constant error of the recorded attitude, about body axis",
    "enclosed_air_factor": "factor on the apparent mass (enclosed air)",
    "canopy_mass": "dry mass of a canopy",
    "cds_over_mass": "drag area over mass, C_D S / m",
    "population_mean": "population: mean of log(C_D S / m)",
    "population_sd": "population: sd of log(C_D S / m)",
}
_FACTORS = {
    "1": "constant",
    "alpha": "angle of attack",
    "q": "dynamic pressure",
    "speed": "airspeed",
    "proximity": "proximity of the canopies",
    "closing": "closing speed of the canopies",
    "restoring": "restoring force at high angle",
    "e": "static force (restoring if positive)",
    "angle": "static force by angle (restoring if positive)",
    "rate": "rate force (damping if positive)",
    "repulsion": "repulsion of the canopies",
    "c": "force along the cluster axis",
    "(e.rate)": "angle times rate",
    "side": "perpendicular component",
}


def is_number(value: Any) -> TypeGuard[float]:
    """Whether a value is a finite number (not a boolean)."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def number(value: Any, digits: int = 3) -> str:
    """A number with significant digits; thousands are grouped, very small and large ones get a power of ten."""
    if not is_number(value):
        return MISSING if value is None or isinstance(value, float) else str(value)
    if value == 0:
        return "0"
    if isinstance(value, int):
        return f"{value:,}".replace("-", "−")
    size = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))  # of what is shown: 0.9999 is 1.00
    if not -4 <= size < 7:
        mantissa, power = f"{value:.{digits - 1}e}".split("e")
        return f"{mantissa}e{int(power)}".replace("-", "−")
    text = f"{round(value, digits - 1 - size):,.{max(digits - 1 - size, 0)}f}"
    return text.replace("-", "−")


def short(value: Any, digits: int = 4) -> str:
    """A number without trailing zeros; anything else as it stands."""
    if value is None or not is_number(value):
        return MISSING if value is None or isinstance(value, float) else str(value)
    text = number(value, digits)
    return text.rstrip("0").rstrip(".") if "." in text and "e" not in text else text


def whole(value: Any) -> str:
    """A count."""
    return f"{value:,.0f}" if is_number(value) else MISSING


def at_precision(value: Any, sd: Any) -> str:
    """A number rounded to the decimals that its standard deviation justifies."""
    if not is_number(value):
        return MISSING
    if not is_number(sd) or sd <= 0:
        return number(value, 4)
    decimals = 1 - math.floor(math.log10(sd))  # two digits of the standard deviation
    if decimals > 7:
        return number(value, 4)
    return f"{round(value, decimals):,.{max(decimals, 0)}f}".replace("-", "−")


def percent(value: Any, digits: int = 0) -> str:
    """A share in percent."""
    if not is_number(value):
        return MISSING
    rounded = round(100.0 * value, digits) + 0.0  # no minus before a zero
    return f"{rounded:.{digits}f} %".replace("-", "−")


def probability(value: Any) -> str:
    """A probability, never rounded up to certainty."""
    if not is_number(value):
        return MISSING
    if 0 < value < 0.001:
        return "< 0.001"
    if 0.999 < value < 1:
        return "> 0.999"
    return f"{value:.3f}" if not 0.01 <= value <= 0.99 else f"{value:.2f}"


@cache
def shown_unit(unit: str) -> tuple[float, str]:
    """Factor from an SI unit to the unit the report shows, and that unit's name."""
    if unit in SHOWN_IN:
        scale, _ = factor_to_si(SHOWN_IN[unit], unit)
        return 1.0 / scale, SHOWN_IN[unit]
    return 1.0, "" if unit in ("1", "dimensionless") else unit


@cache
def us_unit(unit: str) -> tuple[float, str]:
    """Factor from an SI unit to the US unit that the report shows beside it, and its name; empty where both agree."""
    name = ALSO_IN.get(unit, "")
    return (1.0 / factor_to_si(name, unit.replace("*", " "))[0], name) if name else (1.0, "")


def also(values: Any, unit: str, digits: int = 3) -> str:
    """A value in SI, or several of a range, in US units with their unit; empty where these agree or one is missing."""
    several = values if isinstance(values, list | tuple) else (values,)
    scale, name = us_unit(unit)
    if not name or not all(is_number(value) for value in several):
        return ""
    return f"{' … '.join(number(scale * value, digits) for value in several)} {name}"


def quantity(value: Any, unit: str, digits: int = 3) -> str:
    """A value with its unit as shown, and in US units."""
    if not is_number(value):
        return MISSING
    scale, name = shown_unit(unit)
    text, beside = f"{number(scale * value, digits)} {name}".rstrip(), also(value, unit, digits)
    return f"{text} ({beside})" if beside else text


def scaled(facts: Mapping[str, Any], key: str, scale: float) -> float | None:
    """A number of some facts in the unit that is shown; None where it is none."""
    value = facts.get(key)
    return scale * value if is_number(value) else None


def quantity_name(name: str) -> str:
    """A quantity in words."""
    return QUANTITIES.get(name, name.replace("_", " "))


def statistic_name(quantity: str, statistic: str) -> str:
    """A statistic of a quantity in words."""
    return (
        f"{quantity_name(quantity)}, {STATISTICS.get(statistic, statistic)}" if statistic else quantity_name(quantity)
    )


def listed(items: list[str]) -> str:
    """Items joined as in a sentence."""
    return items[0] if len(items) == 1 else ", ".join(items[:-1]) + " and " + items[-1] if items else "none"


def counted(count: int, noun: str) -> str:
    """A count and its noun, in the plural where it is due."""
    return f"{count:,} {noun}" if count == 1 else f"{count:,} {noun}s"


def _factor(factor: str) -> str:
    """One factor of an aerodynamic term in words."""
    if factor in _FACTORS:
        return _FACTORS[factor]
    stem = re.split(r"[(^]", factor)[0]
    power = re.search(r"\^(\d)", factor)
    word = _FACTORS.get(stem, factor)
    return (
        f"{word} {({'2': 'squared', '3': 'cubed'}).get(power.group(1), 'to the ' + power.group(1))}" if power else word
    )


def parameter_meaning(name: str) -> str:
    """A parameter in words; empty for an unknown name."""
    if one := Coefficient.parse(name):
        factors = [_factor(factor.strip()) for factor in one.term.split("*")]
        whose = "" if one.canopy is None or one.flight is None else f", canopy {one.canopy} of {one.flight}"
        return f"{one.kind} force: " + " × ".join(factors) + whose
    stem, _, inner = name.partition("[")  # of a descent among several: the flight
    stem, _, axis = stem.partition(".")  # of a constant error: the axis, and the flight among several
    axis, _, flight = axis.partition("@")
    words = " ".join(part for part in (_PARAMETERS.get(stem, ""), axis) if part)
    return (
        ", ".join([words, *(part for part in (inner.removesuffix("]"), flight) if part)]) if stem in _PARAMETERS else ""
    )
