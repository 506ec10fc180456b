"""Number of Runge-Kutta steps per sample, from the stability limit that stiff risers set."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np

from bayeschute.dynamics.cluster import state_rate
from bayeschute.dynamics.cluster_flight import ClusterFlight, air_between

REAL_LIMIT = 2.785  # classical RK4 is stable on the negative real axis down to -2.785
_MARGIN = 0.85


@jax.jit
def _local_jacobian(flight: ClusterFlight, theta: jax.Array, still: jax.Array) -> jax.Array:
    x = flight.initial(flight.numbers(theta), still)
    now = jax.tree.map(lambda a: a[0], flight.record)
    zero = jnp.zeros(3)
    air = air_between(now, now, zero, zero, 0.0, flight.dt)
    return jax.jacfwd(lambda s: state_rate(s, flight.numbers(theta), flight.structure, air))(x)


def fastest_pole(flight: ClusterFlight, theta: np.ndarray, deviations: int) -> float:
    """Largest magnitude of the poles at the start of a flight [1/s].

    Args:
        flight: The flight.
        theta: Parameters in working coordinates (P,).
        deviations: Number of initial deviations, all zero here.
    """
    begun = replace(flight, record=jax.tree.map(lambda a: a[:1], flight.record))  # compiled once for all lengths
    jacobian = np.asarray(_local_jacobian(begun, theta, np.zeros(deviations)))
    return float(np.max(np.abs(np.linalg.eigvals(jacobian))))


def substeps(pole: float, dt: float, least: int = 3) -> int:
    """Steps per sample that keep RK4 stable for a pole [1/s], with a margin of 15 %.

    Args:
        pole: Largest magnitude expected, priors' upper tails included.
        dt: Sample interval [s].
        least: Steps that accuracy wants anyway.
    """
    return max(least, int(np.ceil(pole * dt / (_MARGIN * REAL_LIMIT))))
