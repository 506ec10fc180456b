"""Domain of a calibration: the ranges of what its replicates had, and in what a run lies outside.

Conditions of a run are numbers (a list by name, one per flight or fit) and names (channels, sampler, origin). Ranges of
numbers that vary from replicate to replicate are widened by a quarter on both sides, on a logarithmic scale where they
are positive: of a hundred replicates the range is then nearly four standard deviations to both sides of a Gaussian, so
that a run like the replicates is seldom called outside in any of its conditions. Numbers that all replicates share may
differ by 5 %.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

BEYOND = 0.25
"""Share of the range of replicates by which it is widened on both sides."""
EQUAL = 0.05
"""Relative difference within which a number is the same."""
NONE = "none"


class Conditions(NamedTuple):
    """What a run or a replicate had.

    Attributes:
        numbers: Values by name, one per flight or fit [SI].
        names: Names that apply, by kind.
        units: Unit by name of `numbers`.
    """

    numbers: Mapping[str, list[float]]
    names: Mapping[str, list[str]]
    units: Mapping[str, str]


def domain(conditions: Iterable[Conditions]) -> dict[str, Any]:
    """Ranges and names over replicates, as stored with a calibration.

    Args:
        conditions: Of the replicates.

    Returns:
        ``replicates``; ``numbers``: name to ``low``, ``high`` and ``unit``; ``names``: kind to all combinations that
        replicates had.
    """
    many = list(conditions)
    numbers: dict[str, dict[str, Any]] = {}
    for one in many:
        for name, values in one.numbers.items():
            known = [float(v) for v in values if math.isfinite(v)]
            if known:
                entry = numbers.setdefault(name, {"low": math.inf, "high": -math.inf, "unit": one.units.get(name, "1")})
                entry["low"], entry["high"] = min(entry["low"], *known), max(entry["high"], *known)
    kinds = dict.fromkeys(kind for one in many for kind in one.names)
    names = {kind: sorted({tuple(sorted(one.names.get(kind, ()))) for one in many}) for kind in kinds}
    return {
        "replicates": len(many),
        "numbers": numbers,
        "names": {kind: [list(some) for some in found] for kind, found in names.items()},
    }


def _limits(low: float, high: float) -> tuple[float, float]:
    """The range of replicates, widened."""
    if low > 0.0:
        more = max(BEYOND * math.log(high / low), EQUAL)
        return low * math.exp(-more), high * math.exp(more)
    more = max(BEYOND * (high - low), EQUAL * max(abs(low), abs(high)), 1e-9)
    return low - more, high + more


def _range(low: float, high: float, unit: str) -> str:
    ends = [f"{value:.3g}" if abs(value) < 1e3 else f"{value:,.0f}" for value in (low, high)]
    text = ends[0] if ends[0] == ends[1] else f"{ends[0]} to {ends[1]}"
    return text if unit == "1" else f"{text} {unit}"


def outside(run: Conditions, stored: Mapping[str, Any] | None) -> list[str]:
    """In what a run lies outside the domain of a calibration, in words; empty where it lies inside.

    Args:
        run: Conditions of the run.
        stored: From `domain`; None: the calibration has none.
    """
    if not stored or not stored.get("numbers"):
        return ["the calibration does not say which flights its replicates had"]
    found = []
    for name, values in run.numbers.items():
        entry, unit = stored["numbers"].get(name), run.units.get(name, "1")
        known = [float(v) for v in values if math.isfinite(v)]
        if not known:
            continue
        if entry is None:
            found.append(f"{name} {_range(min(known), max(known), unit)}, replicates had none")
            continue
        low, high = _limits(float(entry["low"]), float(entry["high"]))
        if min(known) < low or max(known) > high:
            seen = _range(float(entry["low"]), float(entry["high"]), unit)
            found.append(f"{name} {_range(min(known), max(known), unit)}, replicates had {seen}")
    return found + _other_names(run, stored)


def _other_names(run: Conditions, stored: Mapping[str, Any]) -> list[str]:
    """Kinds whose names no replicate had: what is missing and what is additional."""
    found = []
    for kind, names in run.names.items():
        seen = [list(some) for some in stored["names"].get(kind, [])]
        if sorted(names) not in seen:
            text, others = ", ".join(sorted(names)) or NONE, "; ".join(", ".join(s) or NONE for s in seen) or NONE
            found.append(f"{kind} {text}, replicates had {others}")
    return found
