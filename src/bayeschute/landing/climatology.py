"""Winds of a climatology: the scatter of a month's winds about their mean, as a Gaussian process in altitude.

At every altitude the horizontal wind is bivariate normal. Between altitudes a distance d apart the standardised wind is
correlated by exp(-d / L), as an Ornstein-Uhlenbeck process is: it differs over d by sd sqrt(2 (1 - exp(-d / L))) rms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
NODES = 24
"""Altitudes of a process, from the ground to the top; it is linear between them."""
DAYS = (31.0, 28.2425, 31.0, 30.0, 31.0, 30.0, 31.0, 31.0, 30.0, 31.0, 30.0, 31.0)
"""Days of the months, over the leap years of the Gregorian calendar."""


@dataclass(frozen=True)
class Scatter:
    """Scatter of the horizontal wind about a profile, linear between altitudes and held beyond.

    Attributes:
        altitude: Increasing (K,) [m].
        sd: Standard deviations to the north and east (K, 2) [m/s].
        correlation: Of north and east (K,) [1].
    """

    altitude: Array
    sd: Array
    correlation: Array

    def roots(self, altitude: Array) -> Array:
        """Cholesky factors (K, 2, 2) of the wind's covariance at altitudes (K,) [m/s]."""
        north, east = (np.interp(altitude, self.altitude, values) for values in self.sd.T)
        r = np.interp(altitude, self.altitude, self.correlation)
        return np.stack([np.stack([north, 0.0 * r], 1), np.stack([r * east, np.sqrt(1.0 - r**2) * east], 1)], axis=1)


def walk(z: Array, altitude: Array, length: float, sd: float = 1.0) -> Array:
    """Ornstein-Uhlenbeck process through `NODES` altitudes, linear between.

    Args:
        z: Independent standard normal numbers (NODES, 2, B).
        altitude: Uniform, increasing (K,) [m].
        length: Of correlation [m].
        sd: At the nodes.

    Returns:
        (K, 2, B), in the unit of `sd`.
    """
    spacing, at, share = _between(altitude)
    keep = np.exp(-spacing / length)
    rows = [z[0]]
    for row in z[1:]:
        rows.append(keep * rows[-1] + np.sqrt(1.0 - keep**2) * row)
    values = sd * np.stack(rows)
    within = share[:, None, None]
    return np.asarray((1.0 - within) * values[at] + within * values[at + 1])


def even_walk(z: Array, altitude: Array, length: float) -> Array:
    """As `walk`, of variance 1 between the nodes, too, where a line through both of them has less."""
    spacing, _, share = _between(altitude)
    left = np.sqrt((1.0 - share) ** 2 + share**2 + 2.0 * share * (1.0 - share) * np.exp(-spacing / length))
    return walk(z, altitude, length) / left[:, None, None]


def _between(altitude: Array) -> tuple[float, NDArray[np.int64], Array]:
    """Distance of nodes [m], and for each altitude the node below it and the share of the way to the next."""
    nodes = np.linspace(altitude[0], altitude[-1], NODES)
    place = (altitude - nodes[0]) / (nodes[1] - nodes[0])
    at = np.minimum(place.astype(int), NODES - 2)
    return float(nodes[1] - nodes[0]), at, place - at
