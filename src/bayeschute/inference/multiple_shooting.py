"""Multiple shooting: a flight cut into short ones whose ends are tied softly to the beginnings of the next.

Each segment is flown from a node of its own, so that no error lives longer than a segment; nodes begin at filtered
states, close to the data. A node holds the latent processes beside the flight's state; within a segment they decay as
expected, and a tie is as soft as their shocks make the segment's end uncertain, carried through the linearised segment.
Shocks of two segments are independent, so ties are. What shocks do to the samples inside a segment is left out: that is
the approximation, small where segments are short.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bayeschute.air.vector import Component
from bayeschute.dynamics.integrate import outputs, trajectory
from bayeschute.inference.filter_error import Estimate, extended_filter
from bayeschute.inference.noise import whiten
from bayeschute.inference.priors import Prior, factor, working
from bayeschute.inference.target import FlightData, Hyper

Array = NDArray[np.float64]
_FLOOR = 1e-6  # least standard deviation of a tie [unit of the state]


def _padded(data: FlightData, length: int) -> FlightData:
    """The flight with samples added so that segments of this many intervals fill it; nothing is recorded there."""
    more = -(data.samples - 1) % length
    model: Any = data.model

    def longer(a: Any) -> Array:
        return np.concatenate([np.asarray(a), np.repeat(np.asarray(a)[-1:], more, axis=0)])

    record = jax.tree.map(longer, model.record) if hasattr(model, "record") else None
    seen = np.concatenate([np.asarray(data.present, bool), np.zeros((more, data.present.shape[1]), bool)])
    if record is None:
        raise TypeError("a flight model whose inputs are its `record` is needed")
    return replace(data, model=replace(model, record=record), observed=longer(data.observed), present=seen)


def _segments(data: FlightData, length: int) -> Any:
    """The flight's models, one per segment, leaves of the record (N, length + 1, ...)."""
    model: Any = data.model
    starts = np.arange(0, data.samples - 1, length)
    index = starts[:, None] + np.arange(length + 1)
    return jax.tree.map(lambda a: jnp.asarray(a)[index], model.record)


@partial(jax.jit, static_argnames="length")
def tie_covariances(data: FlightData, hyper: Hyper, theta: Component, states: Component, length: int) -> jax.Array:
    """What shocks do to flight and processes at segments' ends: covariances (N - 1, X + L, X + L).

    Args:
        data: The record, filled up to whole segments.
        hyper: Noise parameters.
        theta: Parameters (P,).
        states: States about which to linearise (T, X).
        length: Intervals per segment.
    """
    model, made, inputs = data.model, hyper.dynamics(data), data.model.inputs()
    numbers, still = model.numbers(jnp.asarray(theta)), jnp.zeros(data.latent.rows)
    now, then = jax.tree.map(lambda a: jnp.asarray(a)[:-1], inputs), jax.tree.map(lambda a: jnp.asarray(a)[1:], inputs)
    advance = jax.jacfwd(lambda x, e0, e1, a, b: model.advance(x, numbers, a, b, e0, e1), argnums=(0, 1, 2))
    by_x, by_now, by_then = jax.vmap(advance, in_axes=(0, None, None, 0, 0))(states[:-1], still, still, now, then)
    total = states.shape[1] + data.latent.size

    def segment(by_x: jax.Array, by_now: jax.Array, by_then: jax.Array) -> jax.Array:
        def step(p: jax.Array, row: tuple) -> tuple[jax.Array, None]:
            a, b0, b1 = row
            top = jnp.concatenate([a, b0 @ made.output + b1 @ (made.output @ made.transition)], axis=1)
            below = jnp.concatenate([jnp.zeros((data.latent.size, a.shape[0])), made.transition], axis=1)
            f = jnp.concatenate([top, below])
            g = jnp.concatenate([b1 @ (made.output @ made.shock), made.shock])
            return f @ p @ f.T + g @ g.T, None

        return jax.lax.scan(step, jnp.zeros((total, total)), (by_x, by_now, by_then))[0]

    def cut(a: jax.Array) -> jax.Array:
        return a.reshape(-1, length, *a.shape[1:])[:-1]

    spread = jax.vmap(segment)(cut(by_x), cut(by_now), cut(by_then))
    return 0.5 * (spread + spread.transpose(0, 2, 1)) + _FLOOR**2 * jnp.eye(total)


class _Given(NamedTuple):
    """What a fit holds fixed: priors as centres and the inverse of their factor, and a whitener.

    The whitener is that of the ties (N - 1, X + L, X + L).
    """

    data: FlightData
    hyper: Hyper
    priors: tuple[Component, Component]
    records: Any
    whitener: Component


def _rows(u: jax.Array, given: _Given, length: int) -> jax.Array:
    """Everything whose half square is the cost; u holds theta, standard start (D + L) and nodes (N - 1, X + L)."""
    data, hyper, priors, records, whitener = given
    p, d, total = priors[0].shape[0], data.starts + data.latent.size, whitener.shape[1]
    theta, start, nodes = u[:p], u[p : p + d], u[p + d :].reshape(-1, total)
    model: Any = data.model
    made, size = hyper.dynamics(data), total - data.latent.size
    first = model.initial(model.numbers(theta), jnp.asarray(data.start_scale) * start[: data.starts])
    nodes = jnp.concatenate([jnp.concatenate([first, made.first @ start[data.starts :]])[None], nodes])

    def decay(e: jax.Array, _: None) -> tuple[jax.Array, jax.Array]:
        return made.transition @ e, e

    def fly(node: jax.Array, record: Any) -> tuple[jax.Array, jax.Array]:
        begun = _From(replace(model, record=record), node[:size])
        _, latent = jax.lax.scan(decay, node[size:], length=length + 1)
        x = trajectory(begun, theta, jnp.zeros(data.starts), latent @ made.output.T)
        return x, jnp.concatenate([x[-1], latent[-1]])

    flown, ends = jax.vmap(fly)(nodes, records)
    states = jnp.concatenate([flown[:, :-1].reshape(-1, size), flown[-1, -1:]])
    residual = jnp.where(data.present, data.observed - outputs(model, states, theta), 0.0)
    unit = whiten(hyper.outputs(data), data.dt, jnp.asarray(data.present), residual)
    ties = jnp.einsum("nij,nj->ni", whitener, nodes[1:] - ends[:-1])
    return jnp.concatenate([unit.ravel(), ties.ravel(), start, priors[1] @ (theta - priors[0])])


class _From:
    """A flight model that begins at a given state."""

    def __init__(self, model: Any, state: jax.Array) -> None:
        self.inputs, self.numbers, self.advance, self.observe = (
            model.inputs,
            model.numbers,
            model.advance,
            model.observe,
        )
        self.state = state

    def initial(self, numbers: Any, start: jax.Array) -> jax.Array:
        """The state."""
        return self.state


@partial(jax.jit, static_argnames="length")
def _value(u: jax.Array, given: _Given, length: int) -> jax.Array:
    """Minus the log density at u, constants aside."""
    return 0.5 * jnp.sum(_rows(u, given, length) ** 2)


@partial(jax.jit, static_argnames="length")
def _normal_equations(u: jax.Array, given: _Given, length: int) -> tuple[jax.Array, jax.Array]:
    """Gauss-Newton matrix and gradient at u."""
    rows, by = _rows(u, given, length), jax.jacfwd(_rows)(u, given, length)
    return by.T @ by, by.T @ rows


def fit(
    data: FlightData,
    hyper: Hyper,
    priors: Sequence[Prior],
    theta: Array,
    length: int,
    tolerance: float = 0.01,
    most: int = 40,
) -> Estimate:
    """Most probable parameters by multiple shooting.

    Args:
        data: A record; its model keeps its inputs in `record`.
        hyper: Noise parameters, fixed; the latent ones make the ties.
        priors: Priors of the parameters.
        theta: Where to start (P,).
        length: Intervals per segment, two segments at least.
        tolerance: Largest step of a parameter over its standard error at which to stop.
        most: Most steps.

    Returns:
        The estimate; its covariance is that of parameters, start and nodes eliminated.

    Raises:
        ValueError: If there is no more than one segment.
        FloatingPointError: If the flight is not finite where the search starts.
    """
    if data.samples - 1 <= length:
        raise ValueError(f"segments of {length} intervals make no second one of {data.samples} samples")
    whole, centre = _padded(data, length), working(priors)[0]
    seen = extended_filter(whole, hyper, theta)
    states = seen.states
    whitener = np.linalg.inv(np.linalg.cholesky(tie_covariances(whole, hyper, theta, states, length)))
    nodes = jnp.concatenate([states, seen.latent], axis=1)[: whole.samples - 1 : length][1:]
    given = _Given(
        whole, hyper, (jnp.asarray(centre), jnp.linalg.inv(factor(priors))), _segments(whole, length), whitener
    )
    u, p = np.concatenate([theta, np.zeros(data.starts + data.latent.size), np.ravel(nodes)]), len(priors)
    value, damping, converged = float(_value(jnp.asarray(u), given, length)), 1e-4, False
    if not np.isfinite(value):
        raise FloatingPointError("the segments are not finite where the search starts")
    for _ in range(most):
        matrix, gradient = (np.asarray(a) for a in _normal_equations(jnp.asarray(u), given, length))
        sd_now = np.sqrt(np.diag(scipy.linalg.inv(matrix))[:p])
        while damping < 1e8:
            step = -np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)), gradient)
            new = float(_value(jnp.asarray(u + step), given, length))
            if new <= value + 1e-9 * abs(value):
                break
            damping = max(10.0 * damping, 1e-6)
        else:
            break
        converged = bool(np.max(np.abs(step[:p]) / sd_now) < tolerance and value - new < tolerance and damping < 1e-2)
        u, value, damping = u + step, new, damping / 10.0
        if converged:
            break
    matrix = np.asarray(_normal_equations(jnp.asarray(u), given, length)[0])
    return Estimate(u[:p], scipy.linalg.inv(matrix)[:p, :p], value, converged)
