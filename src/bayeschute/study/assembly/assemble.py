"""From the tables of a study to vehicle, virtual drops, flight data and noise models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import jax
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayeschute.aero.capsule_table import capsule_table
from bayeschute.core.random import seed_of
from bayeschute.core.vectors import Vec3
from bayeschute.dynamics import parameters
from bayeschute.dynamics.parameters import Canopies, Capsule, Cluster, Risers, Structure, engagement_length
from bayeschute.likelihood.disturbances import Latent
from bayeschute.likelihood.joint import NoiseParameters
from bayeschute.posterior.noise_evidence import NoisePrior
from bayeschute.records.reconstruct import ClusterGeometry
from bayeschute.records.sensors import Dropouts, SensorNoise
from bayeschute.study.formulation import noise_medians
from bayeschute.study.load import Study
from bayeschute.study.schema.belief_schema import WindNoise
from bayeschute.study.schema.vehicle_schema import BreathingTable, CapsuleTable, Vehicle, from_centre_of_mass
from bayeschute.study.schema.virtual_schema import VirtualFlight
from bayeschute.study.schema.wind_schema import ProfileTable, WindTable
from bayeschute.study.study import Flight
from bayeschute.virtual.drop import Breathing, Turbulence, VirtualDrop
from bayeschute.virtual.virtual_wind import Gust, ShearLayer, WindHistory, WindProfile


def cluster(
    vehicle: Vehicle, capsule_mass: float | None = None, of_canopies: Mapping[str, NDArray[np.float64]] | None = None
) -> tuple[Cluster, Structure]:
    """The cluster of a vehicle file with the aerodynamics it is flown with.

    Args:
        vehicle: The vehicle.
        capsule_mass: Replaces the vehicle's [kg].
        of_canopies: Coefficients that differ between the canopies (canopy,), by parameter; None: none does.
    """
    aero, k, r = vehicle.aero, vehicle.canopies, vehicle.risers
    capsule = _capsule(vehicle.capsule, capsule_mass)
    moments = (k.pitch_moment_slope or None, k.pitch_damping or None)
    canopies = Canopies(
        k.reference_area, k.reference_length, k.reference_speed, k.dry_mass, k.enclosed_volume, *moments
    )
    usual = engagement_length(capsule.mass * parameters.STANDARD_GRAVITY, r.stiffness, k.number)
    risers = Risers(r.length, r.stiffness, r.damping, usual if r.engagement is None else r.engagement)
    structure = Structure(
        tuple(aero.axial), tuple(aero.transverse), k.number, aero.rate, breathing=k.breathing is not None
    )
    every = [*(aero.coefficients() | dict(of_canopies or {})).values()]
    axial, transverse = tuple(every[: len(aero.axial)]), tuple(every[len(aero.axial) :])
    return Cluster(capsule, canopies, risers, axial, transverse, breathing=_breathing(k.breathing)), structure


def _capsule(c: CapsuleTable, mass: float | None) -> Capsule:
    """The capsule of a vehicle file; coefficients that a table replaces are zero."""
    table = None
    if c.table is not None:
        table = capsule_table(np.array(c.table.total_angle), np.array(c.table.roll), c.table.arrays())
    return Capsule(
        mass=c.mass if mass is None else mass,
        inertia=Vec3(*c.inertia),
        attach_b=Vec3(*from_centre_of_mass(c.attach_point, c.centre_of_mass, c.points_in)),
        reference_centre_b=Vec3(*from_centre_of_mass(c.reference_centre, c.centre_of_mass, c.points_in)),
        area=c.reference_area,
        length=c.reference_length,
        axial_force=c.axial_force or 0.0,
        normal_force_slope=c.normal_force_slope or 0.0,
        moment_slope=c.pitch_moment_slope or 0.0,
        roll_damping=c.roll_damping,
        pitch_damping=c.pitch_damping,
        yaw_damping=c.yaw_damping,
        pitch_rate_damping=c.pitch_rate_damping,
        yaw_rate_damping=c.yaw_rate_damping,
        table=table,
        products=None if c.inertia_products is None else Vec3(*c.inertia_products),
    )


def _breathing(table: BreathingTable | None) -> parameters.Breathing | None:
    if table is None:
        return None
    omega = 2.0 * np.pi * table.frequency
    return parameters.Breathing(omega**2, 2.0 * table.damping_ratio * omega, table.axial_slope)


def _drag_coefficient(c: CapsuleTable) -> float:
    """Drag of a capsule that descends heat shield first, over q S: the size of C_A nearest to 180 degrees."""
    if c.table is None:
        return abs(c.axial_force or 0.0)
    return float(abs(np.mean(c.table.arrays().get("C_A", np.zeros((1, 1)))[-1])))


def geometry(vehicle: Vehicle, capsule_mass: float | None = None) -> ClusterGeometry:
    """Data of a vehicle that the reconstruction of a record needs."""
    c, k = vehicle.capsule, vehicle.canopies
    return ClusterGeometry(
        reference_length=k.reference_length,
        reference_area=k.reference_area,
        dry_mass=k.dry_mass,
        enclosed_volume=k.enclosed_volume,
        capsule_mass=c.mass if capsule_mass is None else capsule_mass,
        capsule_reference_area=c.reference_area,
        capsule_drag_coefficient=_drag_coefficient(c),
        attach_b=from_centre_of_mass(c.attach_point, c.centre_of_mass, c.points_in),
    )


def wind_profile(table: ProfileTable | WindTable) -> WindProfile:
    """The wind by altitude of a table, layers of shear included."""
    layers: tuple[ShearLayer, ...] = ()
    if isinstance(table, WindTable):
        layers = tuple(ShearLayer(k.middle, k.thickness, (k.north, k.east, k.down)) for k in table.layer)
    if table.profile is not None:
        altitude, north, east, down = zip(*table.profile.samples, strict=True)
        return WindProfile(altitude, north, east, down, layers)
    if not table.altitude:
        return WindProfile(layers=layers)
    return WindProfile(table.altitude, table.north, table.east, table.down or (), layers)


def _history(table: WindTable) -> WindHistory | None:
    if table.history is None:
        return None
    rows = table.history.samples
    return WindHistory(tuple(row[0] for row in rows), tuple((row[1], row[2], row[3]) for row in rows))


def drop(virtual: VirtualFlight, quick: bool = False) -> VirtualDrop:
    """The virtual drop of a flight table; `quick` flies a third of it."""
    sensors, seen = {}, virtual.sensors
    for name in type(seen).model_fields:
        table = getattr(seen, name)
        if name != "dropouts" and table is not None:
            sensors[name] = SensorNoise(table.white, table.correlated, table.time_constant or 1.0)
    lost = seen.dropouts
    gusts, breathing = virtual.turbulence, virtual.breathing
    return VirtualDrop(
        duration=virtual.duration / 3.0 if quick else virtual.duration,
        dt=1.0 / virtual.rate,
        altitude=virtual.altitude,
        swing=virtual.swing,
        swing_azimuth=virtual.swing_azimuth,
        swing_rate=virtual.swing_rate,
        flyout=virtual.flyout,
        flyout_azimuth=virtual.flyout_azimuth,
        wind=wind_profile(virtual.wind),
        history=_history(virtual.wind),
        gusts=tuple(Gust(g.start, g.duration, (g.north, g.east, g.down)) for g in virtual.wind.gust),
        every_body=virtual.wind.every_body,
        shape=virtual.shape,
        turbulence=Turbulence(gusts.horizontal, gusts.vertical, gusts.time_constant) if gusts else Turbulence(),
        breathing=Breathing(breathing.amplitude, breathing.frequency, breathing.damping_ratio)
        if breathing
        else Breathing(),
        sensors=sensors,
        dropouts=Dropouts(lost.share, lost.mean_length) if lost else Dropouts(),
    )


def flight_seed(study: Study, flight: Flight) -> int:
    """The seed of one flight's random numbers, independent of the other flights."""
    return seed_of(study.seed, "virtual flight", flight.name)


def hyper(study: Study) -> NoiseParameters:
    """Medians of the noise parameters: residual noise per channel, then groups of latent disturbances."""
    noise = noise_medians(list(study.noise.channels().values()), study.noise.model)
    return NoiseParameters(noise, tuple(np.array(parameters) for _, _, _, parameters in _groups(study)))


def noise_prior(study: Study) -> NoisePrior:
    """Priors of the noise parameters about their medians, and the longest time constants of vertical air."""
    most = {
        f"{name}, vertical": wind.vertical_time_constant_at_most for name, wind in _winds(study) if wind is not None
    }
    longest = ((i, most.get(name)) for i, name in enumerate(noise_parameter_names(study)))
    return NoisePrior(hyper(study), longest=tuple((i, limit) for i, limit in longest if limit is not None))


def latent(study: Study, canopies: int) -> Latent:
    """Latent processes: errors of the wind north, east and down, each canopy's force along and across, the roll."""
    places = {"horizontal": (0, 1), "vertical": (2,), "canopy": tuple(range(3, 3 + canopies))}
    places["across"] = tuple(range(3 + canopies, 3 + 3 * canopies))
    places["roll"] = (3 + 3 * canopies,)
    if study.model == "descent":
        places = {"vertical": (0,)}
    found = _groups(study)
    processes = [(row, group) for group, (_, place, _, _) in enumerate(found) for row in places[place]]
    none = 0 if found else 1 if study.model == "descent" else 3  # wind rows, zero
    return Latent(tuple(kind for _, _, kind, _ in found), tuple(processes), none)


def noise_parameter_names(study: Study) -> tuple[str, ...]:
    """Names of the groups of latent processes, in the order of `hyper`."""
    return tuple(name for name, _, _, _ in _groups(study))


def _winds(study: Study) -> tuple[tuple[str, WindNoise | None], ...]:
    """Gusts and slow wind, by the names of their groups."""
    return ("wind", study.noise.wind), ("slow wind", study.noise.slow_wind)


def _groups(study: Study) -> list[tuple[str, str, str, tuple[float, ...]]]:
    """Name, channel, kind and hyperparameters of every group of latent processes."""
    table = study.noise
    found: list[tuple[str, str, str, tuple[float, ...]]] = []
    if table.model != "latent":
        return found
    for name, wind in _winds(study):
        if wind is not None and wind.horizontal is not None and study.model != "descent":
            found.append((f"{name}, horizontal", "horizontal", "drift", (wind.horizontal, wind.time_constant)))
        if wind is not None:
            found.append((f"{name}, vertical", "vertical", "drift", (wind.vertical, wind.time_constant)))
    if table.canopy_force is not None:
        found.append(("canopy force", "canopy", "drift", (table.canopy_force.sd, table.canopy_force.time_constant)))
    if table.transverse_force is not None:
        f = table.transverse_force
        found.append(("transverse force", "across", "drift", (f.sd, f.time_constant)))
    if table.roll is not None:
        f = table.roll
        found.append(("capsule roll", "roll", "drift", (f.sd, f.time_constant)))
    if table.breathing is not None:
        b = table.breathing
        found.append(("breathing", "canopy", "oscillator", (b.sd, b.frequency, b.damping_ratio)))
    return found


def smaller(study: Study) -> Study:
    """The study at ``--quick`` sizes: the same code, a third of each virtual drop, few draws; not for use."""
    sampler = study.sampler.model_copy(update={"warmup": 100, "draws": 100, "chains": 4})
    predict = study.predict.model_copy(update={"draws": 64})
    return replace(study, sampler=sampler, predict=predict)


def as_plain(value: Any) -> Any:
    """A value for JSON: arrays as lists, NaN as None."""
    if isinstance(value, dict):
        return {str(k): as_plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [as_plain(v) for v in value]
    if isinstance(value, (np.ndarray, xr.DataArray, jax.Array)):
        return as_plain(np.asarray(value).tolist())
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    return value if value is None else str(value)
