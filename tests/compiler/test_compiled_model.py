"""Machine code against JAX: random clusters, both smaller models, failures, and what runs where there is none."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.twins import small_cluster as small

from bayeschute.aero.capsule_table import capsule_table
from bayeschute.atmosphere.wind_field import wind_field
from bayeschute.compiler import compiled_model as kernel
from bayeschute.compiler import programs
from bayeschute.compiler.integrate import (
    along_path,
    outputs,
    reached,
    trajectory,
    trajectory_compiled,
)
from bayeschute.core.vectors import Vec3
from bayeschute.dynamics.cluster import geometry, tension
from bayeschute.dynamics.descent import DensityProfile, DescentFlight, DescentInputs
from bayeschute.dynamics.parameters import Structure
from bayeschute.dynamics.state import unpack
from bayeschute.reduced.dumbbell import Dumbbell, DumbbellFlight, DumbbellInputs
from bayeschute.reduced.planar import PlanarAero

pytest.importorskip("llvmlite")

T, SUBSTEPS, BATCH = 26, 4, 13
RISERS = {"riser_stiffness": np.log(2.19e5), "riser_damping": np.log(1.46e5), "riser_length": 71.3}
BODIES = {"capsule_mass": 9463.0, "enclosed_air_factor": np.log(1.1)}
BODIES |= {"canopy_pitch_moment_slope": -0.1, "canopy_pitch_damping": -0.2, "capsule_normal_force_slope": 0.4}
AXIAL = {
    "1": 0.95,
    "alpha^2": -0.8,
    "alpha": 0.1,
    "q": 0.02,
    "proximity(0.8)": 0.1,
    "speed*alpha^2": 0.1,
    "restoring(20)": 0.3,
}
AXIAL |= {"closing": 0.01, "(e.rate)": 0.1, "(e.c)": 0.05, "(c.rate)": 0.05}
TRANSVERSE = {"e": -0.1, "angle": 0.2, "angle*alpha^2": 2.0, "rate": 0.3, "repulsion(0.8)": 0.3, "side*e": 0.02}
TRANSVERSE |= {"rate*q": 0.1, "c*closing": 0.01, "e*speed": 0.1}
CHANNELS = ("canopy_position", "capsule_velocity", "capsule_attitude", "riser_tension")


@dataclass(frozen=True)
class Case:
    """A flight and a batch of what drives it."""

    model: Any
    theta: np.ndarray
    start: np.ndarray
    error: np.ndarray

    def one(self, i: int = 0) -> tuple:
        return self.model, self.theta[:, i], self.start[:, i], self.error[..., i]


def cluster_case(n, rate, rng, terms=None):
    """Random terms, parameters in random order, wind, gusts and uneven canopies."""
    axial, transverse = terms or (
        ["1", *rng.choice(list(AXIAL)[1:], 3, replace=False)],
        ["e", "rate", *rng.choice([t for t in TRANSVERSE if t not in ("e", "rate")], 3, replace=False)],
    )
    axial, transverse = [str(t) for t in axial], [str(t) for t in transverse]
    structure = Structure(tuple(axial), tuple(transverse), n, rate)
    values = {f"axial[{t}]": AXIAL[t] for t in axial} | {f"transverse[{t}]": TRANSVERSE[t] for t in transverse}
    chosen = list(rng.permutation([*list(values)[:-1], *RISERS, *BODIES]))
    around = np.arange(n) * 2.0 * np.pi / n
    start = small.start([0.2 * np.cos(around) + 0.1, 0.2 * np.sin(around), np.full(n, -1.0)])
    base = small.cluster([AXIAL[t] for t in axial], [TRANSVERSE[t] for t in transverse])
    model = small.flight(base, start, structure, (3.0, -2.0, 0.5), samples=T, substeps=SUBSTEPS, names=tuple(chosen), channels=CHANNELS)  # fmt: skip
    wind = np.asarray(model.record.wind) + rng.normal(size=(T, 3))
    record = replace(model.record, wind=wind, density=1.1 + 0.01 * rng.random(T), axial_factor=1 + 0.05 * rng.normal(size=(T, n)))  # fmt: skip
    if rate == "airflow" and n > 1:
        angle, roll = np.linspace(0.0, np.pi, 7), np.arange(4) * np.pi / 2.0
        bump = np.sin(angle)[:, None] ** 2 * rng.normal(size=(7, 4))
        table = capsule_table(angle, roll, {"C_A": np.cos(angle)[:, None] + bump, "C_N": bump, "C_m": 0.1 * bump})
        capsule = replace(base.capsule, table=table, yaw_damping=-0.3, pitch_rate_damping=-0.1, yaw_rate_damping=-0.2)
        capsule = replace(capsule, products=Vec3(900.0, -700.0, 400.0))
        field = wind_field([-50.0, 0.0, 40.0, 90.0], rng.normal(size=(4, 3)))
        model = replace(model, base=replace(base, capsule=capsule), wind_field=field)
    centre = np.array([(values | RISERS | BODIES)[name] for name in chosen])
    theta = centre[:, None] * (1.0 + 0.02 * rng.normal(size=(centre.size, BATCH)))
    return Case(replace(model, record=record), theta, 0.02 * rng.normal(size=(9 + 4 * n, BATCH)), 0.2 * rng.normal(size=(T, 3 + n, BATCH)))  # fmt: skip


def descent_case(rng):
    air = DensityProfile(0.0, 100.0, np.log(1.2 * np.exp(-np.arange(41) * 100.0 / 8000.0)))
    model = DescentFlight(air, DescentInputs(rng.normal(size=T)), 3000.0, 12.0, 0.2)
    return Case(model, np.log(0.15) + 0.2 * rng.normal(size=(1, BATCH)), rng.normal(size=(1, BATCH)), rng.normal(size=(T, 1, BATCH)))  # fmt: skip


def dumbbell_case(rng):
    record = DumbbellInputs(rng.normal(size=(T, 2)), 1.1 + 0.01 * rng.random(T))
    base, aero = Dumbbell(9463.0, 75.0, small.CANOPIES), PlanarAero(0.8, 0.1, 0.19, 0.35, -0.1)
    model = DumbbellFlight(
        base, aero, np.array([0.0, 0.0, 1.0, 10.0, 0.2, 0.1]), record, 0.1, ("C_Nalpha", "capsule_mass")
    )
    theta = np.array([0.35, 9463.0])[:, None] * (1.0 + 0.05 * rng.normal(size=(2, BATCH)))
    return Case(model, theta, 0.1 * rng.normal(size=(4, BATCH)), 0.5 * rng.normal(size=(T, 2, BATCH)))


def reference(case):
    """States by plain Runge-Kutta steps about the model's own rate."""
    model, theta, error = case.model, jnp.asarray(case.theta), case.error
    widen = lambda tree: jax.tree.map(lambda a: jnp.reshape(a, (*jnp.shape(a), 1)), tree)  # noqa: E731
    rate = jax.jit(
        lambda x, now, then, e0, e1, s: model.rate(x, model.numbers(theta), widen(now), widen(then), e0, e1, s)
    )
    inputs = jax.tree.map(np.asarray, model.inputs())
    x = np.asarray(model.initial(model.numbers(theta), jnp.asarray(case.start)))
    h, found = float(model.dt) / model.stepping.substeps, [x]
    for t in range(T - 1):
        now, then = (jax.tree.map(lambda a, k=k: a[k], inputs) for k in (t, t + 1))
        for s in range(model.stepping.substeps):
            slope = lambda y, part, at=(now, then, error[t], error[t + 1]), s=s: np.asarray(  # noqa: E731
                rate(y, *at, (s + part) / model.stepping.substeps)
            )
            k1 = slope(x, 0.0)
            k2 = slope(x + 0.5 * h * k1, 0.5)
            k3 = slope(x + 0.5 * h * k2, 0.5)
            x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + slope(x + h * k3, 1.0))
        found.append(x)
    return np.stack(found)


def assert_close(got, want, share):
    """Every component within a share of its largest size along the flight."""
    got, want = np.asarray(got), np.asarray(want)
    assert got.shape == want.shape
    size = np.abs(want).max(axis=0, keepdims=True) + 1e-12 * (1.0 + np.abs(want).max())
    assert (np.abs(got - want) / size).max() < share


CASES = {
    f"{n} canopies, {rate}": lambda n=n, rate=rate: cluster_case(n, rate, np.random.default_rng(n))
    for n, rate in ((1, "riser"), (2, "riser"), (3, "riser"), (1, "airflow"), (2, "airflow"))
} | {
    "descent": lambda: descent_case(np.random.default_rng(7)),
    "dumbbell": lambda: dumbbell_case(np.random.default_rng(8)),
}


@pytest.fixture(scope="module", params=CASES)
def case(request):
    return CASES[request.param]()


@pytest.fixture(scope="module")
def descent():
    return descent_case(np.random.default_rng(7))


def test_trajectories_are_those_of_jax(case):
    assert kernel.why_not_compiled(case.model, case.theta, case.start, case.error) is None
    assert_close(kernel.states(case.model, case.theta, case.start, case.error), reference(case), 1e-10)


def test_every_flight_of_a_batch_is_the_single_flight(case):
    many = np.asarray(kernel.states(case.model, case.theta, case.start, case.error))
    for i in (0, 7, BATCH - 1):
        assert_close(kernel.states(*case.one(i)), many[..., i], 1e-10)


def test_outputs_of_paths_are_those_of_jax(case):
    path = np.asarray(kernel.states(case.model, case.theta, case.start, case.error))
    made = kernel.outputs(case.model, case.theta, path)
    assert_close(made, outputs(case.model, jnp.asarray(path), jnp.asarray(case.theta)), 1e-12)
    np.testing.assert_allclose(kernel.outputs(case.model, case.theta[:, 3], path[..., 3]), made[..., 3], atol=1e-12)
    while_traced = []
    jax.jit(lambda x: while_traced.append(kernel.outputs(case.model, case.theta, x)))(path)
    assert while_traced == [None]


def test_steps_from_a_path_are_those_of_jax(case):
    path = np.asarray(kernel.states(case.model, case.theta, case.start, case.error))
    path = path * (1.0 + 1e-3 * np.random.default_rng(5).normal(size=path.shape))
    got = kernel.reached(case.model, case.theta, case.start, case.error, path)
    want = reached(case.model, jnp.asarray(case.theta), jnp.asarray(case.start), jnp.asarray(case.error), path)
    assert_close(got.first[None], want.first[None], 1e-10)
    assert_close(got.steps, want.steps, 1e-10)
    one = kernel.reached(*case.one(), path[..., 0])
    assert_close(one.steps, np.asarray(want.steps)[..., 0], 1e-10)


@pytest.mark.parametrize("known", [1, 9, T])
def test_a_flight_goes_on_from_the_states_given(case, known):
    whole = np.asarray(kernel.states(case.model, case.theta, case.start, case.error))
    goes_on = kernel.states(case.model, case.theta, case.start, case.error, whole[:known])
    assert_close(goes_on, whole, 1e-12)
    given = 1.01 * whole[:known]
    got = np.asarray(kernel.states(case.model, case.theta, case.start, case.error, given))
    want = trajectory(case.model, jnp.asarray(case.theta), jnp.asarray(case.start), jnp.asarray(case.error), given)
    assert np.array_equal(got[:known], given)
    assert_close(got, want, 1e-9)


@pytest.mark.parametrize("count", [1, 2, 8, 9])
def test_batch_of_any_size(descent, count):
    whole = np.asarray(kernel.states(descent.model, descent.theta, descent.start, descent.error))
    given = descent.theta[:, :count], descent.start[:, :count], descent.error[..., :count]
    assert_close(kernel.states(descent.model, *given), whole[..., :count], 1e-13)


def test_derivatives_are_differences_of_flights(case):
    """Of the last state by parameters, start and disturbances: products of the derivatives of the steps."""
    model, theta, start, error = case.one()
    _, _, steps = kernel.along_path(model, theta, start, error, kernel.states(model, theta, start, error))
    direction = np.random.default_rng(3).normal(size=theta.size + start.size + error.size)
    scale = np.concatenate([np.abs(theta) * 1e-2, np.full(start.size, 1e-2), np.full(error.size, 1e-1)])
    by_theta, by_start, by_error = np.split(direction * scale, [theta.size, theta.size + start.size])
    by_error = by_error.reshape(error.shape)
    tangent = np.asarray(steps.first_theta) @ by_theta + np.asarray(steps.first_start) @ by_start
    parts = (steps.by_state, steps.by_theta, steps.by_now, steps.by_then, by_error[:-1], by_error[1:])
    for a, b, c0, c1, e0, e1 in zip(*map(np.asarray, parts), strict=True):
        tangent = a @ tangent + b @ by_theta + c0 @ e0 + c1 @ e1
    h = 1e-3 * np.array([1.0, -1.0, 0.5, -0.5])
    moved = (v[..., None] + d[..., None] * h for v, d in ((theta, by_theta), (start, by_start), (error, by_error)))
    last = np.asarray(kernel.states(model, *moved))[-1]
    wide, narrow = (last[:, 0] - last[:, 1]) / 2e-3, (last[:, 2] - last[:, 3]) / 1e-3
    want = narrow + (narrow - wide) / 3.0  # Richardson
    assert (np.abs(tangent - want) < 1e-6 * np.abs(want).max() * 1.0 + 1e-9 * np.abs(last).max()).all()


@pytest.mark.parametrize("name", ["descent", "dumbbell"])
def test_along_any_path_outputs_steps_and_their_ends_are_those_of_jax(name):
    """A path that obeys no equation of motion."""
    model, theta, start, error = CASES[name]().one()
    path = np.asarray(kernel.states(model, theta, start, error))
    path = path * (1.0 + 0.1 * np.random.default_rng(4).normal(size=path.shape))
    y, reached, steps = kernel.along_path(model, theta, start, error, path)
    y_jax, reached_jax, steps_jax = jax.jit(along_path)(model, theta, start, error, path)
    assert_close(y, y_jax, 1e-11)
    assert_close(reached.steps, reached_jax.steps, 1e-11)
    np.testing.assert_allclose(reached.first, reached_jax.first, rtol=1e-12)
    assert np.abs(np.asarray(reached.steps) - path[1:]).max() > 0.01 * np.abs(path).max()
    for field, got, want in zip(steps._fields, steps, steps_jax, strict=True):
        assert got.shape == want.shape, field
        assert np.abs(np.asarray(got) - want).max() < 1e-9 * (np.abs(want).max() + 1e-12), field


def test_along_its_own_path_a_flight_gets_where_it_gets(case):
    model, theta, start, error = case.one()
    path = np.asarray(kernel.states(model, theta, start, error))
    _, reached, _ = kernel.along_path(model, theta, start, error, path)
    np.testing.assert_allclose(reached.first, path[0], rtol=1e-12, atol=1e-12)
    assert_close(reached.steps, path[1:], 1e-12)


def test_every_step_along_a_path_is_its_own(case):
    """A path of two flights in turn: each step and output is that of the flight whose state it leaves from."""
    model, theta, start, error = case.one()
    paths = [np.asarray(kernel.states(model, theta, s * start, error)) for s in (1.0, -2.0)]
    turns = np.arange(T)[:, None] % 3 == 1
    mixed = kernel.along_path(model, theta, start, error, np.where(turns, *reversed(paths)))
    alone = [kernel.along_path(model, theta, start, error, path) for path in paths]
    assert np.abs(paths[0] - paths[1]).max() > 1e-3

    def check(got, one, other):
        first, second = np.asarray(one), np.asarray(other)
        rows = turns[: len(first)].reshape(-1, *(1,) * (first.ndim - 1))
        np.testing.assert_array_equal(got, np.where(rows, second, first))

    by_sample = ("by_state", "by_theta", "by_now", "by_then", "out_state", "out_theta")
    check(mixed[0], *(made[0] for made in alone))
    check(mixed[1].steps, *(made[1].steps for made in alone))
    for name in by_sample:
        check(getattr(mixed[2], name), *(getattr(made[2], name) for made in alone))


def test_risers_go_slack_and_taut_alike():
    case = cluster_case(2, "riser", np.random.default_rng(5), (("1", "alpha^2"), ("e", "rate", "repulsion(0.8)")))
    gust = case.error.copy()
    gust[8:10, 2] += 25.0  # a blow from above lets the risers go slack, then they snap taut
    case = replace(case, error=gust)
    x = np.asarray(kernel.states(case.model, case.theta, case.start, gust))
    numbers = case.model.numbers(case.theta)
    pulls = [tension(geometry(unpack(jnp.asarray(s), 2), numbers.capsule), numbers.risers) for s in x]
    slack = np.asarray(pulls) == 0.0
    assert slack.any() and not slack[0].any() and not slack[-1].any()
    assert_close(x, reference(case), 1e-9)


def test_failures_stay_in_their_lane_and_are_those_of_jax(descent):
    theta, error = descent.theta.copy(), descent.error.copy()
    whole = np.asarray(kernel.states(descent.model, theta, descent.start, error))
    theta[0, 2], theta[0, 4], error[9, 0, 11] = np.nan, 60.0, np.inf  # 60: a step far beyond stability
    got = np.asarray(kernel.states(descent.model, theta, descent.start, error))
    want = np.asarray(trajectory_compiled(descent.model, theta, descent.start, error))
    np.testing.assert_array_equal(np.isfinite(got), np.isfinite(want))
    broken = ~np.isfinite(want).all(axis=(0, 1))
    assert set(np.flatnonzero(broken)) == {2, 4, 11}
    np.testing.assert_array_equal(got[..., ~broken], whole[..., ~broken])


def test_without_llvmlite_jax_serves(descent, monkeypatch):
    monkeypatch.setattr(programs, "available", lambda: False)
    given = descent.model, descent.theta, descent.start, descent.error
    assert "llvmlite is not installed" in kernel.why_not_compiled(*given)
    assert kernel.states(*given) is None
    assert kernel.along_path(*descent.one(), np.zeros((T, 1))) is None


def test_traced_calls_and_odd_batches_are_left_to_jax(descent):
    given = descent.theta, descent.start, descent.error
    told = []
    jax.jit(lambda *a: told.append(kernel.why_not_compiled(descent.model, *a)) or 0.0)(*given)
    assert told == ["the call is traced"]
    assert "batch axis" in kernel.why_not_compiled(descent.model, descent.theta, descent.start[:, :1], descent.error)
    assert "batch axis" in kernel.why_not_compiled(descent.model, *(a[..., None] for a in given))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Summed(DescentFlight):
    """A descent with an operation that has no scalar form."""

    def rate(self, x, numbers, now, then, error_now, error_then, share):
        return jnp.cumsum(super().rate(x, numbers, now, then, error_now, error_then, share))


def test_models_without_a_form_are_named(descent):
    model = descent.model
    summed = Summed(model.air, model.record, model.altitude, model.speed, model.dt)
    assert kernel.why_not_compiled(summed, *descent.one()[1:]) == "no scalar form of cumsum"

    class Plain:
        pass

    assert kernel.why_not_compiled(Plain(), *descent.one()[1:]) == "Plain has no method 'rate'"
