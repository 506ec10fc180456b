"""Winds of landings: members of an ensemble, errors of a forecast, layers of shear, gusts, turbulence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from bayeschute.landing.turbulence import Turbulence, field, field_size

Array = NDArray[np.float64]
STEP = 2.0  # [m] between the altitudes at which winds are held
_NODES = 24  # of the error of a forecast, from the ground to the top


@dataclass(frozen=True)
class Profile:
    """One wind by altitude, linear between altitudes (K,) [m] and held beyond; wind (K, 3), NED [m/s]."""

    altitude: Array
    wind: Array


@dataclass(frozen=True)
class Event:
    """A layer of shear or a gust at an altitude of its own in every landing that has it.

    Attributes:
        kind: ``shear`` (the wind below differs from that above by `change`) or ``gust``, (1 - cos)/2 in the altitude.
        middle: Mean altitude of its middle [m].
        middle_sd: Standard deviation of that [m].
        thickness: [m].
        change: Largest change of the wind, NED [m/s].
        probability: That a landing meets it [1].
    """

    kind: str
    middle: float
    middle_sd: float
    thickness: float
    change: tuple[float, float, float]
    probability: float = 1.0

    def at(self, altitude: Array, middle: Array) -> Array:
        """Share of the change (K, B) at altitudes (K,), its middle at altitudes (B,) [m]."""
        below = np.clip((middle - altitude[:, None]) / self.thickness + 0.5, 0.0, 1.0)
        return below if self.kind == "shear" else 0.5 * (1.0 - np.cos(2.0 * np.pi * below))


@dataclass(frozen=True)
class WindPlan:
    """What winds are drawn from.

    Attributes:
        profiles: Members, equally likely; none: calm.
        scale_sd: Standard deviation of the logarithm of a factor on a member's wind [1].
        any_direction: Whether a member is turned to any azimuth, events with it.
        error_sd: Standard deviation of each horizontal component of a member's error [m/s].
        error_length: Its length of correlation in altitude [m].
        events: Shears and gusts.
        turbulence: Gusts; None: those that the posterior knows, of the drops it is from.
    """

    profiles: tuple[Profile, ...] = ()
    scale_sd: float = 0.0
    any_direction: bool = False
    error_sd: float = 0.0
    error_length: float = 500.0
    events: tuple[Event, ...] = ()
    turbulence: Turbulence | None = None

    @property
    def size(self) -> int:
        """Standard normal numbers of one wind: member, factor, azimuth, error, events."""
        return 3 + 2 * _NODES + 2 * len(self.events)

    def member(self, u: Array) -> NDArray[np.int64]:
        """Which profile winds (size, B) follow; 0 where there is none."""
        return np.minimum((ndtr(u[0]) * len(self.profiles)).astype(int), max(len(self.profiles) - 1, 0))

    def by_altitude(self, u: Array, altitude: Array) -> Array:
        """Winds without turbulence.

        Args:
            u: Standard normal numbers (size, B).
            altitude: Uniform, increasing (K,) [m].

        Returns:
            (K, 3, B), NED [m/s].
        """
        count = u.shape[1]
        made = np.zeros((altitude.size, 3, count))
        if self.profiles:
            each = np.stack(
                [np.stack([np.interp(altitude, p.altitude, v) for v in p.wind.T], axis=1) for p in self.profiles]
            )
            made += np.moveaxis(each[self.member(u)], 0, 2) * np.exp(self.scale_sd * u[1])
        if self.error_sd > 0.0:
            made[:, :2] += self._error(u[3 : 3 + 2 * _NODES].reshape(_NODES, 2, count), altitude)
        for i, event in enumerate(self.events):
            place, chance = u[3 + 2 * _NODES + 2 * i], ndtr(u[4 + 2 * _NODES + 2 * i])
            share = event.at(altitude, event.middle + event.middle_sd * place) * (chance <= event.probability)
            made += share[:, None] * np.array(event.change)[:, None]
        if self.any_direction:
            turn = 2.0 * np.pi * ndtr(u[2])
            c, s = np.cos(turn), np.sin(turn)
            north, east = made[:, 0].copy(), made[:, 1].copy()
            made[:, 0], made[:, 1] = c * north - s * east, s * north + c * east
        return made

    def _error(self, z: Array, altitude: Array) -> Array:
        """Error of a member (K, 2, B): Ornstein-Uhlenbeck through `_NODES` altitudes, linear between [m/s]."""
        nodes = np.linspace(altitude[0], altitude[-1], _NODES)
        keep = np.exp(-(nodes[1] - nodes[0]) / self.error_length)
        rows = [z[0]]
        for row in z[1:]:
            rows.append(keep * rows[-1] + np.sqrt(1.0 - keep**2) * row)
        values = self.error_sd * np.stack(rows)
        place = (altitude - nodes[0]) / (nodes[1] - nodes[0])
        at = np.minimum(place.astype(int), _NODES - 2)
        within = (place - at)[:, None, None]
        return (1.0 - within) * values[at] + within * values[at + 1]

    def gust_shape(self, span: float) -> tuple[int, int]:
        """Shape of the standard normal numbers of one landing's turbulence over a span [m]; (0, 0) without."""
        return (3, field_size(self.turbulence, span, STEP)) if self.turbulence is not None else (0, 0)

    def gusts(self, z: Array, count: int) -> Array:
        """Turbulence (K, 3, B) at the first `count` altitudes, from normal numbers (3, N, B) [m/s]."""
        assert self.turbulence is not None, "without turbulence there are no gusts to draw"
        return field(self.turbulence, z, STEP)[:count]


def shear_of(wind: Array) -> Array:
    """Greatest change of the horizontal wind over 100 m of altitude (B,) [m/s], of winds (K, 3, B) on the grid."""
    apart = max(int(round(100.0 / STEP)), 1)
    change = wind[apart:, :2] - wind[:-apart, :2]
    return np.sqrt((change**2).sum(axis=1)).max(axis=0) if len(change) else np.zeros(wind.shape[2])
