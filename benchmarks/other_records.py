"""Flights of another program, each set in columns, units, axes and a clock of its own, as records of this one.

Everything comes out in SI: positions and winds in NED, attitude as the quaternion (scalar first) that turns the NED
axes onto the body axes, the body's x axis up, away from the heat shield. The clock stays the record's own, in seconds,
since true histories are told on it. What the sets are is told by ``README.md`` beside them.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayeschute.records.angles import unit
from bayeschute.records.foreign.conventions import Conventions
from bayeschute.records.plausibility.evidence import continuous
from bayeschute.records.plausibility.scatter import scatter
from bayeschute.records.reconstruct import to_ned
from bayeschute.records.record import VARIABLES

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

G0, DEGREE = 9.80665, np.pi / 180.0
SEA_LEVEL_DENSITY = 1.225  # [kg/m^3]
_NED, _BODY, _QUATERNION = "north east down", "x y z", "w x y z"


class Group(NamedTuple):
    """Columns of a quantity: its name in the schema, the columns' pattern, what stands in it, unit, components."""

    quantity: str
    pattern: str
    labels: str
    unit: str
    components: str


@dataclass(frozen=True)
class Layout:
    """How the files of a set are written.

    Attributes:
        time: Column and unit of the clock.
        groups: Columns; ``#`` in a pattern stands for the name of a canopy.
        single: Columns of quantities without components: name, unit.
        profile: Columns of altitude and of the winds to north and east, with their units.
        canopies: Names of the canopies.
        conventions: Of `bayeschute.read_record`.
    """

    time: tuple[str, str]
    groups: tuple[Group, ...]
    single: Mapping[str, tuple[str, str]]
    profile: tuple[tuple[str, str], ...]
    canopies: tuple[str, ...] = ("1", "2")
    conventions: Mapping[str, Any] = field(default_factory=dict)

    def columns(self, header: Collection[str]) -> dict[str, tuple[str, str]]:
        """Column map of a file with that header."""
        made = {"time": self.time} | {name: column for name, column in self.single.items()}
        names = [k for k in self.canopies if self._canopy().replace("#", k) in header]
        for group in self.groups:
            labels = group.labels.split() or [""]
            several = list(enumerate(names, 1)) if "canopy" in VARIABLES[group.quantity].dims else [("", "")]
            for number, name in several:
                for label, component in zip(labels, group.components.split() or [""], strict=True):
                    key = ".".join(str(part) for part in (group.quantity, number, component) if part != "")
                    made[key] = (group.pattern.replace("#", name).format(label), group.unit)
        return made

    def _canopy(self) -> str:
        group = next(g for g in self.groups if g.quantity == "canopy_position")
        return group.pattern.format(group.labels.split()[0])


_DOWN = {"body_axes": "-z y x"}  # of a body whose axes are forward, right, down
LAYOUTS: Mapping[str, Layout] = {
    "P": Layout(
        time=("time_s", "s"),
        groups=(
            Group("capsule_position", "capsule_{}_m", "x y z", "m", _NED),
            Group("capsule_velocity", "capsule_v{}_mps", "x y z", "m/s", _NED),
            Group("capsule_attitude", "quat_{}", "w x y z", "1", _QUATERNION),
            Group("capsule_rate", "omega_{}_radps", "x y z", "rad/s", _BODY),
            Group("capsule_specific_force", "accel_{}_mps2", "x y z", "m/s^2", _BODY),
            Group("canopy_position", "main#_{}_m", "x y z", "m", _NED),
            Group("wind", "wind_{}_mps", "x y", "m/s", "north east"),
            Group("riser_tension", "load#_kN", "", "kN", ""),
        ),
        single={"density": ("density_kgpm3", "kg/m^3")},
        profile=(("altitude_msl_m", "m"), ("wind_x_mps", "m/s"), ("wind_y_mps", "m/s")),
    ),
    "Q": Layout(
        time=("TIME_S", "s"),
        groups=(
            Group("capsule_position", "CAP_P{}_FT", "N E D", "ft", _NED),
            Group("capsule_velocity", "CAP_V{}_FPS", "N E D", "ft/s", _NED),
            Group("capsule_attitude", "Q_{}", "S X Y Z", "1", _QUATERNION),
            Group("capsule_rate", "{}_DPS", "P Q R", "deg/s", _BODY),
            Group("capsule_specific_force", "A{}_G", "X Y Z", "g_0", _BODY),
            Group("canopy_position", "MAIN#_P{}_FT", "N E D", "ft", _NED),
            Group("wind", "WIND_{}_FPS", "N E", "ft/s", "north east"),
            Group("riser_tension", "LOAD#_LBF", "", "lbf", ""),
        ),
        single={"density": ("RHO_SLUGPFT3", "slug/ft^3")},
        profile=(("ALT_FT", "ft"), ("WIND_N_FPS", "ft/s"), ("WIND_E_FPS", "ft/s")),
    ),
    "R": Layout(
        time=("t", "s"),
        groups=(
            Group("capsule_position", "cg_{}_m", "east north up", "m", "east north up"),
            Group("capsule_velocity", "cg_v{}_mps", "e n u", "m/s", "east north up"),
            Group("capsule_attitude", "att_q{}", "w x y z", "1", _QUATERNION),
            Group("capsule_rate", "gyro_{}_degps", "x y z", "deg/s", _BODY),
            Group("capsule_specific_force", "sf_{}_mps2", "x y z", "m/s^2", _BODY),
            Group("canopy_position", "main_#_{}_m", "east north up", "m", "east north up"),
            Group("wind", "air_v{}_mps", "e n", "m/s", "east north"),
            Group("riser_tension", "riser_#_N", "", "N", ""),
        ),
        single={"pressure": ("static_pressure_hPa", "hPa"), "temperature": ("air_temperature_degC", "degC")},
        profile=(("alt_up_m", "m"), ("air_vn_mps", "m/s"), ("air_ve_mps", "m/s")),
        canopies=("a", "b", "c"),
        conventions={"axes": "ENU"},
    ),
    "S": Layout(
        time=("gps_s", "s"),
        groups=(
            Group("capsule_position", "{}_m", "north east down", "m", _NED),
            Group("capsule_velocity", "vel_{}_kmph", "north east down", "km/h", _NED),
            Group("capsule_attitude", "{}_deg", "yaw pitch roll", "deg", "yaw pitch roll"),
            Group("capsule_rate", "rate_{}_degps", "x y z", "deg/s", _BODY),
            Group("capsule_specific_force", "acc_{}_mps2", "x y z", "m/s^2", _BODY),
            Group("canopy_position", "canopy_{}_m", "north east down", "m", _NED),
            Group("wind", "wind_{}_kt", "north east", "knot", "north east"),
            Group("riser_tension", "riser_load_kgf", "", "kgf", ""),
        ),
        single={"density": ("density_gpm3", "g/m^3")},
        profile=(("altitude_ft", "ft"), ("wind_north_kt", "knot"), ("wind_east_kt", "knot")),
        canopies=("",),
        conventions=_DOWN,
    ),
    "T": Layout(
        time=("t_ms", "ms"),
        groups=(
            Group("capsule_position", "pos_{}_m", "n e d", "m", _NED),
            Group("capsule_velocity", "vel_{}_mps", "n e d", "m/s", _NED),
            Group("capsule_attitude", "q_{}", "w x y z", "1", _QUATERNION),
            Group("capsule_rate", "gyr_{}_degps", "x y z", "deg/s", _BODY),
            Group("capsule_specific_force", "acc_{}_g", "x y z", "g_0", _BODY),
            Group("canopy_position", "canopy_{}_m", "n e d", "m", _NED),
        ),
        single={"pressure": ("baro_hPa", "hPa"), "temperature": ("temp_degC", "degC")},
        profile=(("alt_m", "m"), ("wind_n_mps", "m/s"), ("wind_e_mps", "m/s")),
        canopies=("",),
        conventions=_DOWN,
    ),
    "U": Layout(
        time=("time", "s"),
        groups=(
            Group("capsule_position", "p{}", "n e d", "m", _NED),
            Group("capsule_velocity", "v{}", "n e d", "m/s", _NED),
            Group("capsule_attitude", "e{}", "0 1 2 3", "1", _QUATERNION),
            Group("capsule_rate", "{}_rate", "roll yaw", "deg/s", "x z"),
            Group("capsule_specific_force", "f{}", "x y z", "m/s^2", _BODY),
            Group("canopy_position", "can#_{}", "n e d", "m", _NED),
            Group("wind", "w{}", "n e", "m/s", "north east"),
            Group("riser_tension", "cell#", "", "N", ""),
        ),
        single={"density": ("rho", "kg/m^3")},
        profile=(("alt", "m"), ("wn", "m/s"), ("we", "m/s")),
        conventions={"lacks": ("capsule_rate.y",)},
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
        attach = self.position + to_ned(self.attitude, self.attach_b)
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


def _profile(path: Path, layout: Layout) -> Array:
    """Rows of altitude [m], winds to north and east [m/s], upwards."""
    from bayeschute.core.units import factor_to_si

    table = pd.read_csv(path)
    factors = [factor_to_si(unit, si)[0] for (_, unit), si in zip(layout.profile, ("m", "m/s", "m/s"), strict=True)]
    rows = np.stack([f * table[name].to_numpy(float) for f, (name, _) in zip(factors, layout.profile, strict=True)], 1)
    return rows[np.argsort(rows[:, 0])]


def _wind(found: xr.Dataset, profile: Array, position: Array) -> Array:
    """Wind at the capsule (T, 3), NED [m/s]."""
    if "wind" in found:
        return found["wind"].values
    north, east = (np.interp(-position[:, 2], profile[:, 0], profile[:, k]) for k in (1, 2))
    gone = np.isfinite(position[:, 2])
    return np.where(gone[:, None], np.stack([north, east, np.zeros_like(north)], axis=1), np.nan)


def read_flight(data: Path, name: str) -> OtherFlight:
    """A flight of these sets, converted.

    Args:
        data: Folder of the sets.
        name: Such as ``P_1``.
    """
    import bayeschute as bc
    from bayeschute.records.derive import ideal_gas_density

    layout, path = LAYOUTS[name[0]], data / f"{name}.csv.gz"
    found = bc.read_record(path, layout.columns(pd.read_csv(path, nrows=0).columns), **layout.conventions)
    meta = json.loads((data / f"{name}_meta.json").read_text(encoding="utf-8"))
    position, profile = found["capsule_position"].values, _profile(data / f"{name}_wind_profile.csv", layout)
    if "density" in found:
        density = found["density"].values
    else:
        density = ideal_gas_density(found["pressure"].values, found["temperature"].values)
    body = Conventions(**layout.conventions).body()
    return OtherFlight(
        name=name,
        time=found["time"].values,
        position=position,
        velocity=found["capsule_velocity"].values,
        attitude=continuous(unit(found["capsule_attitude"].values)),
        rate=found["capsule_rate"].values,
        force=found["capsule_specific_force"].values,
        canopies=found["canopy_position"].values,
        wind=_wind(found, profile, position),
        density=density,
        tension=found["riser_tension"].values if "riser_tension" in found else None,
        profile=profile,
        meta=meta,
        attach_b=body @ np.array(meta["attach_point_body_m_from_cm"], float),
        inertia=body @ np.array(meta["capsule_inertia_kgm2_body_about_cm"], float) @ body.T,
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
