"""Outputs of a cluster's flight: each channel against its definition, derivatives, and the tip of the swing angle."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.twins import small_cluster as small

from bayeschute.atmosphere.wind_field import wind_field
from bayeschute.compiler import compiled_model as kernel
from bayeschute.compiler.integrate import trajectory_compiled
from bayeschute.core.vectors import Vec3, quaternion, small_rotation
from bayeschute.dynamics.cluster import geometry, state_rate
from bayeschute.dynamics.cluster_flight import CHANNELS, air_between, blown, channel_sizes, output_names, quantity
from bayeschute.dynamics.parameters import Structure
from bayeschute.dynamics.state import unpack
from bayeschute.records.angles import swing_angle as recorded_swing

NAMES = ("riser_stiffness", "riser_length", "capsule_mass", "canopy_mass")
THETA = np.array([np.log(2.0e5), 71.0, 9200.0, 140.0])
FEW = Structure(("1",), ("e",), 2, "riser")
MODEL = small.flight(
    small.cluster((0.95,), (-0.1,)), small.start([[0.2, -0.1], [0.1, -0.2], [-1.0, -1.0]]), FEW,
    samples=6, substeps=4, names=NAMES, channels=CHANNELS,
)  # fmt: skip
NOW = jax.tree.map(lambda a: a[0], MODEL.record)
PLACES = dict(zip(CHANNELS, np.split(np.arange(22), np.cumsum([6, 3, 3, 2, 1, 1])), strict=True))


@jax.jit
def observe(x, theta):
    return MODEL.observe(x, MODEL.numbers(theta), NOW)


slopes = jax.jit(jax.jacfwd(observe, (0, 1)))


def a_state(rng):
    """Risers of 71 to 72 m within some ten degrees of the vertical, everything moving."""
    x = np.asarray(MODEL.initial(MODEL.numbers(jnp.asarray(THETA)), 0.05 * jnp.asarray(rng.normal(size=17)))).copy()
    x[3:6] += rng.normal(size=3)
    x[19:25] += 0.3 * rng.normal(size=6)
    return x


@pytest.fixture(scope="module")
def states():
    rng = np.random.default_rng(4)
    return [a_state(rng) for _ in range(5)]


def test_sizes_are_those_of_the_outputs(states):
    sizes = channel_sizes(CHANNELS, 2)
    assert list(sizes) == list(CHANNELS) and list(sizes.values()) == [len(p) for p in PLACES.values()]
    assert observe(states[0], THETA).shape == (sum(sizes.values()),)


def test_swing_and_descent_are_the_reported_quantities(states):
    for x in states:
        y = np.asarray(observe(x, THETA))
        for name in ("swing_angle", "descent_rate"):
            want = quantity(name, jnp.asarray(x), NOW.density, small.CAPSULE.attach_b, 2)
            np.testing.assert_allclose(y[PLACES[name]], want, rtol=1e-14)


def test_swing_angle_is_that_of_a_reconstruction(states):
    for x in states:
        state, b = unpack(jnp.asarray(x), 2), small.CAPSULE.attach_b
        place = np.asarray((state.position + state.attitude.to_ned(b)).stack())
        line = np.asarray(state.canopy_position.stack()).T - place
        got = np.asarray(observe(x, THETA))[PLACES["swing_angle"]]
        np.testing.assert_allclose(got, recorded_swing(line[None]), rtol=1e-12)


def test_canopy_velocity_is_that_of_the_state_canopy_by_canopy(states):
    """In the order of its names, and the rate at which the model moves the canopies."""
    names = output_names(("canopy_velocity",), 2)
    assert names[:3] == ("canopy_velocity.1.north", "canopy_velocity.1.east", "canopy_velocity.1.down")
    assert (
        names[5] == "canopy_velocity.2.down" and len(names) == channel_sizes(("canopy_velocity",), 2)["canopy_velocity"]
    )
    numbers = MODEL.numbers(jnp.asarray(THETA))
    for x in states:
        got = np.asarray(observe(x, THETA))[PLACES["canopy_velocity"]]
        np.testing.assert_array_equal(got.reshape(2, 3).T, x[19:25].reshape(3, 2))
        rate = np.asarray(MODEL.rate(jnp.asarray(x), numbers, NOW, NOW, jnp.zeros(3), jnp.zeros(3), 0.0))
        np.testing.assert_array_equal(got.reshape(2, 3).T, rate[13:19].reshape(3, 2))


def test_a_further_channel_leaves_the_outputs_of_the_others():
    """Machine code too: to the last bit."""
    start, error = 0.02 * np.random.default_rng(2).normal(size=17), np.zeros((6, 3))
    without = replace(MODEL, channels=CHANNELS[:-1])
    states = kernel.states(MODEL, THETA, start, error)
    np.testing.assert_array_equal(kernel.states(without, THETA, start, error), states)
    y, few = (kernel.along_path(model, THETA, start, error, states)[0] for model in (MODEL, without))
    np.testing.assert_array_equal(np.asarray(y)[:, :16], few)
    np.testing.assert_array_equal(
        np.asarray(y)[:, 16:].reshape(6, 2, 3), np.moveaxis(np.asarray(states)[:, 19:25].reshape(6, 3, 2), 1, 2)
    )


def test_tension_is_spring_and_damper_along_the_riser(states):
    for x in states:
        state, b = unpack(jnp.asarray(x), 2), small.CAPSULE.attach_b
        p, v, q = (np.asarray(a.stack()) for a in (state.position, state.velocity, state.attitude))
        w, u = q[0], q[1:]
        turn = np.eye(3) * (w * w - u @ u) + 2.0 * np.outer(u, u) + 2.0 * w * np.cross(np.eye(3), u)  # body to NED
        arm = np.array([b.x, b.y, b.z])
        attach, moving = p + turn @ arm, v + turn @ np.cross(np.asarray(state.rate.stack()), arm)
        for i in range(2):
            line = np.asarray(state.canopy_position.stack())[:, i] - attach
            length = np.linalg.norm(line)
            opening = line @ (np.asarray(state.canopy_velocity.stack())[:, i] - moving) / length
            force = 2.0e5 * (length - 71.0) + small.RISERS.damping * opening
            want = max(force, 0.0) if length - 71.0 > small.RISERS.engagement else np.nan
            got = float(observe(x, THETA)[PLACES["riser_tension"][i]])
            assert np.isfinite(want) and got == pytest.approx(want, rel=1e-9, abs=1e-6)


def test_derivatives_are_central_differences(states):
    x = states[0]
    by_state, by_theta = slopes(x, THETA)
    for got, base, step, seen in (
        (by_state, x, np.full(x.size, 1e-5), lambda v: observe(v, THETA)),
        (by_theta, THETA, 1e-6 * THETA, lambda v: observe(x, v)),
    ):
        for j, h in enumerate(step):
            away = np.zeros(base.size)
            away[j] = h
            want = (np.asarray(seen(base + away)) - np.asarray(seen(base - away))) / (2.0 * h)
            scale = 1.0 + np.abs(want).max()
            np.testing.assert_allclose(np.asarray(got)[:, j] / scale, want / scale, atol=1e-7)


CENTRED = replace(
    MODEL, base=replace(MODEL.base, capsule=replace(MODEL.base.capsule, attach_b=Vec3(0.0, 0.0, 0.0))), channels=("swing_angle",)
)  # fmt: skip


@jax.jit
def swing_and_slope(x):
    see = lambda v: CENTRED.observe(v, CENTRED.numbers(THETA), NOW)[0]  # noqa: E731
    return see(x), jax.grad(see)(x)


@pytest.mark.parametrize("off", [0.0, 1e-200, 1e-12, 1e-3, -1e-3])
def test_the_tip_of_the_swing_angle_has_a_finite_derivative(off):
    x = np.zeros(25)
    x[6] = 1.0
    x[13:19] = [off, off, 5.0, -5.0, -70.0, -70.0]  # both canopies 70 m above the attach point, moved north
    seen = abs(off) > 1e-100  # less has a square of zero
    swing, slope = swing_and_slope(x)
    assert float(swing) == pytest.approx(np.arctan2(abs(off), 70.0) if seen else 0.0, rel=1e-12)
    assert np.isfinite(np.asarray(slope)).all()
    assert float(slope[13] + slope[14]) * 70.0 == pytest.approx(np.sign(off) if seen else 0.0, rel=1e-6)


def test_an_unknown_channel_is_refused(states):
    model = replace(MODEL, channels=("canopy_position", "tension"))
    with pytest.raises(KeyError, match="'tension' is no channel"):
        model.observe(jnp.asarray(states[0]), model.numbers(jnp.asarray(THETA)), NOW)
    with pytest.raises(KeyError):
        channel_sizes(("tension",), 2)


def test_an_empty_name_replaces_nothing():
    idle = replace(MODEL, names=("riser_stiffness", "riser_length", "", "canopy_mass"))
    numbers = idle.numbers(jnp.asarray(THETA))
    assert float(numbers.capsule.mass) == small.CAPSULE.mass and float(numbers.canopies.dry_mass) == 140.0


def test_machine_code_gives_the_same_outputs_and_derivatives():
    pytest.importorskip("llvmlite")
    start, error = 0.02 * np.random.default_rng(2).normal(size=17), np.zeros((6, 3))
    assert kernel.why_not_compiled(MODEL, THETA, start, error) is None
    x = np.asarray(kernel.states(MODEL, THETA, start, error))
    y, _, steps = kernel.along_path(MODEL, THETA, start, error, kernel.states(MODEL, THETA, start, error))
    for t in range(6):
        by_state, by_theta = slopes(x[t], THETA)
        want = np.asarray(observe(x[t], THETA))
        np.testing.assert_allclose(y[t], want, rtol=1e-11, atol=1e-8)
        for got, exact in ((steps.out_state[t], by_state), (steps.out_theta[t], by_theta)):
            size = 1e-12 + np.abs(np.asarray(exact)).max(axis=1, keepdims=True)
            assert np.abs((np.asarray(got) - np.asarray(exact)) / size).max() < 1e-9


def test_a_scale_of_positions_changes_them_and_nothing_else():
    """Machine code, too: motion and other channels are the same, positions and their derivatives are as many times."""
    pytest.importorskip("llvmlite")
    scaled = replace(MODEL, names=(*NAMES, "canopy_position_scale"))
    start, error, by = 0.02 * np.random.default_rng(2).normal(size=17), np.zeros((6, 3)), 1.03
    states = np.asarray(kernel.states(MODEL, THETA, start, error))
    with_scale = np.array([*THETA, by])
    assert kernel.why_not_compiled(scaled, with_scale, start, error) is None
    np.testing.assert_array_equal(kernel.states(scaled, with_scale, start, error), states)
    y, _, steps = kernel.along_path(MODEL, THETA, start, error, states)
    got, _, scaled_steps = kernel.along_path(scaled, with_scale, start, error, states)
    factor = np.where(np.isin(np.arange(22), PLACES["canopy_position"]), by, 1.0)
    np.testing.assert_allclose(got, factor * y, rtol=1e-13)
    np.testing.assert_allclose(scaled_steps.out_state, factor[:, None] * np.asarray(steps.out_state), rtol=1e-12)
    slope = np.asarray(scaled_steps.out_theta)[..., -1]
    np.testing.assert_allclose(slope, np.where(factor == by, y, 0.0), rtol=1e-12)


def test_constant_errors_of_instruments_are_added_to_their_channels_and_to_nothing_else():
    """Of an attitude that was recorded turned against the true one nothing is left to be seen; machine code, too."""
    pytest.importorskip("llvmlite")
    names = [f"canopy_position_bias.{axis}" for axis in ("north", "east", "down")]
    names += [f"capsule_attitude_bias.{axis}" for axis in "yz"]
    off = np.array([0.5, -0.3, 0.2, 4e-3, -6e-3])
    wrong, with_errors = replace(MODEL, names=(*NAMES, *names)), np.array([*THETA, *off])
    start, error = 0.02 * np.random.default_rng(2).normal(size=17), np.zeros((6, 3))
    states = np.asarray(kernel.states(MODEL, THETA, start, error))
    np.testing.assert_array_equal(kernel.states(wrong, with_errors, start, error), states)
    y, _, _ = kernel.along_path(MODEL, THETA, start, error, states)
    assert kernel.why_not_compiled(wrong, with_errors, start, error) is None
    got, _, steps = kernel.along_path(wrong, with_errors, start, error, states)
    added = np.zeros(22)
    added[PLACES["canopy_position"]], added[PLACES["capsule_attitude"][1:]] = np.tile(off[:3], 2), off[3:]
    np.testing.assert_allclose(got - y, np.tile(added, (6, 1)), atol=1e-12)
    told = np.asarray(steps.out_theta)[0][:, -5:]
    np.testing.assert_allclose(told @ off, added, atol=1e-15)
    x = states[3].copy()
    turned = quaternion(x[6:10]).times(small_rotation(Vec3(0.0, *off[3:])))
    recorded = replace(NOW, attitude=np.array([turned.w, turned.x, turned.y, turned.z]))
    seen = wrong.observe(jnp.asarray(x), wrong.numbers(jnp.asarray(with_errors)), recorded)
    third = np.sum(off[3:] ** 2) ** 1.5 / 8.0  # small turns are right to third order
    np.testing.assert_allclose(np.asarray(seen)[PLACES["capsule_attitude"]], 0.0, atol=third)


def test_the_wind_that_is_met_is_the_recorded_one_less_its_constant_error():
    pytest.importorskip("llvmlite")
    start, error = 0.02 * np.random.default_rng(2).normal(size=17), np.zeros((6, 3))
    blown_off = replace(MODEL, names=(*NAMES, "wind_bias.north", "wind_bias.east"))
    blown_off = replace(blown_off, record=replace(MODEL.record, wind=MODEL.record.wind + np.array([2.0, -1.0, 0.0])))
    wrong = kernel.states(blown_off, np.array([*THETA, 2.0, -1.0]), start, error)
    np.testing.assert_allclose(wrong, kernel.states(MODEL, THETA, start, error), rtol=1e-12, atol=1e-12)
    field = wind_field(np.array([-100.0, 0.0, 100.0]), np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 0.0]]))
    x, none = jnp.asarray(np.asarray(wrong)[0]), jnp.zeros(3)
    numbers = blown_off.numbers(jnp.asarray([*THETA, 2.0, -1.0]))
    air = replace(blown_off, wind_field=field).air(x, numbers, NOW, NOW, none, none, 0.0)
    want = replace(MODEL, wind_field=field).air(x, MODEL.numbers(jnp.asarray(THETA)), NOW, NOW, none, none, 0.0)
    for one, other in ((air, want), (air.aloft, want.aloft)):
        less = [np.asarray(a - b) for a, b in zip(other.wind.stack(), one.wind.stack(), strict=True)]
        for got, by in zip(less, (2.0, -1.0, 0.0), strict=True):
            np.testing.assert_allclose(got, by, atol=1e-12)


EACH = replace(
    MODEL,
    names=("axial[1]", "axial[1].canopy2", "transverse[e].canopy1"),
    channels=("canopy_position", "riser_tension"),
)
OWN = np.array([0.9, 1.05, 0.2])


def test_a_canopy_may_have_a_coefficient_of_its_own():
    numbers = EACH.numbers(jnp.asarray(OWN))
    np.testing.assert_array_equal(numbers.axial[0], [0.9, 1.05])
    np.testing.assert_array_equal(numbers.transverse[0], [0.2, -0.1])
    batch = EACH.numbers(jnp.asarray(OWN)[:, None] + jnp.arange(3.0))
    np.testing.assert_allclose(batch.axial[0], [[0.9, 1.9, 2.9], [1.05, 2.05, 3.05]])
    np.testing.assert_array_equal(batch.transverse[0][1], [-0.1] * 3)


def test_canopies_with_equal_coefficients_are_equal_canopies(states):
    """And with unequal ones the other canopy alone is accelerated otherwise."""
    zero = jnp.zeros(3)
    air = air_between(NOW, NOW, zero, zero, 0.0, 0.1)
    shared = replace(EACH, names=("axial[1]", "", "transverse[e]"))

    def rate(model, theta):
        return np.asarray(state_rate(jnp.asarray(states[0]), model.numbers(jnp.asarray(theta)), FEW, air))

    common = rate(shared, [0.9, 0.0, -0.1])
    np.testing.assert_allclose(rate(EACH, [0.9, 0.9, -0.1]), common, rtol=1e-13)
    other = rate(EACH, [0.9, 1.1, -0.1]) != common
    assert np.flatnonzero(other).tolist() == [20, 22, 24]  # rate of the velocity of the second canopy: (axis, canopy)


@pytest.mark.parametrize("name", ["axial[1].canopy3", "axial[1].canopy0", "axial[q]", "axial[1]x", "axial"])
def test_there_is_no_such_parameter(name):
    with pytest.raises((KeyError, ValueError)):
        replace(EACH, names=(name,)).numbers(jnp.ones(1))


def test_machine_code_serves_canopies_with_coefficients_of_their_own():
    pytest.importorskip("llvmlite")
    start, error = 0.02 * np.random.default_rng(2).normal(size=17), np.zeros((6, 3))
    assert kernel.why_not_compiled(EACH, OWN, start, error) is None
    want = np.asarray(trajectory_compiled(EACH, OWN, start, error))
    np.testing.assert_allclose(kernel.states(EACH, OWN, start, error), want, rtol=1e-11, atol=1e-9)
    _, _, steps = kernel.along_path(EACH, OWN, start, error, kernel.states(EACH, OWN, start, error))
    by_theta = jax.jacfwd(lambda theta: EACH.advance(want[0], EACH.numbers(theta), NOW, NOW, error[0], error[0]))
    exact = np.asarray(by_theta(jnp.asarray(OWN)))
    size = 1e-12 + np.abs(exact).max(axis=1, keepdims=True)
    assert np.abs((np.asarray(steps.by_theta[0]) - exact) / size).max() < 1e-6


ROWS = np.random.default_rng(7).normal(size=(2, 10))  # errors of two samples: wind, axial factors, pushes, roll


def _air(rows, share=0.25):
    then = jax.tree.map(lambda a: a + 0.5, NOW)
    now_error, then_error = jnp.asarray(ROWS[:, :rows])
    return then, air_between(NOW, then, now_error, then_error, share, 0.1)


def test_rows_of_the_errors_are_wind_then_axial_factors_then_pushes_then_the_roll():
    then, air = _air(10)
    mixed = 0.75 * ROWS[0] + 0.25 * ROWS[1]
    np.testing.assert_allclose(air.wind.stack(), 0.75 * NOW.wind + 0.25 * then.wind + mixed[:3])
    np.testing.assert_allclose(air.axial_factor, 0.75 * NOW.axial_factor + 0.25 * then.axial_factor + mixed[3:5])
    north, east = air.push
    np.testing.assert_allclose([north, east], mixed[5:9].reshape(2, 2))
    np.testing.assert_allclose(air.roll, mixed[9])
    np.testing.assert_allclose(air.wind_rate.stack(), (then.wind + ROWS[1, :3] - NOW.wind - ROWS[0, :3]) / 0.1)
    for share, row in ((0.0, ROWS[0]), (1.0, ROWS[1])):
        np.testing.assert_allclose(jnp.stack(_air(10, share)[1].push).ravel(), row[5:9])
        np.testing.assert_allclose(_air(10, share)[1].roll, row[9])


@pytest.mark.parametrize("rows", [3, 5, 9])
def test_fewer_rows_are_less(rows):
    """Those that are there act as among all, and without the last there is no roll, then no push."""
    air, whole = _air(rows)[1], _air(10)[1]
    assert air.roll is None and (air.push is None) == (rows < 9)
    if rows == 9:
        np.testing.assert_array_equal(air.push, whole.push)
    np.testing.assert_array_equal(air.wind.stack(), whole.wind.stack())
    factor = whole.axial_factor if rows > 3 else 0.75 * NOW.axial_factor + 0.25 * (NOW.axial_factor + 0.5)
    np.testing.assert_allclose(air.axial_factor, factor)


def test_machine_code_serves_pushes_and_the_roll():
    """Trajectories are those of JAX, and the derivatives by pushes and roll those of differences."""
    pytest.importorskip("llvmlite")
    start, error = 0.02 * np.random.default_rng(2).normal(size=17), 0.05 * np.random.default_rng(3).normal(size=(6, 10))
    assert kernel.why_not_compiled(EACH, OWN, start, error) is None
    got = np.asarray(kernel.states(EACH, OWN, start, error))
    np.testing.assert_allclose(got, trajectory_compiled(EACH, OWN, start, error), rtol=1e-10, atol=1e-9)
    for rows in (np.arange(10) < 5, np.arange(10) < 9):
        assert np.abs(got - kernel.states(EACH, OWN, start, error * rows)).max() > 1e-4
    _, reached, steps = kernel.along_path(EACH, OWN, start, error, got)
    for row in range(5, 10):
        for by, sample in ((steps.by_now, 2), (steps.by_then, 3)):
            ends = []
            for h in (1e-3, -1e-3):
                moved = error.copy()
                moved[sample, row] += h
                ends.append(np.asarray(kernel.along_path(EACH, OWN, start, moved, got)[1].steps[2]))
            want = (ends[0] - ends[1]) / 2e-3
            np.testing.assert_allclose(by[2][:, row], want, atol=1e-6 * np.abs(want).max())
            assert np.abs(want).max() > 1e-3


def test_machine_code_holds_powers_of_the_angle():
    """Canopies below and beyond the angle: trajectories are those of JAX, and not those without it."""
    pytest.importorskip("llvmlite")
    shape = Structure(("1", "alpha^2"), ("e*alpha^2", "e*(e.rate)"), 2, saturation=0.02)
    base = replace(MODEL.base, axial=(0.0, 0.0), transverse=(0.0, 0.0))
    names = ("axial[1]", "axial[alpha^2]", "transverse[e*alpha^2]", "transverse[e*(e.rate)]")
    held = replace(EACH, base=base, structure=shape, names=names)
    start, error = 0.05 * np.random.default_rng(2).normal(size=17), np.zeros((6, 3))
    theta = np.array([0.9, -0.5, 3.0, 2.0])
    assert kernel.why_not_compiled(held, theta, start, error) is None
    got = np.asarray(kernel.states(held, theta, start, error))
    np.testing.assert_allclose(got, trajectory_compiled(held, theta, start, error), rtol=1e-10, atol=1e-9)
    free = replace(held, structure=replace(shape, saturation=None))
    assert np.abs(got - kernel.states(free, theta, start, error)).max() > 1e-6


def test_a_wind_field_leaves_push_and_roll(states):
    field = wind_field([-50.0, 0.0, 40.0], np.array([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [4.0, 1.0, 0.0]]))
    air = _air(10)[1]
    over = blown(air, field, unpack(jnp.asarray(states[0]), 2))
    assert over.aloft.push is air.push and over.roll is air.roll


def _risers(x):
    state = unpack(jnp.asarray(x).T, 2)
    made = geometry(state, MODEL.base.capsule)
    return np.asarray(made.length), np.asarray(made.stretch_rate)


def moved(x, step, change=None):
    """`x` a step away, the parameters by `change`, if any."""
    theta = jnp.asarray(THETA)
    return MODEL.retract(jnp.asarray(x), jnp.asarray(step), theta, 0.0 * theta if change is None else change)


def test_the_derivative_of_a_retraction_is_the_identity(states):
    """In every direction, also that in which the quaternion of the attitude becomes longer, whatever its size."""
    x = np.array(states)
    x[:, 6:10] *= np.array([1.0, 1.1, 0.9, 1.02, 0.98])[:, None]
    for away in (
        np.random.default_rng(10).standard_normal(x.shape),
        np.where(np.isin(np.arange(25), range(6, 10)), x, 0.0),
    ):
        there, moving = jax.jvp(lambda step: moved(x, step), (np.zeros_like(x),), (away,))
        np.testing.assert_allclose(there, x, atol=1e-12)
        np.testing.assert_allclose(moving, away, atol=1e-11)


def test_a_retracted_step_changes_the_size_of_a_quaternion_as_the_linear_one_says(states):
    x, step = np.array(states), np.random.default_rng(11).standard_normal((len(states), 25))
    x[:, 6:10] *= 1.1
    q = x[:, 6:10]
    size = np.linalg.norm(q, axis=1)
    there = np.asarray(moved(x, 0.1 * step))
    wanted = size + 0.1 * np.sum(q * step[:, 6:10], axis=1) / size
    np.testing.assert_allclose(np.linalg.norm(there[:, 6:10], axis=1), wanted, rtol=1e-12)


def test_a_retracted_step_is_the_step_to_first_order(states):
    """What is left falls with the square of the step; attitudes stay quaternions of length one."""
    x, step = np.array(states), np.random.default_rng(8).standard_normal((len(states), 25))
    q = x[:, 6:10] / np.linalg.norm(x[:, 6:10], axis=1, keepdims=True)
    x[:, 6:10] = q
    step[:, 6:10] -= q * np.sum(q * step[:, 6:10], axis=1, keepdims=True)
    left = []
    for size in (1e-2, 1e-3):
        there = np.asarray(moved(x, size * step))
        np.testing.assert_allclose(np.linalg.norm(there[:, 6:10], axis=1), 1.0, atol=1e-12)
        np.testing.assert_allclose(there[:, :6], x[:, :6] + size * step[:, :6], atol=1e-12)
        left.append(np.abs(there - x - size * step).max())
    assert 50.0 < left[0] / left[1] < 200.0


def test_a_retracted_step_changes_risers_as_the_linear_one_says(states):
    """Two metres sideways stretch a straight move by three centimetres, some 6 kN of a stiff riser."""
    x, step = np.array(states), np.zeros((len(states), 25))
    step[:, 13:19] = 2.0 * np.random.default_rng(9).standard_normal((len(states), 6))
    there = np.asarray(moved(x, step))
    h = 1e-6
    slopes = [(up - down) / (2.0 * h) for up, down in zip(_risers(x + h * step), _risers(x - h * step), strict=True)]
    for before, slope, after in zip(_risers(x), slopes, _risers(there), strict=True):
        np.testing.assert_allclose(after, before + slope, atol=1e-6)
    straight = _risers(x + step)[0] - _risers(x)[0] - slopes[0]
    assert np.abs(straight).max() > 0.01


def test_a_retracted_step_with_other_parameters_is_the_step_to_first_order(states):
    x, step = np.array(states), np.random.default_rng(12).standard_normal((len(states), 25))
    x[:, 6:10] /= np.linalg.norm(x[:, 6:10], axis=1, keepdims=True)
    change = jnp.array([0.4, 0.2, 50.0, 5.0])
    there, moving = jax.jvp(lambda h: moved(x, h * step, h * change), (0.0,), (1.0,))
    np.testing.assert_allclose(there, x, atol=1e-12)
    np.testing.assert_allclose(moving, step, atol=1e-10)
    both = (jnp.stack(pair, axis=-1) for pair in ([x, x], [step, 0.0 * step]))
    many = MODEL.retract(*both, THETA[:, None], jnp.stack([change, 0.0 * change], axis=1))
    np.testing.assert_allclose(many[..., 0], moved(x, step, change), atol=1e-10)
    np.testing.assert_allclose(many[..., 1], x, atol=1e-10)


def test_a_riser_of_other_stiffness_and_damping_keeps_its_tension(states):
    """Were its stretch led in a straight line it would lose 1.6 % of its load; a slack one is led so."""
    x, change = np.array(states), jnp.array([0.18, -0.3, 0.0, 0.0, 0.0])
    damped = replace(MODEL, names=("riser_stiffness", "riser_damping", *NAMES[1:]))
    theta = jnp.asarray(np.insert(THETA, 1, np.log(1.0e5)))
    x[0, 13:19:2] -= 2.0 * np.asarray(geometry(unpack(x[0, :, None], 2), MODEL.base.capsule).direction.stack())[:, 0, 0]
    length, rate = _risers(x)
    stretch, taut = length - THETA[1], length > THETA[1]
    assert taut.any() and not taut.all()
    along = geometry(unpack(jnp.asarray(x).T, 2), MODEL.base.capsule).direction.stack()
    step = np.zeros_like(x)
    for place, value, more in ((slice(13, 19), stretch, change[0]), (slice(19, 25), rate, change[1])):
        step[:, place] = np.reshape(-more * np.where(taut, value, 0.0) * along, (6, -1)).T
    there = _risers(damped.retract(jnp.asarray(x), jnp.asarray(step), theta, change))
    for before, after, more in zip((stretch, rate), (there[0] - THETA[1], there[1]), change[:2], strict=True):
        np.testing.assert_allclose(after, before * np.where(taut, np.exp(-more), 1.0), atol=1e-9)


def test_risers_without_damping_are_led_too(states):
    """Their stretch rate, which pulls nothing, in a straight line."""
    x, step = np.array(states), np.random.default_rng(13).standard_normal((len(states), 25))
    base = replace(MODEL.base, risers=replace(MODEL.base.risers, damping=0.0))
    there, moving = jax.jvp(
        lambda h: replace(MODEL, base=base).retract(jnp.asarray(x), h * step, jnp.asarray(THETA), h * jnp.ones(4)),
        (0.0,),
        (1.0,),
    )
    np.testing.assert_allclose(there, x, atol=1e-9)
    np.testing.assert_allclose(_risers(there + 1e-6 * moving)[1], _risers(x + 1e-6 * step)[1], atol=1e-9)
