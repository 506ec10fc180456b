"""The cluster as one body that descends steadily: fly-out angle, drag area, and force coefficients by angle of attack.

Other programs hang one body under one parachute. What the canopies of a draw do together follows from the simulator's
forces: n canopies stand evenly about the vertical, each at the fly-out angle phi off it, in still air, without a rate.
Two balances fix phi and the speed V,

    rho/2 V^2 S_D(V, phi) = (m_capsule + n m_dry) g,            S_D: drag area of canopies and capsule,
    force across a riser, away from the others = 0              of air, dry weight and riser couple,

the second without inertia, so enclosed air has no part. A canopy alone has phi = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from bayeschute.atmosphere.standard import SEA_LEVEL_DENSITY
from bayeschute.core.errors import Fault, InputError
from bayeschute.core.vectors import Component, Quaternion, Vec3, cross, dot
from bayeschute.dynamics.cluster import Air, canopy_flow, canopy_force, capsule_aerodynamics, geometry, riser_force
from bayeschute.dynamics.cluster_flight import with_parameters
from bayeschute.dynamics.parameters import Cluster, Structure
from bayeschute.dynamics.state import ClusterState
from bayeschute.landing.aero_table import ANGLES
from bayeschute.landing.campaign_plan import Parameters

Array = NDArray[np.float64]
WIDEST = np.deg2rad(60.0)
"""Fly-out angle up to which a balance is looked for."""
_STEP = np.deg2rad(0.5)
_HALVINGS, _SPEEDS = 40, 12
_AZIMUTHS = 24  # directions of the airflow about the cluster's axis over which coefficients are averaged
_SMALL_RATE = 1e-3  # [1], l/(2V) times the rate of the axis at which damping is taken
_AT_ONCE = 256  # draws


@dataclass(frozen=True)
class SteadyCluster:
    """Steady vertical descents in still air at sea level, one a draw (D,).

    Attributes:
        flyout: Angle of every riser off the vertical [rad].
        speed: Descent rate [m/s].
        drag_area: Of canopies and capsule, 2 m g/(rho V^2) [m^2].
        canopy_drag_area: Of all canopies alone [m^2].
        area: Reference area of all canopies [m^2].
        length: Reference length of a canopy [m].
        reach: From the attach point to the canopies, along the vertical [m].
        mass: Of capsule and dry canopies [kg].
        gravity: [m/s^2].
        enclosed_volume: Of the air that moves with all canopies [m^3].
    """

    flyout: Array
    speed: Array
    drag_area: Array
    canopy_drag_area: Array
    area: Array
    length: Array
    reach: Array
    mass: Array
    gravity: Array
    enclosed_volume: Array


def steady_clusters(models: Sequence[Parameters], density: float = SEA_LEVEL_DENSITY) -> SteadyCluster:
    """Steady descents of all draws, in their order through the models.

    Args:
        models: Draws of the posterior.
        density: Of the air [kg/m^3].

    Raises:
        InputError: If canopies of a draw are pushed apart beyond `WIDEST`.
    """
    parts = [_of_model(one, density) for one in models]
    made = SteadyCluster(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(SteadyCluster)))
    lost = int(np.isnan(made.flyout).sum())
    if lost:
        got = f"no steady fly-out angle below {np.rad2deg(WIDEST):g} deg for {lost} of {made.flyout.size} draws"
        do = "Their forces are known only near the angles that were flown; look at `posterior.curve('C_N')`."
        raise InputError(Fault("canopies as one body", got, "canopies that come to rest beside each other", do))
    return made


def _of_model(one: Parameters, density: float) -> SteadyCluster:
    n, draws, theta = one.structure.canopies, len(one.theta), jnp.asarray(one.theta.T)
    base = jax.tree.map(lambda a: jnp.asarray(a, float), one.base)
    solved = partial(_balance, base, structure=one.structure, names=one.names, density=density)
    flyout = np.zeros(draws)
    if n > 1:
        grid = np.arange(_STEP, WIDEST + 0.5 * _STEP, _STEP)
        across = [np.asarray(solved(theta, jnp.full(draws, phi))[0]) for phi in grid]
        flyout = _first_balance(solved, theta, grid, np.array(across))
    _, speed, total, canopies = (np.asarray(a) for a in solved(theta, jnp.asarray(np.nan_to_num(flyout))))
    numbers = with_parameters(base, one.structure, one.names, theta)

    def each(value: Component) -> Array:
        return np.asarray(jnp.broadcast_to(value, (draws,)))

    mass, riser = numbers.capsule.mass + n * numbers.canopies.dry_mass, numbers.risers
    length = riser.length + numbers.capsule.mass * numbers.gravity / (n * riser.stiffness)
    return SteadyCluster(
        flyout, speed, total, canopies, each(n * numbers.canopies.area), each(numbers.canopies.length),
        each(length * np.cos(flyout)), each(mass), each(numbers.gravity), each(n * numbers.canopies.enclosed_volume),
    )  # fmt: skip


def _first_balance(solved: Any, theta: jax.Array, grid: Array, across: Array) -> Array:
    """The least angle (D,) at which the outward force turns inward; 0 where it is inward at once, NaN where nowhere."""
    inward = across <= 0.0
    first = inward.argmax(axis=0)
    low, high = np.where(first > 0, grid[first - 1], 0.0), grid[first]
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        out = np.asarray(solved(theta, jnp.asarray(middle))[0]) > 0.0
        low, high = np.where(out, middle, low), np.where(out, high, middle)
    return np.where(inward.any(axis=0), np.where(first > 0, 0.5 * (low + high), 0.0), np.nan)


@partial(jax.jit, static_argnames=("structure", "names", "density"))
def _balance(
    base: Cluster, theta: jax.Array, flyout: jax.Array, structure: Structure, names: tuple[str, ...], density: float
) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    """At fly-out angles (D,): outward force across a riser [N], speed [m/s], drag areas: all, canopies [m^2]."""
    numbers, n = with_parameters(base, structure, names, theta), structure.canopies
    weight = (numbers.capsule.mass + n * numbers.canopies.dry_mass) * numbers.gravity + 0.0 * flyout

    def areas(speed: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
        state, air = _state(numbers, structure, flyout, Vec3(0.0 * speed, 0.0 * speed, speed)), _air(density)
        geo, q = geometry(state, numbers.capsule), 0.5 * density * speed**2
        force = canopy_force(canopy_flow(state, geo, numbers, structure, air), geo, numbers, structure, air)
        couple = riser_force(state, geo, 0.0 * geo.length, numbers, structure, air)
        on_capsule, _ = capsule_aerodynamics(state, numbers.capsule, air)
        up = -force.z.sum(axis=0)
        known = Vec3(force.x - couple.x, force.y - couple.y, force.z - couple.z)
        known = Vec3(known.x, known.y, known.z + numbers.canopies.dry_mass * numbers.gravity)
        outward = dot(known, _outward(structure, flyout)).mean(axis=0)
        return outward, (up - state.attitude.to_ned(on_capsule).z) / q, up / q

    def faster(_: int, speed: jax.Array) -> jax.Array:
        return jnp.sqrt(2.0 * weight / (density * jnp.maximum(areas(speed)[1], 1e-3)))

    first = jnp.zeros_like(weight) + numbers.canopies.speed
    speed = jax.lax.fori_loop(0, _SPEEDS, faster, first)
    outward, total, canopies = areas(speed)
    return outward, speed, total, canopies


def cluster_coefficients(one: Parameters, flyout: Array, speed: Array, angles: Array = ANGLES) -> Array:
    """Coefficients of all canopies as one rigid body, over their area together.

    The risers stand at the fly-out angle about the body's axis while the air comes at a total angle of attack to it;
    the coefficients are means over the azimuths from which it may come. Density is that of sea level. Of one canopy,
    and of canopies without fly-out that don't influence each other, they are those of `aero_table`, but for terms by
    speed.

    Args:
        one: Draws of a model (D).
        flyout: Fly-out angles (D,) [rad].
        speed: Airspeeds (D,) [m/s].
        angles: Total angles of attack (A,) [rad].

    Returns:
        C_A, C_N and the derivative of C_N by alpha_dot l/(2V), (3, A, D) [1].
    """
    base = jax.tree.map(lambda a: jnp.asarray(a, float), one.base)
    parts = []
    for at in range(0, len(one.theta), _AT_ONCE):
        theta = one.theta[at : at + _AT_ONCE].T
        d, count = theta.shape[1], len(angles) * _AZIMUTHS
        alpha, azimuth = np.meshgrid(angles, 2.0 * np.pi * (np.arange(_AZIMUTHS) + 0.25) / _AZIMUTHS, indexing="ij")
        points = (np.repeat(a.ravel(), d) for a in (alpha, azimuth))
        held = (np.tile(a[at : at + _AT_ONCE], count) for a in (flyout, speed))
        made = _coefficients(base, jnp.tile(theta, count), *points, *held, one.structure, one.names)
        parts.append(np.asarray(made).reshape(3, len(angles), _AZIMUTHS, d).mean(axis=2))
    return np.concatenate(parts, axis=2)


@partial(jax.jit, static_argnames=("structure", "names"))
def _coefficients(
    base: Cluster, theta: jax.Array, alpha: jax.Array, azimuth: jax.Array, flyout: jax.Array, speed: jax.Array,
    structure: Structure, names: tuple[str, ...],
) -> jax.Array:  # fmt: skip
    """Coefficients (3, B) of points (B,): the air comes at alpha from an azimuth."""
    numbers, n = with_parameters(base, structure, names, theta), structure.canopies
    side = Vec3(jnp.cos(azimuth), jnp.sin(azimuth), 0.0 * azimuth)
    along = Vec3(jnp.sin(alpha) * side.x, jnp.sin(alpha) * side.y, jnp.cos(alpha))
    state, air = _state(numbers, structure, flyout, along * speed), _air(SEA_LEVEL_DENSITY)
    still = geometry(state, numbers.capsule)
    scale = 0.5 * SEA_LEVEL_DENSITY * speed**2 * n * numbers.canopies.area

    def force(rate: float) -> Vec3:
        # The axis, from canopies to capsule, turns away from the airflow: x_dot = -rate side, with l/(2V) taken out.
        turning = rate * 2.0 * speed / numbers.canopies.length
        omega = cross(Vec3(0.0 * alpha, 0.0 * alpha, 1.0 + 0.0 * alpha), side) * -turning
        geo = replace(still, across=cross(omega, still.direction) * still.length)
        total = canopy_force(canopy_flow(state, geo, numbers, structure, air), geo, numbers, structure, air)
        return total.map(lambda c: jnp.broadcast_to(c, geo.length.shape).sum(axis=0))

    here, more, less = force(0.0), force(_SMALL_RATE), force(-_SMALL_RATE)
    damping = -dot(more - less, side) / (2.0 * _SMALL_RATE)
    return jnp.stack([-here.z / scale, -dot(here, side) / scale, damping / scale])


def _air(density: float) -> Air:
    still = Vec3(0.0, 0.0, 0.0)
    return Air(still, still, density, 1.0, still)


def _turns(structure: Structure, like: Component) -> Component:
    """Azimuths of the canopies (n, ...) [rad]."""
    return jnp.reshape(2.0 * jnp.pi * jnp.arange(structure.canopies) / structure.canopies, (-1, *(1,) * jnp.ndim(like)))


def _outward(structure: Structure, flyout: Component) -> Vec3:
    """Unit vectors (n, ...) across the risers, away from the cluster's axis."""
    turns = _turns(structure, flyout)
    return Vec3(jnp.cos(flyout) * jnp.cos(turns), jnp.cos(flyout) * jnp.sin(turns), jnp.sin(flyout) + 0.0 * turns)


def _state(numbers: Cluster, structure: Structure, flyout: Component, velocity: Vec3) -> ClusterState:
    """An upright cluster (B) at fly-out angles that moves as one; its risers carry the capsule's weight."""
    n, zero, turns = structure.canopies, 0.0 * velocity.z, _turns(structure, flyout)
    direction = Vec3(jnp.sin(flyout) * jnp.cos(turns), jnp.sin(flyout) * jnp.sin(turns), -jnp.cos(flyout) + 0.0 * turns)
    level = np.sqrt(0.5)
    attitude = Quaternion(level + zero, zero, level + zero, zero)  # body x upwards
    still = Vec3(zero, zero, zero)
    length = numbers.risers.length + numbers.capsule.mass * numbers.gravity / (n * numbers.risers.stiffness)
    place = attitude.to_ned(numbers.capsule.attach_b) + direction * (length + zero)
    moving = velocity.map(lambda c: c + jnp.zeros_like(direction.x))
    shape = (jnp.zeros_like(direction.x),) * 2 if structure.breathing else ()
    return ClusterState(still, velocity, attitude, still, place, moving, *shape)
