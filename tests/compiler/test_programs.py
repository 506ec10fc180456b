"""Programs of a small model in closed form, and which models share them, or have none."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.compiler import programs
from bayeschute.compiler.compiled_model import states
from bayeschute.compiler.machine import aligned
from bayeschute.compiler.programs import LANES, Compiled, Programs, opening, programs_of
from bayeschute.compiler.runge_kutta import EXTENDED, Stepping

pytest.importorskip("llvmlite")


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Ramp:
    """A state that grows at a constant speed by parameter, drive and disturbance, and one that stays."""

    drive: Any  # (T, 2)
    scale: Any
    table: Any  # (3,)
    dt = 0.4
    stepping: Stepping = field(default=Stepping(2), metadata={"static": True})

    def inputs(self):
        return self.drive

    def numbers(self, theta):
        return {"a": theta[0], "b": theta[1]}

    def initial(self, numbers, start):
        return jnp.stack([numbers["a"] + 2.0 * start[0] + self.drive[0, 1], numbers["b"] * start[1] * self.table[2]])

    def rate(self, x, numbers, now, then, error_now, error_then, share):
        speed = self.scale * numbers["a"] + now[0] + 10.0 * then[1] + 100.0 * error_now[0] + 1000.0 * error_then[0]
        return jnp.stack([speed + 0.0 * x[1], numbers["b"] * share])

    def observe(self, x, numbers, now):
        return jnp.stack([x[0] * x[1], numbers["b"] * x[0] + now[1], self.table[0] + x[1] ** 2])


RAMP = Ramp(np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]), 0.5, np.array([7.0, 8.0, 9.0]))
THETA, START, ERROR = np.array([0.3, -0.7]), np.array([1.5, 2.5]), np.array([[0.1], [0.2], [0.3]])
SIZES = THETA, START, ERROR
FIRST = [0.3 + 2.0 * 1.5 + 2.0, -0.7 * 2.5 * 9.0]


@pytest.fixture
def fresh(monkeypatch):
    """No programs known yet."""
    monkeypatch.setattr(programs, "_known", {})


@pytest.fixture(scope="module")
def made():
    found = programs_of(RAMP, *SIZES)
    assert isinstance(found, Programs)
    return found


def test_sizes_are_those_of_the_model(made):
    """Leaves of the model that nobody reads have no place: of the first state's, the scale; of the rate's, all else."""
    assert [len(one.result) for one in (made.first, made.rate, made.outputs)] == [2, 2, 3]
    assert made.first.rows == {"shared": 5, "theta": 2, "start": 2} and made.first.read == [0, 2]
    sizes = {"theta": 2, "x": 2, "now": 2, "then": 2, "error_now": 1, "error_then": 1, "share": 1}
    assert made.rate.rows == {"shared": 1} | sizes and made.rate.read == [1]
    assert made.outputs.rows == {"shared": 3, "theta": 2, "x": 2, "now": 2} and made.outputs.read == [2]


def first_given():
    return np.array([1.0, 2.0, 7.0, 8.0, 9.0])  # drive at the first sample, table


@pytest.mark.parametrize("lanes", [1, LANES])
def test_first_states_side_by_side(made, lanes):
    begin, values = made.begin(lanes), aligned(lanes, 2)
    theta, start = np.outer(THETA, np.linspace(1.0, 2.0, lanes)), np.outer(START, np.linspace(1.0, 0.5, lanes))
    begin.call(first_given(), theta, start, values, aligned(begin.scratch), lanes, 0, 1)
    np.testing.assert_allclose(values[:, 0], theta[0] + 2.0 * start[0] + 2.0, rtol=1e-14)
    np.testing.assert_allclose(values[:, 1], theta[1] * start[1] * 9.0, rtol=1e-14)


def test_slopes_of_the_first_state(made):
    """Of one flight: nothing is written for others."""
    slopes, (values, by_theta, by_start) = made.begin_slopes(), (aligned(2, *shape) for shape in ((2,), (2, 2), (2, 2)))
    slopes.call(first_given(), THETA, START, values, by_theta, by_start, aligned(slopes.scratch), 1, 0, 1)
    np.testing.assert_allclose(values[0], FIRST, rtol=1e-14)
    np.testing.assert_allclose(by_theta[0], [[1.0, 0.0], [0.0, 2.5 * 9.0]], rtol=1e-14)
    np.testing.assert_allclose(by_start[0], [[2.0, 0.0], [0.0, -0.7 * 9.0]], rtol=1e-14)
    assert not values[1].any() and not by_theta[1].any() and not by_start[1].any()


def wanted_states():
    """The steps last 0.2: speed by what is at both ends of a sample, b / 2 on average by the share."""
    drive, x = RAMP.drive, [FIRST]
    for t in (0, 1):
        speed = 0.5 * 0.3 + drive[t, 0] + 10.0 * drive[t + 1, 1] + 100.0 * ERROR[t, 0] + 1000.0 * ERROR[t + 1, 0]
        x.append([x[-1][0] + 0.4 * speed, x[-1][1] + 0.4 * -0.7 * 0.5])
    return np.array(x)


@pytest.mark.parametrize("lanes", [1, LANES])
def test_simulation(made, lanes):
    simulate, states = made.simulate(lanes), aligned(3, 2, lanes)
    wide = [np.repeat(a[..., None], lanes, axis=-1) for a in (THETA, ERROR, np.array([FIRST]))]
    given = np.array([0.5]), wide[0], RAMP.drive, wide[1], RAMP.stepping.plan(0.4), wide[2], states
    simulate.call(*given, aligned(simulate.scratch), 3, lanes, 0, 1, 2, 4, 1)
    np.testing.assert_allclose(states[1:], np.repeat(wanted_states()[1:, :, None], lanes, axis=2), rtol=1e-13)


def test_outputs_and_their_slopes(made):
    observe = made.observe()
    y, by_x, by_theta = aligned(LANES, 3), aligned(LANES, 3, 2), aligned(LANES, 3, 2)
    rng = np.random.default_rng(0)
    x, now = rng.normal(size=(2, LANES)), rng.normal(size=(2, LANES))
    observe.call(RAMP.table, THETA, x, now, y, by_x, by_theta, aligned(observe.scratch), LANES, 0, 1)
    zero, b = np.zeros(LANES), np.full(LANES, -0.7)
    np.testing.assert_allclose(y.T, [x[0] * x[1], -0.7 * x[0] + now[1], 7.0 + x[1] ** 2], rtol=1e-13, atol=1e-14)
    want = [[x[1], x[0]], [b, zero], [zero, 2.0 * x[1]]]
    np.testing.assert_allclose(np.moveaxis(by_x, 0, 2), want, rtol=1e-14)
    np.testing.assert_allclose(np.moveaxis(by_theta, 0, 2), [[zero, zero], [zero, x[0]], [zero, zero]], rtol=1e-14)


def test_tangents(made):
    """By parameters, disturbances at both samples and the state, in eight columns of one block."""
    differentiate = made.differentiate(("theta", "error_now", "error_then"))
    stride = 2 * LANES
    record, error, states = (aligned(rows, stride) for rows in (2, 1, 2))
    record[:, :3], error[:, :3], states[:, :3] = RAMP.drive.T, ERROR.T, wanted_states().T
    source, out, reached = aligned(1, 2, LANES), aligned(LANES, 2, LANES), aligned(2, stride)
    source[0, :, 4:6] = np.eye(2)
    memory = aligned(differentiate.table * 2 * 4), aligned(differentiate.scratch)
    given = np.array([0.5]), THETA, record, error, RAMP.stepping.plan(0.4), states, source, out, reached
    differentiate.call(*given, *memory, stride, 0, 1, 2, 4, 0, 1)
    np.testing.assert_allclose(reached[:, :2], wanted_states()[1:].T, rtol=1e-13)
    slopes = [[0.4 * 0.5, 0.0, 40.0, 400.0, 1.0, 0.0], [0.0, 0.4 * 0.5, 0.0, 0.0, 0.0, 1.0]]
    np.testing.assert_allclose(out[0, :, :6], slopes, rtol=1e-13, atol=1e-15)


def test_programs_say_what_memory_they_need(made):
    """A table only those that carry tangents, by Runge-Kutta stage."""
    one, none = made.differentiate(("theta",)), made.differentiate(())
    assert one.table > 0 and one.table % LANES == 0 and none.table % LANES == 0
    assert made.observe().table == made.simulate(1).table == made.begin(1).table == 0
    assert made.simulate(LANES).scratch >= LANES * made.simulate(1).scratch > 0
    assert all(isinstance(each, Compiled) for each in (one, none))


def test_every_program_is_made_once(monkeypatch, fresh):
    found = programs_of(RAMP, *SIZES)
    count, compile_ = [], programs.compiled
    monkeypatch.setattr(programs, "compiled", lambda *given, **more: count.append(more) or compile_(*given, **more))
    asked = [
        lambda: found.simulate(1), lambda: found.simulate(LANES), lambda: found.begin(1), lambda: found.begin(LANES),
        lambda: found.observe(), lambda: found.begin_slopes(), lambda: found.differentiate(["theta"]),
        lambda: found.differentiate(["error_now"]),
    ]  # fmt: skip
    first = [one() for one in asked]
    assert [one() for one in asked] == first and len(count) == len(asked) == len({id(one.call) for one in first})
    assert [one.get("tuned", False) for one in count] == [True] + [False] * 7  # what flies alone is worth the time


def test_making_a_program_leaves_the_expressions_as_they_are(fresh):
    """Derivatives grow a copy of the graph, as they must: it is shared."""
    found = programs_of(RAMP, *SIZES)
    before = [len(one.graph.nodes) for one in (found.rate, found.outputs, found.first)]
    found.differentiate(("theta",)), found.observe(), found.begin_slopes(), found.simulate(1)
    assert [len(one.graph.nodes) for one in (found.rate, found.outputs, found.first)] == before


def test_models_of_one_kind_share_their_programs(fresh):
    """Whatever their numbers; not models of other sizes, nor calls of other sizes."""
    found = programs_of(RAMP, *SIZES)
    other = replace(RAMP, drive=2.0 * RAMP.drive, scale=3.0, table=RAMP.table - 1.0)
    assert programs_of(other, 2.0 * THETA, START + 1.0, ERROR[:, :1] * 0.0) is found
    assert programs_of(RAMP, np.stack([THETA] * 4, axis=1), START[:, None], ERROR[..., None]) is found
    longer = replace(RAMP, table=np.arange(4.0))
    others = [
        programs_of(longer, *SIZES), programs_of(RAMP, np.arange(3.0), START, ERROR),
        programs_of(RAMP, THETA, np.arange(3.0), ERROR), programs_of(RAMP, THETA, START, np.zeros((3, 2))),
    ]  # fmt: skip
    assert len({id(one) for one in (found, *others)}) == 5 and len(programs._known) == 5


def test_records_of_any_length_share_their_programs(made):
    """And give what the longer one gives as far as both go; steps of any number and method too."""
    short = replace(RAMP, drive=RAMP.drive[:2])
    assert programs_of(replace(RAMP, stepping=Stepping(3, EXTENDED)), *SIZES) is made
    assert programs_of(short, THETA, START, ERROR[:2]) is made
    assert programs.observed(short, 2, 2) is programs.observed(RAMP, 2, 2)
    np.testing.assert_allclose(states(short, THETA, START, ERROR[:2]), wanted_states()[:2], rtol=1e-13)
    np.testing.assert_allclose(states(RAMP, THETA, START, ERROR), wanted_states(), rtol=1e-13)


def test_a_model_whose_rate_reads_inputs_of_other_samples_has_no_programs(fresh):
    """They would be those of whatever record came first."""

    @jax.tree_util.register_dataclass
    @dataclass(frozen=True)
    class Ahead(Ramp):
        def rate(self, x, numbers, *given):
            return super().rate(x, numbers, *given) + self.drive[-1, 0]

    assert programs_of(Ahead(RAMP.drive, RAMP.scale, RAMP.table), *SIZES) == "no scalar form of inputs of other samples"


def test_models_of_two_classes_with_the_same_fields_do_not_share():
    @jax.tree_util.register_dataclass
    @dataclass(frozen=True)
    class Other(Ramp):
        def observe(self, x, numbers, now):
            return -super().observe(x, numbers, now)

    other = Other(RAMP.drive, RAMP.scale, RAMP.table)
    assert programs_of(other, *SIZES) is not programs_of(RAMP, *SIZES)


def test_threads_that_ask_at_once_get_the_same(fresh):
    found = []
    threads = [threading.Thread(target=lambda: found.append(programs_of(RAMP, *SIZES).simulate(1))) for _ in range(4)]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    assert len(found) == 4 and len({id(one) for one in found}) == 1


def test_an_opening_has_the_first_inputs_and_all_else():
    cut = opening(RAMP)
    np.testing.assert_array_equal(cut.drive, [[1.0, 2.0]])
    assert cut.scale == RAMP.scale and cut.table is RAMP.table


def test_there_are_reasons_for_no_programs(fresh, monkeypatch):
    class Plain:
        pass

    @jax.tree_util.register_dataclass
    @dataclass(frozen=True)
    class Sorted(Ramp):
        def observe(self, x, numbers, now):
            return jnp.sort(x)

    assert programs_of(Plain(), *SIZES) == "Plain has no method 'rate'"
    assert programs_of(Sorted(RAMP.drive, RAMP.scale, RAMP.table), *SIZES) == "no scalar form of sort"
    monkeypatch.setattr(jax, "default_backend", lambda: "tpu")
    assert programs_of(RAMP, *SIZES) == "JAX computes on tpu"
    monkeypatch.setattr(programs, "available", lambda: False)
    assert programs_of(RAMP, *SIZES) == "llvmlite is not installed"
