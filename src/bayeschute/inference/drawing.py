"""Draws of the start and disturbances of a linearised flight given its data, by simulation smoothing.

A draw of the linear model is moved onto the data by the smoother (Durbin and Koopman 2002).
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from bayeschute.air.vector import Component
from bayeschute.inference.noise import colour
from bayeschute.inference.statespace import Gains, smooth
from bayeschute.inference.target import FlightData, Hyper, Unknowns


class Normals(NamedTuple):
    """Standard normal numbers behind one draw of a flight: start (D, B), shocks (T, L, B), residual noise (T, C, B)."""

    start: Component
    shocks: Component
    drift: Component
    white: Component


def normals(flight: FlightData, draws: int, rng: np.random.Generator) -> Normals:
    """Numbers for `drawn`."""
    t, c = np.shape(flight.observed)
    shapes = ((flight.starts,), (t, flight.latent.size), (t, c), (t, c))
    return Normals(*(rng.standard_normal((*shape, draws)) for shape in shapes))


@jax.jit
def about(made: Gains, residual: jax.Array, unknowns: Unknowns) -> jax.Array:
    """What the linear model sees of residuals simulated at these unknowns."""
    return residual + linear_response(made, unknowns)


@jax.jit
def drawn(flight: FlightData, hyper: Hyper, made: Gains, series: jax.Array, z: Normals) -> Unknowns:
    """Smooth the difference between data and a draw of the linear model, and add it to the draw."""
    seen = linear_response(made, Unknowns(z.start, z.shocks))
    seen = seen + colour(hyper.outputs(flight), flight.dt, z.drift, z.white)
    start, shocks = smooth(made, series - seen)
    return Unknowns(start + z.start, shocks + z.shocks)


def linear_response(made: Gains, unknowns: Unknowns) -> jax.Array:
    """Outputs (T, C, B) of the linear model driven by standard unknowns, residual noise left out."""

    def step(state: jax.Array, row: tuple) -> tuple[jax.Array, jax.Array]:
        f, h, g, z = row
        return f @ state + g @ z, h @ state

    first = made.start @ unknowns.start + made.first @ unknowns.shocks[0]
    later = jnp.concatenate([unknowns.shocks[1:], unknowns.shocks[:1]])  # the last is not used
    return jax.lax.scan(step, first, (made.transition, made.output, made.shock, later))[1]
