"""Outcome and integration error of a simulation, as values that batches of flights carry."""

from __future__ import annotations

from dataclasses import replace
from enum import IntEnum
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from bayeschute.compiler import compiled_model as kernel
from bayeschute.compiler.integrate import FlightModel, trajectory_compiled
from bayeschute.core.vectors import Component, norm
from bayeschute.dynamics.cluster import geometry, least_inertia
from bayeschute.dynamics.cluster_flight import ClusterFlight
from bayeschute.dynamics.state import CAPSULE_SIZE, unpack

LONGEST_SLACK = 1.0  # [s] that a riser of a descent may be slack; beyond, the model of lines and canopies is not valid
FASTEST = 340.0  # [m/s]; the model is not valid beyond
LONGEST = 1.5  # of a riser, over its unstretched length
_LARGEST = 1e7  # of a state of any other model, SI
LARGEST_STEP_ERROR = 0.01  # [m] of a place in the cluster
_SHARE = 1e-3  # of the largest size of a state of any other model, that its steps may cost
_HALVED = 16.0 / 15.0  # Richardson: error of a fourth-order method from its change when steps are halved


class Outcome(IntEnum):
    """Outcome of a simulation; the largest that applies counts."""

    OK = 0
    UNRESOLVED = 1
    SLACK = 2
    DIVERGED = 3
    ILL_POSED = 4

    @property
    def words(self) -> str:
        """For tables."""
        return ("ok", "steps too long", "a riser slack too long", "diverged", "ill-posed")[self]


class Simulation(NamedTuple):
    """States of a flight with outcome and error estimate; batch axes last.

    Attributes:
        states: (T, X, ...).
        step_error: Largest error of each state that is due to the steps (X, ...), by a flight in halved steps; not
            finite where that failed. Where risers become taut it is an order of magnitude only: the order of the
            method drops.
        outcome: An `Outcome` (...).
        failed_at: Sample at which it began (...); -1 where the outcome is ok.
    """

    states: jax.Array
    step_error: jax.Array
    outcome: jax.Array
    failed_at: jax.Array


def simulate(model: FlightModel, theta: Component, start: Component, error: Component) -> Simulation:
    """Simulate, simulate again with halved steps, and estimate outcome and error.

    The states are those of `bayeschute.compiler.integrate.trajectory`, by machine code where `kernel.flight` has it;
    the rest costs twice their time.

    Args:
        model: The flight.
        theta: Parameters (P, ...).
        start: Initial deviations (D, ...).
        error: Latent disturbances at every sample (T, A, ...).
    """
    return examine(model, theta, start, error, flown(model, theta, start, error))


def examine(model: FlightModel, theta: Component, start: Component, error: Component, states: Component) -> Simulation:
    """Outcome and error of simulated states: the part of `simulate` after the first simulation.

    Steps too long for a riser don't make a flight diverge: its tension can't push, so they shake it between slack and
    taut. The simulation in halved steps shows it.

    Args:
        model: The flight.
        theta: Parameters (P, ...).
        start: Initial deviations (D, ...).
        error: Latent disturbances at every sample (T, A, ...).
        states: From `bayeschute.compiler.integrate.trajectory` (T, X, ...).
    """
    given: Any = model
    finer = replace(given, stepping=model.stepping.finer())
    return _examined(model, theta, states, flown(finer, theta, start, error))


def flown(model: FlightModel, theta: Component, start: Component, error: Component) -> Component:
    """States (T, X, ...) as of `integrate.trajectory`, by machine code where there is any."""
    made = kernel.states(model, theta, start, error)
    return trajectory_compiled(model, theta, start, error) if made is None else made


@jax.jit
def _examined(model: FlightModel, theta: jax.Array, states: jax.Array, finer: jax.Array) -> Simulation:
    off = _HALVED * jnp.abs(finer - states)
    outcome, failed_at = judge(model, theta, states)
    if isinstance(model, ClusterFlight):
        coarse = (off[:, places(model.structure.canopies)] > LARGEST_STEP_ERROR).any(axis=1)
    else:
        coarse = (off > _SHARE * jnp.abs(states).max(axis=0)).any(axis=1)
    unresolved = (coarse | ~jnp.isfinite(finer).all(axis=1)).any(axis=0) & (outcome == Outcome.OK)
    first = jnp.argmax(coarse | ~jnp.isfinite(finer).all(axis=1), axis=0)
    return Simulation(
        states,
        off.max(axis=0),
        jnp.where(unresolved, int(Outcome.UNRESOLVED), outcome),
        jnp.where(unresolved, first, failed_at),
    )


def places(n: int) -> NDArray[np.int64]:
    """Where the positions of capsule and `n` canopies are in the state of a cluster (3 + 3 n,)."""
    return np.array([0, 1, 2, *range(CAPSULE_SIZE, CAPSULE_SIZE + 3 * n)])


def speeds(n: int) -> NDArray[np.int64]:
    """Where their velocities are (3 + 3 n,)."""
    return np.array([3, 4, 5, *range(CAPSULE_SIZE + 3 * n, CAPSULE_SIZE + 6 * n)])


def attributes(simulation: Simulation, dt: float, n: int) -> dict[str, str | float]:
    """Outcome and error of one flight of a cluster of `n` canopies, for the attributes of a dataset.

    Returns:
        ``outcome`` in words, ``failed_at_s`` where it isn't ok [s], and the largest errors due to the steps,
        ``step_error_position_m`` and ``step_error_velocity_m_per_s``, over all bodies.
    """
    off, failed_at = np.asarray(simulation.step_error), int(simulation.failed_at)
    values: dict[str, str | float] = {"outcome": Outcome(int(simulation.outcome)).words}
    if failed_at >= 0:
        values["failed_at_s"] = failed_at * dt
    values["step_error_position_m"] = float(off[places(n)].max())
    values["step_error_velocity_m_per_s"] = float(off[speeds(n)].max())
    return values


def judge(model: FlightModel, theta: jax.Array, states: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Outcome of a simulation and the sample at which it began; steps too long show only in `simulate`.

    Args:
        model: The flight.
        theta: Parameters (P, ...).
        states: States (T, X, ...).

    Returns:
        An `Outcome` (...) and the first sample concerned (...), -1 where there is none.
    """
    finite = jnp.isfinite(states).all(axis=1)
    if isinstance(model, ClusterFlight):
        faults = _cluster_faults(model, theta, states)
        faults[Outcome.DIVERGED] |= ~finite
    else:
        faults = {Outcome.DIVERGED: ~finite | (jnp.abs(states) > _LARGEST).any(axis=1)}
    outcome = jnp.zeros(states.shape[2:], int)
    failed_at = outcome - 1
    for kind, at in sorted(faults.items()):
        found = at.any(axis=0)
        outcome = jnp.where(found, int(kind), outcome)
        failed_at = jnp.where(found, jnp.argmax(at, axis=0), failed_at)
    return outcome, failed_at


def _cluster_faults(model: ClusterFlight, theta: jax.Array, states: jax.Array) -> dict[Outcome, jax.Array]:
    """Where each fault shows, (T, ...)."""
    n, numbers = model.structure.canopies, model.numbers(theta)
    rank = states.ndim - 2
    inputs = jax.tree.map(lambda a: jnp.reshape(a, (*jnp.shape(a), *(1,) * rank)), model.record)
    none = jnp.zeros((3, *(1,) * rank))

    def at(x: jax.Array, now: Any) -> tuple[jax.Array, jax.Array, jax.Array]:
        state = unpack(x, n)
        length = geometry(state, numbers.capsule).length
        fast = jnp.maximum(norm(state.velocity), norm(state.canopy_velocity).max(axis=0)) > FASTEST
        slack = (length <= numbers.risers.length).any(axis=0)
        air = model.air(x, numbers, now, now, none, none, 0.0)
        posed = least_inertia(x, numbers, model.structure, air).min(axis=0)
        return fast | (length > LONGEST * numbers.risers.length).any(axis=0), slack, posed <= 0.0

    diverged, slack, ill_posed = jax.vmap(at)(states, inputs)

    def count(run: jax.Array, now: jax.Array) -> tuple[jax.Array, jax.Array]:
        run = jnp.where(now, run + 1, 0)
        return run, run

    _, runs = jax.lax.scan(count, jnp.zeros(slack.shape[1:], int), slack)
    return {Outcome.SLACK: runs * model.dt > LONGEST_SLACK, Outcome.DIVERGED: diverged, Outcome.ILL_POSED: ill_posed}
