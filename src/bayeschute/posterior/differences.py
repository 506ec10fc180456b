"""Finite differences about a point in whose neighbourhood a flight may fail."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_SHARES = (1.0, 0.5, 0.25, 0.125)  # of a step that are tried where a flight fails


def beside(values: Callable[[Array], Array], count: int, step: float, of_what: str) -> tuple[Array, Array, Array]:
    """Values at a step to either side along every axis; at a shorter one along an axis on which a flight fails there.

    Args:
        values: From points (N, P) to (N, V); not finite where a flight fails.
        count: Number of axes P.
        step: Length of the step; a half, a quarter or an eighth of it where flights fail.
        of_what: For the error.

    Returns:
        Values at plus and at minus the step (P, V), and the steps (P, 1).

    Raises:
        FloatingPointError: If a flight fails at an eighth of the step too.
    """
    left, found, steps = np.arange(count), dict[int, tuple[Array, Array]](), np.full((count, 1), step)
    for share in _SHARES:
        h, axes = share * step, np.eye(count)[left]
        rows = zip(left.tolist(), *np.split(values(h * np.concatenate([axes, -axes])), 2), strict=True)
        found |= {axis: (up, down) for axis, up, down in rows if np.isfinite([up, down]).all()}
        steps[left], left = h, np.array([axis for axis in left if axis not in found], dtype=int)
        if not left.size:
            up, down = (np.array(side) for side in zip(*(found[axis] for axis in range(count)), strict=True))
            return up, down, steps
    raise FloatingPointError(f"flights beside the optimum fail: {of_what} is not known about it")
