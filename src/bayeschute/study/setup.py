"""From the words of a study to the objects of the rooms below: vehicle, virtual drops, flight data, noise."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import jax
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayeschute.air.vector import Vec3
from bayeschute.dynamics.parameters import (
    STANDARD_GRAVITY,
    Canopies,
    Capsule,
    Cluster,
    Risers,
    Structure,
    engagement_length,
)
from bayeschute.flight.reconstruct import ClusterGeometry
from bayeschute.flight.sensors import Dropouts, SensorNoise
from bayeschute.forecast.virtual import Breathing, Turbulence, VirtualDrop, WindProfile
from bayeschute.inference.latent import Latent
from bayeschute.inference.noise import Noise
from bayeschute.inference.target import Hyper
from bayeschute.study.load import Study
from bayeschute.study.study import Flight
from bayeschute.study.vehicle_schema import Vehicle
from bayeschute.study.virtual_schema import VirtualFlight

Array = NDArray[np.float64]


def _offset_b(place: tuple[float, ...], centre: tuple[float, ...]) -> Vec3:
    """A place from the centre of mass in body axes: x and z of the structural frame reverse (6.3.3-14b, -20b)."""
    x, y, z = (float(a - b) for a, b in zip(place, centre, strict=True))
    return Vec3(-x, y, -z)


def cluster(vehicle: Vehicle, capsule_mass: float | None = None) -> tuple[Cluster, Structure]:
    """The cluster of a vehicle file with the aerodynamics it is flown with.

    Args:
        vehicle: The vehicle.
        capsule_mass: Replaces the vehicle's [kg].
    """
    c, aero = vehicle.capsule, vehicle.aero
    capsule = Capsule(
        mass=c.mass if capsule_mass is None else capsule_mass,
        inertia=Vec3(*c.inertia),
        attach_b=_offset_b(c.attach_point, c.centre_of_mass),
        reference_centre_b=_offset_b(c.reference_centre, c.centre_of_mass),
        area=c.reference_area,
        length=c.reference_length,
        axial_force=c.axial_force,
        normal_force_slope=c.normal_force_slope,
        moment_slope=c.pitch_moment_slope,
        roll_damping=c.roll_damping,
        pitch_damping=c.pitch_damping,
    )
    k = vehicle.canopies
    canopies = Canopies(k.reference_area, k.reference_length, k.reference_speed, k.dry_mass, k.enclosed_volume)
    r = vehicle.risers
    engagement = engagement_length(capsule.mass * STANDARD_GRAVITY, r.stiffness, k.number)
    risers = Risers(r.length, r.stiffness, r.damping, engagement)
    structure = Structure(tuple(aero.axial), tuple(aero.transverse), k.number, aero.rate)
    return Cluster(capsule, canopies, risers, tuple(aero.axial.values()), tuple(aero.transverse.values())), structure


def geometry(vehicle: Vehicle, capsule_mass: float | None = None) -> ClusterGeometry:
    """What the reconstruction of a record needs of a vehicle."""
    c, k = vehicle.capsule, vehicle.canopies
    attach = _offset_b(c.attach_point, c.centre_of_mass)
    return ClusterGeometry(
        reference_length=k.reference_length,
        reference_area=k.reference_area,
        dry_mass=k.dry_mass,
        enclosed_volume=k.enclosed_volume,
        capsule_mass=c.mass if capsule_mass is None else capsule_mass,
        capsule_reference_area=c.reference_area,
        capsule_drag_coefficient=abs(c.axial_force),
        attach_b=(attach.x, attach.y, attach.z),
    )


def drop(virtual: VirtualFlight, quick: bool = False) -> VirtualDrop:
    """The virtual drop of a flight table; `quick` flies a third of it."""
    sensors, seen = {}, virtual.sensors
    for name in type(seen).model_fields:
        table = getattr(seen, name)
        if name != "dropouts":
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
        wind=WindProfile(tuple(virtual.wind.altitude), tuple(virtual.wind.north), tuple(virtual.wind.east)),
        turbulence=Turbulence(gusts.horizontal, gusts.vertical, gusts.time_constant) if gusts else Turbulence(),
        breathing=Breathing(breathing.amplitude, breathing.frequency, breathing.damping_ratio)
        if breathing
        else Breathing(),
        sensors=sensors,
        dropouts=Dropouts(lost.share, lost.mean_length) if lost else Dropouts(),
    )


def flight_seed(study: Study, flight: Flight) -> int:
    """The seed of one flight's random numbers, its own whatever the other flights are."""
    place = [f.name for f in study.flights].index(flight.name)
    return int(np.random.SeedSequence([study.seed, place]).generate_state(1)[0])


def hyper(study: Study) -> Hyper:
    """Medians of the noise parameters: residual noise per channel, then groups of latent disturbances."""
    tables = list(study.noise.channels().values())
    tiny = 1e-6
    noise = Noise(
        np.array([t.white or tiny for t in tables]),
        np.array([t.correlated or tiny for t in tables]),
        np.array([t.time_constant or 1.0 for t in tables]),
    )
    return Hyper(noise, tuple(np.array(law) for _, _, _, law in _groups(study)))


def latent(study: Study, canopies: int) -> Latent:
    """Latent processes: errors of the wind north, east and down, then what makes each canopy's force fluctuate."""
    places = {"horizontal": (0, 1), "vertical": (2,), "canopy": tuple(range(3, 3 + canopies))}
    if study.model == "descent":
        places = {"vertical": (0,)}
    found = _groups(study)
    processes = [(row, group) for group, (_, place, _, _) in enumerate(found) for row in places[place]]
    return Latent(tuple(kind for _, _, kind, _ in found), tuple(processes))


def law_names(study: Study) -> tuple[str, ...]:
    """Names of the groups of latent processes, in the order of `hyper`."""
    return tuple(name for name, _, _, _ in _groups(study))


def _groups(study: Study) -> list[tuple[str, str, str, tuple[float, ...]]]:
    """Name, place, kind and law of every group of latent processes."""
    table = study.noise
    found: list[tuple[str, str, str, tuple[float, ...]]] = []
    for name, wind in (("wind", table.wind), ("slow wind", table.slow_wind)):
        if wind is not None and wind.horizontal is not None and study.model != "descent":
            found.append((f"{name}, horizontal", "horizontal", "drift", (wind.horizontal, wind.time_constant)))
        if wind is not None:
            found.append((f"{name}, vertical", "vertical", "drift", (wind.vertical, wind.time_constant)))
    if table.canopy_force is not None:
        found.append(("canopy force", "canopy", "drift", (table.canopy_force.sd, table.canopy_force.time_constant)))
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
    """A value as JSON holds it: arrays as lists, NaN as None."""
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
