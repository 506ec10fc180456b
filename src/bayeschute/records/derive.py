"""Derived quantities of a log: density, place north and east, descent rate, altitude from pressure."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bayeschute.atmosphere.standard import (
    GAS_CONSTANT_DRY_AIR,
    SEA_LEVEL_DENSITY,
    STANDARD_GRAVITY,
    pressure_altitude,
    standard_density,
)
from bayeschute.core.errors import Fault, InputError
from bayeschute.records.differentiate import savitzky_golay
from bayeschute.records.record import VARIABLES, Repair, repairs, with_repairs

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

_SEMI_MAJOR = 6378137.0  # WGS 84 ellipsoid [m]
_FLATTENING = 1.0 / 298.257223563
_FROM: Mapping[str, tuple[tuple[str, ...], ...]] = MappingProxyType(
    {
        "altitude": (("pressure",), ("capsule_position",)),
        "capsule_position": (("latitude", "longitude", "altitude"),),
        "descent_rate": (("capsule_velocity",), ("altitude",)),
    }
)  # what `derive` makes measured quantities of: the first that are all there
_SMOOTHING = 2.0  # least length of the window that differentiates altitude [s]


def ideal_gas_density(pressure: NDArray, temperature: NDArray) -> Array:
    """Density of dry air, p/(R T); humidity is ignored (it lowers the density by up to 1 %).

    Args:
        pressure: [Pa].
        temperature: [K].

    Returns:
        [kg/m^3].
    """
    return np.asarray(pressure / (GAS_CONSTANT_DRY_AIR * temperature))


def tangent_plane(latitude: NDArray, longitude: NDArray, origin: tuple[float, float], altitude: float = 0.0) -> Array:
    """North and east of an origin, on the plane that touches the WGS 84 ellipsoid there.

    First order in the angles: off by less than 1e-3 of the distance within 5 km of the origin below 80 degrees.

    Args:
        latitude: Geodetic latitude (T,) [rad].
        longitude: (T,) [rad].
        origin: Latitude and longitude of the origin [rad].
        altitude: Altitude of the plane [m].

    Returns:
        (T, 2) [m].
    """
    squared = _FLATTENING * (2.0 - _FLATTENING)  # of the eccentricity
    root = np.sqrt(1.0 - squared * np.sin(origin[0]) ** 2)
    meridian = _SEMI_MAJOR * (1.0 - squared) / root**3 + altitude
    parallel = (_SEMI_MAJOR / root + altitude) * np.cos(origin[0])
    around = np.mod(np.asarray(longitude) - origin[1] + np.pi, 2.0 * np.pi) - np.pi
    return np.stack([(np.asarray(latitude) - origin[0]) * meridian, around * parallel], axis=-1)


def smoothing_window(dt: float, length: float = _SMOOTHING) -> int:
    """Odd number of samples, at least 5, that spans `length` [s]."""
    return max(5, 2 * int(np.ceil(0.5 * length / dt - 1e-9)) + 1)


def descent_rate_from_altitude(altitude: NDArray, dt: float, window: int | None = None) -> Array:
    """Velocity downward by a smooth derivative of altitude.

    Args:
        altitude: (T,) [m].
        dt: Sample interval [s].
        window: Samples of the local quadratic; as many as span 2 s where none are given.

    Returns:
        (T,) [m/s]; NaN where the window touches a NaN.

    Raises:
        InputError: If the record is shorter than the window.
    """
    return -savitzky_golay(altitude, dt, window or smoothing_window(dt))


def sea_level_rate(descent_rate: NDArray, density: NDArray) -> Array:
    """Descent rate at the same dynamic pressure in sea-level air, V_down sqrt(rho/rho_0) [m/s]."""
    return np.asarray(descent_rate * np.sqrt(np.asarray(density) / SEA_LEVEL_DENSITY))


def uniform_interval(time: NDArray, where: str) -> float:
    """The sample interval of a uniform clock [s].

    Raises:
        InputError: If the clock is not uniform.
    """
    step = np.diff(np.asarray(time, dtype=float))
    if step.size == 0 or not np.allclose(step, np.mean(step), rtol=1e-6, atol=1e-9):
        got = f"intervals from {step.min():g} to {step.max():g} s" if step.size else "fewer than two samples"
        raise InputError(Fault(f"{where} time", got, "a uniform rate", "Clean the record first (flight.clean)."))
    return float(np.mean(step))


def _pressure_altitude(pressure: Array, temperature: Array | None) -> Array:
    """Altitude from pressure: hypsometric with recorded temperatures, anchored at the highest pressure."""
    standard = pressure_altitude(pressure)
    if temperature is None:
        return standard
    both = np.flatnonzero(np.isfinite(pressure) & np.isfinite(temperature))
    if both.size < 2:
        return standard
    order = both[np.argsort(-pressure[both], kind="stable")]
    log_p, t = np.log(pressure[order]), temperature[order]
    # Hydrostatic: -dp/p = g dh/(R T).
    rise = np.cumsum(0.5 * (t[1:] + t[:-1]) * -np.diff(log_p)) * (GAS_CONSTANT_DRY_AIR / STANDARD_GRAVITY)
    out = np.full(pressure.shape, np.nan)
    out[order] = standard[order[0]] + np.concatenate([[0.0], rise])
    return out


def _position(
    latitude: Array, longitude: Array, altitude: Array, origin: tuple[float, float] | None
) -> tuple[Array, tuple[float, float]]:
    """North, east and down (T, 3) [m], and the origin used [rad]."""
    if origin is None:
        fixes = np.flatnonzero(np.isfinite(latitude) & np.isfinite(longitude))
        if fixes.size == 0:
            raise InputError(Fault("record", "no fix with latitude and longitude", "at least one, or an origin"))
        origin = float(latitude[fixes[0]]), float(longitude[fixes[0]])
    return np.column_stack([tangent_plane(latitude, longitude, origin), -altitude]), origin


def derive(record: xr.Dataset, origin: tuple[float, float] | None = None) -> xr.Dataset:
    """Add what the record implies and lacks; nothing recorded is replaced.

    In this order: ``altitude`` from pressure (and temperature), ``density`` from pressure and temperature or else from
    the standard atmosphere, ``capsule_position`` from latitude, longitude and altitude (origin at sea level),
    ``descent_rate`` from the recorded vertical velocity or from altitude. Each is listed in ``repairs``.

    Args:
        record: A record at a uniform rate (`bayeschute.records.clean.clean`).
        origin: Latitude and longitude of the origin [rad]; the first fix where none is given.

    Returns:
        The record with further variables.

    Raises:
        InputError: If the rate is not uniform or an altitude is beyond the standard atmosphere where that is needed.
    """
    time = record["time"].values
    dt = uniform_interval(time, "record")
    have: dict[str, Array] = {str(name): record[name].values for name in record.data_vars}
    notes: list[Repair] = []
    added: dict[str, Array] = {}

    def add(name: str, values: Array, detail: str) -> None:
        have[name] = added[name] = values
        finite = np.isfinite(values.reshape(len(values), -1)).all(axis=1)
        notes.append(Repair("derived", name, float(time[0]), float(time[-1]), int(finite.sum()), detail))

    if "altitude" not in have and "pressure" in have:
        how = "hypsometric from pressure and temperature" if "temperature" in have else "pressure altitude"
        values = _pressure_altitude(have["pressure"], have.get("temperature"))
        add("altitude", values, f"{how}, standard atmosphere at the lowest sample")
    if "altitude" not in have and "capsule_position" in have:
        add("altitude", -have["capsule_position"][:, 2], "minus the position downward: origin taken at sea level")
    if "density" not in have and {"pressure", "temperature"} <= set(have):
        add("density", ideal_gas_density(have["pressure"], have["temperature"]), "ideal gas, dry: humidity is ignored")
    elif "density" not in have and "altitude" in have:
        add("density", standard_density(have["altitude"]), "US Standard Atmosphere 1976 at the altitude")
    if "capsule_position" not in have and {"latitude", "longitude", "altitude"} <= set(have):
        values, fix = _position(have["latitude"], have["longitude"], have["altitude"], origin)
        where = f"latitude {np.rad2deg(fix[0]):.6f}, longitude {np.rad2deg(fix[1]):.6f} deg"
        add("capsule_position", values, f"tangent plane at {where}, down from sea level")
    if "descent_rate" not in have and "capsule_velocity" in have:
        add("descent_rate", have["capsule_velocity"][:, 2].copy(), "velocity downward")
    elif "descent_rate" not in have and "altitude" in have:
        window = smoothing_window(dt)
        if len(time) >= window:
            how = f"local quadratics of altitude over {window} samples"
            add("descent_rate", descent_rate_from_altitude(have["altitude"], dt, window), how)
    out = record
    for name, values in added.items():
        variable = VARIABLES[name]
        if "axis" in variable.dims and "axis" not in out.coords:
            out = out.assign_coords(axis=["north", "east", "down"])
        out = out.assign({name: (variable.dims, values, {"units": variable.unit, "long_name": variable.meaning})})
    return with_repairs(out, notes)


def measured(record: xr.Dataset, name: str) -> NDArray[np.bool_]:
    """Which samples of a series are measurements (T,): those that a sample of the instrument lies next to.

    What was interpolated, across a gap or between the samples of a slower series, tells nothing of its own: to fit it
    as well would count one measurement several times. What `derive` made is as good as all that it was made of.

    Args:
        record: A record on a uniform clock.
        name: A variable, with the canopy where it has one (``canopy_position.1``).
    """
    time, notes = record["time"].values.astype(float), repairs(record)
    between, near = 0.5 * (time[1:] + time[:-1]), 1e-6 * float(time[1] - time[0])
    known = np.ones(time.size, dtype=bool)
    for entry in notes:
        if entry.variable not in (name, name.split(".")[0]):
            continue
        if entry.kind == "interpolated":
            known &= (time <= entry.start + near) | (time >= entry.end - near)
        if entry.times:
            known &= np.isin(np.arange(time.size), np.searchsorted(between, entry.times))
    if any((entry.kind, entry.variable) == ("derived", name) for entry in notes):
        sources = [of for of in _FROM.get(name, ()) if all(one in record for one in of)]
        for one in sources[0] if sources else ():
            known &= measured(record, one)
    return known
