"""Expressions of JAX functions and their eliminated derivatives, valued by NumPy, against JAX itself."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.compiler.derivative import Jacobian, jacobian
from bayeschute.compiler.graph import Graph
from bayeschute.compiler.trace import UnknownOperationError, trace

TABLE = np.array([3.0, -1.0, 4.0, 1.0, -5.0])


def everything(table, x):
    """A bit of every operation that has a form, several of them in pieces."""
    a, b = x[:3], x[3:]
    near = jnp.where(a < b, a * b, jnp.maximum(a, 0.2) - jnp.minimum(b, a**3))
    turned = jnp.roll(jnp.stack([jnp.arctan2(a, b), jnp.sqrt(1.0 + a**2)], axis=1), 1, axis=0)
    place = jnp.clip(jnp.floor(x[0] * 2.0 + 2.0).astype(int), 0, 3)
    between = table[place] + (table[place + 1] - table[place]) * (x[0] * 2.0 + 2.0 - place)
    mixed = jnp.exp(-b) * jnp.sin(a) / (2.0 + jnp.cos(a) ** 2) + jnp.abs(b) * jnp.sign(a) + jnp.log(3.0 + a)
    return jnp.concatenate([near, turned.reshape(-1), mixed, jnp.tanh(between)[None] * a[0], x[5:] ** -2, jnp.flip(b)])


@pytest.mark.parametrize("seed", range(6))
def test_values_and_derivatives_are_those_of_jax(seed):
    x = np.random.default_rng(seed).uniform(-1.0, 1.0, 6)
    traced = trace(everything, (TABLE, x), ("shared", "x"))
    inputs = {"shared": TABLE, "x": x}
    np.testing.assert_allclose(traced.graph.evaluate(traced.result, inputs), everything(TABLE, x), rtol=1e-14)
    np.testing.assert_array_equal(traced.value(TABLE, x), traced.graph.evaluate(traced.result, inputs))
    want = np.asarray(jax.jacfwd(everything, argnums=1)(TABLE, x))
    np.testing.assert_allclose(Jacobian(traced, "x").at(TABLE, x), want, rtol=1e-12, atol=1e-14)


def test_ties_are_halved_and_a_branch_switched_off_counts_nothing():
    def function(x):
        safe = jnp.where(x[0] > 0.0, x[0], 1.0)
        return jnp.stack([jnp.maximum(x[1], 0.0), jnp.minimum(x[1], 0.0), jnp.where(x[0] > 0.0, jnp.sqrt(safe), 0.0)])

    traced = trace(lambda none, x: function(x), ((), np.zeros(2)), ("shared", "x"))
    entries = jacobian(traced.graph, traced.result, ("x",))
    slopes = traced.graph.evaluate([n for *_, n in entries], {"x": np.zeros(2)})
    assert {(i, j): float(s) for (i, (_, j), _), s in zip(entries, slopes, strict=True)} == {
        (0, 1): 0.5,
        (1, 1): 0.5,
        (2, 0): 0.0,
    }


def test_every_operation_occurs_once():
    """Products written again, with other signs or in another order, are the same nodes; zeros and ones leave none."""
    graph = Graph()
    a, b = graph.input("x", 0), graph.input("x", 1)
    product = graph.apply("mul", a, b)
    assert graph.apply("mul", b, a) == product
    assert graph.apply("neg", graph.apply("mul", graph.apply("neg", b), a)) == product
    assert graph.apply("sub", a, b) == graph.apply("neg", graph.apply("sub", b, a))
    assert graph.apply("mul", a, graph.constant(1.0)) == graph.apply("add", a, graph.constant(0.0)) == a
    assert graph.value(graph.apply("mul", a, graph.constant(0.0))) is None  # not zero where a is not finite
    assert graph.constant(0.0) != graph.constant(-0.0)


@pytest.mark.parametrize(
    ("function", "named"),
    [(lambda t, x: jnp.cumsum(x), "cumsum"), (lambda t, x: jnp.linalg.cholesky(x.reshape(2, 2)), "cholesky"), (lambda t, x: x[t[0].astype(int)], "varies")],
)  # fmt: skip
def test_what_has_no_scalar_form_is_named(function, named):
    with pytest.raises(UnknownOperationError, match=named):
        trace(function, (np.zeros(1), np.zeros(4)), ("shared", "x"))


def test_leaves_that_nothing_reads_take_no_place():
    given = {"long": np.zeros(1000), "table": TABLE, "scale": 2.0}
    traced = trace(lambda g, x: g["scale"] * x + g["table"][1], (given, np.zeros(1)), ("shared", "x"))
    assert traced.rows["shared"] == 6 and traced.read == [1, 2]
