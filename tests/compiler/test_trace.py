"""Single operations as scalar expressions against NumPy, corners included."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from bayeschute.compiler.trace import UnknownOperationError, trace

X = np.array([0.7, -1.3, 0.2, 2.4, -0.6, 1.1])
GRID = X.reshape(2, 3)


def value(function, x=X, table=()):
    traced = trace(function, (table, x), ("shared", "x"))
    rows = {"x": np.ravel(x), "shared": np.ravel(table)}
    return np.array(traced.graph.evaluate(traced.result, rows))


ELEMENTS = {
    "greater": (lambda t, x: x > 0.2, X > 0.2),
    "not less": (lambda t, x: x >= 0.2, X >= 0.2),
    "less": (lambda t, x: x < 0.2, X < 0.2),
    "clamp": (lambda t, x: lax.clamp(-0.5, x, 1.0), np.clip(X, -0.5, 1.0)),
    "seventh power": (lambda t, x: lax.integer_pow(x, 7), X**7),
    "minus third power": (lambda t, x: lax.integer_pow(x, -3), X**-3.0),
    "no power": (lambda t, x: lax.integer_pow(x, 0), np.ones(6)),
    "reciprocal root": (lambda t, x: lax.rsqrt(x * x), 1.0 / np.abs(X)),
    "square": (lambda t, x: lax.square(x), X**2),
    "choice": (lambda t, x: lax.select_n(x > 0.0, 2.0 * x, 3.0 * x), np.where(X > 0.0, 3.0 * X, 2.0 * X)),
    "true": (lambda t, x: (x - 0.2).astype(bool).astype(float), [1, 1, 0, 1, 1, 1]),
    "truncated": (lambda t, x: x.astype(int).astype(float), np.trunc(X)),
}


@pytest.mark.parametrize("name", ELEMENTS)
def test_elements(name):
    function, want = ELEMENTS[name]
    np.testing.assert_allclose(value(function), want, rtol=1e-15)


def test_the_sign_of_zeros_and_of_what_is_no_number_is_theirs():
    with np.errstate(invalid="ignore"):
        x = np.array([-2.0, -0.0, 0.0, 3.0, np.nan, -np.inf])
        np.testing.assert_array_equal(value(lambda t, x: jnp.sign(x), x), np.sign(x))
    assert np.signbit(value(lambda t, x: jnp.sign(x), x)[1])


ARRAYS = {
    "sum of columns": (lambda t, x: x.sum(axis=0), GRID.sum(axis=0)),
    "sum of rows": (lambda t, x: x.sum(axis=1), GRID.sum(axis=1)),
    "greatest": (lambda t, x: x.max(axis=1), GRID.max(axis=1)),
    "least": (lambda t, x: x.min(axis=(0, 1)), [GRID.min()]),
    "transposed": (lambda t, x: x.T, GRID.T.ravel()),
    "turned": (lambda t, x: lax.rev(x, (1,)), GRID[:, ::-1].ravel()),
    "beside": (lambda t, x: jnp.concatenate([x, 2.0 * x], axis=1), np.hstack([GRID, 2.0 * GRID]).ravel()),
    "below": (lambda t, x: jnp.concatenate([x, 2.0 * x], axis=0), np.vstack([GRID, 2.0 * GRID]).ravel()),
    "tiled": (lambda t, x: jnp.tile(x, (1, 2)), np.tile(GRID, (1, 2)).ravel()),
    "every second": (lambda t, x: lax.slice(x, (0, 0), (2, 3), (1, 2)), GRID[:, ::2].ravel()),
    "rows spread": (lambda t, x: x - x[:, :1], (GRID - GRID[:, :1]).ravel()),
    "columns spread": (lambda t, x: x - x[:1], (GRID - GRID[:1]).ravel()),
    "stacked": (lambda t, x: jnp.stack([x[0], x[1]], axis=1), np.stack([GRID[0], GRID[1]], axis=1).ravel()),
    "split": (lambda t, x: jnp.concatenate(jnp.split(x, [1], axis=1)[::-1], axis=1), np.hstack([GRID[:, 1:], GRID[:, :1]]).ravel()),
}  # fmt: skip


@pytest.mark.parametrize("name", ARRAYS)
def test_arrays(name):
    function, want = ARRAYS[name]
    np.testing.assert_allclose(value(function, GRID), want, rtol=1e-15)


TABLE = np.array([3.0, -1.0, 4.0, 1.0])


@pytest.mark.parametrize(("at", "want"), [(-5.0, 3.0), (0.0, 3.0), (2.9, 4.0), (3.0, 1.0), (99.0, 1.0)])
def test_an_index_beyond_a_table_is_its_end(at, want):
    x = np.array([at])
    sliced = value(lambda t, x: lax.dynamic_slice(t, (x[0].astype(int),), (1,)), x, TABLE)
    gathered = value(lambda t, x: t.at[x.astype(int)].get(mode="clip"), x, TABLE)
    assert sliced == gathered == [want] or at < 0.0  # a negative index counts from the end for `at`
    assert sliced == [want]


def test_a_known_index_reads_its_row_and_a_table_behind_another_leaf_its_own():
    leaves = {"a": np.array([9.0, 8.0]), "b": TABLE}

    def function(t, x):
        return jnp.stack([t["b"][2] + t["a"][0], lax.dynamic_slice(t["b"], (x[0].astype(int),), (1,))[0]])

    traced = trace(function, (leaves, np.array([1.0])), ("shared", "x"))
    held = np.concatenate([np.ravel(leaves["ab"[number]]) for number in traced.read])
    assert traced.rows == {"shared": 6, "x": 1}
    assert traced.graph.evaluate(traced.result, {"x": [1.0], "shared": held}) == [13.0, -1.0]


def test_only_leaves_of_the_first_argument_that_are_read_have_a_place():
    leaves = [np.zeros(5), np.array([2.0, 3.0]), np.zeros(7), np.array(4.0)]
    inner = jax.jit(lambda t, x: x[1] * t[1][1] + t[3])
    traced = trace(lambda t, x, unread: inner(t, x), (leaves, X, np.zeros(3)), ("shared", "x", "unread"))
    assert sorted(traced.read) == [1, 3] and traced.rows == {"shared": 3, "x": 6, "unread": 3}
    held = np.concatenate([np.ravel(leaves[i]) for i in traced.read])
    assert traced.graph.evaluate(traced.result, {"x": X, "shared": held}) == [X[1] * 3.0 + 4.0]


@pytest.mark.parametrize(
    ("function", "named"),
    [
        (lambda t, x: t.at[x.astype(int)].get(mode="fill"), "gather"),
        (lambda t, x: lax.select_n(x.astype(jnp.int32), x, 2.0 * x, 3.0 * x), "select_n"),
        (lambda t, x: lax.dynamic_slice(t, (x[0].astype(int),), (2,)), "dynamic_slice"),
    ],
)
def test_forms_that_would_be_read_wrongly_are_refused(function, named):
    with pytest.raises(UnknownOperationError, match=named):
        trace(function, (TABLE, X), ("shared", "x"))
