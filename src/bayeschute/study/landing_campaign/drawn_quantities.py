"""Quantities of a campaign file that may be drawn: ``{ mean = "9 m", sd = "1 m" }``. Nothing here imports JAX."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator

from bayeschute.study.schema.quantities import HIGHEST, LOWEST, Bounds, read_quantity
from bayeschute.study.schema.reading.strict import refuse
from bayeschute.study.schema.wind_schema import FASTEST


def spread(unit: str, example: str, most: float, least: float | None = None) -> BeforeValidator:
    """Validator of a quantity, or of ``{ mean = .., sd = .. }`` of one: mean and standard deviation in SI.

    The mean is at least `least`, or minus `most`.
    """
    bounds = Bounds(least=-most if least is None else least, most=most)

    def read(value: Any) -> tuple[float, float]:
        if not isinstance(value, dict):
            return read_quantity(value, unit, example, bounds), 0.0
        if not {"mean", "sd"} >= set(value) or "mean" not in value:
            refuse("a quantity, or a table of mean and sd", f"a table of {', '.join(map(str, value)) or 'nothing'}")
        spread = read_quantity(value["sd"], unit, example, Bounds(least=0.0, most=most)) if "sd" in value else 0.0
        return read_quantity(value["mean"], unit, example, bounds), spread

    return BeforeValidator(read)


def _pure(value: Any) -> tuple[float, float]:
    wanted = "a number >= 0, or a table of mean and sd of one"
    if isinstance(value, dict) and not {"mean", "sd"} >= set(value):
        refuse(wanted, f"a table of {', '.join(map(str, value))}"[:200])
    parts: tuple[Any, Any] = (value.get("mean"), value.get("sd", 0.0)) if isinstance(value, dict) else (value, 0.0)
    if not all(isinstance(p, int | float) and not isinstance(p, bool) and 0.0 <= p <= 1e6 for p in parts):
        refuse(wanted)
    return float(parts[0]), float(parts[1])


Pair = tuple[float, float]
Altitudes = Annotated[Pair, spread("m", "4000 ft", HIGHEST, LOWEST)]
Angles = Annotated[Pair, spread("rad", "5 deg", 2.0 * np.pi)]
Rates = Annotated[Pair, spread("rad/s", "1 deg/s", 20.0)]
Speeds = Annotated[Pair, spread("m/s", "5 ft/s", FASTEST)]
Shares = Annotated[Pair, BeforeValidator(_pure)]
