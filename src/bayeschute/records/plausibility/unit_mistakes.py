"""Mistaken units: of lengths, speeds, rates, forces, air, loads and clocks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from bayeschute.atmosphere.standard import HIGHEST, LOWEST, SEA_LEVEL_DENSITY, standard_density
from bayeschute.core.units import factor_to_si
from bayeschute.records.plausibility.evidence import Evidence
from bayeschute.records.plausibility.mistake import Mistake, changed, other_heights, scaled, with_profile

_OF_UNITS = {  # by channel: what it is called, units it may be in, its SI unit
    "position": ("capsule positions", ("ft", "km", "yd"), "m"),
    "canopies": ("canopy positions", ("ft", "km", "yd"), "m"),
    "velocity": ("capsule velocities", ("ft/s", "knot", "km/h"), "m/s"),
    "canopy_velocity": ("canopy velocities", ("ft/s", "knot", "km/h"), "m/s"),
    "wind": ("winds", ("knot", "ft/s", "km/h"), "m/s"),
    "altitude": ("altitudes", ("ft", "km"), "m"),
    "descent_rate": ("descent rates", ("ft/s", "knot", "km/h", "ft/min"), "m/s"),
    "rate": ("angular rates", ("deg/s", "rpm"), "rad/s"),
    "force": ("specific forces", ("g_0", "ft/s^2"), "m/s^2"),
    "density": ("densities", ("slug/ft^3", "lb/ft^3", "g/m^3"), "kg/m^3"),
    "pressure": ("pressures", ("hPa", "kPa", "psi", "inHg"), "Pa"),
    "tension": ("load cells", ("lbf", "kN", "kgf"), "N"),
}


def unit_mistakes() -> Iterator[Mistake]:
    """Units of channels, one or several together."""
    for name, (words, units, si) in _OF_UNITS.items():
        for unit in units:
            factor = factor_to_si(unit, si)[0]
            shown, read = (_UNIT_WORDS.get(u, u) for u in (unit, si))
            for told, do, by, doubt in (
                (f"{shown}, read as {read}", unit, factor, 0.1),
                (f"{read} already, converted as if in {shown}", si, 1.0 / factor, 0.3),
            ):
                undo = partial(_rescaled, name=name, factor=by)
                yield Mistake(f"{words} are in {told}", _advice(do, by), undo, doubt)
    foot = factor_to_si("ft", "m")[0]
    for names, told in (
        (("position", "canopies"), "positions"),
        (("position", "canopies", "velocity"), "positions and velocities"),
        (("position", "canopies", "velocity", "canopy_velocity"), "positions and velocities of capsule and canopies"),
    ):
        for unit, power, doubt in (
            ("feet, read as metres", 1, 0.1),
            ("metres already, converted as if in feet", -1, 0.3),
        ):
            factor = foot**power
            do = _advice("ft" if power > 0 else "m", factor)
            yield Mistake(f"{told} are in {unit}", do, partial(scaled, names=names, factor=factor), doubt)
    for unit in ("ft/s", "knot", "km/h"):
        told = f"velocities of capsule and canopies are in {_UNIT_WORDS.get(unit, unit)}, read as m/s"
        factor = factor_to_si(unit, "m/s")[0]
        undo = partial(scaled, names=("velocity", "canopy_velocity"), factor=factor)
        yield Mistake(told, _advice(unit, factor), undo)
    for target in ("wind", "profile"):  # one of the two only
        words = "recorded winds" if target == "wind" else "winds by altitude"
        channels: tuple[str, ...] = ("wind",) if target == "wind" else ("profile", "shear")
        for unit in ("knot", "ft/s"):
            factor, read = factor_to_si(unit, "m/s")[0], _UNIT_WORDS.get(unit, unit)
            for told, do, by, doubt in (
                (f"{read}, read as m/s", unit, factor, 0.2),
                (f"m/s already, converted as if in {read}", "m/s", 1.0 / factor, 0.3),
            ):
                undo = partial(_one_wind, names=channels, factor=by)
                yield Mistake(f"{words} are in {told}", _advice(do, by), undo, doubt)
    for unit, told, doubt in (
        ("ft", "feet, read as metres", 0.1),
        ("m", "metres already, converted as if in feet", 0.3),
    ):
        by = foot if unit == "ft" else 1.0 / foot
        undo_heights = partial(other_heights, read=partial(np.multiply, 1.0 / by))
        yield Mistake(f"altitudes of the wind profile are in {told}", _advice(unit, by), undo_heights, doubt)
    yield Mistake(
        "temperatures are in degrees Celsius, read as kelvin",
        "Give their unit as 'degC'.",
        changed(("temperature",), partial(np.add, 273.15)),
    )


def _advice(unit: str, factor: float) -> str:
    """What to do about channels that become right by a factor: true of them whatever unit they were given in."""
    off = f"{factor:.3g} times too small" if factor > 1.0 else f"{1.0 / factor:.3g} times too large"
    return f"Give their unit as '{unit}'; as it is given now they are {off}."


def _rescaled(e: Evidence, name: str, factor: float) -> Evidence | None:
    """A channel times a factor; where it is the wind, with its profile."""
    names = with_profile((name,), e)
    return scaled(e, names, factor) if names else None


def _one_wind(e: Evidence, names: tuple[str, ...], factor: float) -> Evidence | None:
    """The recorded wind or that by altitude times a factor, where there are both."""
    return None if e.wind is None or e.profile is None else scaled(e, names, factor)


_UNIT_WORDS = {"ft": "feet", "m": "metres", "knot": "knots", "yd": "yards", "g_0": "g"}


def clock_mistakes() -> Iterator[Mistake]:
    """Units of the time."""
    for words, factor, do in (
        ("milliseconds, read as seconds", 1e-3, "ms"),
        ("microseconds, read as seconds", 1e-6, "us"),
        ("minutes, read as seconds", 60.0, "min"),
        ("seconds already, converted as if in milliseconds", 1e3, "s"),
    ):
        yield Mistake(
            f"times are in {words}",
            f"Give their unit as '{do}'.",
            changed(("time",), partial(np.multiply, factor)),
        )


def air_mistakes() -> Iterator[Mistake]:
    """Altitudes that a density was looked up at."""

    def looked_up(e: Evidence, factor: float, shift: float = 0.0) -> Evidence | None:
        height = e.height()
        if e.density is None or height is None:
            return None
        inside = np.clip(height, LOWEST, HIGHEST)
        other = np.clip(factor * height + shift, LOWEST, HIGHEST)
        return replace(e, density=e.density * standard_density(inside) / standard_density(other))

    foot = factor_to_si("ft", "m")[0]
    yield Mistake(
        "density was looked up at altitudes in feet, as if in metres",
        "Look it up anew.",
        lambda e: looked_up(e, 1.0 / foot),
    )
    yield Mistake(
        "density was looked up at altitudes in metres, as if in feet", "Look it up anew.", lambda e: looked_up(e, foot)
    )
    yield Mistake(
        "density is that of the sea at all altitudes",
        "Give the density along the flight, or leave it out.",
        lambda e: (
            None
            if e.density is None or e.height() is None
            else looked_up(replace(e, density=e.density), 0.0)
            if abs(np.nanstd(e.density)) < 0.02 * SEA_LEVEL_DENSITY
            else None
        ),
    )
