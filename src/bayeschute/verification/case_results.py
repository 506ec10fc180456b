"""Result of a check case: an error against its reference, the bound, and whether it passed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from bayeschute.core.units import to_si
from bayeschute.verification.flying import MEMBERS, Flown

SLACK = 1.25  # bounds are this times the errors of an independent simulation of the same cases
_RATIO, _RATIO_BOUND = 10.0, 0.3


class Result(NamedTuple):
    """One line of the table.

    Attributes:
        case: Name of the check case.
        set: Name of the parameter set; "both" where all flights count.
        stiffness: Factor on the risers' stiffness and damping; None where all flights count.
        quantity: What is compared.
        reference: What it is compared with.
        unit: Unit of `error` and `bound`.
        error: Largest difference from the reference; NaN if the simulation failed.
        bound: What is allowed.
        passed: Whether the error is within the bound.
    """

    case: str
    set: str
    stiffness: float | None
    quantity: str
    reference: str
    unit: str
    error: float
    bound: float
    passed: bool


def _largest(difference: ArrayLike) -> float:
    return float(np.max(np.abs(np.asarray(difference, float))))


def _rms(difference: ArrayLike) -> np.float64:
    return np.float64(np.sqrt(np.mean(np.square(np.asarray(difference, float)))))


def single(
    case: str, member: int, quantity: str, reference: str, unit: str, difference: ArrayLike, bound: float
) -> Result:
    """A line about one flight.

    Args:
        case: Name of the case.
        member: Which of `MEMBERS` flew.
        quantity: What is compared.
        reference: What with.
        unit: Of the bound.
        difference: From the reference, SI; its largest size counts.
        bound: What is allowed [`unit`].
    """
    s, stiffer = MEMBERS[member]
    error = _largest(difference) / (to_si(f"1 {unit}", _si(unit)) if unit else 1.0)
    return Result(case, s.name, stiffer, quantity, reference, unit, error, bound, bool(error <= bound))


def _si(unit: str) -> str:
    return {"ft/s": "m/s", "ft": "m", "deg": "rad", "rad": "rad", "Hz": "Hz", "lbf": "N"}[unit]


def all_members(
    case: str, quantity: str, reference: str, unit: str, differences: Sequence[ArrayLike], bound: float
) -> list[Result]:
    """Lines about all flights of a case whose error doesn't come from the risers' elasticity."""
    return [single(case, b, quantity, reference, unit, d, bound) for b, d in enumerate(differences)]


def elastic(
    case: str, quantity: str, reference: str, unit: str, differences: Sequence[ArrayLike], bound: float
) -> list[Result]:
    """Lines about all flights of a case whose error comes from the risers' elasticity alone: it must fall as 1/k.

    Args:
        case: Name of the case.
        quantity: What is compared.
        reference: What with; its risers are rigid.
        unit: Of the bound.
        differences: From the reference, one for each of `MEMBERS`, SI.
        bound: With nominal risers [`unit`]; a tenth of it with risers ten times as stiff.
    """
    lines = []
    for b, (s, stiffer) in enumerate(MEMBERS):
        lines.append(single(case, b, quantity, reference, unit, differences[b], bound / stiffer))
        if stiffer != 1.0:
            with np.errstate(all="ignore"):  # a broken simulation gives NaN, which no bound admits
                error = float(np.abs(_rms(differences[b - 1]) / _rms(differences[b]) - _RATIO))
            name, words = f"{quantity}: error by 1/k", "ratio of rms errors 10"
            lines.append(Result(case, s.name, None, name, words, "", error, _RATIO_BOUND, error <= _RATIO_BOUND))
    return lines


def unturned(case: str, flown: Flown) -> Result:
    """The line that says that a capsule whose risers meet at its centre of mass hasn't turned at all."""
    error = _largest(flown.states[:, 6:13] - flown.states[:1, 6:13])
    name = "attitude and rate of the capsule"
    return Result(case, "both", None, name, "constant", "", error, 0.0, error == 0.0)


def table(results: Sequence[Result]) -> list[str]:
    """Lines of a table, the heading first."""
    heading = ("case", "set", "k, c", "quantity", "reference", "error", "bound", "unit", "")
    rows = [heading] + [
        (
            r.case,
            r.set,
            "" if r.stiffness is None else f"x {r.stiffness:g}",
            r.quantity,
            r.reference,
            f"{r.error:.2e}",
            f"{r.bound:.2e}",
            r.unit,
            "pass" if r.passed else "FAIL",
        )
        for r in results
    ]
    widths = [max(len(row[i]) for row in rows) for i in range(len(heading))]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
