"""Records of virtual flights for `rivals.py`: the same files for every program.

Descents of a point mass and swings of the planar dumbbell are flown by bayeschute's simulator; in the case ``gusts``
with gusts, an error of the recorded wind and noise that remembers, in the case ``calm`` with white noise alone.
``cluster`` is the default study's drop, projected on the plane of its first swing.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import bayeschute as bc
from bayeschute.aero.published import load_published
from bayeschute.atmosphere.standard import standard_density
from bayeschute.compiler.integrate import trajectory_compiled
from bayeschute.core.random import stream
from bayeschute.core.units import to_si
from bayeschute.dynamics.descent import DensityProfile, DescentFlight, DescentInputs
from bayeschute.dynamics.parameters import Canopies
from bayeschute.likelihood.channels import initial_motion
from bayeschute.records.sensors import SensorNoise, noisy, ornstein_uhlenbeck
from bayeschute.reduced.dumbbell import Dumbbell
from bayeschute.reduced.published_models import planar_aero
from bayeschute.reduced.virtual_swing import SwingDrop, fly_swing
from bayeschute.virtual.drop import Turbulence
from bayeschute.virtual.virtual_wind import WindProfile

Array = NDArray[np.float64]
FT, SLUG, DEGREE = to_si("1 ft", "m"), to_si("1 slug", "kg"), to_si("1 deg", "rad")
LOG_SD = 0.7  # of the noise parameters' priors, as bayeschute has them

# Swings: report's tables 6.1.1, 7.1-1 and 7.1-2.
CANOPIES = Canopies(10563.0 * FT**2, 116.0 * FT, 32.0 * FT, 328.0 / 32.174 * SLUG, 140164.0 * FT**3)
BASE = Dumbbell(21906.0 / 32.174 * SLUG, 235.0 * FT, CANOPIES, 32.174 * FT)
LIGHTER = replace(BASE, capsule_mass=to_si("20340 lb", "kg"))
TABLE = load_published("table-7.1-2")
AERO = planar_aero(TABLE)
PRIOR_SD = {"C_A0": 0.1, "C_Aalpha": 0.15, "alpha_0": 0.04, "C_Nalpha": 0.08, "C_Nalphadot": 0.2}
WIDE = {"C_A0": 0.5, "C_Aalpha": 1.5, "alpha_0": 0.15, "C_Nalpha": 0.5, "C_Nalphadot": 1.0}
GUSTY = Turbulence(2.0 * FT, 0.8 * FT, 6.0)
REMEMBERING = {
    "swing_angle": SensorNoise(0.12 * DEGREE, 0.2 * DEGREE, 2.0),
    "capsule_velocity": SensorNoise(0.06, 0.12, 3.0),
    "wind": SensorNoise(0.0, 1.0 * FT, 20.0),
}
WHITE = {
    "swing_angle": SensorNoise(0.25 * DEGREE, 0.0, 1.0),
    "capsule_velocity": SensorNoise(0.15, 0.0, 1.0),
}
START_SD = (0.02, 0.03, 0.5, 0.5)  # swing [rad], its rate [rad/s], velocity along and down [m/s]
SWING_NOISE = (0.25 * DEGREE, 0.15, 0.15)  # medians: swing [rad], velocity along and down [m/s]
ALTITUDES, STILL = tuple(h * FT for h in (0.0, 2500.0, 5000.0, 8000.0)), (0.0,) * 4
WINDS = tuple(
    WindProfile(ALTITUDES, tuple(v * FT for v in row), STILL)
    for row in ((5.0, 12.0, 20.0, 24.0), (6.0, 14.0, 22.0, 26.0))
)

# Descents: a small body like a sonde, one value a second; its last third is predicted.
DESCENT_PRIOR = (float(np.log(0.13)), 0.4)  # of log C_D S/m [m^2/kg]
DESCENT_NOISE = 0.4  # median [m/s]
RELEASE, SECONDS, FITTED = 3000.0, 120, 80  # [m], [s], [s]
LIFT, SLOW = (0.5, 10.0), (0.3, 100.0)  # vertical air: sd [m/s], time constant [s]
CASES = ("descent-calm", "descent-gusts", "swing-calm", "swing-gusts", "swing-wide", "cluster")


@dataclass(frozen=True)
class Truth:
    """What a record was made with.

    Attributes:
        parameters: By name; none where the rivals' model is not that of the record.
        time: Of the predicted flight (T,) [s].
        motion: Its true quantities (T,) [rad, m/s].
        absolute: Whether a model's swing counts by its size.
    """

    parameters: dict[str, float]
    time: Array
    motion: dict[str, Array]
    absolute: bool = False


def make(case: str, seed: int, folder: Path) -> Truth:
    """Write the files of a case and seed into a folder.

    Args:
        case: Of `CASES`.
        seed: Of truth, gusts, instruments and the priors' centres.
        folder: Where to.
    """
    folder.mkdir(parents=True, exist_ok=True)
    kind, _, air = case.partition("-")
    if kind == "descent":
        return _descent(air == "gusts", seed, folder)
    return _cluster(seed, folder) if kind == "cluster" else _swing(air, seed, folder)


def _write(folder: Path, problem: dict[str, Any], record: dict[str, Array], following: dict[str, Array]) -> None:
    (folder / "problem.json").write_text(json.dumps(problem, indent=1), encoding="utf-8")
    for name, table in (("record", record), ("next", following)):
        rows = np.column_stack(list(table.values()))
        np.savetxt(folder / f"{name}.csv", rows, delimiter=",", header=",".join(table), comments="", fmt="%.9g")


def _descent(gusts: bool, seed: int, folder: Path) -> Truth:
    rng = stream(seed, "a descent for rivals")
    drag = float(rng.normal(*DESCENT_PRIOR))
    time, fine = np.arange(SECONDS + 1.0), 10
    ticks = SECONDS * fine + 1
    air = sum(sd * ornstein_uhlenbeck(1.0, tau, 1.0 / fine, (ticks, 1), rng)[:, 0] for sd, tau in (LIFT, SLOW)) * float(
        gusts
    )
    nodes = np.arange(-2000.0, 4000.0, 50.0)
    profile = DensityProfile(nodes[0], 50.0, np.log(standard_density(nodes)))
    speed = float(np.sqrt(2.0 * 9.80665 / (np.exp(drag) * standard_density(np.array([RELEASE]))[0])))
    flight = DescentFlight(profile, DescentInputs(air), RELEASE, speed, 1.0 / fine)
    states = np.asarray(trajectory_compiled(flight, np.array([drag]), np.zeros(1), np.zeros((ticks, 1))))[::fine]
    altitude, rate = states[:, 0], states[:, 1]
    sensor = SensorNoise(0.3, 0.3, 3.0) if gusts else SensorNoise(0.4, 0.0, 1.0)
    seen = noisy(rate, sensor, 1.0, rng)
    first, after = time <= FITTED, time > FITTED
    problem = {
        "model": "descent", "seed": seed, "priors": {"log_cds_over_mass": list(DESCENT_PRIOR)},
        "noise": [DESCENT_NOISE], "noise_log_sd": LOG_SD, "gravity": 9.80665, "start": [RELEASE, speed],
        "start_sd": [0.0, 2.0], "mass": 1.0,
        "next_start": [float(altitude[after][0]), float(np.median(seen[FITTED - 5 : FITTED + 1]))],
    }  # fmt: skip
    columns = {"time": time, "altitude": altitude, "descent_rate": seen, "density": standard_density(altitude)}
    _write(
        folder, problem, {k: v[first] for k, v in columns.items()}, {k: columns[k][after] for k in ("time", "density")}
    )
    whole = np.column_stack([time, altitude, seen])
    np.savetxt(folder / "whole.csv", whole, delimiter=",", header="time,altitude,descent_rate", comments="", fmt="%.9g")
    return Truth({"log_cds_over_mass": drag}, time[after], {"descent_rate": rate[after]})


def priors(seed: int, wide: bool) -> dict[str, list[float]]:
    """Means and standard deviations of the coefficients' normal priors; the truth is a draw, 10 to 50 % off if wide."""
    rng = np.random.default_rng([seed, 1])
    if wide:
        off = {p.name: 1.0 + rng.uniform(0.1, 0.5) * rng.choice([-1.0, 1.0]) for p in TABLE.parameters}
        return {p.name: [p.estimate * off[p.name], WIDE[p.name]] for p in TABLE.parameters}
    return {p.name: [float(rng.normal(p.estimate, PRIOR_SD[p.name])), PRIOR_SD[p.name]] for p in TABLE.parameters}


def body(base: Dumbbell) -> dict[str, float]:
    """Numbers of a dumbbell, of all its canopies together."""
    c, n = base.canopies, base.count
    return {
        "capsule_mass": float(base.capsule_mass), "length": float(base.length), "gravity": float(base.gravity),
        "area": float(n * c.area), "dry_mass": float(n * c.dry_mass), "enclosed_volume": float(n * c.enclosed_volume),
    }  # fmt: skip


def _first(record: xr.Dataset) -> list[float]:
    """Swing, its rate, velocity along and down at the first sample, out of the record's first seconds."""
    values = np.column_stack([record["swing_angle"].values, record["capsule_velocity"].values])
    value, slope, _ = initial_motion(record["time"].values, values)
    return [float(v) for v in (value[0], slope[0], value[1], value[2])]


def _table(record: xr.Dataset) -> dict[str, Array]:
    wind, velocity = record["wind"].values, record["capsule_velocity"].values
    return {
        "time": record["time"].values, "swing_angle": record["swing_angle"].values, "along": velocity[:, 0],
        "down": velocity[:, 1], "wind_along": wind[:, 0], "wind_down": wind[:, 1], "density": record["density"].values,
    }  # fmt: skip


def _swing_files(
    folder: Path, seed: int, wide: bool, flights: list[tuple[xr.Dataset, Dumbbell]], start: list[float]
) -> dict[str, Array]:
    """Write both flights; the second begins at a start that all programs are told."""
    (first, base), (second, other) = flights
    problem = {
        "model": "swing", "seed": seed, "priors": priors(seed, wide), "noise": list(SWING_NOISE),
        "noise_log_sd": LOG_SD,
        "start": _first(first), "start_sd": list(START_SD), "body": body(base), "next_body": body(other),
        "next_start": start,
    }  # fmt: skip
    seen = _table(second)
    _write(folder, problem, _table(first), {k: seen[k] for k in ("time", "wind_along", "wind_down", "density")})
    return seen


def _swing(air: str, seed: int, folder: Path) -> Truth:
    gusts, sensors = (Turbulence(), WHITE) if air == "calm" else (GUSTY, REMEMBERING)
    first = SwingDrop(90.0, 0.2, 6500.0 * FT, 17.0 * DEGREE, 0.0, WINDS[0], gusts, sensors)
    second = SwingDrop(60.0, 0.2, 7000.0 * FT, 12.0 * DEGREE, 0.0, WINDS[1], gusts, sensors)
    record, _ = fly_swing(first, BASE, AERO, seed)
    following, truth = fly_swing(second, LIGHTER, AERO, 1000 + seed)
    start = [second.swing, second.swing_rate, *map(float, truth["capsule_velocity"].values[0])]
    seen = _swing_files(folder, seed, air == "wide", [(record, BASE), (following, LIGHTER)], start)
    motion = {"swing_angle": truth["swing_angle"].values, "descent_rate": truth["capsule_velocity"].values[:, 1]}
    return Truth(TABLE.estimates(), seen["time"], motion)


def planar(flight: bc.Flight, azimuth: float, base: Dumbbell) -> xr.Dataset:
    """A cluster's record in the plane of an azimuth [rad]; its swing is that of the canopies' mean."""
    one = flight.record.isel(time=slice(None, None, 2))
    along = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    line = one["capsule_position"].values - one["canopy_position"].mean("canopy").values
    made = xr.Dataset(coords={"time": one["time"].values, "plane": ["along", "down"]})
    made["swing_angle"] = ("time", np.arctan2(line @ along, line[:, 2]))
    for name in ("capsule_velocity", "wind"):
        made[name] = (("time", "plane"), np.column_stack([one[name].values @ along, one[name].values[:, 2]]))
    made["density"] = ("time", one["density"].values)
    return made


def _cluster(seed: int, folder: Path) -> Truth:
    study = bc.Study.load(Path(__file__).parents[1] / "models/studies/cdt-3-11.toml")
    first, second = study.flights["cdt-3-11"], study.flights["cdt-3-12"]
    pairs = [(planar(f, a * DEGREE, b), b) for f, a, b in ((first, 40.0, BASE), (second, -60.0, LIGHTER))]
    seen = _swing_files(folder, seed, False, pairs, _first(pairs[1][0]))
    truth = second.truth
    assert truth is not None
    truth = truth.isel(time=slice(None, None, 2))
    motion = {k: truth[k].values for k in ("swing_angle", "descent_rate")}
    return Truth({}, seen["time"], motion, absolute=True)
