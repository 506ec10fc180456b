"""Simulation of the check cases with the product's own equations of motion and Runge-Kutta steps, in batches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from bayeschute.core.vectors import Component, Vec3
from bayeschute.dynamics.cluster import Air, geometry, state_rate, tension
from bayeschute.dynamics.parameters import Cluster, Structure
from bayeschute.dynamics.state import ClusterState, unpack
from bayeschute.verification.sets import SETS, Array, ParameterSet

CANOPIES = 2
MEMBERS = tuple((s, stiffer) for s in SETS for stiffer in (1.0, 10.0))  # every case is flown by these four
SUBSTEPS = 25  # with samples of 0.1 s a step of 4 ms: risers ten times as stiff have poles at -610 1/s
_CHUNK = 100  # samples flown by one call: one compilation serves flights of every duration


class Weather(NamedTuple):
    """Air that the check cases meet; z is down from where the canopies start.

    Attributes:
        density: At z = 0 [kg/m^3].
        scale_height: Density grows as exp(z/H); H [m].
        north_shear: Wind to the north per z [1/s].
        down: Wind downwards at z = 0 and t = 0 [m/s].
        down_ramp: Its growth with time [m/s^2].
        down_shear: Its growth with z [1/s].
    """

    density: float
    scale_height: float = np.inf
    north_shear: float = 0.0
    north: float = 0.0
    north_ramp: float = 0.0
    down: float = 0.0
    down_ramp: float = 0.0
    down_shear: float = 0.0

    def at(self, state: ClusterState, time: Component) -> Air:
        """The air where the canopies are; they coincide wherever it isn't the same everywhere."""
        z = state.canopy_position.z[0]
        zero = 0.0 * z
        down = self.down + self.down_ramp * time + self.down_shear * z
        density = self.density * jnp.exp(z / self.scale_height)
        still = Vec3(zero, zero, zero)
        north = self.north + self.north_ramp * time + self.north_shear * z
        return Air(Vec3(north, zero, down), still, density, 1.0, still)


def begin(s: ParameterSet, direction: Array, turning: Array, velocity: Sequence[float], depth: float = 0.0) -> Array:
    """Initial state of a capsule at the attitude (1, 0, 0, 0).

    Args:
        s: The parameter set; risers have its length.
        direction: Unit vectors capsule -> canopy (3, 2).
        turning: Their rates (3, 2) [1/s].
        velocity: Of the capsule, NED [m/s].
        depth: z of the first canopy [m].
    """
    capsule = np.array([0.0, 0.0, depth - s.length * direction[2, 0]])
    v = np.asarray(velocity, float)
    places, speeds = capsule[:, None] + s.length * direction, v[:, None] + s.length * turning
    return np.concatenate([capsule, v, [1.0, 0.0, 0.0, 0.0], np.zeros(3), places.ravel(), speeds.ravel()])


def leaning(lean: float, azimuth: Sequence[float] = (0.0, 0.0)) -> Array:
    """Directions (3, 2) of risers that lean off the vertical towards azimuths from north, both [rad]."""
    phi = np.asarray(azimuth, float)
    return np.stack([np.sin(lean) * np.cos(phi), np.sin(lean) * np.sin(phi), np.full(2, -np.cos(lean))])


@dataclass(frozen=True)
class Flown:
    """Flights of a batch.

    Attributes:
        time: [s], (T, B).
        states: (T, 13 + 6 n, B).
    """

    time: Array
    states: Array

    def member(self, b: int, until: float = np.inf) -> tuple[Array, ClusterState]:
        """Time (T,) and state by name, arrays (T,) or (canopy, T), of one flight up to a time [s]."""
        time = self.time[self.time[:, b] <= until + 1e-9, b]
        return time, unpack(jnp.asarray(self.states[: len(time), :, b].T), CANOPIES)

    def tension(self, b: int, model: Cluster) -> Array:
        """Tension of both risers of one flight, (canopy, T) [N]."""
        return np.asarray(tension(geometry(self.member(b)[1], model.capsule), model.risers))


def _step(rate: Callable[[jax.Array, Component], jax.Array], x: jax.Array, h: Component, i: jax.Array) -> jax.Array:
    """The i-th classical Runge-Kutta step of a sample; the sum of the rates rounds less than a sum of states."""
    k1 = rate(x, i / SUBSTEPS)
    k2 = rate(x + (0.5 * h) * k1, (i + 0.5) / SUBSTEPS)
    k3 = rate(x + (0.5 * h) * k2, (i + 0.5) / SUBSTEPS)
    k4 = rate(x + h * k3, (i + 1.0) / SUBSTEPS)
    return x + (h / 6.0) * (k1 + 2.0 * (k2 + k3) + k4)


@partial(jax.jit, static_argnames=("structure",))
def _chunk(
    x: jax.Array, time: jax.Array, dt: Any, model: Cluster, weather: Weather, structure: Structure
) -> tuple[jax.Array, jax.Array]:
    def sample(carry: tuple[jax.Array, jax.Array], _: None) -> tuple[Any, Any]:
        state, t = carry

        def rate(s: jax.Array, share: Component) -> jax.Array:
            air = weather.at(unpack(s, CANOPIES), t + share * dt)
            frozen = model.canopies.enclosed_volume * (weather.density / air.density)  # mass of the enclosed air
            now = replace(model, canopies=replace(model.canopies, enclosed_volume=frozen))
            return state_rate(s, now, structure, air)

        def step(x: jax.Array, i: jax.Array) -> tuple[jax.Array, None]:
            return _step(rate, x, dt / SUBSTEPS, i), None

        state = jax.lax.scan(step, state, jnp.arange(SUBSTEPS) * 1.0)[0]
        return (state, t + dt), state

    return jax.lax.scan(sample, (x, time), None, length=_CHUNK)[1], time + _CHUNK * dt


def fly(
    force: Callable[..., Vec3],
    starts: Sequence[Array],
    models: Sequence[Cluster],
    weather: Sequence[Weather],
    samples: int,
    dt: float | Sequence[float] = 0.1,
) -> Flown:
    """Fly a batch.

    Args:
        force: Law of the canopies' force.
        starts: Initial states, (13 + 6 n,) each.
        models: Their clusters.
        weather: Their air.
        samples: Number of samples after the first.
        dt: Their interval [s], of all or of each; it takes `SUBSTEPS` steps.

    Returns:
        States at the samples, the first included.
    """
    structure = Structure((), (), CANOPIES, force=force)
    x = jnp.asarray(np.stack(starts, axis=-1))
    stack = partial(jax.tree.map, lambda *leaves: np.array(leaves, dtype=float))
    model, air = stack(*models), stack(*weather)
    step = np.broadcast_to(np.asarray(dt, float), (len(starts),)).copy()
    time, parts = jnp.zeros(len(starts)), [np.asarray(x)[None]]
    while sum(len(p) for p in parts) <= samples:
        states, time = _chunk(x, time, step, model, air, structure)
        x = states[-1]
        parts.append(np.asarray(states))
    return Flown(np.arange(samples + 1)[:, None] * step, np.concatenate(parts)[: samples + 1])
