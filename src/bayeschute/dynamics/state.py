"""State vector of the cluster: capsule position, velocity, quaternion, body rate, then the canopies."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp

from bayeschute.core.vectors import Component, Quaternion, Vec3, quaternion, vec3

CAPSULE_SIZE = 13


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ClusterState:
    """State by name; NED components, SI.

    Attributes:
        position: Capsule centre of mass [m].
        velocity: Its velocity [m/s].
        attitude: Unit quaternion, NED to body.
        rate: Body rate [rad/s].
        canopy_position: Components of shape (canopy, ...) [m].
        canopy_velocity: Likewise [m/s].
        shape: eta of every canopy (canopy, ...), 0 as built; None where canopies don't breathe.
        shape_rate: Its rate [1/s]; likewise.
    """

    position: Vec3
    velocity: Vec3
    attitude: Quaternion
    rate: Vec3
    canopy_position: Vec3
    canopy_velocity: Vec3
    shape: Component | None = None
    shape_rate: Component | None = None


def size(n: int, breathing: bool = False) -> int:
    """Length of the state vector with `n` canopies."""
    return CAPSULE_SIZE + (8 if breathing else 6) * n


def unpack(x: Component, n: int) -> ClusterState:
    """State by name from an array of shape (13 + 6 n, ...), or (13 + 8 n, ...) with the canopies' shape."""
    batch = x.shape[1:]
    split, end = CAPSULE_SIZE + 3 * n, size(n)
    shape = (x[end : end + n], x[end + n :]) if x.shape[0] > end else (None, None)
    return ClusterState(
        vec3(x[0:3]),
        vec3(x[3:6]),
        quaternion(x[6:10]),
        vec3(x[10:13]),
        vec3(x[CAPSULE_SIZE:split].reshape(3, n, *batch)),
        vec3(x[split:end].reshape(3, n, *batch)),
        *shape,
    )


def pack(state: ClusterState) -> jax.Array:
    """The array of a state by name, or of its rate."""
    canopies = [state.canopy_position, state.canopy_velocity]
    columns = [c for v in canopies for c in (v.x, v.y, v.z)]
    columns += [c for c in (state.shape, state.shape_rate) if c is not None]
    batch = jnp.broadcast_shapes(*(jnp.shape(c)[1:] for c in columns), jnp.shape(state.velocity.x))
    q = state.attitude
    capsule = [*_components(state.position), *_components(state.velocity), q.w, q.x, q.y, q.z, *_components(state.rate)]
    rows = [jnp.broadcast_to(c, batch)[None] for c in capsule]
    return jnp.concatenate(rows + [jnp.broadcast_to(c, (jnp.shape(c)[0], *batch)) for c in columns])


def _components(v: Vec3) -> tuple:
    return v.x, v.y, v.z
