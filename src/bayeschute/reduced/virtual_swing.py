"""Virtual drops of the planar dumbbell, and frequency and amplitude of a swing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayeschute.atmosphere.standard import standard_density
from bayeschute.compiler.integrate import trajectory_compiled
from bayeschute.compiler.runge_kutta import Stepping
from bayeschute.core.random import stream
from bayeschute.likelihood import disturbances as processes
from bayeschute.likelihood.joint import FlightData, NoiseParameters
from bayeschute.records.sensors import SensorNoise, noisy, ornstein_uhlenbeck
from bayeschute.reduced.dumbbell import Dumbbell, DumbbellFlight, DumbbellInputs, steady_speed
from bayeschute.reduced.planar import PlanarAero
from bayeschute.virtual.drop import Turbulence
from bayeschute.virtual.virtual_wind import WindProfile

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SwingDrop:
    """A virtual drop in one plane; SI.

    Attributes:
        duration: [s].
        dt: Sample interval [s].
        altitude: At the first sample [m].
        swing: Angle at the first sample, positive when the capsule is ahead [rad].
        swing_rate: [rad/s].
        wind: By altitude; its northward part blows along the plane.
        turbulence: Unknown to an identification.
        sensors: Noise of ``swing_angle``, ``capsule_velocity`` and ``wind``.
    """

    duration: float
    dt: float
    altitude: float
    swing: float
    swing_rate: float = 0.0
    wind: WindProfile = field(default_factory=WindProfile)
    turbulence: Turbulence = field(default_factory=Turbulence)
    sensors: Mapping[str, SensorNoise] = field(default_factory=dict)


def fly_swing(
    drop: SwingDrop, base: Dumbbell, aero: PlanarAero, seed: int, substeps: int = 4
) -> tuple[xr.Dataset, xr.Dataset]:
    """Fly a virtual drop of the dumbbell; it starts at its terminal speed, carried by the wind.

    Args:
        drop: The drop.
        base: Masses and sizes.
        aero: Coefficients.
        seed: Seed of turbulence and sensors.
        substeps: Runge-Kutta steps per sample.

    Returns:
        The planar record as instruments saw it, and the truth (its wind the steady part, with ``turbulence``); see
        `bayeschute.reduced.dumbbell_data`.

    Raises:
        FloatingPointError: If the flight is not finite.
    """
    rng = stream(seed, "virtual swing")
    time = np.arange(round(drop.duration / drop.dt) + 1) * drop.dt
    gusts = drop.turbulence
    sd = np.array([gusts.horizontal, gusts.vertical])
    turbulence = sd * ornstein_uhlenbeck(1.0, gusts.time_constant, drop.dt, (time.size, 2), rng)
    speed = float(steady_speed(base, aero, float(standard_density(np.array([drop.altitude]))[0])))
    start = np.array([0.0, 0.0, 0.0, speed, drop.swing, drop.swing_rate])
    start[2:4] += drop.wind.at(np.array([drop.altitude]))[0, [0, 2]]
    altitude = drop.altitude - start[3] * time
    for _ in range(12):
        steady, density = drop.wind.at(altitude)[:, [0, 2]], standard_density(altitude)
        inputs = DumbbellInputs(steady + turbulence, density)
        flight = DumbbellFlight(base, aero, start, inputs, drop.dt, (), ("swing_angle",), Stepping(substeps))
        states = np.asarray(trajectory_compiled(flight, np.zeros(0), np.zeros(4), np.zeros((time.size, 2))))
        if not np.isfinite(states).all():
            raise FloatingPointError("the virtual swing left the finite numbers")
        change, altitude = np.max(np.abs(altitude - drop.altitude + states[:, 1])), drop.altitude - states[:, 1]
        if change < 0.01:
            break
    truth = xr.Dataset(coords={"time": time, "plane": ["along", "down"]})
    truth["swing_angle"] = ("time", states[:, 4], {"units": "rad"})
    for name, values in (("capsule_velocity", states[:, 2:4]), ("wind", steady), ("turbulence", turbulence)):
        truth[name] = (("time", "plane"), values, {"units": "m/s"})
    truth["density"] = ("time", density, {"units": "kg/m^3"})
    record = truth.drop_vars("turbulence").copy(deep=True)
    for name in ("swing_angle", "capsule_velocity", "wind"):
        if name in drop.sensors:
            record[name].values = noisy(truth[name].values, drop.sensors[name], drop.dt, rng)
    return record, truth


class Swing(NamedTuple):
    """A swing in numbers: frequency [Hz], and amplitude, half of the mean travel from turn to turn [rad]."""

    frequency: float
    amplitude: float


def swing_of(time: Array, angle: Array) -> Swing:
    """Frequency and amplitude of a swing from its passages through the mean of its turning points.

    Args:
        time: (T,) [s].
        angle: (T,) [rad], free of noise.

    Returns:
        Both; NaN where there are fewer than three passages.
    """
    middle = 0.5 * (angle.max() + angle.min())
    for _ in range(2):
        side = angle - middle
        before = np.flatnonzero(side[:-1] * side[1:] < 0.0)
        if before.size < 3:
            return Swing(np.nan, np.nan)
        parts = [side[a + 1 : b + 1] for a, b in zip(before, before[1:], strict=False)]
        turns = np.array([part[np.argmax(np.abs(part))] for part in parts])
        middle += 0.5 * (turns[turns > 0.0].mean() + turns[turns < 0.0].mean())
    share = side[before] / (side[before] - side[before + 1])
    passages = time[before] + share * (time[before + 1] - time[before])
    # Passages in one direction are whole periods apart.
    whole = passages[: passages.size - (passages.size - 1) % 2]
    frequency = 0.5 * (whole.size - 1) / (whole[-1] - whole[0])
    return Swing(float(frequency), float(0.5 * (turns[turns > 0.0].mean() - turns[turns < 0.0].mean())))


def predict_swings(
    flight: FlightData, hyper: NoiseParameters | None, theta: Array, after: float, rng: np.random.Generator
) -> Array:
    """Frequency and amplitude of a flight for every draw of the parameters, from the opening of its record on.

    Args:
        flight: From `dumbbell_data`: its start and recorded wind are taken, its data are not.
        hyper: Noise parameters of the latent wind error, drawn for every draw; none where None.
        theta: Draws (N, P).
        after: Time since the first sample from which the swing is measured [s].
        rng: Source of randomness.

    Returns:
        (N, 2), as `Swing`; NaN where a flight does not swing or is not finite.
    """
    count, samples = len(theta), flight.samples
    error = np.zeros((samples, flight.latent.rows, count))
    if hyper is not None and flight.latent.size:
        process_noise = jnp.asarray(rng.standard_normal((samples, flight.latent.size, count)))
        error = np.asarray(processes.disturbances(hyper.dynamics(flight), process_noise))
    states = np.asarray(trajectory_compiled(flight.model, theta.T, np.zeros((flight.starts, count)), error))
    time = float(np.asarray(flight.dt)) * np.arange(samples, dtype=np.float64)
    seen = time >= after
    return np.array([swing_of(time[seen], states[seen, 4, i]) for i in range(count)])
