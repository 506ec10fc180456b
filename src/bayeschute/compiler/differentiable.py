"""The machine code of a flight's steps as a JAX function that `jax.jit`, `jax.grad` and `jax.vmap` take.

Outputs along a path and where every step leads from it are found by machine code (`compiler.compiled_model`), called
back from JAX; their derivatives are those that the same code has of every step, so that a gradient costs one pass along
the path, whatever differentiates what is built on it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from bayeschute.compiler import compiled_model
from bayeschute.compiler.integrate import FlightModel, Steps

Stepped = Callable[[jax.Array, jax.Array, jax.Array, jax.Array], tuple[jax.Array, jax.Array]]


def differentiable_steps(
    model: FlightModel, parameters: int, starts: int, errors: int, path_shape: tuple[int, int], outputs: int
) -> Stepped | None:
    """Outputs and steps along a path, by machine code, with reverse-mode derivatives.

    Args:
        model: The flight; its numbers are fixed.
        parameters: Size P of theta.
        starts: Size D of the initial deviations.
        errors: Size A of a sample's disturbances.
        path_shape: Samples and states (T, X).
        outputs: Size C of a sample's outputs.

    Returns:
        A function of theta (P,), start (D,), error (T, A) and path (T, X) that returns outputs (T, C), and the first
        state with the states that steps lead to (T, X); None where the flight isn't served by machine code. Under
        `jax.vmap` it is called one after the other.

    Example:
        ``jax.grad(lambda theta: jnp.sum(steps(theta, start, error, path)[1] ** 2))(theta)``
    """
    (samples, states) = path_shape
    blank = np.zeros(parameters), np.zeros(starts), np.zeros((samples, errors))
    programs = compiled_model.programs_for(model, *blank)
    if programs is None:
        return None
    fixed = jax.tree.map(np.asarray, model)

    def shaped(*shape: int) -> jax.ShapeDtypeStruct:
        return jax.ShapeDtypeStruct(shape, np.float64)

    values = shaped(samples, outputs), shaped(samples, states)
    by_step = samples - 1, states
    slopes: Any = (
        shaped(*by_step, states), shaped(*by_step, parameters), shaped(*by_step, errors), shaped(*by_step, errors),
        shaped(states, parameters), shaped(states, starts), shaped(samples, outputs, states),
        shaped(samples, outputs, parameters),
    )  # fmt: skip

    def evaluated(*given: Any) -> Any:  # NumPy alone: JAX must not be called from what it calls back
        y, reached, steps = compiled_model.arrays_along(programs, fixed, *map(np.asarray, given))
        return y, reached, jax.tree.map(np.ascontiguousarray, steps)

    def forward(*given: jax.Array) -> tuple[tuple[jax.Array, jax.Array], Steps]:
        y, reached, steps = jax.pure_callback(evaluated, (*values, Steps(*slopes)), *given, vmap_method="sequential")
        return (y, reached), steps

    def backward(steps: Steps, by: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, ...]:
        by_y, by_reached = by
        first, later = by_reached[0], by_reached[1:]
        theta = jnp.einsum("tcp,tc->p", steps.out_theta, by_y) + first @ steps.first_theta
        theta = theta + jnp.einsum("txp,tx->p", steps.by_theta, later)
        path = jnp.einsum("tcx,tc->tx", steps.out_state, by_y)
        path = path.at[:-1].add(jnp.einsum("tyx,ty->tx", steps.by_state, later))
        now, then = (jnp.einsum("txa,tx->ta", one, later) for one in (steps.by_now, steps.by_then))
        none = jnp.zeros((1, errors))
        error = jnp.concatenate([now, none]) + jnp.concatenate([none, then])
        return theta, first @ steps.first_start, error, path

    @jax.custom_vjp
    def stepped(theta: jax.Array, start: jax.Array, error: jax.Array, path: jax.Array) -> tuple[jax.Array, jax.Array]:
        return forward(theta, start, error, path)[0]

    stepped.defvjp(forward, backward)
    made: Stepped = stepped
    return made
