"""Simulation smoother: draws of initial state and disturbances of a linearised flight given its data.

A draw of the linear model is conditioned on the data by the smoother (Durbin and Koopman 2002). The smoother needs only
the innovations of the draw, and these are computed from the deviation of the draw from its own prediction, which stays
small where the draw itself grows without bound, as for an unstable flight.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from bayeschute.core.vectors import Component
from bayeschute.likelihood.joint import FlightData, NoiseParameters, Unknowns
from bayeschute.likelihood.kalman import Gains, Seen, backward, forward


class Normals(NamedTuple):
    """Standard normal numbers behind one draw of a flight: start (D, B), process noise (T, L, B), noise (T, C, B)."""

    start: Component
    process_noise: Component
    drift: Component
    white: Component


class Drawn(NamedTuple):
    """A draw: standard start and process noise, and the deviation of its states from the trajectory (T, X, B)."""

    unknowns: Unknowns
    states: jax.Array


def normals(flight: FlightData, draws: int, rng: np.random.Generator) -> Normals:
    """Numbers for `drawn`."""
    t, c = np.shape(flight.observed)
    shapes = ((flight.starts,), (t, flight.latent.size), (t, c), (t, c))
    return Normals(*(rng.standard_normal((*shape, draws)) for shape in shapes))


@jax.jit
def drawn(flight: FlightData, hyper: NoiseParameters, made: Gains, seen: Seen, z: Normals) -> Drawn:
    """Draw of the unknowns of the linear model given its data.

    Args:
        flight: The record.
        hyper: Noise parameters.
        made: The filter.
        seen: Data relative to a trajectory, one column per draw.
        z: From `normals`; zeros give the smoothed unknowns.
    """
    unit, weighted, filtered = forward(made, *seen)
    off, of_draw = _prediction_errors(flight, hyper, made, z)
    start, process_noise, vectors = backward(made, weighted - of_draw)
    predicted = filtered - made.gain @ (made.root @ unit) + off
    states = predicted[:, : seen.inputs.shape[1]] + made.spread @ vectors
    return Drawn(Unknowns(start + z.start, process_noise + z.process_noise), states)


def _prediction_errors(
    flight: FlightData, hyper: NoiseParameters, made: Gains, z: Normals
) -> tuple[jax.Array, jax.Array]:
    """By how much a draw runs from its prediction (T, S, B), and its innovations times their inverse covariance."""
    noise, many = hyper.outputs(flight), z.start.shape[1]
    count, size = made.output.shape[1:]
    phi, sd = (jnp.asarray(a)[:, None] for a in (jnp.exp(-flight.dt / noise.time_constant), noise.correlated))
    white = jnp.asarray(noise.white)[:, None] * z.white
    rows = jnp.asarray(flight.present)[..., None]
    noisy = jnp.zeros((len(rows), size, many))
    noisy = (
        noisy.at[:, size - count :]
        .set(sd * jnp.sqrt(1.0 - phi**2) * z.drift)
        .at[0, size - count :]
        .set(sd * z.drift[0])
    )

    def step(off: jax.Array, row: tuple) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
        f, h, gain, inverse, g, e, here, white_noise, drift = row
        v = jnp.where(here, h @ off + e, 0.0)
        return f @ (off - gain @ v) + g @ white_noise + drift, (off, inverse.T @ (inverse @ v))

    first = made.start @ z.start + made.first @ z.process_noise[0] + noisy[0]
    after = (jnp.concatenate([a[1:], a[:1]]) for a in (z.process_noise, noisy))  # the last is not used
    parts = (made.transition, made.output, made.gain, made.inverse, made.noise_gain, white, rows, *after)
    return jax.lax.scan(step, first, parts)[1]
