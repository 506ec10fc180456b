"""Interface of the samplers, which are independent of parachutes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
LogDensity = Callable[[Array], Array]
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Draws:
    """Draws in standard coordinates.

    Attributes:
        xi: (chain, draw, P).
        log_density: (chain, draw).
        stats: Further per-draw numbers (chain, draw), e.g. ``diverging``, ``acceptance_rate``.
        failed: Evaluations whose simulation was not finite; they were rejected and counted.
        evaluations: Evaluations of the exact density.
        notes: Remarks for the reader, in sentences.
    """

    xi: Array
    log_density: Array
    stats: Mapping[str, Array] = field(default_factory=dict)
    failed: int = 0
    evaluations: int = 0
    notes: tuple[str, ...] = ()


class Counted:
    """A batch log density that turns non-finite values into minus infinity and counts them."""

    def __init__(self, log_density: LogDensity) -> None:
        """Wrap a log density of (P, B) arrays."""
        self._log_density = log_density
        self.failed = 0
        self.evaluations = 0

    def __call__(self, xi: Array) -> Array:
        """Log densities (B,) at (P, B)."""
        value = np.asarray(self._log_density(xi), float)
        bad = ~np.isfinite(value)
        self.failed += int(bad.sum())
        self.evaluations += value.size
        return np.where(bad, -np.inf, value)
