"""A posterior's density beside Laplace's approximation at points."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.posterior.beyond_linear import laplace
from bayeschute.posterior.beyond_linear.laplace import Progress
from bayeschute.posterior.felt_axes import apart, groups
from bayeschute.posterior.marginal import (
    Marginal,
    flight_half_squares,
    in_batches,
    in_range,
    prior_residuals,
)

Array = NDArray[np.float64]


class Compared(NamedTuple):
    """Minus the log density at points less that at the centre, of a posterior and by Laplace's approximation there.

    Attributes:
        own: The posterior's (N,).
        laplace: Laplace's (N,); neither is finite where a flight fails.
        in_range: Whether the linear models tell anything there (N,).
        missing: What the posterior's lacks, by group of flights (G, N): see `felt_axes.groups`.
    """

    own: Array
    laplace: Array
    in_range: NDArray[np.bool_]
    missing: Array

    @classmethod
    def none(cls, parts: int) -> Compared:
        """Of no points, for so many groups of flights."""
        return cls(np.zeros(0), np.zeros(0), np.zeros(0, bool), np.zeros((parts, 0)))

    @property
    def known(self) -> NDArray[np.bool_]:
        """Where no flight fails (N,)."""
        return np.isfinite(self.own) & np.isfinite(self.laplace)

    @property
    def errors(self) -> Array:
        """What the posterior's lacks (N,)."""
        return self.laplace - self.own

    def and_at(self, more: Compared) -> Compared:
        """At further points, too."""
        return Compared(*(np.concatenate(both, axis=-1) for both in zip(self, more, strict=True)))


def compared(marginal: Marginal, points: Array, progress: Progress | None = None) -> Compared:
    """A posterior's density beside Laplace's approximation at points.

    Args:
        marginal: From `corrected`.
        points: Standard coordinates (N, P).
        progress: See `Progress`.
    """
    here = laplace.at(marginal, np.zeros(points.shape[1]))
    there = laplace.at_each(lambda point: laplace.at(marginal, point).bare(), points, progress=progress)
    places = np.vstack([0.0 * points[:1], points]).T
    own, prices = np.zeros((2, len(marginal.flights), len(points)))
    for number in range(len(own)):
        squares, price = in_batches(partial(flight_half_squares, marginal, number), places)
        own[number], prices[number] = squares[1:] - squares[0], price[1:]
    exact = np.array([one.squares + one.determinants - here.squares - here.determinants for one in there]).T
    parts, before = groups(marginal), 0.5 * np.sum(prior_residuals(marginal, places) ** 2, axis=0)
    followed, shares = np.asarray(marginal.followed(points.T)), apart(marginal.correction, parts)
    corrections = [one.at(followed[g.axes]) for one, g in zip(shares, parts, strict=True)]
    own = np.array([own[list(g.flights)].sum(axis=0) + more for g, more in zip(parts, corrections, strict=True)])
    exact = np.array([exact[list(g.flights)].sum(axis=0) for g in parts])
    more = before[1:] - before[0]
    return Compared(more + own.sum(axis=0), more + exact.sum(axis=0), in_range(prices), exact - own)
