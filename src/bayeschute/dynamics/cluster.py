"""Equations of motion of a capsule under n canopies on elastic risers (report 6.3.3, without its singular axes)."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp

from bayeschute.aero.airflow import (
    CanopyFlow,
    axis_rate,
    neighbours,
    riser_rate,
    squared_angle,
    wind_direction_rate,
)
from bayeschute.aero.capsule_rates import angle_rates
from bayeschute.aero.capsule_table import table_coefficients
from bayeschute.aero.terms import axial_coefficient, transverse_coefficient
from bayeschute.atmosphere.standard import SEA_LEVEL_DENSITY
from bayeschute.core.vectors import Component, Vec3, cross, dot, norm, perpendicular
from bayeschute.dynamics.parameters import Capsule, Cluster, Risers, Structure
from bayeschute.dynamics.riser import riser_tension, taut_share
from bayeschute.dynamics.state import ClusterState, pack, unpack

_LEAST_SPEED = 1e-6  # [m/s]; keeps 1/|V| finite at zero speed, negligible in flight


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Air:
    """The air at one instant.

    Attributes:
        wind: Velocity of the air, NED [m/s]; components broadcast over canopies.
        wind_rate: Its partial derivative with time [m/s^2] (only the airflow rate needs it).
        density: [kg/m^3].
        axial_factor: Factor on every canopy's axial coefficient, (canopy, ...) or 1: breathing (6.3.2-28).
        shear: Derivative of the wind with altitude [1/s].
        aloft: The air where the canopies are, components (canopy, ...); None: the same.
        push: Latent transverse force: residual of every canopy's transverse coefficient, towards north and east,
        components
            (canopy, ...); its component along the riser has no effect. None: zero.
        roll: Latent angular acceleration of the capsule about its long axis, such as by risers that
            twist, over gravity over the risers' length (...). None: nothing.
    """

    wind: Vec3
    wind_rate: Vec3
    density: Component
    axial_factor: Component
    shear: Vec3
    aloft: Air | None = None
    push: tuple[Component, Component] | None = None
    roll: Component | None = None


@dataclass(frozen=True)
class RiserGeometry:
    """Geometry of the risers: unit vectors capsule -> canopy, lengths, and velocities of their ends."""

    attach_n: Vec3
    direction: Vec3
    length: Component
    across: Vec3
    stretch_rate: Component


def geometry(state: ClusterState, capsule: Capsule) -> RiserGeometry:
    """Risers of a state (6.3.3-4, -20b)."""
    attach_n = state.attitude.to_ned(capsule.attach_b)
    attach_velocity = state.velocity + state.attitude.to_ned(cross(state.rate, capsule.attach_b))
    along = state.canopy_position - (state.position + attach_n)
    length = norm(along)
    n = along / length
    relative = state.canopy_velocity - attach_velocity
    return RiserGeometry(attach_n, n, length, relative, dot(n, relative))


def tension(geo: RiserGeometry, risers: Risers) -> Component:
    """Tension of every riser [N], never negative, zero when slack (6.3.3-1..3, clamped)."""
    stretch = geo.length - risers.length
    return riser_tension(stretch, geo.stretch_rate, risers.stiffness, risers.damping, risers.engagement)


def riser_force(
    state: ClusterState, geo: RiserGeometry, riser_tension: Component, model: Cluster, structure: Structure, air: Air
) -> Vec3:
    """Force of every riser on the capsule at the attach point [N], NED; on the canopy its opposite.

    Beside the tension it is the couple q S (l/L) (C_m_alpha e + C_mq r l/(2V)), e the transverse part of the flow's
    direction and r the transverse rate, by which a riser that is straight carries its canopy's aerodynamic moment
    M = q S l (...): riser and canopy turn as one body, which has no moment of inertia about the canopy. Slack lines
    carry nothing of it.
    """
    force, canopies = geo.direction * riser_tension, model.canopies
    if canopies.moment_slope is None and canopies.pitch_damping is None:
        return force
    flow = canopy_flow(state, geo, model, structure, air if air.aloft is None else air.aloft)
    slope, damping = (0.0 if c is None else c for c in (canopies.moment_slope, canopies.pitch_damping))
    moment = (flow.e * slope + flow.rate * damping) * (flow.q * canopies.area * canopies.length)
    return force - moment * (taut_share(geo.length - model.risers.length, model.risers.engagement) / geo.length)


def canopy_flow(state: ClusterState, geo: RiserGeometry, model: Cluster, structure: Structure, air: Air) -> CanopyFlow:
    """Airflow at every canopy, with the riser's part of the transverse rate."""
    canopies = model.canopies
    axis = -geo.direction
    v = state.canopy_velocity - air.wind
    speed = norm(v, _LEAST_SPEED)
    w = v / speed
    cosine = dot(w, axis)
    e = w - axis * cosine
    x_dot = axis_rate(geo.direction, geo.across, geo.length)
    q = 0.5 * air.density * speed * speed
    reference = 0.5 * SEA_LEVEL_DENSITY * canopies.speed**2
    return CanopyFlow(
        axis=axis,
        e=e,
        rate=riser_rate(axis, x_dot, cosine) * (canopies.length / (2.0 * speed)),
        alpha_squared=squared_angle(dot(e, e), cosine),
        cos_alpha=cosine,
        q=q,
        q_ratio=q / reference,
        speed_ratio=speed / canopies.speed - 1.0,
        neighbours=neighbours(state.canopy_position, state.canopy_velocity, axis, canopies.length, structure.canopies),
        saturation=structure.saturation,
    )


def canopy_force(flow: CanopyFlow, geo: RiserGeometry, model: Cluster, structure: Structure, air: Air) -> Vec3:
    """Aerodynamic force on every canopy, q S (-C_A x + transverse) [N], NED (6.3.3-5), or a user-defined law."""
    if structure.force is not None:
        return structure.force(flow, geo, model, air)
    axial = axial_coefficient(structure.axial, model.axial, flow) * air.axial_factor
    transverse = transverse_coefficient(structure.transverse, model.transverse, flow)
    if air.push is not None:
        north, east = air.push
        transverse = transverse + perpendicular(Vec3(north, east, jnp.zeros_like(north)), flow.axis)
    return (transverse - flow.axis * axial) * (flow.q * model.canopies.area)


def canopy_acceleration(
    state: ClusterState, geo: RiserGeometry, pull: Vec3, model: Cluster, structure: Structure, air: Air
) -> Vec3:
    """Acceleration of every canopy [m/s^2] with the force `pull` of its riser on the capsule.

    Weight is on the dry mass, inertia has the enclosed air (6.3.3-6, corrected).
    """
    air = air if air.aloft is None else air.aloft
    canopies = model.canopies
    mass = canopies.dry_mass + air.density * canopies.enclosed_volume
    flow = canopy_flow(state, geo, model, structure, air)
    zero = jnp.zeros_like(flow.cos_alpha)
    weight = Vec3(zero, zero, zero + canopies.dry_mass * model.gravity)
    known = weight - pull
    if structure.breathing and model.breathing is not None:
        known = known - flow.axis * (flow.q * canopies.area * model.breathing.axial_slope * state.shape)
    if structure.rate == "riser":
        return (known + canopy_force(flow, geo, model, structure, air)) / mass
    lhs, f0 = _affine_force(flow, geo, mass, state, model, structure, air)
    rhs = known + f0
    determinant = dot(lhs[0], cross(lhs[1], lhs[2]))
    return Vec3(
        dot(rhs, cross(lhs[1], lhs[2])) / determinant,
        dot(lhs[0], cross(rhs, lhs[2])) / determinant,
        dot(lhs[0], cross(lhs[1], rhs)) / determinant,
    )


def _affine_force(
    flow: CanopyFlow,
    geo: RiserGeometry,
    mass: Component,
    state: ClusterState,
    model: Cluster,
    structure: Structure,
    air: Air,
) -> tuple[list[Vec3], Vec3]:
    """Columns of m I + B and F_0 where F = F_0 - B a: affine through the rate of the wind direction (PHYSICS 3)."""
    v = state.canopy_velocity - air.wind
    speed = norm(v, _LEAST_SPEED)
    w = v / speed
    scale = model.canopies.length / (2.0 * speed)
    carried = air.wind_rate - air.shear * state.canopy_velocity.z  # altitude is minus z

    def force(a: Vec3) -> Vec3:
        turn = perpendicular(wind_direction_rate(w, a - carried, speed), flow.axis) * scale
        moved = CanopyFlow(**{**flow.__dict__, "rate": flow.rate + turn})
        return canopy_force(moved, geo, model, structure, air)

    zero = jnp.zeros_like(flow.cos_alpha)
    one = zero + 1.0
    f0 = force(Vec3(zero, zero, zero))
    columns = [force(Vec3(*(one if i == j else zero for j in range(3)))) - f0 for i in range(3)]
    lhs = [Vec3(zero + mass * (i == 0), zero + mass * (i == 1), zero + mass * (i == 2)) - columns[i] for i in range(3)]
    return lhs, f0


def least_inertia(x: jax.Array, model: Cluster, structure: Structure, air: Air) -> jax.Array:
    """Least eigenvalue of every canopy's inertia including the airflow-rate terms, over its mass (canopy, ...).

    At zero or below the acceleration is not defined by the equations: the model is ill-posed (PHYSICS 3). It is 1 where
    the rate is the riser's.

    Args:
        x: State (13 + 6 n, ...).
        model: Parameters.
        structure: Terms and options.
        air: Air at this instant.
    """
    state = unpack(x, structure.canopies)
    air = air if air.aloft is None else air.aloft
    geo = geometry(state, model.capsule)
    flow = canopy_flow(state, geo, model, structure, air)
    mass = model.canopies.dry_mass + air.density * model.canopies.enclosed_volume + 0.0 * flow.cos_alpha
    if structure.rate == "riser":
        return jnp.ones_like(mass)
    lhs, _ = _affine_force(flow, geo, mass, state, model, structure, air)
    matrix = jnp.stack([column.stack() for column in lhs])
    symmetric = jnp.moveaxis(matrix + jnp.swapaxes(matrix, 0, 1), (0, 1), (-2, -1)) / 2.0
    return jnp.linalg.eigvalsh(symmetric)[..., 0] / mass


def capsule_aerodynamics(state: ClusterState, capsule: Capsule, air: Air) -> tuple[Vec3, Vec3]:
    """Aerodynamic force [N] and moment about the centre of mass [N m], body axes (6.3.3-11..15).

    Without the moments that follow the rates of the angles of the airflow: see `_rate_moment`.
    """
    v_b = state.attitude.to_body(state.velocity - air.wind)
    speed = norm(v_b, _LEAST_SPEED)
    q_area = 0.5 * air.density * speed * speed * capsule.area
    along = v_b / speed
    if capsule.table is None:
        slope = capsule.normal_force_slope
        force = Vec3(-capsule.axial_force + 0.0 * along.x, -slope * along.y, -slope * along.z) * q_area
        static = Vec3(0.0 * along.x, capsule.moment_slope * along.z, -capsule.moment_slope * along.y) * (
            q_area * capsule.length
        )
    else:
        C_A, C_Y, C_N, C_l, C_m, C_n = table_coefficients(capsule.table, along)
        force = Vec3(-C_A, C_Y, -C_N) * q_area
        static = Vec3(C_l, C_m, C_n) * (q_area * capsule.length)
    p, q, r = state.rate.x, state.rate.y, state.rate.z
    yaw_damping = capsule.pitch_damping if capsule.yaw_damping is None else capsule.yaw_damping
    damping = Vec3(capsule.roll_damping * p, capsule.pitch_damping * q, yaw_damping * r)
    damping = damping * (q_area * capsule.length**2 / (2.0 * speed))
    return force, static + damping + cross(capsule.reference_centre_b, force)


def _rate_moment(state: ClusterState, capsule: Capsule, air: Air, acceleration: Vec3) -> Vec3:
    """Moment by the rates of the angle of attack and of sideslip, body axes [N m] (6.3.3-13).

    The rates are the airflow's: they follow from the acceleration, on which this moment has no effect.
    """
    relative = state.velocity - air.wind
    carried = air.wind_rate - air.shear * state.velocity.z  # altitude is minus z
    v_b = state.attitude.to_body(relative)
    speed = norm(v_b, _LEAST_SPEED)
    along = v_b / speed
    turning = wind_direction_rate(along, state.attitude.to_body(acceleration - carried), speed)
    alpha_rate, beta_rate = angle_rates(along, turning - cross(state.rate, along))
    scale = 0.25 * air.density * speed * capsule.area * capsule.length**2
    pitch = 0.0 if capsule.pitch_rate_damping is None else capsule.pitch_rate_damping * alpha_rate
    yaw = 0.0 if capsule.yaw_rate_damping is None else capsule.yaw_rate_damping * beta_rate
    return Vec3(0.0 * speed, pitch, yaw) * scale


def capsule_acceleration(state: ClusterState, pull: Vec3, model: Cluster, air: Air, n: int) -> tuple[Vec3, Vec3]:
    """Acceleration of the centre of mass, NED [m/s^2]; angular acceleration, body axes [rad/s^2] (6.3.3-16, -19)."""
    capsule = model.capsule
    together = Vec3(*(sum((c[i] for i in range(1, n)), c[0]) for c in (pull.x, pull.y, pull.z)))
    force_b, moment_b = capsule_aerodynamics(state, capsule, air)
    acceleration = (together + state.attitude.to_ned(force_b)) / capsule.mass
    acceleration = Vec3(acceleration.x, acceleration.y, acceleration.z + model.gravity)
    if not (capsule.pitch_rate_damping is None and capsule.yaw_rate_damping is None):
        moment_b = moment_b + _rate_moment(state, capsule, air, acceleration)
    moment_b = moment_b + cross(capsule.attach_b, state.attitude.to_body(together))
    turning = capsule.turned_by(moment_b - cross(state.rate, capsule.angular_momentum(state.rate)))
    if air.roll is not None:
        turning = Vec3(turning.x + air.roll * (model.gravity / model.risers.length), turning.y, turning.z)
    return acceleration, turning


def state_rate(x: jax.Array, model: Cluster, structure: Structure, air: Air) -> jax.Array:
    """Rate of the state vector.

    Args:
        x: State (13 + 6 n, ...); (13 + 8 n, ...) if the canopies breathe.
        model: Parameters, arrays that broadcast over the batch axes.
        structure: Terms and options.
        air: Air at this instant.

    Returns:
        dx/dt, same shape.
    """
    n = structure.canopies
    state = unpack(x, n)
    geo = geometry(state, model.capsule)
    pull = riser_force(state, geo, tension(geo, model.risers), model, structure, air)
    canopy = canopy_acceleration(state, geo, pull, model, structure, air)
    acceleration, turning = capsule_acceleration(state, pull, model, air, n)
    shape = _breathing(state, model) if structure.breathing else (None, None)
    return pack(
        ClusterState(
            state.velocity,
            acceleration,
            state.attitude.rate(state.rate),
            turning,
            state.canopy_velocity,
            canopy,
            *shape,
        )
    )


def _breathing(state: ClusterState, model: Cluster) -> tuple[Component, Component]:
    """Rates of the canopies' shape and of its rate (6.3.2-27)."""
    assert model.breathing is not None, "a structure that breathes wants Cluster(breathing=...)"
    b = model.breathing
    return state.shape_rate, -b.damping * state.shape_rate - b.stiffness * state.shape
