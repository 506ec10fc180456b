"""Measurement noise AR(1) + white: exact whitening by a Kalman filter, O(n), with missing samples.

A channel's residual is ``a_t + w_t``: a stationary first-order process plus white noise. A Kalman filter turns a series
into innovations; its gains depend on the pattern of gaps alone, so it is a linear map that whitens residuals and their
derivatives alike. Innovations at missing samples are zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from bayeschute.core.array_library import library_of
from bayeschute.core.vectors import Component


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Noise:
    """Parameters per output.

    Attributes:
        white: Standard deviation of the white part (C,).
        correlated: Stationary standard deviation of the AR(1) part (C,).
        time_constant: Its e-folding time (C,) [s].
    """

    white: Component
    correlated: Component
    time_constant: Component


def of_outputs(noise: Noise, channel: tuple[int, ...]) -> Noise:
    """Noise of outputs (C,) from that of channels (K,), given the channel of every output by number (C entries)."""
    library = library_of(noise)
    return jax.tree.map(lambda a: library.asarray(a)[np.array(channel, int)], noise)


def gains(noise: Noise, dt: Component, present: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Kalman gains and innovation variances.

    Args:
        noise: Parameters (C,).
        dt: Sample interval [s].
        present: Which samples exist (T, C).

    Returns:
        The AR coefficient (C,), gains (T, C) and innovation variances (T, C); both hold 0 and 1 at missing samples.
    """
    phi = jnp.exp(-dt / noise.time_constant)
    stationary = noise.correlated**2
    white = noise.white**2

    def step(variance: jax.Array, here: jax.Array) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
        total = variance + white
        gain = jnp.where(here, variance / total, 0.0)
        after = variance * (1.0 - gain)
        return phi**2 * after + (1.0 - phi**2) * stationary, (gain, jnp.where(here, total, 1.0))

    _, (k, s) = jax.lax.scan(step, stationary, present)
    return phi, k, s


def whiten(noise: Noise, dt: Component, present: jax.Array, series: jax.Array) -> jax.Array:
    """Standardised innovations of a series, or of the columns of its derivatives.

    Args:
        noise: Parameters (C,).
        dt: Sample interval [s].
        present: Which samples exist (T, C).
        series: Residuals (T, C, ...); values at missing samples are ignored.

    Returns:
        Innovations over their standard deviations, same shape.
    """
    phi, k, s = gains(noise, dt, present)
    extra = (1,) * (series.ndim - 2)
    phi = phi.reshape(-1, *extra)

    def step(mean: jax.Array, row: tuple) -> tuple[jax.Array, jax.Array]:
        z, gain, scale, here = row
        innovation = jnp.where(here, z - mean, 0.0)
        return phi * (mean + gain * innovation), innovation / scale

    widen = (*present.shape, *extra)
    rows = (series, k.reshape(widen), jnp.sqrt(s).reshape(widen), present.reshape(widen))
    return jax.lax.scan(step, jnp.zeros(series.shape[1:]), rows)[1]


def colour(noise: Noise, dt: Component, drift: Component, white: Component) -> NDArray[np.float64]:
    """AR(1) plus white noise (T, C, ...) from two arrays of standard normal numbers of that shape."""
    extra = (1,) * (np.ndim(drift) - 2)
    phi, sd, small = (
        np.reshape(a, (-1, *extra)) for a in (np.exp(-dt / noise.time_constant), noise.correlated, noise.white)
    )
    driven = sd * np.sqrt(1.0 - phi**2) * np.asarray(drift)
    driven[0] = sd * drift[0]
    states = [lfilter([1.0], [1.0, -one], driven[:, i], axis=0) for i, one in enumerate(phi.ravel())]
    return np.stack(states, axis=1) + small * white
