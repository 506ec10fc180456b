"""Flights of another program, each set in columns, units, axes and a clock of its own, as records of this one.

Everything comes out in SI: positions and winds in NED, attitude as the quaternion (scalar first) that turns the NED
axes onto the body axes, the body's x axis up, away from the heat shield. The clock stays the record's own, in seconds,
since true histories are told on it. What the sets are is told by ``README.md`` beside them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import comb
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.signal import savgol_filter

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

FOOT, POUND_FORCE, SLUG, KNOT = 0.3048, 4.4482216152605, 14.593902937206364, 1852.0 / 3600.0
G0, DEGREE = 9.80665, np.pi / 180.0
GAS_CONSTANT, SEA_LEVEL_DENSITY, FREEZING = 287.05, 1.225, 273.15  # [J/(kg K)], [kg/m^3], [K]
_HALF = float(np.sqrt(0.5))
_NED_OF_ENU = np.array([0.0, _HALF, _HALF, 0.0])  # half a turn about north-east
_DOWN_OF_UP = np.array([_HALF, 0.0, _HALF, 0.0])  # a vector along our (x, y, z) is along (z, y, -x) of a body z down
_SMOOTHING = 1.0  # length of the local quadratics that tell a rate from the attitude [s]
_ORDER = 4  # of the differences that tell a channel's scatter


class Columns(NamedTuple):
    """Columns of a file, and what their numbers are multiplied with for SI; None for one that isn't there."""

    names: tuple[str | None, ...]
    factor: float = 1.0


def _all(pattern: str, labels: str, factor: float = 1.0) -> Columns:
    return Columns(tuple(pattern.format(label) for label in labels.split()), factor)


@dataclass(frozen=True)
class Layout:
    """How the files of a set are written.

    Attributes:
        time: On the record's clock.
        position: Along the set's earth axes.
        velocity: Likewise.
        attitude: Quaternion, scalar first whatever the order in the file; or yaw, pitch and roll.
        rate: About the body's axes.
        force: Specific force along them.
        canopy: Position of a canopy, ``#`` for its name.
        canopies: Names of the canopies.
        wind: Wind along the first two earth axes; None: the profile tells it.
        density: None: from pressure [hPa] and temperature [deg C], in the columns `air`.
        air: These two.
        tension: Of a canopy's load cell, ``#`` for its name; None: none.
        profile: Altitude, in metres by its factor, and the winds along the first two earth axes.
        profile_wind: Factor of these.
        enu: Whether the earth axes are east, north, up, not north, east, down.
        body_down: Whether the body's axes are forward, right, down, not up, across, across.
    """

    time: Columns
    position: Columns
    velocity: Columns
    attitude: Columns
    rate: Columns
    force: Columns
    canopy: Columns
    canopies: tuple[str, ...]
    profile: Columns
    profile_wind: float = 1.0
    wind: Columns | None = None
    density: Columns | None = None
    air: tuple[str, str] = ("", "")
    tension: Columns | None = None
    enu: bool = False
    body_down: bool = False


LAYOUTS: Mapping[str, Layout] = {
    "P": Layout(
        time=Columns(("time_s",)),
        position=_all("capsule_{}_m", "x y z"),
        velocity=_all("capsule_v{}_mps", "x y z"),
        attitude=_all("quat_{}", "w x y z"),
        rate=_all("omega_{}_radps", "x y z"),
        force=_all("accel_{}_mps2", "x y z"),
        canopy=_all("main#_{}_m", "x y z"),
        canopies=("1", "2"),
        profile=Columns(("altitude_msl_m", "wind_x_mps", "wind_y_mps")),
        wind=_all("wind_{}_mps", "x y"),
        density=Columns(("density_kgpm3",)),
        tension=Columns(("load#_kN",), 1e3),
    ),
    "Q": Layout(
        time=Columns(("TIME_S",)),
        position=_all("CAP_P{}_FT", "N E D", FOOT),
        velocity=_all("CAP_V{}_FPS", "N E D", FOOT),
        attitude=_all("Q_{}", "S X Y Z"),
        rate=_all("{}_DPS", "P Q R", DEGREE),
        force=_all("A{}_G", "X Y Z", G0),
        canopy=_all("MAIN#_P{}_FT", "N E D", FOOT),
        canopies=("1", "2"),
        profile=Columns(("ALT_FT", "WIND_N_FPS", "WIND_E_FPS"), FOOT),
        profile_wind=FOOT,
        wind=_all("WIND_{}_FPS", "N E", FOOT),
        density=Columns(("RHO_SLUGPFT3",), SLUG / FOOT**3),
        tension=Columns(("LOAD#_LBF",), POUND_FORCE),
    ),
    "R": Layout(
        time=Columns(("t",)),
        position=_all("cg_{}_m", "east north up"),
        velocity=_all("cg_v{}_mps", "e n u"),
        attitude=_all("att_q{}", "w x y z"),
        rate=_all("gyro_{}_degps", "x y z", DEGREE),
        force=_all("sf_{}_mps2", "x y z"),
        canopy=_all("main_#_{}_m", "east north up"),
        canopies=("a", "b", "c"),
        profile=Columns(("alt_up_m", "air_ve_mps", "air_vn_mps")),
        wind=_all("air_v{}_mps", "e n"),
        air=("static_pressure_hPa", "air_temperature_degC"),
        tension=Columns(("riser_#_N",)),
        enu=True,
    ),
    "S": Layout(
        time=Columns(("gps_s",)),
        position=_all("{}_m", "north east down"),
        velocity=_all("vel_{}_kmph", "north east down", 1.0 / 3.6),
        attitude=_all("{}_deg", "yaw pitch roll", DEGREE),
        rate=_all("rate_{}_degps", "x y z", DEGREE),
        force=_all("acc_{}_mps2", "x y z"),
        canopy=_all("canopy_{}_m", "north east down"),
        canopies=("",),
        profile=Columns(("altitude_ft", "wind_north_kt", "wind_east_kt"), FOOT),
        profile_wind=KNOT,
        wind=_all("wind_{}_kt", "north east", KNOT),
        density=Columns(("density_gpm3",), 1e-3),
        tension=Columns(("riser_load_kgf",), G0),
        body_down=True,
    ),
    "T": Layout(
        time=Columns(("t_ms",), 1e-3),
        position=_all("pos_{}_m", "n e d"),
        velocity=_all("vel_{}_mps", "n e d"),
        attitude=_all("q_{}", "w x y z"),
        rate=_all("gyr_{}_degps", "x y z", DEGREE),
        force=_all("acc_{}_g", "x y z", G0),
        canopy=_all("canopy_{}_m", "n e d"),
        canopies=("",),
        profile=Columns(("alt_m", "wind_n_mps", "wind_e_mps")),
        air=("baro_hPa", "temp_degC"),
        body_down=True,
    ),
    "U": Layout(
        time=Columns(("time",)),
        position=_all("p{}", "n e d"),
        velocity=_all("v{}", "n e d"),
        attitude=_all("e{}", "0 1 2 3"),
        rate=Columns(("roll_rate", None, "yaw_rate"), DEGREE),
        force=_all("f{}", "x y z"),
        canopy=_all("can#_{}", "n e d"),
        canopies=("1", "2"),
        profile=Columns(("alt", "wn", "we")),
        wind=_all("w{}", "n e"),
        density=Columns(("rho",)),
        tension=Columns(("cell#",)),
    ),
}


@dataclass(frozen=True)
class OtherFlight:
    """A flight in our units and axes; NaN where a sample is missing.

    Attributes:
        name: Such as ``P_1``.
        time: On the record's clock (T,) [s].
        position: Of the centre of mass (T, 3), NED, from mean sea level [m].
        velocity: (T, 3), NED [m/s].
        attitude: Quaternion from NED to body, scalar first, signs without jumps (T, 4).
        rate: Angular, body axes (T, 3) [rad/s].
        force: Specific, body axes (T, 3) [m/s^2].
        canopies: Positions (T, n, 3), NED [m].
        wind: Towards, at the capsule (T, 3), NED [m/s].
        density: (T,) [kg/m^3].
        tension: Of the load cells (T, n) [N]; None: none.
        profile: Rows of altitude [m], wind to the north and to the east [m/s], upwards.
        meta: The meta file.
        attach_b: Attach point from the centre of mass, body axes (3,) [m].
        inertia: Tensor about the body's axes (3, 3) [kg m^2].
    """

    name: str
    time: Array
    position: Array
    velocity: Array
    attitude: Array
    rate: Array
    force: Array
    canopies: Array
    wind: Array
    density: Array
    tension: Array | None
    profile: Array
    meta: Mapping[str, Any]
    attach_b: Array
    inertia: Array

    def risers(self) -> Array:
        """From the attach point to the canopies (T, n, 3), NED [m]."""
        attach = self.position + turned(self.attitude, self.attach_b)
        return np.asarray(self.canopies - attach[:, None])

    def quantities(self) -> dict[str, Array]:
        """Swing angle [deg] and sea-level-equivalent descent rate [m/s], as the record shows them (T,)."""
        mean = self.risers().mean(axis=1)
        swing = np.arctan2(np.hypot(mean[:, 0], mean[:, 1]), np.abs(mean[:, 2])) / DEGREE
        return {
            "swing_angle": swing,
            "sea_level_descent_rate": self.velocity[:, 2] * np.sqrt(self.density / SEA_LEVEL_DENSITY),
        }

    def scatter(self) -> dict[str, float]:
        """White noise of the channels that are fitted, by differences of neighbours: [m], [m/s] and [rad]."""
        apart = (self.canopies - self.position[:, None]).reshape(self.time.size, -1)
        each = {"canopy_position": apart, "capsule_velocity": self.velocity}
        found = {name: float(np.median([scatter(x) for x in values.T])) for name, values in each.items()}
        turn = 2.0 * np.sqrt(sum(scatter(x) ** 2 for x in self.attitude.T) / 3.0)
        return found | {"capsule_attitude": float(turn)}


def product(a: Array, b: Array) -> Array:
    """Product of quaternions, scalar first (..., 4): first turn by `b`, then by `a`, as matrices do."""
    w, v = a[..., :1], a[..., 1:]
    u, q = b[..., :1], b[..., 1:]
    return np.concatenate([w * u - np.sum(v * q, axis=-1, keepdims=True), w * q + u * v + np.cross(v, q)], axis=-1)


def turned(attitude: Array, v_b: Array) -> Array:
    """Earth components of vectors given in body axes.

    Args:
        attitude: (T, 4).
        v_b: (T, 3) or (3,).

    Returns:
        (T, 3), in the unit of `v_b`.
    """
    w, q = attitude[:, :1], attitude[:, 1:]
    twice = 2.0 * np.cross(q, np.broadcast_to(v_b, q.shape))
    return np.asarray(v_b + w * twice + np.cross(q, twice))


def of_euler(yaw: Array, pitch: Array, roll: Array) -> Array:
    """Quaternion of the turns about z, then y, then x (T, 4); angles in rad."""
    none = np.zeros_like(yaw)
    about_z = np.stack([np.cos(yaw / 2.0), none, none, np.sin(yaw / 2.0)], axis=-1)
    about_y = np.stack([np.cos(pitch / 2.0), none, np.sin(pitch / 2.0), none], axis=-1)
    about_x = np.stack([np.cos(roll / 2.0), np.sin(roll / 2.0), none, none], axis=-1)
    return product(product(about_z, about_y), about_x)


def without_jumps(q: Array) -> Array:
    """Unit quaternions (T, 4) whose signs go on from sample to sample; gaps stay gaps."""
    made, known = np.array(q), np.isfinite(q).all(axis=1)
    x = made[known] / np.linalg.norm(made[known], axis=1, keepdims=True)
    flips = np.where(np.sum(x[1:] * x[:-1], axis=1) < 0.0, -1.0, 1.0)
    made[known] = x * np.concatenate([[1.0], np.cumprod(flips)])[:, None]
    return made


def rate_of_attitude(q: Array, dt: float, window: float = _SMOOTHING) -> Array:
    """Angular rate, body axes (T, 3) [rad/s], by local quadratics; NaN where the attitude is missing.

    Args:
        q: Attitude without jumps (T, 4).
        dt: Sample interval [s].
        window: Their length [s].
    """
    known, index = np.asarray(np.isfinite(q).all(axis=1)), np.arange(len(q))
    filled = np.stack([np.interp(index, index[known], x[known]) for x in q.T], axis=1)
    change = savgol_filter(filled, 2 * round(0.5 * window / dt) + 1, 2, deriv=1, delta=dt, axis=0)
    turning = 2.0 * product(filled * np.array([1.0, -1.0, -1.0, -1.0]), change)[:, 1:]
    return np.where(known[:, None], turning, np.nan)


def scatter(x: Array) -> float:
    """Standard deviation of the white part of a series, from the median of its fourth differences."""
    difference = np.diff(x[np.isfinite(x)], _ORDER)
    return float(np.median(np.abs(difference)) / 0.6745 / np.sqrt(comb(2 * _ORDER, _ORDER)))


def _values(table: pd.DataFrame, columns: Columns, canopy: str = "") -> Array:
    """Columns in SI (T, C); NaN for those that aren't there."""
    none = np.full(len(table), np.nan)
    found = [none if name is None else table[name.replace("#", canopy)].to_numpy(float) for name in columns.names]
    return columns.factor * np.stack(found, axis=1)


def _earth(values: Array, enu: bool) -> Array:
    """Components along NED of those along a set's earth axes (..., 3)."""
    return np.stack([values[..., 1], values[..., 0], -values[..., 2]], axis=-1) if enu else values


def _body(values: Array, down: bool) -> Array:
    """Components along our body axes of those along a set's (..., 3)."""
    return np.stack([-values[..., 2], values[..., 1], values[..., 0]], axis=-1) if down else values


def _attitude(table: pd.DataFrame, layout: Layout) -> Array:
    raw = _values(table, layout.attitude)
    q = of_euler(*raw.T) if raw.shape[1] == 3 else raw
    q = product(np.broadcast_to(_NED_OF_ENU, q.shape), q) if layout.enu else q
    q = product(q, np.broadcast_to(_DOWN_OF_UP, q.shape)) if layout.body_down else q
    return without_jumps(q)


def _profile(path: Path, layout: Layout) -> Array:
    """Rows of altitude [m], winds to north and east [m/s], upwards."""
    table = pd.read_csv(path)
    altitude, first, second = (table[str(name)].to_numpy(float) for name in layout.profile.names)
    north, east = (second, first) if layout.enu else (first, second)
    rows = np.stack([layout.profile.factor * altitude, layout.profile_wind * north, layout.profile_wind * east], 1)
    return rows[np.argsort(rows[:, 0])]


def _wind(table: pd.DataFrame, layout: Layout, profile: Array, position: Array) -> Array:
    """Wind at the capsule (T, 3), NED [m/s]."""
    if layout.wind is None:
        north, east = (np.interp(-position[:, 2], profile[:, 0], profile[:, k]) for k in (1, 2))
        gone = np.isfinite(position[:, 2])
        return np.where(gone[:, None], np.stack([north, east, np.zeros_like(north)], axis=1), np.nan)
    two = _values(table, layout.wind)
    return _earth(np.concatenate([two, np.zeros((len(two), 1))], axis=1), layout.enu)


def read_flight(data: Path, name: str) -> OtherFlight:
    """A flight of these sets, converted.

    Args:
        data: Folder of the sets.
        name: Such as ``P_1``.
    """
    layout = LAYOUTS[name[0]]
    table = pd.read_csv(data / f"{name}.csv.gz")
    meta = json.loads((data / f"{name}_meta.json").read_text(encoding="utf-8"))
    names = [k for k in layout.canopies if str(layout.canopy.names[0]).replace("#", k) in table]
    time = _values(table, layout.time)[:, 0]
    position = _earth(_values(table, layout.position), layout.enu)
    attitude = _attitude(table, layout)
    rate = _body(_values(table, layout.rate), layout.body_down)
    dead = np.array([not np.isfinite(x).any() for x in rate.T])
    if dead.any():  # a gyro that is dead: the attitude tells that rate
        rate[:, dead] = rate_of_attitude(attitude, float(np.median(np.diff(time))))[:, dead]
    profile = _profile(data / f"{name}_wind_profile.csv", layout)
    if layout.density is not None:
        density = _values(table, layout.density)[:, 0]
    else:
        pressure, temperature = (table[column].to_numpy(float) for column in layout.air)
        density = 100.0 * pressure / (GAS_CONSTANT * (temperature + FREEZING))
    tension = layout.tension
    inertia = np.array(meta["capsule_inertia_kgm2_body_about_cm"], float)
    return OtherFlight(
        name=name,
        time=time,
        position=position,
        velocity=_earth(_values(table, layout.velocity), layout.enu),
        attitude=attitude,
        rate=rate,
        force=_body(_values(table, layout.force), layout.body_down),
        canopies=np.stack([_earth(_values(table, layout.canopy, k), layout.enu) for k in names], axis=1),
        wind=_wind(table, layout, profile, position),
        density=density,
        tension=None if tension is None else np.concatenate([_values(table, tension, k) for k in names], axis=1),
        profile=profile,
        meta=meta,
        attach_b=_body(np.array(meta["attach_point_body_m_from_cm"], float), layout.body_down),
        inertia=_body(_body(inertia, layout.body_down).T, layout.body_down),
    )


def flights_of(data: Path, letter: str) -> list[str]:
    """Names of a set's flights, in order; the first is to be identified."""
    return sorted(path.name.removesuffix(".csv.gz") for path in data.glob(f"{letter}_[0-9].csv.gz"))


def record(flight: OtherFlight, known_for: float | None = None) -> xr.Dataset:
    """A flight as a record of this program.

    Args:
        flight: The flight.
        known_for: Of a flight to be predicted, how much of it is known [s]: all that comes later is blanked but the
            density of the air, and its wind is left to the profile. None: all is known.
    """
    from bayeschute.records.record import make_record

    arrays: dict[str, Any] = {
        "capsule_position": flight.position,
        "capsule_velocity": flight.velocity,
        "capsule_attitude": flight.attitude,
        "capsule_rate": flight.rate,
        "capsule_specific_force": flight.force,
        "canopy_position": flight.canopies,
    }
    if flight.tension is not None:
        arrays["riser_tension"] = flight.tension
    if known_for is None:
        arrays["wind"] = flight.wind
    else:
        later = flight.time > flight.time[0] + known_for + 1e-6
        arrays = {name: np.where(later.reshape(-1, *[1] * (a.ndim - 1)), np.nan, a) for name, a in arrays.items()}
    return make_record(time=flight.time, density=flight.density, **arrays)


def first_seen(flight: OtherFlight, after: float) -> float:
    """First time, so long after the first sample or later, at which every canopy is seen [s]."""
    seen = np.isfinite(flight.canopies).all(axis=(1, 2)) & (flight.time >= flight.time[0] + after - 1e-6)
    return float(flight.time[np.flatnonzero(seen)[0]])


def climatology(flight: OtherFlight, levels: Sequence[float]) -> dict[str, Array]:
    """Quantiles of what a record shows, by quantity: what one would foretell of another flight without a model."""
    return {name: np.nanquantile(values, levels) for name, values in flight.quantities().items()}
