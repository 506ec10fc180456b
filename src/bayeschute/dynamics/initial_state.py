"""Initial states of a cluster: a few free parameters, with riser stretch in equilibrium (no line transient)."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from bayeschute.core.vectors import Component, Quaternion, Vec3, cross, dot, norm, small_rotation, vec3
from bayeschute.dynamics.cluster import Air, canopy_acceleration, capsule_acceleration, geometry, riser_force
from bayeschute.dynamics.parameters import Cluster, Structure
from bayeschute.dynamics.state import ClusterState, pack


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Start:
    """Where a flight begins, before deviations; NED, SI.

    Attributes:
        position: Capsule centre of mass (3,) [m].
        velocity: Its velocity (3,) [m/s].
        attitude: Quaternion NED to body (4,).
        rate: Body rate (3,) [rad/s].
        direction: Unit vectors attach point -> canopy (3, n).
        turning: Their rates (3, n) [1/s].
        shape: eta of canopies that breathe, and its rate [1/s] (2, n); None: zero.
    """

    position: Component
    velocity: Component
    attitude: Component
    rate: Component
    direction: Component
    turning: Component
    shape: Component | None = None


def deviation_names(n: int) -> tuple[str, ...]:
    """Names of the deviations from a `Start`, in order: 9 + 4 n of them."""
    axes = ("north", "east", "down")
    names = [f"velocity.{a}" for a in axes] + [f"attitude.{a}" for a in "xyz"] + [f"rate.{a}" for a in "xyz"]
    for what in ("direction", "turning"):
        names += [f"{what}.{side}.{i + 1}" for side in ("first", "second") for i in range(n)]
    return tuple(names)


def _basis(direction: Component) -> tuple[Vec3, Vec3]:
    """Two unit vectors across each riser direction, (3, n); fixed by the start, not by the deviations."""
    n = np.asarray(direction)
    least = np.eye(3)[np.argmin(np.abs(n), axis=0)].T
    first = np.cross(n.T, least.T)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return vec3(first.T), vec3(np.cross(n.T, first).T)


def tangent_basis(direction: Component) -> Component:
    """The across-riser directions of a start as one array (2, 3, n), stored with it."""
    first, second = _basis(direction)
    return np.stack([np.stack([first.x, first.y, first.z]), np.stack([second.x, second.y, second.z])])


def initial_state(
    start: Start, basis: Component, deviation: Component, model: Cluster, structure: Structure, air: Air
) -> jax.Array:
    """State vector of a start plus deviations, risers at their quasi-static stretch.

    Args:
        start: Reference start.
        basis: Its `tangent_basis` (2, 3, n).
        deviation: Deviations in the order of `deviation_names`, (9 + 4 n, ...): m/s, rad, rad/s, rad, 1/s.
        model: Parameters.
        structure: Terms and options.
        air: Air at the first sample.

    Returns:
        State (13 + 6 n, ...); (13 + 8 n, ...) if the canopies breathe.
    """
    n, batch = structure.canopies, jnp.shape(deviation)[1:]

    def per_canopy(rows: Component) -> Component:
        return jnp.reshape(rows, (2, n, *batch))

    def widen(array: Component) -> Component:
        return jnp.reshape(jnp.asarray(array), (*jnp.shape(array), *(1,) * len(batch)))

    lean, swing = per_canopy(deviation[9 : 9 + 2 * n]), per_canopy(deviation[9 + 2 * n :])
    first, second = vec3(widen(basis[0])), vec3(widen(basis[1]))
    direction = vec3(widen(start.direction)) + first * lean[0] + second * lean[1]
    direction = direction / norm(direction)
    turning = vec3(widen(start.turning)) + first * swing[0] + second * swing[1]
    turning = turning - direction * dot(direction, turning)
    q = widen(start.attitude)
    attitude = Quaternion(q[0], q[1], q[2], q[3]).times(small_rotation(vec3(deviation[3:6])))
    velocity = vec3(widen(start.velocity)) + vec3(deviation[0:3])
    rate = vec3(widen(start.rate)) + vec3(deviation[6:9])
    position = vec3(widen(start.position) + 0.0 * velocity.x)
    shape: tuple[Component, ...] = ()
    if structure.breathing:
        eta = widen(np.zeros((2, n)) if start.shape is None else start.shape) + 0.0 * turning.x
        shape = eta[0], eta[1]

    def placed(pull: Component) -> ClusterState:
        length = model.risers.length + pull / model.risers.stiffness
        attach = attitude.to_ned(model.capsule.attach_b)
        attach_velocity = velocity + attitude.to_ned(cross(rate, model.capsule.attach_b))
        where = position + attach + direction * length
        moving = attach_velocity + turning * length
        return ClusterState(position, velocity, attitude, rate, where, moving, *shape)

    weight = (model.capsule.mass * model.gravity) / n
    state = placed(weight + 0.0 * direction.x)
    return pack(placed(static_tension(state, model, structure, air)))


def static_tension(state: ClusterState, model: Cluster, structure: Structure, air: Air) -> Component:
    """Tensions (canopy, ...) [N] at which no riser changes its rate of stretch.

    The second rate of every riser's length is affine in the tensions; this solves for its zero.
    """
    n = structure.canopies
    geo = geometry(state, model.capsule)
    across = geo.across - geo.direction * geo.stretch_rate

    def second_rate(pulls: Component) -> Component:
        pull = riser_force(state, geo, pulls, model, structure, air)
        canopy = canopy_acceleration(state, geo, pull, model, structure, air)
        a, turning = capsule_acceleration(state, pull, model, air, n)
        arm, w = model.capsule.attach_b, state.rate
        attach = a + state.attitude.to_ned(cross(turning, arm) + cross(w, cross(w, arm)))
        return dot(geo.direction, canopy - attach) + dot(across, across) / geo.length

    zero = 0.0 * geo.length
    residual = second_rate(zero)
    scale = model.capsule.mass * model.gravity
    unit = [np.eye(n)[j].reshape(n, *(1,) * (zero.ndim - 1)) * scale for j in range(n)]
    columns = [second_rate(zero + u) - residual for u in unit]
    return jnp.stack(_solved([[c[i] for c in columns] for i in range(n)], [-residual[i] for i in range(n)])) * scale


def _solved(matrix: list[list[Component]], right: list[Component]) -> list[Component]:
    """Gauss elimination without pivoting: riser tensions on bodies with mass give a definite matrix."""
    n = len(right)
    for k in range(n):
        for i in range(k + 1, n):
            factor = matrix[i][k] / matrix[k][k]
            matrix[i] = [a - factor * b for a, b in zip(matrix[i], matrix[k], strict=True)]
            right[i] = right[i] - factor * right[k]
    solution: list[Component] = [0.0] * n
    for i in reversed(range(n)):
        known = sum((matrix[i][j] * solution[j] for j in range(i + 1, n)), 0.0 * right[i])
        solution[i] = (right[i] - known) / matrix[i][i]
    return solution
