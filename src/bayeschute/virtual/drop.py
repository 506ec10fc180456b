"""Virtual drops: simulated flights with disturbances unknown to the identification, measured by simulated sensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
import xarray as xr
from numpy.typing import NDArray

from bayeschute.atmosphere.standard import standard_density
from bayeschute.compiler.runge_kutta import Stepping
from bayeschute.core.random import stream
from bayeschute.core.vectors import Vec3, vec3
from bayeschute.dynamics.cluster import geometry, state_rate, tension
from bayeschute.dynamics.cluster_flight import QUANTITIES, ClusterFlight, ClusterInputs, quantity
from bayeschute.dynamics.initial_state import Start, tangent_basis
from bayeschute.dynamics.outcome import attributes, examine, flown
from bayeschute.dynamics.parameters import Cluster, Structure
from bayeschute.dynamics.state import CAPSULE_SIZE, unpack
from bayeschute.records.record import make_record
from bayeschute.records.sensors import Dropouts, SensorNoise, ornstein_uhlenbeck, record_of
from bayeschute.virtual.virtual_wind import Gust, WindHistory, WindProfile

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Turbulence:
    """Ornstein-Uhlenbeck turbulence: standard deviations [m/s], time constant [s]."""

    horizontal: float = 0.0
    vertical: float = 0.0
    time_constant: float = 5.0


@dataclass(frozen=True)
class Breathing:
    """Randomly driven oscillator on every canopy's axial coefficient (6.3.2-27, -28).

    Attributes:
        amplitude: Standard deviation of the relative change.
        frequency: [Hz].
        damping_ratio: Share of critical damping.
    """

    amplitude: float = 0.0
    frequency: float = 0.23
    damping_ratio: float = 0.05


@dataclass(frozen=True)
class VirtualDrop:
    """Specification of a virtual drop; SI.

    Attributes:
        duration: [s].
        dt: Sample interval [s].
        altitude: Of the capsule at the first sample [m].
        swing: Angle of the cluster off the vertical [rad], towards `swing_azimuth` from north.
        swing_azimuth: [rad].
        swing_rate: [rad/s].
        flyout: Angle of each riser from the cluster's axis [rad].
        flyout_azimuth: Direction of the first canopy about that axis [rad].
        wind: By altitude.
        history: Wind by time that adds to it; None: none.
        gusts: Unknown to an identification.
        every_body: Whether the wind at capsule and canopies is that at their altitudes; otherwise all have the
        capsule's.
        shape: eta of the canopies at the first sample, where the structure breathes; empty: zero.
        turbulence: Unknown to an identification.
        breathing: Likewise.
        sensors: Noise by record variable. ``riser_tension``, ``swing_angle``, ``descent_rate`` and ``canopy_velocity``
            are recorded only where they are named here; the other variables always.
        dropouts: Of the canopies' positions.
    """

    duration: float
    dt: float
    altitude: float
    swing: float = 0.0
    swing_azimuth: float = 0.0
    swing_rate: float = 0.0
    flyout: float = 0.15
    flyout_azimuth: float = 0.0
    wind: WindProfile = field(default_factory=WindProfile)
    history: WindHistory | None = None
    gusts: tuple[Gust, ...] = ()
    every_body: bool = False
    shape: tuple[float, ...] = ()
    turbulence: Turbulence = field(default_factory=Turbulence)
    breathing: Breathing = field(default_factory=Breathing)
    sensors: Mapping[str, SensorNoise] = field(default_factory=dict)
    dropouts: Dropouts = field(default_factory=Dropouts)


def start_of(drop: VirtualDrop, model: Cluster, n: int) -> Start:
    """The start of a virtual drop: leaning cluster, capsule axis along it, falling at its terminal speed."""
    s, a = drop.swing, drop.swing_azimuth
    axis = np.array([np.sin(s) * np.cos(a), np.sin(s) * np.sin(a), -np.cos(s)])
    lean = np.array([np.cos(s) * np.cos(a), np.cos(s) * np.sin(a), np.sin(s)])
    first = np.array([np.cos(drop.flyout_azimuth), np.sin(drop.flyout_azimuth), 0.0])
    first -= axis * (first @ axis)
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    turns = 2.0 * np.pi * np.arange(n) / n
    spread = np.cos(turns)[:, None] * first + np.sin(turns)[:, None] * second
    flyout = drop.flyout if n > 1 else 0.0
    direction = np.cos(flyout) * axis + np.sin(flyout) * spread
    turning = drop.swing_rate * (lean - direction * (direction @ lean)[:, None])
    density = float(standard_density(np.array([drop.altitude]))[0])
    weight = (model.capsule.mass + n * model.canopies.dry_mass) * model.gravity
    axial = float(np.mean(model.axial[0])) if model.axial else 1.0
    speed = float(np.sqrt(2.0 * weight / (density * n * model.canopies.area * max(axial, 0.1))))
    velocity = drop.wind.at(np.array([drop.altitude]))[0] + np.array([0.0, 0.0, speed])
    if drop.history is not None:
        velocity = velocity + drop.history.at(np.zeros(1))[0]
    shape = np.array([drop.shape, np.zeros(n)]) if drop.shape else None
    place = np.array([0.0, 0.0, -drop.altitude])
    return Start(place, velocity, _upright(axis), np.zeros(3), direction.T, turning.T, shape)


def _upright(axis: Array) -> Array:
    """The quaternion NED to body that puts the body's x axis along `axis` by the shortest turn from straight up."""
    up = np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0])  # body x axis along -down
    vertical = np.array([0.0, 0.0, -1.0])
    turn = np.concatenate([[1.0 + vertical @ axis], np.cross(vertical, axis)])
    turn /= np.linalg.norm(turn)
    w, v = turn[0], turn[1:]
    return np.concatenate([[w * up[0] - v @ up[1:]], w * up[1:] + up[0] * v + np.cross(v, up[1:])])


def breathing_history(breathing: Breathing, dt: float, samples: int, n: int, rng: np.random.Generator) -> Array:
    """Factors on the axial coefficients (T, n): one plus a stationary, randomly driven oscillator per canopy."""
    omega, zeta = 2.0 * np.pi * breathing.frequency, breathing.damping_ratio
    a = np.array([[0.0, 1.0], [-(omega**2), -2.0 * zeta * omega]])
    stationary = np.diag([1.0, omega**2])
    step = scipy.linalg.expm(a * dt)
    driven = np.linalg.cholesky(stationary - step @ stationary @ step.T + 1e-15 * np.eye(2))
    state = np.sqrt(np.diag(stationary))[:, None] * rng.standard_normal((2, n))
    history = np.empty((samples, n))
    for i in range(samples):
        history[i] = state[0]
        state = step @ state + driven @ rng.standard_normal((2, n))
    return 1.0 + breathing.amplitude * history


def fly(
    drop: VirtualDrop, model: Cluster, structure: Structure, seed: int, substeps: int = 4
) -> tuple[xr.Dataset, xr.Dataset]:
    """Fly a virtual drop.

    The steady wind and the density belong to the altitude that the capsule reaches, so the flight is repeated until
    altitudes agree to a centimetre.

    Args:
        drop: The drop.
        model: The cluster, aerodynamics included.
        structure: Terms and options.
        seed: Seed of disturbances and sensors.
        substeps: Runge-Kutta steps per sample.

    Returns:
        The record as instruments saw it, and the truth (with the quantities of interest and the true wind); both with
        the outcome and the error due to the steps in their attributes (`bayeschute.dynamics.outcome.attributes`).

    Raises:
        FloatingPointError: If the flight is not finite, with the time of its failure.
    """
    rng = stream(seed, "virtual drop")
    n, dt = structure.canopies, drop.dt
    time = np.arange(round(drop.duration / dt) + 1, dtype=np.float64) * dt
    gusts = drop.turbulence
    sd = np.array([gusts.horizontal, gusts.horizontal, gusts.vertical])
    turbulence = sd * ornstein_uhlenbeck(1.0, gusts.time_constant, dt, (time.size, 3), rng)
    for gust in drop.gusts:
        turbulence = turbulence + gust.at(time)
    slow = np.zeros((time.size, 3)) if drop.history is None else drop.history.at(time)
    wind_field = drop.wind.field() if drop.every_body else None
    factor = breathing_history(drop.breathing, dt, time.size, n, rng)
    start = start_of(drop, model, n)
    altitude = drop.altitude - start.velocity[2] * time
    still = np.zeros(0), np.zeros(9 + 4 * n), np.zeros((time.size, 3))
    for _ in range(12):
        steady = drop.wind.at(altitude) + slow
        wind = (slow if drop.every_body else steady) + turbulence
        inputs = ClusterInputs(wind, standard_density(altitude), factor, np.zeros((time.size, 4)))
        basis = tangent_basis(start.direction)
        flight = ClusterFlight(model, start, basis, inputs, dt, structure, (), (), Stepping(substeps), wind_field)
        states = np.asarray(flown(flight, *still))
        if not np.isfinite(states).all():
            bad = time[~np.isfinite(states).all(axis=1)][0]
            raise FloatingPointError(f"the virtual drop left the finite numbers at {bad:.1f} s")
        change = np.max(np.abs(altitude + states[:, 2]))
        altitude = -states[:, 2]
        if change < 0.01:
            break
    else:
        raise FloatingPointError(f"the altitude of the virtual drop did not settle: it still changed by {change:.2f} m")
    verdict = attributes(examine(flight, *still, jnp.asarray(states)), dt, n)
    truth = _truth(time, states, flight, steady).assign_attrs(verdict)
    if "riser_tension" in drop.sensors:
        truth["riser_tension"] = (("time", "canopy"), np.asarray(_tensions(flight, states)), {"units": "N"})
    if "canopy_velocity" in drop.sensors:
        truth["canopy_velocity"] = (("time", "canopy", "axis"), _canopies(states, 1, n), {"units": "m/s"})
    recorded = [*_RECORDED, *(name for name in _ON_REQUEST if name in drop.sensors)]
    record = record_of(truth[recorded], drop.sensors, drop.dropouts, rng)
    return record, truth.assign(turbulence=(("time", "axis"), turbulence, {"units": "m/s"}))


_RECORDED = (
    "capsule_position",
    "capsule_velocity",
    "capsule_attitude",
    "capsule_rate",
    "capsule_specific_force",
    "canopy_position",
    "wind",
    "density",
    "altitude",
)
_ON_REQUEST = ("riser_tension", "swing_angle", "descent_rate", "canopy_velocity")


def _truth(time: Array, states: Array, flight: ClusterFlight, steady: Array) -> xr.Dataset:
    """The flight as a record without noise, with the quantities of interest."""
    n = flight.structure.canopies
    inputs = flight.record
    specific_force, quantities = (np.asarray(a) for a in _seen(flight, states))
    truth = make_record(
        time=time,
        capsule_position=states[:, 0:3],
        capsule_velocity=states[:, 3:6],
        capsule_attitude=states[:, 6:10],
        capsule_rate=states[:, 10:13],
        capsule_specific_force=specific_force,
        canopy_position=_canopies(states, 0, n),
        wind=steady,
        density=np.asarray(inputs.density),
        altitude=-states[:, 2],
    )
    for name, values in zip(QUANTITIES, quantities.T, strict=True):
        truth[name] = ("time", values, {"units": "rad" if name.endswith("angle") else "m/s"})
    return truth


def _canopies(states: Array, place: int, n: int) -> Array:
    """Positions (place 0) or velocities (place 1) of the canopies in states (T, 13 + 6 n), as (T, n, 3)."""
    first = CAPSULE_SIZE + 3 * n * place
    return np.moveaxis(states[:, first : first + 3 * n].reshape(-1, 3, n), 1, 2)


@jax.jit
def _tensions(flight: ClusterFlight, states: jax.Array) -> jax.Array:
    """Tension of every riser (T, n) [N]."""
    model, n = flight.base, flight.structure.canopies
    return jax.vmap(lambda x: tension(geometry(unpack(x, n), model.capsule), model.risers))(states)


@jax.jit
def _seen(flight: ClusterFlight, states: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Specific force in body axes (T, 3) and the quantities of interest (T, Q)."""
    n, model = flight.structure.canopies, flight.base

    def at(x: jax.Array, now: ClusterInputs) -> tuple[jax.Array, jax.Array]:
        zero = jnp.zeros(3)
        air = flight.air(x, model, now, now, zero, zero, 0.0)
        acceleration = vec3(state_rate(x, model, flight.structure, air)[3:6])
        lifted = Vec3(acceleration.x, acceleration.y, acceleration.z - model.gravity)
        felt = unpack(x, n).attitude.to_body(lifted).stack()
        return felt, jnp.stack([quantity(q, x, now.density, model.capsule.attach_b, n) for q in QUANTITIES])

    return jax.vmap(at)(states, flight.record)
