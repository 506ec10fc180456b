"""Equations of motion against a naive twin, and the laws that any cluster obeys."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.twins import naive_cluster, small_cluster

from bayeschute.core.vectors import Vec3
from bayeschute.dynamics.cluster import (
    Air,
    canopy_acceleration,
    canopy_flow,
    capsule_acceleration,
    geometry,
    riser_force,
    state_rate,
    tension,
)
from bayeschute.dynamics.parameters import Structure
from bayeschute.dynamics.state import pack, unpack

twin, small = naive_cluster, small_cluster

AXIAL = {
    "1": 0.9,
    "alpha^2": -0.7,
    "alpha": 0.1,
    "q": 0.05,
    "speed": -0.2,
    "proximity(0.8)": 0.1,
    "(e.rate)*alpha": 0.2,
}
TRANSVERSE = {
    "e": 0.1,
    "angle*alpha^2": 1.5,
    "rate": 0.3,
    "rate*speed": 0.1,
    "repulsion(2.5)": 0.2,
    "c*proximity(3)*closing": 0.1,
    "c*(c.rate)": 0.2,
    "e*(e.c)": 0.15,
    "e*side": 0.07,
    "rate*side*alpha": 0.1,
    "c*side*(e.c)": 0.05,
    "e*restoring(10)": 0.4,
}


@partial(jax.jit, static_argnums=2)
def rate_of(x, model, structure, wind, wind_rate, density, factor):
    zero = 0.0 * wind[0]
    return state_rate(x, model, structure, Air(Vec3(*wind), Vec3(*wind_rate), density, factor, Vec3(zero, zero, zero)))


def structure_of(n, rate):
    return Structure(tuple(AXIAL), tuple(TRANSVERSE), n, rate)


MODEL = small.cluster(AXIAL.values(), TRANSVERSE.values())


def random_states(n, count, rng):
    """States near a descent, some risers slack; (13 + 6 n, count)."""
    columns = []
    for _ in range(count):
        q = rng.normal(size=4)
        line = rng.normal([0.0, 0.0, -1.5], 0.5, (n, 3))
        line *= (71.3 + rng.uniform(-0.5, 1.5, n) + 1.9)[:, None] / np.linalg.norm(line, axis=1)[:, None]
        where = rng.normal(size=3) * 100.0
        columns.append(
            np.concatenate(
                [
                    where,
                    rng.normal([0, 0, 10.0], 3.0),
                    q / np.linalg.norm(q),
                    rng.normal(size=3) * 0.3,
                    (where + line).T.ravel(),
                    rng.normal([0, 0, 10.0], 3.0, (n, 3)).T.ravel(),
                ]
            )
        )
    return np.array(columns).T


def tensor(capsule):
    """Inertia about the centre of mass, body axes (3, 3)."""
    made = np.diag([capsule.inertia.x, capsule.inertia.y, capsule.inertia.z])
    if capsule.products is not None:
        xy, xz, yz = capsule.products.x, capsule.products.y, capsule.products.z
        made = made + np.array([[0.0, xy, xz], [xy, 0.0, yz], [xz, yz, 0.0]])
    return made


def naive(x, n, rate, wind, wind_rate, density, factor, c=small.CAPSULE, k=small.CANOPIES):
    r = small.RISERS
    p = {
        "attach_b": np.array([c.attach_b.x, c.attach_b.y, c.attach_b.z]),
        "reference_b": np.array([c.reference_centre_b.x, c.reference_centre_b.y, c.reference_centre_b.z]),
        "inertia": tensor(c),
        "m_c": c.mass, "S_c": c.area, "l_c": c.length, "C_A": c.axial_force, "C_Nslope": c.normal_force_slope,
        "C_mslope": c.moment_slope, "C_lp": c.roll_damping, "C_mq": c.pitch_damping,
        "S": k.area, "l": k.length, "V_o": k.speed, "m_d": k.dry_mass, "V_ea": k.enclosed_volume,
        "k_mslope": k.moment_slope or 0.0, "k_mq": k.pitch_damping or 0.0,
        "l0": r.length, "k": r.stiffness, "c": r.damping, "engagement": r.engagement, "g": 9.80665,
    }  # fmt: skip
    air = {"wind": wind, "wind_rate": wind_rate, "rho": density, "factor": factor}
    return twin.naive_rate(x, n, p, list(AXIAL.items()), list(TRANSVERSE.items()), rate, air)


SKEW = replace(small.CAPSULE, products=Vec3(3e3, -5e3, 4e3))
TURNING = replace(small.CANOPIES, moment_slope=-0.09, pitch_damping=-0.2)


@pytest.mark.parametrize(
    ("n", "rate", "capsule", "canopies"),
    [(n, rate, small.CAPSULE, small.CANOPIES) for rate in ("riser", "airflow") for n in (1, 2, 3)]
    + [(1, "riser", SKEW, small.CANOPIES)]
    + [(n, rate, small.CAPSULE, TURNING) for n, rate in ((1, "riser"), (2, "riser"), (2, "airflow"))],
)
def test_state_rate_equals_its_twin_one_by_one_and_in_a_batch(n, rate, capsule, canopies):
    rng, model = np.random.default_rng(n), replace(MODEL, capsule=capsule, canopies=canopies)
    count = 12
    x = random_states(n, count, rng)
    wind, wind_rate = rng.normal(size=(3, count)) * 4.0, rng.normal(size=(3, count))
    density, factor = rng.uniform(0.8, 1.2, count), rng.uniform(0.9, 1.1, (n, count))
    got = np.asarray(rate_of(x, model, structure_of(n, rate), wind, wind_rate, density, factor))
    for b in range(count):
        want = naive(x[:, b], n, rate, wind[:, b], wind_rate[:, b], density[b], factor[:, b], capsule, canopies)
        np.testing.assert_allclose(got[:, b], want, rtol=3e-7, atol=3e-7)


def turned(x, n, turn):
    """State after turning the whole problem in space."""
    R, s = turn.as_matrix(), x.copy()
    s[0:3], s[3:6] = R @ x[0:3], R @ x[3:6]
    s[6:10] = (turn * Rotation.from_quat(x[6:10], scalar_first=True)).as_quat(scalar_first=True)
    s[13:] = np.concatenate([(R @ part.reshape(3, n)).ravel() for part in np.split(x[13:], 2)])
    return s


def turned_rate(dx, n, turn):
    R, s = turn.as_matrix(), dx.copy()
    s[0:3], s[3:6] = R @ dx[0:3], R @ dx[3:6]
    w, *v = dx[6:10]
    a, *b = turn.as_quat(scalar_first=True)
    s[6:10] = np.concatenate([[a * w - np.dot(b, v)], a * np.array(v) + w * np.array(b) + np.cross(b, v)])
    s[13:] = np.concatenate([(R @ part.reshape(3, n)).ravel() for part in np.split(dx[13:], 2)])
    return s


@pytest.mark.parametrize("rate", ["riser", "airflow"])
@pytest.mark.parametrize("gravity", [9.80665, 0.0])
def test_rates_turn_with_the_problem(rate, gravity):
    """About the vertical; without gravity about any axis."""
    rng = np.random.default_rng(5)
    n, count, model = 2, 12, replace(MODEL, gravity=gravity)
    x = random_states(n, count, rng)
    turn = Rotation.from_rotvec([0.0, 0.0, 2.1] if gravity else [0.4, -1.3, 0.8])
    w, dw = rng.normal(size=(3, count)) * 4.0, rng.normal(size=(3, count))
    rest = (np.full(count, 1.1), np.ones((n, count)))
    plain = np.asarray(rate_of(x, model, structure_of(n, rate), w, dw, *rest))
    moved = np.array([turned(x[:, b], n, turn) for b in range(count)]).T
    R = turn.as_matrix()
    got = np.asarray(rate_of(moved, model, structure_of(n, rate), R @ w, R @ dw, *rest))
    for b in range(count):
        want = turned_rate(plain[:, b], n, turn)
        # Sign of the turned quaternion is free.
        got_q = got[6:10, b] * np.sign(got[6:10, b] @ want[6:10])
        np.testing.assert_allclose(got_q, want[6:10], atol=1e-9)
        np.testing.assert_allclose(
            np.delete(got[:, b], range(6, 10)), np.delete(want, range(6, 10)), rtol=1e-9, atol=1e-8
        )


def in_axes(capsule, turn):
    """The capsule by numbers along other body axes, whose components are `turn` times those along its own."""
    made = turn @ tensor(capsule) @ turn.T
    arms = {name: Vec3(*(turn @ getattr(capsule, name).stack())) for name in ("attach_b", "reference_centre_b")}
    return replace(capsule, inertia=Vec3(*np.diag(made)), products=Vec3(made[0, 1], made[0, 2], made[1, 2]), **arms)


@pytest.mark.parametrize(("axis", "density"), [([0.7, 0.0, 0.0], 1.1), ([0.4, -1.3, 0.8], 0.0)], ids=["x", "any"])
def test_a_capsule_flies_the_same_in_other_body_axes(axis, density):
    """Turned about its long axis in air, whose forces know no roll; without air in any axes."""
    rng, count, turn = np.random.default_rng(10), 12, Rotation.from_rotvec(axis)
    x, other, B = random_states(1, count, rng), turn.inv(), turn.as_matrix()
    rest = (np.zeros((3, count)), np.zeros((3, count)), np.full(count, density), np.ones((1, count)))
    plain = np.asarray(rate_of(x, replace(MODEL, capsule=SKEW), structure_of(1, "riser"), *rest))

    def renamed(s):
        s, (a, *b) = s.copy(), other.as_quat(scalar_first=True)
        w, v = s[6].copy(), s[7:10].copy()
        s[6] = a * w - np.dot(b, v)
        s[7:10] = a * v + np.outer(b, w) - np.cross(b, v, axisb=0).T  # the turn of the axes comes first
        s[10:13] = B @ s[10:13]
        return s

    model = replace(MODEL, capsule=in_axes(SKEW, B))
    got = np.asarray(rate_of(renamed(x), model, structure_of(1, "riser"), *rest))
    np.testing.assert_allclose(got, renamed(plain), rtol=1e-9, atol=1e-9)
    assert np.abs(got[10:13] - plain[10:13]).max() > 1e-3


def test_without_torque_a_capsule_keeps_its_angular_momentum_and_energy():
    """In space: risers that pull at the centre of mass, and no air."""
    rng, count = np.random.default_rng(11), 12
    x, capsule = random_states(1, count, rng), replace(SKEW, attach_b=Vec3(0.0, 0.0, 0.0))
    none = (np.zeros((3, count)), np.zeros((3, count)), np.zeros(count), np.ones((1, count)))
    dx = np.asarray(rate_of(x, replace(MODEL, capsule=capsule), structure_of(1, "riser"), *none))
    h, inertia = 1e-4, tensor(capsule)

    def momentum(s):
        return [twin.rotation_from_body(c[6:10] / np.linalg.norm(c[6:10])) @ inertia @ c[10:13] for c in s.T]

    change = np.subtract(momentum(x + h * dx), momentum(x - h * dx)) / (2.0 * h)
    np.testing.assert_allclose(change, 0.0, atol=1e-3)
    np.testing.assert_allclose(np.sum(x[10:13] * (inertia @ dx[10:13]), axis=0), 0.0, atol=1e-9)
    assert np.abs(inertia @ dx[10:13]).max() > 100.0


def test_renaming_the_canopies_renames_their_rates():
    rng = np.random.default_rng(6)
    n, count, order = 3, 12, [2, 0, 1]
    x = random_states(n, count, rng)
    rest = (np.zeros((3, count)), np.zeros((3, count)), np.full(count, 1.1), np.ones((n, count)))

    def renamed(s):
        return np.concatenate(
            [s[:13], *[part.reshape(3, n, count)[:, order].reshape(3 * n, count) for part in np.split(s[13:], 2)]]
        )

    structure = structure_of(n, "riser")
    want = renamed(np.asarray(rate_of(x, MODEL, structure, *rest)))
    np.testing.assert_allclose(np.asarray(rate_of(renamed(x), MODEL, structure, *rest)), want, rtol=1e-9, atol=1e-9)


def _bodies(x, dx, n):
    """Masses (dry), positions, velocities, accelerations of capsule and canopies, at zero density."""
    m = np.array([small.CAPSULE.mass] + [small.CANOPIES.dry_mass] * n)
    split = 13 + 3 * n
    r = np.vstack([x[0:3], x[13:split].reshape(3, n).T])
    v = np.vstack([x[3:6], x[split:].reshape(3, n).T])
    a = np.vstack([dx[3:6], dx[split:].reshape(3, n).T])
    return m[:, None], r, v, a


@pytest.mark.parametrize("gravity", [0.0, 9.80665])
def test_without_air_momentum_is_kept_and_only_riser_dampers_take_energy(gravity):
    rng = np.random.default_rng(7)
    n, count, model = 2, 12, replace(MODEL, gravity=gravity)
    X = random_states(n, count, rng)
    none = (np.zeros((3, count)), np.zeros((3, count)), np.zeros(count), np.ones((n, count)))
    dX = np.asarray(rate_of(X, model, structure_of(n, "riser"), *none))
    k, c, l0 = small.RISERS.stiffness, small.RISERS.damping, small.RISERS.length
    inertia = np.array([25e3, 22e3, 20e3])
    taut = 0
    for x, dx in zip(X.T, dX.T, strict=True):
        m, r, v, a = _bodies(x, dx, n)
        weight = m * np.array([0.0, 0.0, gravity])
        force = (m * a - weight).sum(axis=0)
        R, omega = twin.rotation_from_body(x[6:10]), x[10:13]
        spin = R @ (inertia * dx[10:13] + np.cross(omega, inertia * omega))
        torque = np.cross(r, m * a - weight).sum(axis=0) + spin
        np.testing.assert_allclose(force, 0.0, atol=1e-8)
        np.testing.assert_allclose(torque, 0.0, atol=1e-5)
        geo = geometry(unpack(x, n), small.CAPSULE)
        length, stretch_rate = np.asarray(geo.length), np.asarray(geo.stretch_rate)
        pull = np.asarray(tension(geo, small.RISERS))
        power = np.sum(m * v * a) - np.sum(weight * v) + omega @ (inertia * dx[10:13])
        assert power == pytest.approx(-np.sum(pull * stretch_rate), rel=1e-9, abs=1e-6)
        full = (length > l0) & (pull > 0.0)
        taut += full.sum()
        np.testing.assert_allclose(pull[full], (k * (length - l0) + c * stretch_rate)[full])
    assert 3 < taut < n * count


@pytest.mark.parametrize("moment", [{"moment_slope": -0.1}, {"pitch_damping": -0.2}])
def test_a_canopys_moment_is_a_couple_that_restores_or_takes_energy(moment):
    """Forces on capsule and canopies by it cancel; its moment about the canopy is across riser and flow."""
    rng = np.random.default_rng(11)
    x, n = random_states(2, 20, rng), 2
    still = Air(Vec3(0.0, 0.0, 0.0), Vec3(0.0, 0.0, 0.0), 1.1, 1.0, Vec3(0.0, 0.0, 0.0))
    turned_by = replace(MODEL, canopies=replace(small.CANOPIES, **moment))
    shape, engaged = structure_of(n, "riser"), 0
    for state in (unpack(column, n) for column in x.T):
        geo = geometry(state, small.CAPSULE)
        pull = tension(geo, small.RISERS)
        plain, force = (riser_force(state, geo, pull, model, shape, still) for model in (MODEL, turned_by))
        F, axis = np.asarray((force - plain).stack()), np.asarray(geo.direction.stack())
        np.testing.assert_allclose(np.sum(F * axis, axis=0), 0.0, atol=1e-6)
        slack = np.asarray(geo.length) <= small.RISERS.length
        assert not F[:, slack].any()
        bodies = []
        for model in (MODEL, turned_by):
            a, _ = capsule_acceleration(state, riser_force(state, geo, pull, model, shape, still), model, still, n)
            own = riser_force(state, geo, pull, model, shape, still)
            on = canopy_acceleration(state, geo, own, model, shape, still)
            bodies.append(small.CAPSULE.mass * a.stack() + (149.1 + 1.1 * 3969.0) * np.sum(on.stack(), axis=1))
        np.testing.assert_allclose(bodies[0], bodies[1], rtol=1e-9, atol=1e-5)
        flow = canopy_flow(state, geo, turned_by, shape, still)
        along = flow.e if "moment_slope" in moment else flow.rate
        work = np.sum(-F * np.asarray(along.stack()), axis=0)[~slack]  # of the force on the canopy
        assert (work < 0.0).all()
        engaged += work.size
    assert engaged > 10


def test_a_slack_riser_pulls_nothing_and_none_pushes():
    rng = np.random.default_rng(8)
    x = random_states(2, 200, rng)
    geo = geometry(unpack(x, 2), small.CAPSULE)
    pull, slack = np.asarray(tension(geo, small.RISERS)), np.asarray(geo.length) <= small.RISERS.length
    assert slack.any() and (~slack).any()
    assert (pull[slack] == 0.0).all() and (pull >= 0.0).all()


def test_weight_acts_on_dry_mass_and_inertia_on_enclosed_air_too():
    """A canopy at rest under a slack riser falls at m_d g/(m_d + rho V_ea)."""
    rng = np.random.default_rng(9)
    x = random_states(1, 12, rng)
    x[13:16] = x[0:3] + [[0.0], [0.0], [-60.0]]  # slack
    x[16:19] = 0.0
    zero, one = np.zeros((3, 12)), np.ones((1, 12))
    dx = np.asarray(rate_of(x, MODEL, structure_of(1, "riser"), zero, zero, np.full(12, 1.1), one))
    want = 149.1 * 9.80665 / (149.1 + 1.1 * 3969.0)
    np.testing.assert_allclose(dx[18], want, rtol=1e-4)


def test_state_survives_its_names():
    x = random_states(3, 4, np.random.default_rng(0))
    np.testing.assert_array_equal(pack(unpack(x, 3)), x)
