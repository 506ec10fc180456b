"""The surface that landings touch: level ground, a slope, or the sea by linear wave theory.

A long-crested Gaussian sea of one frequency in deep water (Airy's linear theory, as in Lamb, Hydrodynamics, chapter 9):
with s along the way of the waves,

    eta = a cos(phi),   phi = k s - omega t + e,   k = omega^2 / g,

the elevation's amplitude a follows a Rayleigh law and e is uniform, so that eta and its rate are independent and normal
at a point, with standard deviations H_s / 4 and omega H_s / 4. Everything else follows from those two:

    rise   d eta / dt = a omega sin(phi),
    slope  d eta / ds = -a k sin(phi) = -(k / omega) d eta / dt,
    drift of the water along s = a omega cos(phi) = omega eta,

so what rises is the front of a wave, which descends along its way.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from bayeschute.atmosphere.standard import STANDARD_GRAVITY

Array = NDArray[np.float64]
STEEPEST = np.deg2rad(60.0)
"""Angle [rad] beyond which a slope that is drawn is held: steeper ground is a wall."""
_SIZE = 3


@dataclass(frozen=True)
class Waves:
    """A sea of one frequency.

    Attributes:
        height: Significant height, four standard deviations of the elevation [m].
        period: [s].
        direction: Azimuth that waves travel to [rad]; None: any.
    """

    height: float
    period: float
    direction: float | None = None

    @property
    def frequency(self) -> float:
        """Angular frequency [rad/s]."""
        return 2.0 * np.pi / self.period

    @property
    def number(self) -> float:
        """Wave number in deep water [rad/m]."""
        return self.frequency**2 / STANDARD_GRAVITY


class Surface(NamedTuple):
    """The surface where landings touch it, (..., B).

    Attributes:
        gradient: Of its height towards north and east (2, B) [1].
        rise: Rate of its height at a fixed place [m/s].
        drift: Velocity of the water at it to the north and east (2, B) [m/s].
    """

    gradient: Array
    rise: Array
    drift: Array


@dataclass(frozen=True)
class SurfacePlan:
    """What surfaces are drawn from; level and at rest unless said otherwise.

    Attributes:
        slope: Mean and standard deviation of the ground's slope [rad].
        direction: Azimuth of its steepest descent [rad]; None: any.
        waves: In place of a slope; None: ground.
    """

    slope: tuple[float, float] = (0.0, 0.0)
    direction: float | None = None
    waves: Waves | None = None

    @property
    def level(self) -> bool:
        """Whether all of it is level and at rest."""
        return self.waves is None and self.slope == (0.0, 0.0)

    @property
    def size(self) -> int:
        """Standard normal numbers of one surface."""
        return 0 if self.level else _SIZE

    def drawn(self, u: Array) -> Surface:
        """Surfaces from standard normal numbers (size, B): elevation or slope, rise, direction."""
        count = u.shape[1]
        if self.level:
            return Surface(np.zeros((2, count)), np.zeros(count), np.zeros((2, count)))
        to = self.direction if self.waves is None else self.waves.direction
        azimuth = np.full(count, to) if to is not None else 2.0 * np.pi * ndtr(u[2])
        way = np.stack([np.cos(azimuth), np.sin(azimuth)])
        if self.waves is None:
            slope = np.clip(self.slope[0] + self.slope[1] * u[0], -STEEPEST, STEEPEST)
            return Surface(-np.tan(slope) * way, np.zeros(count), np.zeros((2, count)))
        sd, omega = 0.25 * self.waves.height, self.waves.frequency
        elevation, rise = sd * u[0], omega * sd * u[1]
        return Surface(-(self.waves.number / omega) * rise * way, rise, omega * elevation * way)


def against(surface: Surface, velocity: Array, axis: Array) -> dict[str, Array]:
    """Measures of a touchdown against the surface and the water at it.

    The water at the surface stays there: it moves upwards by rise + drift . gradient (kinematic condition), so the
    speed along the normal is the rate at which a point at the capsule's place closes with the surface.

    Args:
        surface: Where each landing touches.
        velocity: Of the capsule, NED (3, B) [m/s].
        axis: Unit vector of the capsule's axis towards its risers, NED (3, B).

    Returns:
        By the names of `measures.MEASURES`, (B,) each.
    """
    steep = np.hypot(*surface.gradient)
    upward = surface.rise + (surface.drift * surface.gradient).sum(axis=0)
    normal = np.stack([-surface.gradient[0], -surface.gradient[1], -np.ones_like(steep)]) / np.sqrt(1.0 + steep**2)
    moving = velocity - np.stack([surface.drift[0], surface.drift[1], -upward])
    into = -(moving * normal).sum(axis=0)
    along = moving + into * normal
    apart = np.cross(axis, normal, axis=0)
    return {
        "normal_speed": into,
        "tangential_speed": np.sqrt((along**2).sum(axis=0)),
        "surface_angle": np.arctan2(np.sqrt((apart**2).sum(axis=0)), (axis * normal).sum(axis=0)),
        "surface_slope": np.arctan(steep),
        "surface_slope_direction": np.where(steep > 0.0, np.arctan2(-surface.gradient[1], -surface.gradient[0]), 0.0),
        "surface_rise": surface.rise,
    }
