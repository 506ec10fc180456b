"""The gap: how far the mean of flights lies from the flight of the mean.

Given the parameters, start and disturbances are known within a width over which the simulation is not quite linear. Its
outputs, averaged over that width, differ from those at the most probable start and disturbances; a marginal density
that leaves this out leans parameters by up to half a standard deviation.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from bayeschute.air.vector import Component
from bayeschute.inference.drawing import drawn, normals
from bayeschute.inference.statespace import Gains, innovations
from bayeschute.inference.target import Course, FlightData, Hyper, Linear, as_series, course, residuals

_PAIRS = 32  # of simulations


def mean(
    flight: FlightData, hyper: Hyper, made: Gains, theta: NDArray[np.float64], driven: Course
) -> tuple[jax.Array, int]:
    """Mean displacement of simulated outputs over the conditional law of start and disturbances.

    Draws come in pairs about the optimum, so that all that is linear cancels exactly. A pair of which a simulation
    fails is left out, and counted.

    Args:
        flight: The record.
        hyper: Noise parameters.
        made: The filter of the flight linearised at the optimum.
        theta: Parameters (P,).
        driven: The conditional optimum.

    Returns:
        The gap (T, C), and how many pairs failed.

    Raises:
        FloatingPointError: If a simulation of every pair fails.
    """
    z = normals(flight, _PAIRS, np.random.default_rng(0))
    off = course(flight, hyper, drawn(flight, hyper, made, jnp.zeros((*jnp.shape(flight.observed), _PAIRS)), z))
    pairs = zip(driven, off, strict=True)
    both = Course(*(jnp.concatenate([m[..., None] + d, m[..., None] - d], axis=-1) for m, d in pairs))
    wide = jnp.repeat(jnp.asarray(theta)[:, None], 2 * _PAIRS, axis=1)
    middle = residuals(flight, jnp.asarray(theta), driven)
    moved = np.asarray(middle[..., None] - residuals(flight, wide, both))
    by_pair = 0.5 * (moved[..., :_PAIRS] + moved[..., _PAIRS:])
    good = np.isfinite(by_pair).all(axis=(0, 1))
    if not good.any():
        raise FloatingPointError("simulations under all drawn disturbances about the optimum fail")
    return jnp.asarray(by_pair[..., good].mean(axis=-1)), int((~good).sum())


@jax.jit
def slope(linear: Linear, made: Gains, gap: Component) -> jax.Array:
    """What a gap (T, C) adds to the slope of minus the log density by theta (P,), where the flight was linearised."""
    by_theta = as_series(linear)[..., 1:]
    unit = innovations(made, jnp.concatenate([jnp.asarray(gap)[..., None], by_theta], axis=2))
    unit = unit.reshape(-1, unit.shape[2])
    return unit[:, 1:].T @ unit[:, 0]
