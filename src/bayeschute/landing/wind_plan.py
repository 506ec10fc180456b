"""Winds of landings: an ensemble, a climatology, errors of a forecast, layers of shear, gusts, turbulence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from bayeschute.landing.climatology import NODES, Scatter, even_walk, walk
from bayeschute.landing.turbulence import Turbulence, field, field_size

Array = NDArray[np.float64]
STEP = 2.0  # [m] between the altitudes at which winds are held


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
        profiles: Members, or means of months; none: calm.
        scale_sd: Standard deviation of the logarithm of a factor on a member's wind [1].
        any_direction: Whether a member is turned to any azimuth, events with it.
        error_sd: Standard deviation of each horizontal component of a member's error [m/s].
        error_length: Its length of correlation in altitude [m].
        events: Shears and gusts.
        turbulence: Gusts; None: those that the posterior knows, of the drops it is from.
        weights: How likely each profile is, in proportion; none: all equally.
        scatter: Of a wind about each profile; none: members are winds themselves.
        scatter_length: Its length of correlation in altitude [m].
    """

    profiles: tuple[Profile, ...] = ()
    scale_sd: float = 0.0
    any_direction: bool = False
    error_sd: float = 0.0
    error_length: float = 500.0
    events: tuple[Event, ...] = ()
    turbulence: Turbulence | None = None
    weights: tuple[float, ...] = ()
    scatter: tuple[Scatter, ...] = ()
    scatter_length: float = 1000.0

    @property
    def size(self) -> int:
        """Standard normal numbers of one wind: member, factor, azimuth, error, scatter, events."""
        return self._before_events + 2 * len(self.events)

    @property
    def _before_events(self) -> int:
        return 3 + (4 if self.scatter else 2) * NODES

    def member(self, u: Array) -> NDArray[np.int64]:
        """Which profile winds (size, B) follow; 0 where there is none."""
        last = max(len(self.profiles) - 1, 0)
        if self.weights:
            upto = np.cumsum(self.weights) / np.sum(self.weights)
            return np.minimum(np.searchsorted(upto, ndtr(u[0]), side="right"), last)
        return np.minimum((ndtr(u[0]) * len(self.profiles)).astype(int), last)

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
        if self.scatter:
            made[:, :2] += self._scattered(u, altitude) * np.exp(self.scale_sd * u[1])
        if self.error_sd > 0.0:
            z = u[3 : 3 + 2 * NODES].reshape(NODES, 2, count)
            made[:, :2] += walk(z, altitude, self.error_length, self.error_sd)
        for i, event in enumerate(self.events):
            place, chance = u[self._before_events + 2 * i], ndtr(u[self._before_events + 2 * i + 1])
            share = event.at(altitude, event.middle + event.middle_sd * place) * (chance <= event.probability)
            made += share[:, None] * np.array(event.change)[:, None]
        if self.any_direction:
            turn = 2.0 * np.pi * ndtr(u[2])
            c, s = np.cos(turn), np.sin(turn)
            north, east = made[:, 0].copy(), made[:, 1].copy()
            made[:, 0], made[:, 1] = c * north - s * east, s * north + c * east
        return made

    def _scattered(self, u: Array, altitude: Array) -> Array:
        """Deviation of winds (size, B) from their members (K, 2, B) [m/s]."""
        z = u[3 + 2 * NODES : self._before_events].reshape(NODES, 2, -1)
        roots = np.stack([one.roots(altitude) for one in self.scatter])
        return np.einsum("bkij,kjb->kib", roots[self.member(u)], even_walk(z, altitude, self.scatter_length))

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
