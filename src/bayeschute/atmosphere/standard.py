"""US Standard Atmosphere 1976 up to 32 km: temperature, pressure and density by geometric altitude."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayeschute.core.errors import Fault, InputError

Array = NDArray[np.float64]

STANDARD_GRAVITY = 9.80665  # [m/s^2]
SEA_LEVEL_DENSITY = 1.225  # [kg/m^3], US Standard Atmosphere 1976
SEA_LEVEL_PRESSURE = 101325.0  # [Pa]
GAS_CONSTANT_DRY_AIR = 287.05287  # [J/(kg K)], 8314.32 / 28.9644 of the 1976 standard
LOWEST, HIGHEST = -5000.0, 32000.0  # geometric altitudes covered [m]

_EARTH_RADIUS = 6356766.0  # [m], of the standard's geopotential
_BASE = np.array([0.0, 11000.0, 20000.0])  # geopotential altitude of the layers [m]
_LAPSE = np.array([-0.0065, 0.0, 0.001])  # [K/m]
_HYDROSTATIC = STANDARD_GRAVITY / GAS_CONSTANT_DRY_AIR  # [K/m]


def _layer_pressure(height: Array, base: float, temperature: float, pressure: float, lapse: float) -> Array:
    """Pressure in a layer of constant lapse rate, from its base [Pa]."""
    if lapse == 0.0:
        return np.asarray(pressure * np.exp(-_HYDROSTATIC * (height - base) / temperature))
    return np.asarray(pressure * (1.0 + lapse * (height - base) / temperature) ** (-_HYDROSTATIC / lapse))


def _bases() -> tuple[Array, Array]:
    """Temperature [K] and pressure [Pa] at the base of every layer."""
    temperature, pressure = [288.15], [SEA_LEVEL_PRESSURE]
    for i in range(len(_BASE) - 1):
        top = _layer_pressure(_BASE[i + 1], _BASE[i], temperature[i], pressure[i], _LAPSE[i])
        temperature.append(temperature[i] + _LAPSE[i] * (_BASE[i + 1] - _BASE[i]))
        pressure.append(float(top))
    return np.array(temperature), np.array(pressure)


_BASE_TEMPERATURE, _BASE_PRESSURE = _bases()


def _geopotential(altitude: ArrayLike) -> Array:
    """Geopotential from geometric altitude [m]; NaN stays NaN."""
    z = np.asarray(altitude, dtype=float)
    outside = (z < LOWEST) | (z > HIGHEST)
    if np.any(outside):
        raise InputError(
            Fault(
                "standard atmosphere, altitude",
                f"{z[outside].ravel()[0]:g} m",
                f"between {LOWEST:g} and {HIGHEST:g} m",
                "Give a recorded density, or pressure and temperature.",
            )
        )
    return np.asarray(_EARTH_RADIUS * z / (_EARTH_RADIUS + z))


def _layer(height: Array) -> NDArray[np.intp]:
    return np.clip(np.searchsorted(_BASE, np.nan_to_num(height), side="right") - 1, 0, len(_BASE) - 1)


def standard_temperature(altitude: ArrayLike) -> Array:
    """Temperature of the standard atmosphere.

    Args:
        altitude: Geometric altitude above the sea [m], any shape.

    Returns:
        [K], same shape.

    Raises:
        InputError: Below -5 km or above 32 km.
    """
    height = _geopotential(altitude)
    layer = _layer(height)
    return np.asarray(_BASE_TEMPERATURE[layer] + _LAPSE[layer] * (height - _BASE[layer]))


def standard_pressure(altitude: ArrayLike) -> Array:
    """Pressure of the standard atmosphere.

    Args:
        altitude: Geometric altitude above the sea [m], any shape.

    Returns:
        [Pa], same shape.

    Raises:
        InputError: Below -5 km or above 32 km.
    """
    height = _geopotential(altitude)
    layer = _layer(height)
    pressure = np.empty_like(height)
    for i in range(len(_BASE)):
        here = layer == i
        pressure[here] = _layer_pressure(height[here], _BASE[i], _BASE_TEMPERATURE[i], _BASE_PRESSURE[i], _LAPSE[i])
    return pressure


def standard_density(altitude: ArrayLike) -> Array:
    """Density of the standard atmosphere.

    Args:
        altitude: Geometric altitude above the sea [m], any shape.

    Returns:
        [kg/m^3], same shape.

    Raises:
        InputError: Below -5 km or above 32 km.
    """
    return standard_pressure(altitude) / (GAS_CONSTANT_DRY_AIR * standard_temperature(altitude))


def pressure_altitude(pressure: ArrayLike) -> Array:
    """Geometric altitude at which the standard atmosphere has a pressure.

    Args:
        pressure: [Pa], any shape; NaN stays NaN.

    Returns:
        [m], same shape.

    Raises:
        InputError: If a pressure lies outside the standard's altitudes.
    """
    p = np.asarray(pressure, dtype=float)
    low, high = float(standard_pressure(HIGHEST)), float(standard_pressure(LOWEST))
    outside = (p < low) | (p > high)
    if np.any(outside):
        raise InputError(
            Fault("pressure altitude", f"{p[outside].ravel()[0]:g} Pa", f"between {low:.0f} and {high:.0f} Pa")
        )
    layer = np.clip(np.searchsorted(-_BASE_PRESSURE, -np.nan_to_num(p), side="right") - 1, 0, len(_BASE) - 1)
    height = np.empty_like(p)
    for i in range(len(_BASE)):
        here = layer == i
        ratio, temperature, lapse = p[here] / _BASE_PRESSURE[i], _BASE_TEMPERATURE[i], _LAPSE[i]
        if lapse == 0.0:
            rise = -temperature / _HYDROSTATIC * np.log(ratio)
        else:
            rise = temperature / lapse * (ratio ** (-lapse / _HYDROSTATIC) - 1.0)
        height[here] = _BASE[i] + rise
    return np.asarray(_EARTH_RADIUS * height / (_EARTH_RADIUS - height))
