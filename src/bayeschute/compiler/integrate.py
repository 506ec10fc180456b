"""One simulation loop and its exact Jacobians for every model of a flight.

A model advances a state from one sample of a record to the next. Simulations run through the samples in turn; Jacobians
are taken of all steps at once along a known path, so their cost hardly depends on the number of parameters.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp

from bayeschute.compiler.runge_kutta import Stepping


class FlightModel(Protocol):
    """A flight in discrete time: a dataclass and a pytree whose leaves are the record's inputs; batch axes are last.

    `theta` (P, ...) are parameters in working coordinates, `start` (D, ...) deviations of the initial state, `error`
    (A, ...) the latent disturbances at a sample.

    Attributes:
        stepping: How it goes through a sample.
    """

    @property
    def stepping(self) -> Stepping:
        """Static."""

    def inputs(self) -> Any:
        """Inputs with a leading time axis, one entry per sample."""

    def numbers(self, theta: jax.Array) -> Any:
        """What the other methods need of the parameters, computed once per simulation."""

    def initial(self, numbers: Any, start: jax.Array) -> jax.Array:
        """State at the first sample (X, ...)."""

    def advance(
        self, x: jax.Array, numbers: Any, now: Any, then: Any, error_now: jax.Array, error_then: jax.Array
    ) -> jax.Array:
        """State at the next sample."""

    def observe(self, x: jax.Array, numbers: Any, now: Any) -> jax.Array:
        """Outputs at a sample (C, ...)."""


def _widen(tree: Any, rank: int) -> Any:
    return jax.tree.map(lambda a: jnp.reshape(a, (*jnp.shape(a), *(1,) * rank)), tree)


def trajectory(
    model: FlightModel, theta: jax.Array, start: jax.Array, error: jax.Array, given: jax.Array | None = None
) -> jax.Array:
    """States at every sample.

    Args:
        model: The flight.
        theta: Parameters (P, ...).
        start: Initial deviations (D, ...).
        error: Latent disturbances at every sample (T, A, ...).
        given: States known at the first samples (K, X, ...); the simulation goes on from the last of them.

    Returns:
        States (T, X, ...).
    """
    inputs = _widen(model.inputs(), theta.ndim - 1)
    numbers = model.numbers(theta)
    known = model.initial(numbers, start)[None] if given is None else given
    first, done = known[-1], len(known) - 1

    def step(x: jax.Array, now_then: Any) -> tuple[jax.Array, jax.Array]:
        now, then, e0, e1 = now_then
        x = model.advance(x, numbers, now, then, e0, e1)
        return x, x

    now, then = jax.tree.map(lambda a: a[done:-1], inputs), jax.tree.map(lambda a: a[done + 1 :], inputs)
    _, rest = jax.lax.scan(step, first, (now, then, error[done:-1], error[done + 1 :]))
    return jnp.concatenate([known, rest])


def outputs(model: FlightModel, states: jax.Array, theta: jax.Array) -> jax.Array:
    """Outputs at every sample (T, C, ...) of given states (T, X, ...)."""
    inputs = _widen(model.inputs(), theta.ndim - 1)
    numbers = model.numbers(theta)
    return jax.vmap(lambda x, now: model.observe(x, numbers, now))(states, inputs)


class Steps(NamedTuple):
    """Exact derivatives of every step along a known trajectory, and of the outputs; X states.

    Attributes:
        by_state: Next state by state (T - 1, X, X).
        by_theta: Next state by parameters (T - 1, X, P).
        by_now: Next state by disturbances at the sample (T - 1, X, A).
        by_then: Next state by disturbances at the next sample (T - 1, X, A).
        first_theta: First state by parameters (X, P).
        first_start: First state by initial deviations (X, D).
        out_state: Outputs by state (T, C, X).
        out_theta: Outputs by parameters (T, C, P).
    """

    by_state: jax.Array
    by_theta: jax.Array
    by_now: jax.Array
    by_then: jax.Array
    first_theta: jax.Array
    first_start: jax.Array
    out_state: jax.Array
    out_theta: jax.Array


class Reached(NamedTuple):
    """The first state (X,) of parameters and deviations, and where a step leads from every state of a path (T - 1, X).

    They equal the path's own states where it obeys the equations of motion.
    """

    first: Any
    steps: Any


def reached(model: FlightModel, theta: jax.Array, start: jax.Array, error: jax.Array, path: jax.Array) -> Reached:
    """The first state, and where every step leads from the states of a path.

    Args:
        model: The flight.
        theta: Parameters (P, ...).
        start: Initial deviations (D, ...).
        error: Latent disturbances at every sample (T, A, ...).
        path: States (T, X, ...), which need not obey the equations of motion.
    """
    inputs, numbers = _widen(model.inputs(), theta.ndim - 1), model.numbers(theta)
    now, then = jax.tree.map(lambda a: a[:-1], inputs), jax.tree.map(lambda a: a[1:], inputs)
    steps = jax.vmap(lambda x, now, then, e0, e1: model.advance(x, numbers, now, then, e0, e1))
    return Reached(model.initial(numbers, start), steps(path[:-1], now, then, error[:-1], error[1:]))


def along_path(
    model: FlightModel, theta: jax.Array, start: jax.Array, error: jax.Array, path: jax.Array
) -> tuple[jax.Array, Reached, Steps]:
    """Outputs (T, C) on a path, where its steps lead, and the derivatives of all steps at once.

    Args:
        model: The flight.
        theta: Parameters (P,).
        start: Initial deviations (D,).
        error: Latent disturbances at every sample (T, A).
        path: States (T, X), which need not obey the equations of motion.
    """
    inputs = model.inputs()
    now, then = jax.tree.map(lambda a: a[:-1], inputs), jax.tree.map(lambda a: a[1:], inputs)

    def advance(x: jax.Array, theta: jax.Array, now: Any, then: Any, e0: jax.Array, e1: jax.Array) -> jax.Array:
        return model.advance(x, model.numbers(theta), now, then, e0, e1)

    step = jax.vmap(jax.jacfwd(advance, argnums=(0, 1, 4, 5)), in_axes=(0, None, 0, 0, 0, 0))
    rows = (path[:-1], theta, now, then, error[:-1], error[1:])
    along = step(*rows)
    first = jax.jacfwd(lambda t, d: model.initial(model.numbers(t), d), argnums=(0, 1))(theta, start)
    observe = jax.vmap(
        jax.jacfwd(lambda x, t, now: model.observe(x, model.numbers(t), now), argnums=(0, 1)), in_axes=(0, None, 0)
    )
    return (
        outputs(model, path, theta),
        reached(model, theta, start, error, path),
        Steps(*along, *first, *observe(path, theta, inputs)),
    )


trajectory_compiled = jax.jit(trajectory)
