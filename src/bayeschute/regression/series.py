"""Rows of a regression sorted into time series on uniform grids, gaps kept in their place."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from bayeschute.core.errors import Fault, InputError
from bayeschute.regression.problem import row_labels

Labels = Sequence[Hashable] | np.ndarray | None


class Series(NamedTuple):
    """Time series of one group, on a common uniform grid of times.

    Attributes:
        rows: For each component its rows, counted among the rows in use.
        places: For each component the grid places of these rows.
        length: Number of grid places from the first row in use to the last.
    """

    rows: tuple[Int[np.ndarray, " n"], ...]
    places: tuple[Int[np.ndarray, " n"], ...]
    length: int

    def on_grid(self, values: Float[np.ndarray, "N k"]) -> Float[np.ndarray, "m L k"]:
        """Rows laid on the grid, zeros in the gaps."""
        out = np.zeros((len(self.rows), self.length, values.shape[1]))
        for i, (rows, places) in enumerate(zip(self.rows, self.places, strict=True)):
            out[i, places] = values[rows]
        return out


def time_series(
    used: Bool[np.ndarray, " N"],
    *,
    blocks: Labels = None,
    groups: Labels = None,
    time: Float[np.ndarray, " N"] | None = None,
) -> tuple[Series, ...]:
    """Sort rows into time series on uniform grids.

    Args:
        used: Rows in use; the others are gaps.
        blocks: Time series of each row; rows of one series stand in order of time. None: one series.
        groups: Label of each row; series with the same label are simultaneous components. None: none are.
        time: Time of each row [s]; uniform apart from gaps. None: every row of a series, used or not, is one step.

    Returns:
        One entry per group.

    Raises:
        InputError: For labels of the wrong length, a series in two groups, simultaneous series of unequal length
            without times, or times that don't rise on a uniform grid.
    """
    N = used.size
    block = row_labels(blocks, N, "blocks")
    group = block if groups is None else row_labels(groups, N, "groups")
    owner: dict[int, list[int]] = {}
    for b in range(int(block.max(initial=0)) + 1):
        inside = np.unique(group[block == b])
        if inside.size != 1:
            raise InputError(Fault("groups", f"block {b} in {inside.size} groups", "each block in one group"))
        owner.setdefault(int(inside[0]), []).append(b)
    number = np.cumsum(used) - 1
    found = []
    for members in owner.values():
        everywhere = [np.flatnonzero(block == b) for b in members]
        places = _places(everywhere, None if time is None else np.asarray(time, dtype=np.float64))
        keep = [used[rows] for rows in everywhere]
        present = [p[k] for p, k in zip(places, keep, strict=True)]
        filled = np.concatenate(present)
        first, last = (int(filled.min()), int(filled.max())) if filled.size else (0, 0)
        found.append(
            Series(
                rows=tuple(number[r[k]] for r, k in zip(everywhere, keep, strict=True)),
                places=tuple(p - first for p in present),
                length=last - first + 1,
            )
        )
    return tuple(found)


def _places(everywhere: list[np.ndarray], time: np.ndarray | None) -> list[np.ndarray]:
    if time is None:
        if len({rows.size for rows in everywhere}) > 1:
            sizes = [int(rows.size) for rows in everywhere]
            raise InputError(
                Fault("groups", f"series of {sizes} rows", "simultaneous series of one length", "Give time.")
            )
        return [np.arange(rows.size) for rows in everywhere]
    t = [time[rows] for rows in everywhere]
    steps = np.concatenate([np.diff(part) for part in t])
    if not all(np.isfinite(part).all() for part in t) or (steps <= 0.0).any():
        raise InputError(Fault("time", "missing or falling times within a block", "rising times", "Sort the rows."))
    dt = float(np.median(steps)) if steps.size else 1.0
    start = min(float(part[0]) for part in t)
    exact = [(part - start) / dt for part in t]
    places = [np.rint(x).astype(np.intp) for x in exact]
    off = max(float(np.max(np.abs(x - p))) for x, p in zip(exact, places, strict=True))
    if off > 0.25 or any((np.diff(p) == 0).any() for p in places):
        raise InputError(Fault("time", f"times off a uniform grid by {off:.2g} steps", "uniform times", "Resample."))
    rows = max(p.size for p in places)
    if max(int(p[-1]) for p in places) > 1000 * rows + 1000:
        raise InputError(Fault("time", "a series that is almost all gap", "denser series", "Split it into blocks."))
    return places
