"""Simulation smoother: draws of initial state and disturbances of a linearised flight given its data.

A draw of the linear model is conditioned on the data by the smoother (Durbin and Koopman 2002). The smoother needs only
the innovations of the draw, and these are computed from the deviation of the draw from its own prediction, which stays
small where the draw itself grows without bound, as for an unstable flight.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from bayeschute.core.random import stream
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
    states: Component


def normals(flight: FlightData, draws: int, rng: np.random.Generator) -> Normals:
    """Numbers for `drawn`."""
    return Normals(*(rng.standard_normal((*shape, draws)) for shape in _shapes(flight)))


def _shapes(flight: FlightData) -> tuple[tuple[int, ...], ...]:
    """Of one draw of `Normals`."""
    t, c = np.shape(flight.observed)
    return (flight.starts,), (t, flight.latent.size), (t, c), (t, c)


def same_normals(flight: FlightData, draws: int) -> Normals:
    """Numbers for `drawn` that are the same in every call; not to be changed."""
    return _of_stream(_shapes(flight), draws)


@lru_cache(maxsize=8)
def _of_stream(shapes: tuple[tuple[int, ...], ...], draws: int) -> Normals:
    rng = stream(0, "pairs of the mean flight")
    return Normals(*(rng.standard_normal((*shape, draws)) for shape in shapes))


def drawn(flight: FlightData, hyper: NoiseParameters, made: Gains, seen: Seen, z: Normals) -> Drawn:
    """Draw of the unknowns of the linear model given its data.

    Args:
        flight: The record.
        hyper: Noise parameters.
        made: The filter.
        seen: Data relative to a trajectory, one column per draw.
        z: From `normals`; zeros give the smoothed unknowns.
    """
    series, inputs = _less_draw(flight, hyper, made, seen, z)
    _, weighted, predicted = forward(made, series, inputs, seen.inputs.shape[1])
    start, process_noise, states = backward(made, weighted, predicted)
    return Drawn(Unknowns(start + z.start, process_noise + z.process_noise), states)


def _less_draw(flight: FlightData, hyper: NoiseParameters, made: Gains, seen: Seen, z: Normals) -> Seen:
    """Data less those of a draw, and inputs to all states with which predicted means are those of data and draw."""
    noise, many = hyper.outputs(flight), z.start.shape[1]
    states, count = made.first.shape[0], seen.series.shape[1]
    phi, sd = (np.asarray(a)[:, None] for a in (np.exp(-flight.dt / noise.time_constant), noise.correlated))
    drift = sd * np.sqrt(1.0 - phi**2) * z.drift
    drift[0] = sd * z.drift[0]
    shocks = z.process_noise
    own, latent = np.asarray(made.by_shock) @ shocks[1:], np.asarray(made.noise_gain) @ shocks[1:]
    inputs = np.zeros((len(shocks), states, many))
    inputs[1:, : own.shape[1]] = own
    inputs[1:, own.shape[1] : own.shape[1] + latent.shape[1]] = latent
    inputs[0] = made.start @ z.start + made.first @ shocks[0]
    inputs[:, states - count :] += drift
    inputs[:, : seen.inputs.shape[1]] += seen.inputs
    return Seen(seen.series - np.asarray(noise.white)[:, None] * z.white, inputs)
