"""Wind of a virtual drop: a profile with layers of shear, a time history, gusts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayeschute.atmosphere.wind_field import WindField, wind_field

Array = NDArray[np.float64]
Velocity = tuple[float, float, float]


@dataclass(frozen=True)
class ShearLayer:
    """A layer across which the wind changes linearly.

    Attributes:
        middle: Altitude [m].
        thickness: > 0 [m].
        change: Wind below the layer less wind above it, NED [m/s].
    """

    middle: float
    thickness: float
    change: Velocity

    @property
    def edges(self) -> tuple[float, float]:
        """Altitudes of its lower and upper edge [m]."""
        return self.middle - 0.5 * self.thickness, self.middle + 0.5 * self.thickness

    def at(self, altitude: Array) -> Array:
        """Its share of the wind (..., 3) at altitudes (...) [m/s]."""
        return np.clip((self.edges[1] - altitude) / self.thickness, 0.0, 1.0)[..., None] * np.array(self.change)


@dataclass(frozen=True)
class WindProfile:
    """Wind by altitude, constant beyond its ends.

    Attributes:
        altitude: [m].
        north: Northward velocity of the air [m/s].
        east: Eastward [m/s].
        down: Downward [m/s]; empty: none.
        layers: Layers of shear; they add up.
    """

    altitude: tuple[float, ...] = (0.0, 1.0)
    north: tuple[float, ...] = (0.0, 0.0)
    east: tuple[float, ...] = (0.0, 0.0)
    down: tuple[float, ...] = ()
    layers: tuple[ShearLayer, ...] = ()

    def at(self, altitude: Array) -> Array:
        """Wind (..., 3) at altitudes (...), NED [m/s]."""
        rows = [np.interp(altitude, self.altitude, v) for v in (self.north, self.east)]
        rows.append(np.interp(altitude, self.altitude, self.down) if self.down else np.zeros_like(rows[0]))
        wind = np.stack(rows, axis=-1)
        for layer in self.layers:
            wind = wind + layer.at(altitude)
        return wind

    def nodes(self) -> Array:
        """Altitudes between which the wind is linear, two at least, increasing [m]."""
        nodes = np.unique([*self.altitude, *(edge for layer in self.layers for edge in layer.edges)])
        return nodes if nodes.size > 1 else nodes + np.array([0.0, 1.0])

    def field(self, origin: float = 0.0) -> WindField:
        """The same wind, evaluated at the altitude of each body.

        Args:
            origin: Altitude of the origin of the bodies' positions [m].
        """
        nodes = self.nodes()
        return wind_field(nodes - origin, self.at(nodes))


@dataclass(frozen=True)
class WindHistory:
    """Wind by time, the same at all altitudes: times since the first sample [s] and winds (T, 3), NED [m/s]."""

    time: tuple[float, ...]
    wind: tuple[Velocity, ...]

    def at(self, time: Array) -> Array:
        """Wind (S, 3) at times (S,) [s], linear between, constant beyond the ends."""
        return np.stack([np.interp(time, self.time, v) for v in np.array(self.wind).T], axis=-1)


@dataclass(frozen=True)
class Gust:
    """A gust (1 - cos)/2: start [s], duration [s], largest change of the wind, NED [m/s]."""

    start: float
    duration: float
    change: Velocity

    def at(self, time: Array) -> Array:
        """Its share of the wind (T, 3) [m/s]."""
        share = np.clip((time - self.start) / self.duration, 0.0, 1.0)
        return 0.5 * (1.0 - np.cos(2.0 * np.pi * share))[:, None] * np.array(self.change)
