"""Simplified expressions against the same written plainly in NumPy: equal to the last digit."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.compiler.graph import BOOLEAN, FLOAT, INTEGER, Graph

UFUNCS = {"add": np.add, "sub": np.subtract, "mul": np.multiply, "div": np.divide, "neg": np.negative, "max": np.maximum,
          "min": np.minimum, "abs": np.abs}  # fmt: skip
ARITIES = dict.fromkeys(UFUNCS, 2) | {"neg": 1, "abs": 1}
NUMBERS = (0.0, 1.0, -1.0, 2.0, 0.5)


@pytest.mark.parametrize("seed", range(5))
def test_simplifying_changes_no_rounding(seed):
    """Random sums, products and signs of few inputs, so that zeros, ones, equal terms and signs meet often."""
    rng, graph = np.random.default_rng(seed), Graph()
    inputs = rng.normal(size=3)
    nodes = [graph.input("x", i) for i in range(3)] + [graph.constant(v) for v in NUMBERS]
    plain = [*inputs, *NUMBERS]
    for _ in range(400):
        op = rng.choice(list(UFUNCS))
        which = rng.integers(len(nodes), size=ARITIES[op])
        with np.errstate(all="ignore"):
            value = UFUNCS[op](*(plain[i] for i in which))
        if op == "div" and plain[which[1]] == 0.0 or not 1e-100 < abs(value) < 1e100 and value != 0.0:
            continue  # the sign of a zero is free, so that of what is divided by it too
        nodes.append(graph.apply(op, *(nodes[i] for i in which)))
        plain.append(value)
    assert len(set(nodes)) < 0.97 * len(nodes)  # some are the same
    np.testing.assert_array_equal(graph.evaluate(nodes, {"x": inputs}), plain)


def test_constants_are_folded_and_their_kinds_kept():
    g = Graph()
    assert g.value(g.apply("pow", g.constant(2.0), g.constant(0.5))) == 2.0**0.5
    assert g.value(g.apply("sub", g.constant(2.0), g.constant(5.0))) == -3.0
    assert g.value(g.apply("atan2", g.constant(1.0), g.constant(-1.0))) == np.arctan2(1.0, -1.0)
    assert np.isnan(g.value(g.apply("sqrt", g.constant(-1.0))))
    less = g.apply("lt", g.constant(1.0), g.constant(2.0))
    assert g.value(less) is True and g.kinds[less] == BOOLEAN
    assert g.kinds[g.apply("add", g.constant(1), g.constant(2))] == INTEGER
    assert len({g.constant(1), g.constant(1.0), g.constant(True)}) == 3


def test_a_choice_that_is_known_is_made():
    g = Graph()
    a, b = g.input("x", 0), g.input("x", 1)
    mask = g.apply("lt", a, b)
    assert g.apply("select", g.constant(True), a, b) == a and g.apply("select", g.constant(False), a, b) == b
    assert g.apply("select", mask, a, a) == a and g.kinds[g.apply("select", mask, a, b)] == FLOAT
    assert g.value(g.apply("select", mask, a, b)) is None


def test_converting_what_is_of_that_kind_is_nothing():
    g = Graph()
    a, mask = g.input("x", 0), g.apply("lt", g.input("x", 0), g.input("x", 1))
    assert g.apply("to_float", a) == a and g.value(g.apply("to_integer", g.constant(2.9))) == 2
    made = g.apply("to_float", mask)
    assert g.kinds[made] == FLOAT and g.kinds[g.apply("to_integer", mask)] == INTEGER and g.nodes[made].op == "to_float"


def test_order_of_operands_matters_only_where_it_does():
    g = Graph()
    a, b = g.input("x", 0), g.input("x", 1)
    assert g.apply("max", a, b) == g.apply("max", b, a) and g.apply("eq", a, b) == g.apply("eq", b, a)
    assert g.apply("lt", a, b) != g.apply("lt", b, a) and g.apply("div", a, b) != g.apply("div", b, a)
    assert g.apply("copysign", a, b) != g.apply("copysign", b, a)


def test_a_copy_grows_on_its_own_and_knows_what_there_was():
    g = Graph()
    total = g.apply("add", g.input("x", 0), g.input("x", 1))
    other = g.copy()
    assert other.apply("add", other.input("x", 1), other.input("x", 0)) == total
    other.apply("sin", total)
    assert len(other.nodes) == len(g.nodes) + 1


def test_only_what_is_needed_is_named_operands_first():
    g = Graph()
    a, b = g.input("x", 0), g.input("x", 1)
    g.apply("mul", a, b)
    sine = g.apply("sin", a)
    assert g.needed([g.apply("neg", sine)]) == [a, sine, sine + 1] and g.needed([]) == []
