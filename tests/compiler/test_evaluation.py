"""Machine code of single operations against NumPy on all lanes, corners included; derivatives in closed form."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.compiler import machine
from bayeschute.compiler.evaluation import by_sample, evaluation
from bayeschute.compiler.graph import Graph

pytest.importorskip("llvmlite")

BLOCKS = 2
CORNERS = [0.0, -0.0, 1.0, -1.0, 0.5, -2.5, 1e300, -1e300, np.inf, -np.inf, np.nan, 3.7, 1e-300, 7.0, -7.9, 2.0]


def operations(g):
    """Nodes of every operation of two numbers and of a table that all lanes share."""
    a, b = g.input("x", 0), g.input("x", 1)
    ordered, same = g.apply("lt", a, b), g.apply("eq", a, b)
    flags = [ordered, same, g.apply("le", a, b), g.apply("ne", a, b)]
    flags += [g.apply(op, ordered, same) for op in ("and", "or", "xor")] + [g.apply("not", ordered)]
    flags += [g.apply("eq", ordered, same), g.apply("ne", ordered, same)]
    inside = g.apply("min", g.apply("max", g.apply("to_integer", a), g.constant(0)), g.constant(3))
    numbers = [g.apply(op, a, b) for op in ("add", "sub", "mul", "div", "max", "min", "copysign")]
    numbers += [g.apply(op, a, g.constant(0.7)) for op in ("max", "min")]
    numbers += [g.apply(op, a) for op in ("neg", "abs", "floor", "sqrt")]
    numbers += [g.apply("select", ordered, a, b), g.apply("to_float", inside), g.lookup("shared", 1, inside)]
    numbers += [g.apply("power_of_two", g.apply("sub", inside, g.constant(2))), g.apply("mul", a, g.input("shared", 4))]
    return [*numbers, *(g.apply("to_float", flag) for flag in flags)]


def run(g, results, lanes, by=(), x=None, blocks=(0, BLOCKS), table=None):
    rows = {"shared": 5, "x": 2}
    program = evaluation(g, results, rows, ("x",), by, lanes)
    stride = lanes * BLOCKS
    inputs, values = machine.aligned(2, stride), machine.aligned(stride, len(results))
    inputs[:] = x
    held = machine.aligned(5)
    held[:] = table
    slopes = [machine.aligned(stride, len(results), rows[group]) for group in by]
    machine.compiled(program)(held, inputs, values, *slopes, machine.aligned(max(program.scratch, 1)), stride, *blocks)
    return values, slopes


@pytest.mark.parametrize("lanes", [1, 8])
def test_every_operation_is_that_of_numpy(lanes):
    g, rng = Graph(), np.random.default_rng(lanes)
    results, table = operations(g), np.array([9.0, 3.0, -1.0, 4.0, 1.5])
    for _ in range(16):
        x = rng.choice(CORNERS, (2, lanes * BLOCKS))
        values, _ = run(g, results, lanes, x=x, table=table)
        for lane in range(lanes * BLOCKS):
            np.testing.assert_array_equal(values[lane], plain(*x[:, lane], table), err_msg=str(x[:, lane]))


def plain(a, b, table):
    """The same in NumPy: whole parts beyond what an integer holds saturate, that of NaN is zero."""
    whole = int(np.clip(0.0 if np.isnan(a) else np.trunc(np.clip(a, -1e9, 1e9)), 0, 3))
    flags = [a < b, a == b, a <= b, a != b]
    flags += [flags[0] & flags[1], flags[0] | flags[1], flags[0] ^ flags[1], not flags[0]]
    flags += [flags[0] == flags[1], flags[0] != flags[1]]
    with np.errstate(all="ignore"):
        numbers = [a + b, a - b, a * b, np.divide(a, b), np.maximum(a, b), np.minimum(a, b), np.copysign(a, b)]
        numbers += [np.maximum(a, 0.7), np.minimum(a, 0.7), -a, abs(a), np.floor(a), np.sqrt(a), a if a < b else b]
    numbers += [whole, table[1 + whole], 2.0 ** (whole - 2), a * table[4]]
    return np.array([*numbers, *map(float, flags)])


def test_only_the_blocks_that_are_asked_for_are_touched():
    g = Graph()
    values, _ = run(
        g, [g.apply("add", g.input("x", 0), g.constant(1.0))], 8, x=np.ones((2, 16)), blocks=(1, 2), table=0.0
    )
    np.testing.assert_array_equal(values[:, 0], [0.0] * 8 + [2.0] * 8)


@pytest.mark.parametrize("lanes", [1, 8])
def test_derivatives_stand_at_their_lane_result_and_row(lanes):
    """Of x0 x1^2 + t4 and t2 x0: by a group that varies and by one that all lanes share."""
    g, rng = Graph(), np.random.default_rng(3)
    a, b, t = g.input("x", 0), g.input("x", 1), g.input("shared", 2)
    results = [g.apply("add", g.apply("mul", a, g.apply("mul", b, b)), g.input("shared", 4)), g.apply("mul", t, a)]
    x, table = rng.normal(size=(2, lanes * BLOCKS)), np.array([0.0, 0.0, 3.0, 0.0, 5.0])
    values, (by_x, by_table) = run(g, results, lanes, ("x", "shared"), x, table=table)
    np.testing.assert_allclose(values, np.stack([x[0] * x[1] ** 2 + 5.0, 3.0 * x[0]], axis=1), rtol=1e-14)
    want = np.array([[x[1] ** 2, 2.0 * x[0] * x[1]], [np.full_like(x[0], 3.0), np.zeros_like(x[0])]])
    np.testing.assert_allclose(by_x, np.moveaxis(want, 2, 0), rtol=1e-14)
    assert np.flatnonzero(by_table.any(axis=0)).tolist() == [4, 7]
    np.testing.assert_array_equal(by_table[:, 0, 4], 1.0)
    np.testing.assert_array_equal(by_table[:, 1, 2], x[0])


def of_a_sample(shared, x, theta, change):
    """Reads every group; a comparison of what all samples share decides in each of them."""
    grown = jnp.where(theta[0] > 0.0, x[0] * theta[0], x[0] / change[0])
    return jnp.stack([grown + shared["offset"][1], jnp.sin(x[1]) * shared["offset"][0], jnp.maximum(x[0], x[1])])


def of_all_samples(shared, x, theta, change):
    grown = np.where(theta[0] > 0.0, x[:, 0] * theta[0], x[:, 0] / change[0])
    rest = np.sin(x[:, 1]) * shared["offset"][0], np.maximum(x[:, 0], x[:, 1])
    return np.stack([grown + shared["offset"][1], *rest], axis=1)


@pytest.mark.parametrize("flights", [(), (1,), (8,), (13,)])
@pytest.mark.parametrize("wide", [("x",), ("theta",), ("x", "theta", "change")])
def test_samples_of_one_flight_and_of_many_are_those_of_numpy(flights, wide):
    rng, shared, samples = np.random.default_rng(len(wide)), {"offset": np.array([2.0, -1.0])}, 11
    shapes = {"x": (samples, 2), "theta": (1,), "change": (1,)}
    given = {name: rng.normal(size=shape + (flights if name in wide else ())) for name, shape in shapes.items()}
    made = by_sample("test", of_a_sample, shared, given, ("x",))
    spread = {
        name: a if name in wide or not flights else np.broadcast_to(a[..., None], (*a.shape, *flights))
        for name, a in given.items()
    }
    np.testing.assert_allclose(made, of_all_samples(shared, *spread.values()), rtol=1e-14)


def test_functions_of_samples_that_are_traced_or_have_no_scalar_form_are_left_to_jax():
    given = {"x": np.ones((3, 2)), "theta": np.ones(1), "change": np.ones(1)}
    shared, left = {"offset": np.ones(2)}, []
    jax.jit(lambda x: left.append(by_sample("test", of_a_sample, shared, {**given, "x": x}, ("x",))))(given["x"])
    assert left == [None]
    assert by_sample("sorted", lambda shared, x: jnp.sort(x), shared, {"x": given["x"]}, ("x",)) is None
