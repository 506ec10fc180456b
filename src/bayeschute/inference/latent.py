"""Latent disturbances: Ornstein-Uhlenbeck processes at knots, linear between them (METHODS 5).

What a model doesn't know is put where it arises: the error of the wind, per axis, and the relative fluctuation of each
canopy's axial force (breathing, change of shape). Knots must lie well inside the time constants: the part of a process
that lines between knots can't follow is error that nothing accounts for.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from bayeschute.air.vector import Component


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Latent:
    """Stationary standard deviation of every process (A,), in its own unit, and e-folding time (A,) [s]."""

    sd: Component
    time_constant: Component


def knot_times(duration: float, spacing: float) -> NDArray[np.float64]:
    """Times of the knots [s], evenly over the record, no farther apart than `spacing`."""
    return np.linspace(0.0, duration, max(int(np.ceil(duration / spacing - 1e-9)), 1) + 1)


def interpolation(times: NDArray[np.float64], knots: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weights (T, K) that interpolate knots linearly to the samples."""
    return np.stack([np.interp(times, knots, row) for row in np.eye(knots.size)], axis=1)


def whiten(latent: Latent, spacing: Component, knots: jax.Array) -> jax.Array:
    """Standardised innovations of the knots.

    Args:
        latent: Parameters (A,).
        spacing: Distance of the knots [s].
        knots: Values (K, A, ...).

    Returns:
        Standard normal under the process, same shape.
    """
    extra = (1,) * (knots.ndim - 2)
    phi = jnp.exp(-spacing / latent.time_constant).reshape(-1, *extra)
    inner = jnp.sqrt(-jnp.expm1(-2.0 * spacing / latent.time_constant)).reshape(-1, *extra)
    unit = knots / latent.sd.reshape(-1, *extra)
    return jnp.concatenate([unit[:1], (unit[1:] - phi * unit[:-1]) / inner])


def log_determinant(latent: Latent, spacing: Component, knots: int) -> jax.Array:
    """Sum of the logarithms of the scales that `whiten` divides by."""
    inner = 0.5 * jnp.log(-jnp.expm1(-2.0 * spacing / latent.time_constant))
    return jnp.sum(knots * jnp.log(latent.sd) + (knots - 1) * inner)


def draw(latent: Latent, spacing: float, shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.float64]:
    """Draws of the knots.

    Args:
        latent: Parameters (A,).
        spacing: Distance of the knots [s].
        shape: (K, A, ...).
        rng: Source of randomness.

    Returns:
        Knots of that shape.
    """
    extra = (1,) * (len(shape) - 2)
    phi = np.exp(-spacing / np.asarray(latent.time_constant)).reshape(-1, *extra)
    z = rng.standard_normal(shape)
    knots = np.empty(shape)
    knots[0] = z[0]
    for j in range(1, shape[0]):
        knots[j] = phi * knots[j - 1] + np.sqrt(1.0 - phi**2) * z[j]
    return knots * np.asarray(latent.sd).reshape(-1, *extra)
