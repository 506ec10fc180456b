"""Published sets of aerodynamic coefficients: TOML files with source, units and sign conventions, validated on load."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from bayeschute.core.errors import Fault, InputError
from bayeschute.core.units import to_si

PLANAR_UNITS = {"C_A0": "", "C_Aalpha": "1/rad", "alpha_0": "rad", "C_Nalpha": "1/rad", "C_Nalphadot": "s/rad"}
# Factors of the polar form with the unit of each coefficient (meanings: `bayeschute.structure.polar_names`).
POLAR_FACTORS = {
    "1": "",
    "q": "1/Pa",
    "speed": "",
    "alpha": "1/rad",
    "alpha_rate": "",
    "azimuth_rate": "",
    "distance": "",
    "overlap": "",
    "sin_proximity": "",
    "cos_proximity": "",
}
COEFFICIENTS = {"planar": ("C_A", "C_N", ""), "polar": ("C_A", "C_Y", "C_N")}
_KEYS = {"title", "source", "form", "readings", "parameter"}
_ENTRY = {"name", "coefficient", "term", "estimate", "standard_error"}


@dataclass(frozen=True)
class PublishedParameter:
    """One number of a published set; SI.

    Attributes:
        name: Of a planar set: a field of `PlanarAero`; of a polar set: ``C_A[q]`` and the like.
        coefficient: The coefficient that it belongs to, whose sign a reading may turn; empty for an angle.
        term: Factors joined by ``*``; empty in a planar set.
        estimate: With the sign of the chosen reading.
        standard_error: As published, > 0.
        unit: Of both.
    """

    name: str
    coefficient: str
    term: str
    estimate: float
    standard_error: float
    unit: str


@dataclass(frozen=True)
class PublishedSet:
    """A published set under one reading of its signs.

    Attributes:
        title: Description of the set.
        source: Where it is printed.
        form: ``"planar"`` (6.3.1-10..12) or ``"polar"`` (coefficients along the wind axes, 6.3.3-5).
        reading: Name of the reading.
        parameters: In the order of the file.
    """

    title: str
    source: str
    form: str
    reading: str
    parameters: tuple[PublishedParameter, ...]

    def estimates(self) -> dict[str, float]:
        """Estimates by name."""
        return {p.name: p.estimate for p in self.parameters}

    def of(self, coefficient: str) -> dict[str, float]:
        """Estimates of one coefficient by term, of a polar set."""
        return {p.term: p.estimate for p in self.parameters if p.coefficient == coefficient}


def published_names() -> tuple[str, ...]:
    """Names of the sets that come with the package."""
    return tuple(sorted(f.name.removesuffix(".toml") for f in files("bayeschute.aero").joinpath("tables").iterdir()))


def load_published(source: str | Path, reading: str = "conventional") -> PublishedSet:
    """Read a published set.

    Args:
        source: One of `published_names`, or the path of a file.
        reading: One of the file's readings of signs; ``"conventional"`` has drag and restoring force positive.

    Returns:
        The set, in SI.

    Raises:
        InputError: With every fault of the file.
    """
    if isinstance(source, str) and source in published_names():
        text = files("bayeschute.aero").joinpath("tables", f"{source}.toml").read_text(encoding="utf-8")
    elif isinstance(source, str) and not source.endswith(".toml"):
        known = ", ".join(published_names())
        raise InputError(Fault("published set", repr(source), f"one of {known}, or the path of a .toml file"))
    else:
        try:
            text = Path(source).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(Fault(str(source), str(error), "a readable TOML file")) from error
    try:
        return parse_published(tomllib.loads(text), str(source), reading)
    except tomllib.TOMLDecodeError as error:
        raise InputError(Fault(str(source), str(error), "valid TOML")) from error


def parse_published(raw: Mapping[str, Any], where: str, reading: str) -> PublishedSet:
    """Check the contents of a file and convert them to SI.

    Args:
        raw: Contents of the TOML file.
        where: Its name, for faults.
        reading: Name of the reading.

    Raises:
        InputError: With every fault found.
    """
    faults = _unknown(raw, _KEYS, where)
    for key in ("title", "source"):
        if not isinstance(raw.get(key), str) or not raw[key].strip():
            faults.append(Fault(f"{where} {key}", repr(raw.get(key)), "a text"))
    form = raw.get("form")
    if form not in COEFFICIENTS:
        faults.append(Fault(f"{where} form", repr(form), " or ".join(map(repr, COEFFICIENTS))))
        raise InputError(faults)
    signs = _signs(raw.get("readings"), form, where, reading, faults)
    entries = raw.get("parameter")
    if not isinstance(entries, list) or not entries:
        faults.append(Fault(f"{where} parameter", repr(entries), "tables [[parameter]]"))
        entries = []
    found: list[PublishedParameter] = []
    for i, entry in enumerate(entries, 1):
        one = _parameter(entry, form, f"{where} [[parameter]] {i}", signs, faults)
        if one is not None:
            if one.name in [p.name for p in found]:
                faults.append(Fault(f"{where} [[parameter]] {i}", f"{one.name!r} again", "each parameter once"))
            found.append(one)
    lacking = [n for n in PLANAR_UNITS if n not in [p.name for p in found]] if form == "planar" and not faults else []
    faults += [Fault(f"{where} parameter", f"no {name!r}", "all five of Table 7.1-2") for name in lacking]
    if faults:
        raise InputError(faults)
    return PublishedSet(raw["title"], raw["source"], form, reading, tuple(found))


def _unknown(table: Mapping[str, Any], known: set[str], where: str) -> list[Fault]:
    return [
        Fault(f"{where} {k}", "an unknown key", f"one of {', '.join(sorted(known))}") for k in table if k not in known
    ]


def _are_signs(signs: Any, wanted: set[str]) -> bool:
    if not isinstance(signs, dict) or set(signs) != wanted:
        return False
    return all(type(sign) is int and abs(sign) == 1 for sign in signs.values())


def _signs(readings: Any, form: str, where: str, reading: str, faults: list[Fault]) -> dict[str, float]:
    """Signs of the chosen reading; all readings are checked."""
    wanted = {name for name in COEFFICIENTS[form] if name}
    if not isinstance(readings, dict) or not readings:
        faults.append(Fault(f"{where} readings", repr(readings), "at least the reading 'conventional'"))
        return {}
    for name, signs in readings.items():
        if not _are_signs(signs, wanted):
            each = ", ".join(sorted(wanted))
            faults.append(Fault(f"{where} readings.{name}", repr(signs), f"1 or -1 for each of {each}"))
    if reading not in readings:
        faults.append(Fault(f"{where} readings", f"no reading {reading!r}", f"one of {', '.join(readings)}"))
        return {}
    return readings[reading] if _are_signs(readings[reading], wanted) else {}


def _parameter(
    entry: Any, form: str, where: str, signs: Mapping[str, float], faults: list[Fault]
) -> PublishedParameter | None:
    """One [[parameter]]; None if it has faults, which are added."""
    before = len(faults)
    if not isinstance(entry, dict):
        faults.append(Fault(where, repr(entry), "a table"))
        return None
    faults += _unknown(entry, _ENTRY, where)
    coefficient, term, name = entry.get("coefficient", ""), entry.get("term", ""), entry.get("name")
    if coefficient not in COEFFICIENTS[form]:
        wanted = ", ".join(map(repr, COEFFICIENTS[form]))
        faults.append(Fault(f"{where} coefficient", repr(coefficient), f"one of {wanted}"))
    unit = ""
    if form == "planar":
        if name not in PLANAR_UNITS:
            faults.append(Fault(f"{where} name", repr(name), f"one of {', '.join(PLANAR_UNITS)}"))
        unit = PLANAR_UNITS.get(str(name), "")
    else:
        name, unit = f"{coefficient}[{term}]", _polar_unit(term, where, faults)
    if len(faults) > before:
        return None
    estimate, error = (_quantity(entry, key, unit, where, faults) for key in ("estimate", "standard_error"))
    if error is not None and not error > 0.0:
        faults.append(Fault(f"{where} standard_error", repr(entry["standard_error"]), "a number > 0"))
    if len(faults) > before or estimate is None or error is None:
        return None
    return PublishedParameter(str(name), str(coefficient), term, estimate * signs.get(str(coefficient), 1), error, unit)


def _polar_unit(term: Any, where: str, faults: list[Fault]) -> str:
    """Unit that a term gives to its coefficient."""
    factors = split_polar(term) if isinstance(term, str) else None
    if factors is None:
        known = ", ".join(POLAR_FACTORS)
        faults.append(Fault(f"{where} term", repr(term), f"factors joined by '*', squared by '^2', of {known}"))
        return ""
    units = [POLAR_FACTORS[f] for f, power in factors for _ in range(power) if POLAR_FACTORS[f]]
    return "*".join(f"({u})" for u in units) if len(units) > 1 else "".join(units)


def split_polar(term: str) -> tuple[tuple[str, int], ...] | None:
    """Factors of a polar term with their powers; None if one is unknown."""
    parts = tuple((p.removesuffix("^2"), 2 if p.endswith("^2") else 1) for p in (f.strip() for f in term.split("*")))
    return parts if all(name in POLAR_FACTORS for name, _ in parts) else None


def _quantity(entry: Mapping[str, Any], key: str, unit: str, where: str, faults: list[Fault]) -> float | None:
    text = entry.get(key)
    try:
        if not isinstance(text, str):
            raise ValueError(f"{text!r} is not a quantity written as text")
        return to_si(text, unit)
    except ValueError as error:
        faults.append(Fault(f"{where} {key}", str(error), f"a quantity in {unit or 'no unit'}"))
        return None
