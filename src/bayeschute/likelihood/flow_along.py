"""The airflow that canopies met along the path of a flight, its fitted wind error included."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from bayeschute.aero.airflow import CanopyFlow
from bayeschute.core.vectors import Vec3, perpendicular
from bayeschute.dynamics.cluster import canopy_flow, geometry
from bayeschute.dynamics.cluster_flight import ClusterFlight
from bayeschute.dynamics.state import unpack
from bayeschute.likelihood.joint import FlightData


class Along(NamedTuple):
    """What canopies met along a path; arrays (canopy, T).

    Attributes:
        flow: Airflow.
        axial: Disturbance of the axial force coefficient, relative [1]; zero where the fit has none.
        transverse: Disturbance of the transverse coefficient, NED components across the canopy axis [1].
    """

    flow: CanopyFlow
    axial: Any
    transverse: Vec3


@jax.jit
def _along(model: ClusterFlight, theta: jax.Array, path: jax.Array, error: jax.Array) -> Along:
    n, numbers = model.structure.canopies, model.numbers(theta)

    def at(x: jax.Array, now: Any, error_now: jax.Array) -> Along:
        air = model.air(x, numbers, now, now, error_now, error_now, 0.0)
        state = unpack(x, n)
        flow = canopy_flow(
            state, geometry(state, numbers.capsule), numbers, model.structure, air if air.aloft is None else air.aloft
        )
        zero = jnp.zeros_like(flow.cos_alpha)
        push = zero, zero
        if error_now.shape[0] > 3 + n:
            push = error_now[3 + n : 3 + 2 * n], error_now[3 + 2 * n : 3 + 3 * n]
        axial = error_now[3 : 3 + n] if error_now.shape[0] > 3 else zero
        return Along(flow, axial, perpendicular(Vec3(*push, zero), flow.axis))

    return jax.vmap(at, out_axes=-1)(path, model.record, error)


def flow_along(data: FlightData, theta: Any, path: Any, error: Any) -> Along:
    """Airflow and latent disturbances of the canopies along a path.

    Args:
        data: A flight of a cluster.
        theta: Parameters in working coordinates (P,).
        path: States (T, X).
        error: Disturbances (T, A).

    Returns:
        NumPy arrays (canopy, T).
    """
    made: Along = _along(data.model, jnp.asarray(theta), jnp.asarray(path), jnp.asarray(error))
    return jax.tree.map(np.asarray, made)
