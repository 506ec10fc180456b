"""Known mistakes made with records: units, axes, signs, order; each with its inverse, by which it is tried.

A mistake is tried by undoing it and looking whether the laws then hold. So the right one is found by evidence, not by a
rule per symptom. Those whose size must be estimated first are in `bayeschute.records.plausibility.estimated_mistakes`.
"""

from __future__ import annotations

from functools import cache

from bayeschute.records.plausibility.axis_mistakes import attitude_mistakes, axis_mistakes, wind_mistakes
from bayeschute.records.plausibility.instrument_mistakes import canopy_mistakes, instrument_mistakes
from bayeschute.records.plausibility.mistake import Mistake
from bayeschute.records.plausibility.unit_mistakes import air_mistakes, clock_mistakes, unit_mistakes
from bayeschute.records.plausibility.vehicle_mistakes import vehicle_mistakes

_KINDS = (
    unit_mistakes,
    clock_mistakes,
    axis_mistakes,
    wind_mistakes,
    attitude_mistakes,
    instrument_mistakes,
    canopy_mistakes,
    air_mistakes,
    vehicle_mistakes,
)


@cache
def known_mistakes() -> tuple[Mistake, ...]:
    """Every mistake of known size."""
    return tuple(mistake for kind in _KINDS for mistake in kind())
