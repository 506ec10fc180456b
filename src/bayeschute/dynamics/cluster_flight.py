"""The cluster model along one record: the capsule under n canopies as a discrete-time state-space model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from bayeschute.aero.coefficient import APPARENT_MASS, Coefficient
from bayeschute.atmosphere.standard import SEA_LEVEL_DENSITY
from bayeschute.atmosphere.wind_field import WindField
from bayeschute.compiler.evaluation import by_sample
from bayeschute.compiler.runge_kutta import Stepping, advanced
from bayeschute.core.array_library import library_of
from bayeschute.core.vectors import Component, Quaternion, Vec3, dot, norm, quaternion, vec3
from bayeschute.dynamics.cluster import Air, geometry, state_rate, tension
from bayeschute.dynamics.initial_state import Start, initial_state
from bayeschute.dynamics.parameters import BIASES, Capsule, Cluster, Risers, Structure
from bayeschute.dynamics.state import ClusterState, pack, unpack

LOGARITHMIC = ("riser_stiffness", "riser_damping", APPARENT_MASS)
OF_CAPSULE = {
    "capsule_mass": "mass",
    "capsule_axial_force": "axial_force",
    "capsule_normal_force_slope": "normal_force_slope",
    "capsule_pitch_moment_slope": "moment_slope",
    "capsule_pitch_damping": "pitch_damping",
}
OF_INERTIA = {"capsule_inertia_factor_y": "y", "capsule_inertia_factor_z": "z"}
OF_CANOPIES = {
    "canopy_mass": "dry_mass",
    "canopy_pitch_moment_slope": "moment_slope",
    "canopy_pitch_damping": "pitch_damping",
}
POSITION_SCALE = "canopy_position_scale"
_RISER = "riser_"
CHANNELS = (
    "canopy_position",
    "capsule_velocity",
    "capsule_attitude",
    "riser_tension",
    "swing_angle",
    "descent_rate",
    "canopy_velocity",
)


def with_parameters(
    base: Cluster, structure: Structure, names: Sequence[str], theta: Component, air_shares: Sequence[float] = ()
) -> Cluster:
    """A cluster with some parameters replaced.

    Args:
        base: The other numbers.
        structure: Terms, for the places of ``axial[...]`` and ``transverse[...]``.
        names: Names of the entries of `theta`; an empty name: the entry replaces nothing. ``axial[...]`` is that of
            every canopy, ``axial[...].canopy2`` that of the second alone.
        theta: Working coordinates (P, ...): logarithms for `LOGARITHMIC`, SI values otherwise.
        air_shares: By entry, the share s of the apparent mass in what a canopy moves: with a factor f on that among the
            parameters, the value is that of theta times 1 + s (f - 1). Empty: no value depends on it.

    Returns:
        The cluster.

    Raises:
        KeyError: If a name is no parameter of this structure.
    """
    aero = {"axial": list(base.axial), "transverse": list(base.transverse)}
    risers, capsule, canopies, scale = base.risers, base.capsule, base.canopies, base.position_scale
    biases: dict[str, list[Component]] = {}
    more_air = jnp.exp(theta[names.index(APPARENT_MASS)]) - 1.0 if air_shares and APPARENT_MASS in names else None
    for i, name in enumerate(names):
        value = jnp.exp(theta[i]) if name in LOGARITHMIC else theta[i]
        if more_air is not None and air_shares[i]:
            value = value * (1.0 + air_shares[i] * more_air)
        found = Coefficient.parse(name)
        if found is not None and found.flight is None:
            place, canopy = getattr(structure, found.kind).index(found.term), found.canopy
            old = aero[found.kind][place]
            new = value if canopy is None else _with_canopy(old, canopy, value, structure.canopies)
            aero[found.kind][place] = new
        elif name.startswith(_RISER):
            risers = replace(risers, **{name[len(_RISER) :]: value})
        elif name in OF_CAPSULE:
            new_of_capsule: dict[str, Any] = {OF_CAPSULE[name]: value}
            capsule = replace(capsule, **new_of_capsule)
        elif name in OF_INERTIA:
            new_moment: dict[str, Any] = {OF_INERTIA[name]: value * getattr(capsule.inertia, OF_INERTIA[name])}
            capsule = replace(capsule, inertia=replace(capsule.inertia, **new_moment))
        elif name in OF_CANOPIES:
            canopies = replace(canopies, **{OF_CANOPIES[name]: value})
        elif name == APPARENT_MASS:
            canopies = replace(canopies, enclosed_volume=canopies.enclosed_volume * value)
        elif name == POSITION_SCALE:
            scale = value
        elif (bias := name.partition(".")[0]) in BIASES:
            _, axes = BIASES[bias]
            biases.setdefault(bias, [0.0] * len(axes))[axes.index(name[len(bias) + 1 :])] = value
        elif name:
            raise KeyError(f"{name!r} is no parameter of the cluster")
    axial, transverse = (tuple(aero[kind]) for kind in ("axial", "transverse"))
    bodies = replace(base, risers=risers, capsule=capsule, canopies=canopies, position_scale=scale)
    errors: dict[str, Any] = {bias: tuple(values) for bias, values in biases.items()}
    return replace(bodies, axial=axial, transverse=transverse, **errors)


def _with_canopy(old: Component, canopy: int, value: Component, count: int) -> Component:
    """A coefficient (canopy, ...) with that of one canopy, counted from 1, replaced; `old` may be one for all."""
    if not 1 <= canopy <= count:
        raise KeyError(f"there is no canopy {canopy} among {count}")
    every = jnp.broadcast_to(old, (count, *jnp.shape(value)))
    return jnp.stack([value if i == canopy - 1 else every[i] for i in range(count)])


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ClusterInputs:
    """Inputs of the cluster at each sample (wind, density); leaves (T, ...).

    Attributes:
        wind: Best-estimated wind (T, 3) [m/s].
        density: (T,) [kg/m^3].
        axial_factor: Breathing factor on the axial coefficients (T, n); ones when unknown.
        attitude: Recorded attitude (T, 4), against which attitude outputs are formed.
    """

    wind: Component
    density: Component
    axial_factor: Component
    attitude: Component


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ClusterFlight:
    """One flight of a cluster (a `FlightModel`).

    Attributes:
        base: Numbers that are not parameters.
        start: Reference start, with its across-riser directions `basis` (2, 3, n).
        record: Inputs at the samples.
        dt: Sample interval [s].
        structure: Terms and options.
        names: Parameters, in the order of theta.
        channels: Outputs: any of ``canopy_position`` (relative to the capsule, times the scale of positions, 3 n),
            ``capsule_velocity`` (3), ``capsule_attitude`` (rotation vector from the recorded attitude, 3),
            ``riser_tension`` (n) [N], ``swing_angle`` (1) [rad] and ``descent_rate`` (1) [m/s] as of `quantity`,
            ``canopy_velocity`` (over ground, of each canopy's reference point, 3 n) [m/s].
        stepping: How it goes through a sample.
        wind_field: Wind by altitude added to the record's, at every body's altitude; None: all have the record's.
        air_shares: By parameter, as of `with_parameters`.
    """

    base: Cluster
    start: Start
    basis: Component
    record: ClusterInputs
    dt: Component
    structure: Structure = field(metadata={"static": True})
    names: tuple[str, ...] = field(metadata={"static": True})
    channels: tuple[str, ...] = field(metadata={"static": True})
    stepping: Stepping = field(default=Stepping(4), metadata={"static": True})
    wind_field: WindField | None = None
    air_shares: tuple[float, ...] = field(default=(), metadata={"static": True})

    def inputs(self) -> ClusterInputs:
        """The record's inputs."""
        return self.record

    def numbers(self, theta: jax.Array) -> Cluster:
        """The cluster with these parameters."""
        return with_parameters(self.base, self.structure, self.names, theta, self.air_shares)

    def with_own_parameters(self) -> tuple[ClusterFlight, tuple[int, ...]]:
        """The flight of the parameters that it has alone, and their numbers among all: others move nothing."""
        own = tuple(i for i, name in enumerate(self.names) if name)
        if len(own) == len(self.names):
            return self, own
        shares = tuple(self.air_shares[i] for i in own) if self.air_shares else ()
        return replace(self, names=tuple(self.names[i] for i in own), air_shares=shares), own

    def initial(self, numbers: Cluster, start: jax.Array) -> jax.Array:
        """State at the first sample (13 + 6 n, ...)."""
        rank = start.ndim - 1
        first = jax.tree.map(lambda a: jnp.reshape(a[0], (*jnp.shape(a)[1:], *(1,) * rank)), self.record)
        none = jnp.zeros((3, *(1,) * rank))
        air = unbiased(air_between(first, first, none, none, 0.0, self.dt), numbers)
        x = initial_state(self.start, self.basis, start, numbers, self.structure, air)
        if self.wind_field is None:
            return x
        air = blown(air, self.wind_field, unpack(x, self.structure.canopies))
        return initial_state(self.start, self.basis, start, numbers, self.structure, air)

    def advance(
        self, x: jax.Array, numbers: Cluster, now: Any, then: Any, error_now: Any, error_then: Any
    ) -> jax.Array:
        """State one sample later."""
        given = numbers, now, then, error_now, error_then
        return advanced(self.stepping, lambda state, share: self.rate(state, *given, share), x, self.dt)

    def rate(
        self, x: jax.Array, numbers: Cluster, now: Any, then: Any, error_now: Any, error_then: Any, share: Component
    ) -> jax.Array:
        """Rate of the state when this share of the sample has passed."""
        air = self.air(x, numbers, now, then, error_now, error_then, share)
        return state_rate(x, numbers, self.structure, air)

    def air(
        self,
        x: jax.Array,
        numbers: Cluster,
        now: Any,
        then: Any,
        error_now: Component,
        error_then: Component,
        share: Component,
    ) -> Air:
        """Air that a state meets when this share of the sample has passed."""
        air = unbiased(air_between(now, then, error_now, error_then, share, self.dt), numbers)
        return air if self.wind_field is None else blown(air, self.wind_field, unpack(x, self.structure.canopies))

    def retract(self, x: Component, step: Component, theta: Component, change: Component) -> Component:
        """States a step away, risers pulling as the linear step says.

        A canopy that moves across its riser in a straight line stretches it by the square of that move, and a stiff
        riser answers with more than its load. So does one whose stiffness changes by a fifth while its stretch follows
        in a straight line, where the load is what it was. So what the step does to both parts of the tension of every
        riser, stiffness times stretch and damping times stretch rate, is taken from its derivative, and the canopies
        are put there along the new direction (a retraction; Absil, Mahony & Sepulchre 2008). While slack, length and
        rate are taken in place of tensions. So is the size of the quaternion of the attitude.

        Args:
            x: States (T, X, ...).
            step: Change of the states (T, X, ...).
            theta: Parameters (P, ...).
            change: Change of the parameters (P, ...).
        """
        rows = np.array([i for i, name in enumerate(self.names) if name.startswith(_RISER)], dtype=int)
        names = tuple(self.names[i][len(_RISER) :] for i in rows)
        library = library_of(theta, change)
        change = library.asarray(change)[rows]
        theta = library.broadcast_to(library.asarray(theta)[rows], change.shape)
        function = partial(_retracted, names=names, n=self.structure.canopies)
        shared, given = (self.base.risers, self.base.capsule), {"x": x, "step": step, "theta": theta, "change": change}
        made = by_sample(("retract", names, self.structure.canopies), function, shared, given, ("x", "step"))
        if made is None:
            each = (jnp.moveaxis(jnp.asarray(a), 1, 0) for a in (x, step))
            return jnp.moveaxis(function(shared, *each, theta, change), 0, 1)
        return made

    def observe(self, x: jax.Array, numbers: Cluster, now: Any) -> jax.Array:
        """Outputs of `channels`, in order (C, ...)."""
        n = self.structure.canopies
        state = unpack(x, n)
        rows = []
        for channel in self.channels:
            if channel == "canopy_position":
                apart = state.canopy_position - state.position
                if numbers.position_scale is not None:
                    apart = apart * numbers.position_scale
                if numbers.canopy_position_bias is not None:
                    apart = apart + Vec3(*numbers.canopy_position_bias)
                rows.append(_by_canopy(apart, n))
            elif channel == "canopy_velocity":
                rows.append(_by_canopy(state.canopy_velocity, n))
            elif channel == "capsule_velocity":
                rows.append(state.velocity.stack())
            elif channel == "capsule_attitude":
                apart_q = quaternion(now.attitude).conjugate().times(state.attitude)
                turn = Vec3(apart_q.x, apart_q.y, apart_q.z) * (2.0 * jnp.sign(apart_q.w))
                if numbers.capsule_attitude_bias is not None:
                    turn = turn + Vec3(0.0, *numbers.capsule_attitude_bias)
                rows.append(turn.stack())
            elif channel == "riser_tension":
                rows.append(tension(geometry(state, numbers.capsule), numbers.risers))
            elif channel == "swing_angle":
                rows.append(swing_angle(state, numbers.capsule.attach_b)[None])
            elif channel == "descent_rate":
                rows.append(quantity(channel, x, now.density, numbers.capsule.attach_b, n)[None])
            else:
                raise KeyError(f"{channel!r} is no channel of the cluster")
        return jnp.concatenate([jnp.zeros((0, *x.shape[1:])), *rows])


@partial(jax.jit, static_argnames=("names", "n"))
def _retracted(
    shared: tuple[Risers, Capsule],
    x: jax.Array,
    step: jax.Array,
    theta: jax.Array,
    change: jax.Array,
    names: tuple[str, ...],
    n: int,
) -> jax.Array:
    """`ClusterFlight.retract` with what it needs of a flight, so that flights of any terms share a compiled function.

    Args:
        shared: Risers, but for the parameters, and the capsule, with the attach point.
        x: States (X, ...).
        step: Their change (X, ...).
        theta: Parameters of the risers (R, ...).
        change: Their change (R, ...).
        names: Fields of the risers, in the order of theta.
        n: Number of canopies.
    """
    known, capsule = shared

    def size(q: Quaternion) -> jax.Array:
        return jnp.sqrt(q.w**2 + q.x**2 + q.y**2 + q.z**2)

    def kept(x: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
        state = unpack(x, n)
        geo = geometry(state, capsule)
        return size(state.attitude), geo.length, geo.stretch_rate

    def risers(theta: jax.Array) -> tuple[Component, Component, Component]:
        logarithmic = (_RISER + name in LOGARITHMIC for name in names)
        values = (jnp.exp(row) if log else row for row, log in zip(theta, logarithmic, strict=True))
        given = replace(known, **dict(zip(names, values, strict=True)))
        return given.length, given.stiffness, given.damping

    (turned, length, rate), by = jax.jvp(kept, (x,), (step,))
    (slack, *given), (longer, *more) = jax.jvp(risers, (theta,), (change,))
    new_slack, *new = risers(theta + change)

    def pulled(i: int, value: jax.Array, by: jax.Array) -> jax.Array:
        pulls = (length > slack) & (new[i] > 0.0)
        return jnp.where(pulls, (given[i] * (value + by) + more[i] * value) / new[i], value + by)

    turned, stretch, rate = turned + by[0], pulled(0, length - slack, by[1] - longer), pulled(1, rate, by[2])
    length = new_slack + stretch
    there = unpack(x + step, n)
    q, share = there.attitude, turned / size(there.attitude)
    there = replace(there, attitude=Quaternion(q.w * share, q.x * share, q.y * share, q.z * share))
    geo = geometry(there, capsule)
    place = there.canopy_position + geo.direction * (length - geo.length)
    moving = there.canopy_velocity + geo.direction * (rate - geo.stretch_rate)
    return pack(replace(there, canopy_position=place, canopy_velocity=moving))


def _by_canopy(vector: Vec3, n: int) -> jax.Array:
    """Components of the vectors of `n` canopies in the order of `output_names` (3 n, ...)."""
    return jnp.stack([c[i] for i in range(n) for c in (vector.x, vector.y, vector.z)])


def channel_sizes(channels: Sequence[str], n: int) -> dict[str, int]:
    """Number of outputs of each channel with `n` canopies."""
    sizes = dict(zip(CHANNELS, (3 * n, 3, 3, n, 1, 1, 3 * n), strict=True))
    return {channel: sizes[channel] for channel in channels}


def output_names(channels: Sequence[str], n: int) -> tuple[str, ...]:
    """Names of the outputs of some channels with `n` canopies: a channel, a canopy, an axis."""
    axes, each = ("north", "east", "down"), range(1, n + 1)
    parts: dict[str, list[str]] = {
        "canopy_position": [f".{i}.{a}" for i in each for a in axes],
        "capsule_velocity": [f".{a}" for a in axes],
        "capsule_attitude": [f".{a}" for a in "xyz"],
        "riser_tension": [f".{i}" for i in each],
        "canopy_velocity": [f".{i}.{a}" for i in each for a in axes],
    }
    return tuple(channel + part for channel in channels for part in parts.get(channel, [""]))


def unbiased(air: Air, numbers: Cluster) -> Air:
    """Air without the constant error of the recorded wind."""
    if numbers.wind_bias is None:
        return air
    north, east = numbers.wind_bias
    return replace(air, wind=air.wind - Vec3(north, east, 0.0))


def blown(air: Air, field: WindField, state: ClusterState) -> Air:
    """Air with a wind field on top, at the altitudes of the capsule and of the canopies."""
    low, high = field.at(-state.position.z), field.at(-state.canopy_position.z)
    aloft = replace(air, wind=air.wind + high[0], shear=high[1])
    return replace(air, wind=air.wind + low[0], shear=low[1], aloft=aloft)


def air_between(
    now: Any, then: Any, error_now: Component, error_then: Component, share: Component, dt: Component
) -> Air:
    """Air at a share of the sample, linear between samples.

    The first three rows of the errors add to the recorded wind; the next, one per canopy, to the axial factors; those
    beyond, if any, are the canopies' transverse coefficients that no term explains: all towards north, then all
    towards east; and the last is the capsule's unexplained roll.
    """
    w0, w1 = now.wind + error_now[:3], then.wind + error_then[:3]
    f0, f1 = now.axial_factor, then.axial_factor
    n = f0.shape[0]
    if error_now.shape[0] > 3:
        f0, f1 = f0 + error_now[3 : 3 + n], f1 + error_then[3 : 3 + n]
    more = error_now[3 + n :] + (error_then[3 + n :] - error_now[3 + n :]) * share
    push = (more[:n], more[n : 2 * n]) if more.shape[0] else None
    zero = jnp.zeros_like(w0[0])
    return Air(
        wind=vec3(w0 + (w1 - w0) * share),
        wind_rate=vec3((w1 - w0) / dt),
        density=now.density + (then.density - now.density) * share,
        axial_factor=f0 + (f1 - f0) * share,
        shear=Vec3(zero, zero, zero),
        push=push,
        roll=more[2 * n] if more.shape[0] > 2 * n else None,
    )


def _off_vertical(line: Vec3) -> Component:
    """Angle of a line off the vertical, either way up [rad]."""
    return jnp.arctan2(jnp.sqrt(line.x**2 + line.y**2), jnp.abs(line.z))


def _risers(state: ClusterState, attach_b: Vec3) -> Vec3:
    """From the attach point to every canopy, NED [m]."""
    return state.canopy_position - (state.position + state.attitude.to_ned(attach_b))


def swing_angle(state: ClusterState, attach_b: Vec3) -> Component:
    """Swing angle (6.1-18) as of `quantity`, with a derivative that is finite everywhere [rad].

    The angle is the distance from a point, the vertical, so it has a cone's tip there: no derivative exists. Here it is
    zero, the mean of those in all directions; everywhere else it is exact, of size 1 over the mean riser's length. A
    linearised fit follows the angle where the swing is large compared with its uncertainty.
    """
    mean = _risers(state, attach_b).map(lambda c: c.sum(axis=0))
    leans = mean.x**2 + mean.y**2 > 0.0
    aside = Vec3(jnp.where(leans, mean.x, 1.0), jnp.where(leans, mean.y, 0.0), mean.z)
    return jnp.where(leans, _off_vertical(aside), 0.0)


QUANTITIES = ("swing_angle", "descent_rate", "sea_level_descent_rate", "flyout_angle")


def quantity(name: str, x: jax.Array, density: Component, attach_b: Vec3, n: int) -> jax.Array:
    """A reported quantity of a state: swing angle (6.1-18), flyout angle (6.1-20) [rad] or a descent rate [m/s].

    Args:
        name: One of `QUANTITIES`.
        x: State (13 + 6 n, ...).
        density: Air density [kg/m^3].
        attach_b: Attach point from the centre of mass, body axes [m].
        n: Number of canopies.

    Returns:
        The quantity, shape of the batch.
    """
    state = unpack(x, n)
    if name == "descent_rate":
        return state.velocity.z
    if name == "sea_level_descent_rate":
        return state.velocity.z * jnp.sqrt(density / SEA_LEVEL_DENSITY)
    along = _risers(state, attach_b)
    if name == "swing_angle":
        return _off_vertical(along.map(lambda c: c.sum(axis=0)))
    if n == 1:
        return jnp.zeros_like(state.velocity.z)
    unit = along / norm(along)
    pairs = [
        dot(unit.map(lambda c, i=i: c[i]), unit.map(lambda c, j=j: c[j])) for i in range(n) for j in range(i + 1, n)
    ]
    angles = [0.5 * jnp.arccos(jnp.clip(p, -1.0, 1.0)) for p in pairs]
    return jnp.mean(jnp.stack(angles), axis=0)
