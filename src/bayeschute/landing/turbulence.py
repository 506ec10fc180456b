"""Turbulence along the way down: frozen in the air, stationary, as Gaussian fields of the altitude.

Spectra as in MIL-F-8785C (3.7.1): Dryden and von Karman, two-sided in the space frequency. The way through the air is
nearly vertical, so the vertical gust is the longitudinal one and the horizontal gusts are transverse. An
Ornstein-Uhlenbeck field has an exponential correlation in all components.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
KINDS = ("ou", "dryden", "von-karman")
_KARMAN = 1.339  # so that the longitudinal integral scale is L


class Turbulence(NamedTuple):
    """A field of gusts.

    Attributes:
        kind: One of `KINDS`.
        horizontal: Standard deviation of each horizontal component [m/s].
        vertical: Of the vertical component [m/s].
        horizontal_length: Scale of the horizontal components [m].
        vertical_length: Of the vertical one [m].
    """

    kind: str
    horizontal: float
    vertical: float
    horizontal_length: float
    vertical_length: float


def spectrum(kind: str, longitudinal: bool, length: float, omega: Array) -> Array:
    """Power of a unit-variance component, two-sided: its integral over all frequencies is 1.

    Args:
        kind: One of `KINDS`.
        longitudinal: Whether the component lies along the way.
        length: Scale [m].
        omega: Space frequency [rad/m].

    Returns:
        [m/rad].
    """
    scaled = (length * omega) ** 2
    if kind == "ou" or (kind == "dryden" and longitudinal):
        return length / np.pi / (1.0 + scaled)
    if kind == "dryden":
        return 0.5 * length / np.pi * (1.0 + 3.0 * scaled) / (1.0 + scaled) ** 2
    scaled = scaled * _KARMAN**2
    if longitudinal:
        return length / np.pi / (1.0 + scaled) ** (5.0 / 6.0)
    return 0.5 * length / np.pi * (1.0 + 8.0 / 3.0 * scaled) / (1.0 + scaled) ** (11.0 / 6.0)


def field_size(law: Turbulence, span: float, step: float) -> int:
    """Points of a periodic field of which a stretch [m] shows nothing of the period: even, good for an FFT."""
    wanted = (span + 6.0 * max(law.horizontal_length, law.vertical_length)) / step
    return int(2 ** np.ceil(np.log2(max(wanted, 16.0))))


def field(law: Turbulence, z: Array, step: float) -> Array:
    """Gusts by altitude, NED.

    Each amplitude of the Fourier series has the variance that the spectrum has about its frequency; what lies beyond
    the grid's highest frequency is left out, as a body much larger than the grid averages over it.

    Args:
        law: The field.
        z: Independent standard normal numbers (3, N, ...), N as of `field_size`.
        step: Distance of the grid's points [m].

    Returns:
        (N, 3, ...) [m/s].
    """
    size = z.shape[1]
    omega = np.asarray(2.0 * np.pi * np.fft.rfftfreq(size, step), float)
    band = 2.0 * np.pi / (size * step)
    parts = []
    for axis in range(3):
        up = axis == 2
        length, sd = (law.vertical_length, law.vertical) if up else (law.horizontal_length, law.horizontal)
        amplitude = sd * np.sqrt(spectrum(law.kind, up, length, omega) * band)
        half = size // 2
        tail = (1,) * (z.ndim - 2)
        # A real series: conjugate pairs share their power, constant and highest frequency stand alone.
        waves = np.zeros((half + 1, *z.shape[2:]), complex)
        waves[1:half] = (z[axis, 1:half] + 1j * z[axis, half + 1 : size]) * np.sqrt(0.5)
        waves[0], waves[half] = z[axis, 0], z[axis, half]
        parts.append(np.fft.irfft(waves * amplitude.reshape(-1, *tail), size, axis=0) * size)
    return np.stack(parts, axis=1)
