"""Written-out functions against NumPy's, over their whole range."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.compiler.elementary import written_out
from bayeschute.compiler.graph import Graph

ELEMENTARY = {"sin", "cos", "exp", "log", "atan2", "tan", "tanh", "asin", "acos", "atan", "sinh", "cosh", "pow"}
RNG = np.random.default_rng(0)
SIGNS = np.array([0.0, -0.0, 1.0, -1.0])
INFINITE = np.array([np.inf, -np.inf, np.nan])


def value(op, *args):
    graph = Graph()
    node = graph.apply(op, *(graph.input("x", i) for i in range(len(args))))
    graph, (node,) = written_out(graph, [node])
    assert not {graph.nodes[n].op for n in graph.needed([node])} & ELEMENTARY
    return graph.evaluate([node], {"x": args})[0]


def ulps(got, want):
    return np.nanmax(np.abs(got - want) / np.spacing(np.abs(want)))


def test_sine_and_cosine():
    x = np.concatenate([RNG.uniform(-8, 8, 20000), RNG.uniform(-1e6, 1e6, 20000), RNG.normal(size=2000) * 1e-9])
    for op, exact in (("sin", np.sin), ("cos", np.cos)):
        got = value(op, x)
        np.testing.assert_allclose(got, exact(x), rtol=0, atol=3e-16)
        clear = np.abs(exact(x)) > 1e-3
        assert ulps(got[clear], exact(x)[clear]) < 4
    assert ulps(value("sin", x[-2000:]), np.sin(x[-2000:])) < 2
    assert np.isnan(value("sin", INFINITE)).all() and np.isnan(value("cos", INFINITE)).all()


def test_exponential():
    x = np.concatenate([RNG.uniform(-1, 1, 20000), RNG.uniform(-700, 709, 20000)])
    assert ulps(value("exp", x), np.exp(x)) < 4
    ends = np.array([-np.inf, -1e5, -760.0, 0.0, 710.0, 1e5, np.inf, np.nan])
    with np.errstate(over="ignore"):
        np.testing.assert_array_equal(value("exp", ends), np.exp(ends))
    np.testing.assert_allclose(value("exp", np.array([-740.0])), np.exp(-740.0), rtol=1e-1)  # below normal numbers


def test_angle():
    around = RNG.uniform(-np.pi, np.pi, 40000)
    y, x = np.sin(around) * 10.0 ** RNG.uniform(-9, 9, 40000), np.cos(around) * 10.0 ** RNG.uniform(-9, 9, 40000)
    assert ulps(value("atan2", y, x), np.arctan2(y, x)) < 4
    corner_y, corner_x = (g.ravel() for g in np.meshgrid(SIGNS, SIGNS[::2]))
    np.testing.assert_allclose(value("atan2", corner_y, corner_x), np.arctan2(corner_y, corner_x), rtol=1e-15)
    assert np.isnan(value("atan2", np.array([np.nan, 1.0]), np.array([1.0, np.nan]))).all()


@pytest.mark.parametrize("op", ["tan", "tanh", "log"])
def test_other_functions_stay_calls(op):
    graph = Graph()
    node = graph.apply(op, graph.input("x", 0))
    graph, (node,) = written_out(graph, [node])
    assert graph.nodes[node].op == op
