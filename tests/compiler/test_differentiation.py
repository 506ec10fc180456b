"""Tangents along a known flight against JAX's derivatives of plain Runge-Kutta steps; what the table holds."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.compiler.differentiation import Slopes, differentiation
from bayeschute.compiler.graph import Graph
from bayeschute.compiler.machine import aligned, compiled
from bayeschute.compiler.runge_kutta import Stepping
from bayeschute.compiler.trace import trace

pytest.importorskip("llvmlite")

GROUPS = ("shared", "theta", "x", "now", "then", "error_now", "error_then", "share")
DRIVEN = ("theta", "error_now", "error_then")
SIZES = {"shared": 2, "theta": 3, "x": 5, "now": 2, "then": 2, "error_now": 2, "error_then": 2, "share": 1}
H, SUBSTEPS = 0.2, 3


def rate(shared, theta, x, now, then, e0, e1, share):
    """Slopes that vary, that are constants, that are one, and none at all; inputs to some of the states."""
    wind = now[0] + share * (then[0] - now[0])
    gust = e0 + share * (e1 - e0)
    return jnp.stack([
        jnp.sin(x[1]) * theta[0] + gust[0] * x[0],
        0.5 * x[0] - shared[1] * x[1] * x[2] + theta[2] * gust[1],
        x[0],
        wind * shared[0] + share,
        theta[1] ** 2 * then[1] - x[3] + jnp.where(x[4] > 0.0, x[4] * x[4], 0.0),
    ])  # fmt: skip


def traced():
    return trace(rate, [np.zeros(SIZES[group]) for group in GROUPS[:-1]] + [0.0], GROUPS)


@jax.jit
def step(x, shared, theta, now, then, e0, e1):
    """From a sample to the next one, by the textbook."""
    for s in range(SUBSTEPS):
        slope = lambda y, part, s=s: rate(shared, theta, y, now, then, e0, e1, (s + part) / SUBSTEPS)  # noqa: E731
        k1 = slope(x, 0.0)
        k2 = slope(x + 0.5 * H * k1, 0.5)
        k3 = slope(x + 0.5 * H * k2, 0.5)
        x = x + H / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + slope(x + H * k3, 1.0))
    return x


by_all = jax.jit(jax.jacfwd(step, (2, 5, 6, 0)))  # in the order of the columns: by inputs, then by the state


@pytest.fixture(scope="module")
def flight():
    rng = np.random.default_rng(5)
    samples = 16  # two blocks of the widest lanes
    sizes = {"shared": 2, "theta": 3}
    given = {name: rng.normal(size=size) for name, size in sizes.items()}
    sizes = {"x": 5, "record": 2, "error": 2}
    return given | {name: rng.normal(size=(size, samples + 8)) for name, size in sizes.items()}


def run(flight, lanes, source, blocks, wanted=0, groups=DRIVEN, fill=0.0):
    """Tangents (T, X, columns) and the states that the steps lead to (X, stride)."""
    made = traced()
    program, table = differentiation(made.graph, made.result, made.rows, groups, lanes)
    stride = flight["x"].shape[1]
    columns = source.shape[1]
    wide = -(-columns // lanes) * lanes
    held = np.zeros((len(source), wide))
    held[:, :columns] = source
    tangents = aligned(wide // lanes, len(source), lanes)
    tangents[:] = held.reshape(len(source), -1, lanes).swapaxes(0, 1)
    out, reached = np.full((stride, len(source), wide), fill), np.full((len(source), stride), fill)
    arrays = [np.ascontiguousarray(flight[name]) for name in ("shared", "theta", "record", "error")]
    arrays += [Stepping(SUBSTEPS).plan(H * SUBSTEPS), np.ascontiguousarray(flight["x"]), tangents, out, reached]
    arrays += [aligned(table * SUBSTEPS * 4), aligned(program.scratch)]
    compiled(program)(*arrays, stride, *blocks, SUBSTEPS, 4, wanted, wide // lanes)
    return out, reached


def steps_of(flight, t):
    """The textbook's step from a sample and its derivatives (X, columns)."""
    now, then, e0, e1 = (flight[name][:, k] for name in ("record", "error") for k in (t, t + 1))
    given = flight["x"][:, t], flight["shared"], flight["theta"], now, then, e0, e1
    return np.asarray(step(*given)), np.concatenate([np.asarray(part) for part in by_all(*given)], axis=1)


@pytest.mark.parametrize("lanes", [2, 4, 8])
def test_columns_are_derivatives_by_inputs_and_then_of_what_they_start_from(flight, lanes):
    """Seven columns with inputs, beside them in the same block of columns the first of those without."""
    source = np.concatenate([np.zeros((5, 7)), np.eye(5)], axis=1)
    out, reached = run(flight, lanes, source, (0, 16 // lanes))
    for t in range(16):
        state, slopes = steps_of(flight, t)
        np.testing.assert_allclose(reached[:, t], state, rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(out[t, :, :12], slopes, rtol=1e-11, atol=1e-12)


def test_tangents_start_from_the_source(flight):
    """What is given is carried along by the derivatives by the state; inputs come on top."""
    source = np.random.default_rng(6).normal(size=(5, 12))
    out, _ = run(flight, 4, source, (0, 4))
    for t in (0, 7, 15):
        _, slopes = steps_of(flight, t)
        want = slopes[:, 7:] @ source
        want[:, :7] += slopes[:, :7]
        np.testing.assert_allclose(out[t, :, :12], want, rtol=1e-11, atol=1e-11)


def test_without_groups_only_the_state_varies(flight):
    out, _ = run(flight, 4, np.eye(5), (0, 4), groups=())
    for t in (0, 9):
        np.testing.assert_allclose(out[t, :, :5], steps_of(flight, t)[1][:, 7:], rtol=1e-11, atol=1e-12)


def test_groups_stand_in_the_order_that_is_asked(flight):
    out, _ = run(flight, 4, np.zeros((5, 5)), (0, 4), groups=("error_then", "theta"))
    for t in (0, 9):
        slopes = steps_of(flight, t)[1]
        np.testing.assert_allclose(out[t, :, :5], slopes[:, [5, 6, 0, 1, 2]], rtol=1e-11, atol=1e-12)


def test_only_what_is_asked_for_is_written(flight):
    """Blocks of samples, and blocks of columns from the first that is wanted."""
    source = np.concatenate([np.zeros((5, 7)), np.eye(5)], axis=1)
    whole, ends = run(flight, 4, source, (0, 4), fill=77.0)
    part, some = run(flight, 4, source, (1, 3), wanted=1, fill=77.0)
    np.testing.assert_array_equal(part[4:12, :, 4:], whole[4:12, :, 4:])
    np.testing.assert_array_equal(some[:, 4:12], ends[:, 4:12])
    untouched = part.copy()
    untouched[4:12, :, 4:] = 77.0
    assert (untouched == 77.0).all() and (np.delete(some, np.s_[4:12], axis=1) == 77.0).all()
    assert (whole[:16] != 77.0).all() and (whole[16:] == 77.0).all()


def test_a_part_of_a_table_is_as_long_as_there_are_lanes():
    g = Graph()
    a, b, t = g.input("x", 0), g.input("x", 1), g.input("theta", 1)
    rates = [g.apply("mul", a, g.apply("mul", b, t)), g.apply("add", a, g.apply("mul", g.constant(2.0), b)), t]
    made = Slopes(g, rates, {"x": 2, "theta": 2, "error_now": 3}, ("theta", "error_now"), 4)
    values = [[(j, made.graph.value(node)) for j, node in sorted(row)] for row in made.by_state]
    assert values == [[(0, None), (1, None)], [(0, 1.0), (1, 2.0)], []]
    assert {i: set(row) for i, row in made.by_input.items()} == {0: {1}, 2: {1}} and made.blocks == 2
    assert sorted(made.place.values()) == [0, 1] and made.size == 4 + 2 * 2 * 4
    assert [made.input_place(block, row) for block in (0, 1) for row in (0, 2)] == [4, 8, 12, 16]
    pieces = dict(made.pieces())
    assert list(pieces) == [0, 4, 8, 12, 16] and all(len(piece) == 4 for piece in pieces.values())
    assert pieces[0] == [*made.place, None, None]
    assert pieces[4] == [None, made.by_input[0][1], None, None] and made.graph.value(pieces[8][1]) == 1.0
    assert pieces[12] == pieces[16] == [None] * 4  # nothing goes by the last three columns
    assert set(made.nodes) == {*made.rates, *made.place, made.by_input[0][1], made.by_input[2][1]}


def test_columns_beyond_a_block_lie_in_the_next_one():
    """By the sixth of six inputs."""
    g = Graph()
    rates = [g.apply("mul", g.input("x", 0), g.input("error_now", 3))]
    made = Slopes(g, rates, {"x": 1, "theta": 2, "error_now": 4}, ("theta", "error_now"), 4)
    pieces = dict(made.pieces())
    assert set(made.by_input[0]) == {5} and pieces[made.input_place(1, 0)] == [None, made.by_input[0][5], None, None]


@pytest.mark.parametrize("lanes", [2, 8])
def test_the_table_is_told_by_stage(lanes):
    """Samples of a block times what each of these holds."""
    made = traced()
    slopes = Slopes(made.graph.copy(), made.result, made.rows, DRIVEN, lanes)
    program, table = differentiation(made.graph, made.result, made.rows, DRIVEN, lanes)
    assert table == lanes * slopes.size and program.name == "differentiate"
    assert program.sizes == ("stride", "first", "last", "substeps", "stages", "wanted", "blocks")
