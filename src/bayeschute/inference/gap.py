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
from bayeschute.inference.target import Course, FlightData, Hyper, Linear, as_seen, course, residuals

_PAIRS = 32  # of simulations
_SHARES = (1.0, 0.5, 0.25, 0.125)  # of the conditional law's width at which pairs are tried


def mean(
    flight: FlightData, hyper: Hyper, made: Gains, theta: NDArray[np.float64], driven: Course
) -> tuple[jax.Array, int]:
    """Mean displacement of simulated outputs over the conditional law of start and disturbances.

    Draws come in pairs about the optimum, so that all that is linear cancels exactly. A pair of which a simulation
    fails is left out, and counted. Where none flies, as about an optimum at the edge of what does, pairs are drawn
    together; what is left of them is of second order, so it is divided by the square of how much they were.

    Args:
        flight: The record.
        hyper: Noise parameters.
        made: The filter of the flight linearised at the optimum.
        theta: Parameters (P,).
        driven: The conditional optimum.

    Returns:
        The gap (T, C), and how many pairs failed at their full width.

    Raises:
        FloatingPointError: If a simulation of every pair fails at every width.
    """
    z = normals(flight, _PAIRS, np.random.default_rng(0))
    off = course(flight, hyper, drawn(flight, hyper, made, jnp.zeros((*jnp.shape(flight.observed), _PAIRS)), z))
    wide = jnp.repeat(jnp.asarray(theta)[:, None], 2 * _PAIRS, axis=1)
    middle, lost = residuals(flight, jnp.asarray(theta), driven), 0
    for share in _SHARES:
        pairs = [(m[..., None], share * d) for m, d in zip(driven, off, strict=True)]
        both = Course(*(jnp.concatenate([m + d, m - d], axis=-1) for m, d in pairs))
        moved = np.asarray(middle[..., None] - residuals(flight, wide, both))
        by_pair = 0.5 * (moved[..., :_PAIRS] + moved[..., _PAIRS:])
        good = np.isfinite(by_pair).all(axis=(0, 1))
        lost = lost or int((~good).sum())
        if good.any():
            return jnp.asarray(by_pair[..., good].mean(axis=-1) / share**2), lost
    raise FloatingPointError("simulations under all drawn disturbances about the optimum fail")


@jax.jit
def slope(linear: Linear, made: Gains, gap: Component) -> jax.Array:
    """What a gap (T, C) adds to the slope of minus the log density by theta (P,), where the flight was linearised."""
    seen = as_seen(linear)
    first = jnp.asarray(gap)[..., None], jnp.zeros_like(seen.driven[..., :1])
    alone = [jnp.concatenate([one, part[..., 1:]], axis=2) for one, part in zip(first, seen, strict=True)]
    unit = innovations(made, *alone)
    unit = unit.reshape(-1, unit.shape[2])
    return unit[:, 1:].T @ unit[:, 0]
