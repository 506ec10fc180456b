"""Wind profile by altitude, evaluated at the altitude of every body."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from bayeschute.core.vectors import Component, Vec3


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class WindField:
    """Wind by altitude: linear between nodes, held beyond the ends; K nodes.

    Attributes:
        altitude: Of the nodes (K,), increasing [m].
        lowest: Wind at the first node and below (3,), NED [m/s].
        bend: Change of the wind's slope at every node (K, 3) [1/s].
    """

    altitude: Component
    lowest: Component
    bend: Component

    def at(self, altitude: Component) -> tuple[Vec3, Vec3]:
        """Wind [m/s] and its derivative with altitude [1/s] at altitudes [m] of any shape."""
        tail = (1,) * jnp.ndim(altitude)
        above = altitude - jnp.reshape(jnp.asarray(self.altitude), (-1, *tail))
        height, step = jnp.maximum(above, 0.0), jnp.where(above > 0.0, 1.0, 0.0)
        bends = [jnp.reshape(jnp.asarray(self.bend)[:, i], (-1, *tail)) for i in range(3)]
        wind = [self.lowest[i] + jnp.sum(bends[i] * height, axis=0) for i in range(3)]
        return Vec3(*wind), Vec3(*(jnp.sum(bend * step, axis=0) for bend in bends))


def wind_field(altitude: ArrayLike, wind: ArrayLike) -> WindField:
    """A field through nodes.

    Args:
        altitude: (K,), increasing [m].
        wind: (K, 3), NED [m/s].
    """
    h, w = np.asarray(altitude, float), np.asarray(wind, float)
    slope = np.diff(w, axis=0) / np.diff(h)[:, None]
    edge = np.zeros((1, 3))
    return WindField(h, w[0].copy(), np.diff(np.concatenate([edge, slope, edge]), axis=0))
