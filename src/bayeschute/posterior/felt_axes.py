"""Flights that the same standard coordinates move, and functions of their coordinates alone.

The density of many flights is a sum of functions of what all of them share and of what is each flight's own (see
`Marginal.felt`). Flight by flight it costs in proportion to their number; as one function of all coordinates, products
of axes alone would cost its third power.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.posterior.marginal import Marginal, Quadratic

Array = NDArray[np.float64]


class Group(NamedTuple):
    """Flights that the same standard coordinates move.

    Attributes:
        flights: Their numbers.
        axes: The coordinates (A,).
    """

    flights: tuple[int, ...]
    axes: NDArray[np.intp]


def groups(marginal: Marginal) -> tuple[Group, ...]:
    """All flights, those together that the same coordinates move; without those that none moves."""
    made = dict[bytes, list[int]]()
    for number, row in enumerate(marginal.felt):
        if row.any():
            made.setdefault(row.tobytes(), []).append(number)
    return tuple(Group(tuple(flights), np.flatnonzero(marginal.felt[flights[0]])) for flights in made.values())


def apart(whole: Quadratic, parts: Sequence[Group]) -> list[Quadratic]:
    """Polynomials of the coordinates of groups (A,) whose sum is one of all (P,).

    What several groups share is shared out evenly: their own parts of it are not known.

    Args:
        whole: The polynomial; without terms that no group has.
        parts: The groups.
    """
    slope, curvature = np.asarray(whole.slope), np.asarray(whole.curvature)
    felt = np.zeros((len(parts), len(slope)))
    for row, group in zip(felt, parts, strict=True):
        row[group.axes] = 1.0
    slopes, curvatures = felt.sum(axis=0), felt.T @ felt
    return [
        Quadratic(slope[a] / slopes[a], curvature[np.ix_(a, a)] / curvatures[np.ix_(a, a)])
        for a in (group.axes for group in parts)
    ]


def together(polynomials: Sequence[Quadratic], parts: Sequence[Group], parameters: int) -> Quadratic:
    """The sum of polynomials of the coordinates of groups (A,), as one of all (P,).

    Args:
        polynomials: One per group.
        parts: The groups.
        parameters: Number of all coordinates P.
    """
    slope, curvature = np.zeros(parameters), np.zeros((parameters, parameters))
    for one, group in zip(polynomials, parts, strict=True):
        slope[group.axes] += one.slope
        curvature[np.ix_(group.axes, group.axes)] += one.curvature
    return Quadratic(slope, curvature)
