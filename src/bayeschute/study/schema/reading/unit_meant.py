"""What a unit that is none, or of something else, was likely meant to be."""

from __future__ import annotations

import re
from collections.abc import Iterator

from bayeschute.core.units import factor_to_si, to_si

_LONGEST = 100  # texts in which a unit is sought
_WORDS = {  # of units as people write them, in small letters: what the program calls them
    "g": "g_0", "gs": "g_0", "gee": "g_0", "gn": "g_0", "mg": "millig_0",
    "c": "degC", "degc": "degC", "deg_c": "degC", "deg c": "degC", "celsius": "degC", "centigrade": "degC",
    "f": "degF", "degf": "degF", "deg_f": "degF", "deg f": "degF", "fahrenheit": "degF", "k": "K", "kelvin": "K",
    "dps": "deg/s", "degps": "deg/s", "radps": "rad/s", "kmh": "km/h", "kmhr": "km/h", "mps": "m/s",
    "kmps": "km/s",
    "mb": "mbar", "hpa": "hPa", "kpa": "kPa", "pa": "Pa", "inhg": "inHg", "mmhg": "mmHg", "hz": "Hz",
    "lb": "lbf", "lbs": "lbf", "kn": "kN", "n": "N", "newtons": "N", "kgs": "kg",
}  # fmt: skip
_MISTYPED = ("m", "s")  # likely meant where they are written as M (molar) or S (siemens)
_MEANING = {
    "g_0": "standard gravity",
    "millig_0": "thousandths of standard gravity",
    "degC": "degrees Celsius",
    "degF": "degrees Fahrenheit",
    "lbf": "pound-force",
}


def unit_meant(text: str, unit: str) -> str:
    """Advice on a unit that is none, or is of something else: what was likely meant.

    Args:
        text: The unit as written, or a quantity in it, such as ``"g"``, which is the gram, or ``"20 degc"``.
        unit: SI unit of what was wanted, such as ``"m/s^2"``.

    Returns:
        A question such as ``"Did you mean 'g_0' (standard gravity)?"``; empty where nothing of the kind is known.
    """
    written = re.sub(r"^[-+.\d]+([eE][-+]?\d+)?\s*", "", text[:_LONGEST].strip())
    known = _is_unit(written) and written.lower() not in _MISTYPED  # 'Pa' is no 'pa', which would be years
    for tried in _spellings(written):
        if tried == written or (known and tried == written.lower()):
            continue
        try:
            to_si(f"1 {tried}", unit)
        except ValueError:
            continue
        meaning = f" ({_MEANING[tried]})" if tried in _MEANING else ""
        return f"Did you mean {tried!r}{meaning}?"
    return ""


def _is_unit(text: str) -> bool:
    """Whether a text is a unit of some kind as it stands."""
    try:
        factor_to_si(text, text)
    except ValueError:
        return False
    return True


def _spellings(text: str) -> Iterator[str]:
    """Other ways to write a unit, the likeliest first: powers with their sign, words of the trade, small letters."""
    powers = re.sub(r"(?<=[A-Za-z])\^?([23])", r"^\1", text.replace("²", "2").replace("³", "3"))
    yield from (powers, _WORDS.get(text.lower(), text))
    for written in (powers, powers.lower()):
        yield re.sub(r"[A-Za-z_]+", lambda word: _WORDS.get(word[0].lower(), word[0]), written)
    yield powers.lower()
