"""What is computed once per run, per sample and at every state: levels, what is kept between them, values."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.compiler.emit import Code
from bayeschute.compiler.graph import FLOAT, Graph
from bayeschute.compiler.machine import aligned, compiled
from bayeschute.compiler.sections import LEVELS, RUN, SAMPLE, STATE, Memory, Place, Sections

pytest.importorskip("llvmlite")


def test_memory_is_handed_out_without_overlap():
    memory = Memory(8)
    assert [memory.take(3), memory.take(), memory.take(0), memory.take(2)] == [0, 24, 32, 32]
    assert memory.size == 48


@pytest.mark.parametrize(
    ("group", "level"),
    [
        ("shared", RUN), ("theta", RUN), ("now", SAMPLE), ("then", SAMPLE), ("error_now", SAMPLE),
        ("error_then", SAMPLE), ("x", STATE), ("start", STATE), ("share", STATE),
    ],
)  # fmt: skip
def test_an_operation_is_as_frequent_as_what_it_reads(group, level):
    g = Graph()
    root = g.apply("sqrt", g.input(group, 0))
    assert Sections(g, [root], Code(1), Memory(1)).level[root] == level == LEVELS[group]
    assert RUN < SAMPLE < STATE


def test_the_most_frequent_operand_decides():
    """The index of a lookup counts, as does its group; a constant never does."""
    g = Graph()
    theta, now, x = (g.apply("sqrt", g.input(group, 0)) for group in ("theta", "now", "x"))
    whole = {name: g.apply("to_integer", node) for name, node in (("theta", theta), ("now", now))}
    nodes = {
        g.apply("mul", theta, g.constant(3.0)): RUN, g.apply("add", theta, now): SAMPLE, g.apply("add", x, now): STATE,
        g.lookup("shared", 2, whole["theta"]): RUN, g.lookup("shared", 2, whole["now"]): SAMPLE,
        g.lookup("now", 1, whole["theta"]): SAMPLE,
    }  # fmt: skip
    sections = Sections(g, list(nodes), Code(1), Memory(1))
    assert {node: sections.level[node] for node in nodes} == nodes


def test_only_what_is_asked_for_later_is_kept():
    g = Graph()
    inner = g.apply("sqrt", g.input("theta", 0))
    kept = g.apply("exp", inner)  # a state asks for it, and for nothing below
    wanted = g.apply("log", g.input("theta", 1))  # a result
    sample = g.apply("mul", g.input("now", 0), g.input("now", 1))
    state = g.apply("add", g.apply("mul", g.input("x", 0), kept), sample)
    memory = Memory(4)
    memory.take(5)
    sections = Sections(g, [state, wanted, g.input("theta", 2)], Code(4), memory)
    assert set(sections.slots) == {kept, wanted, sample}
    assert sorted(sections.slots.values()) == [20, 24, 28] and memory.size == 32
    assert inner in sections.operations and g.input("theta", 2) not in sections.operations


def operations_in(code, since):
    """Arithmetic of floats that was written since."""
    words = ("fadd contract", "fsub contract", "fmul contract", "fdiv")
    return sum(any(f" {word} " in line for word in words) for line in code.lines[since:])


def test_every_operation_is_written_once_and_at_its_level():
    g = Graph()
    a, b = g.input("theta", 0), g.input("theta", 1)
    run = g.apply("add", g.apply("mul", a, b), a)
    sample = g.apply("mul", g.input("now", 0), run)
    x = g.input("x", 0)
    shared = g.apply("mul", x, sample)
    results = [g.apply("add", shared, run), g.apply("div", shared, x)]
    code = Code(1)
    sections = Sections(g, results, code, Memory(1))
    places = {name: Place(f"%{name}") for name in ("theta", "now", "x")}
    counts = []
    for level in (RUN, SAMPLE, STATE):
        before = len(code.lines)
        names = sections.write(level, places)
        if level == STATE:
            assert len(code.lines) == before  # only what is named
            first = [names(node) for node in results]
            at = len(code.lines)
            assert [names(node) for node in results] == first and len(code.lines) == at
        counts.append(operations_in(code, before))
    assert counts == [2, 1, 3]


def rich(g):
    """Results that read every group, a lookup and constants; operands from all levels."""
    (t0, t1), (n0, n1) = ([g.input(group, k) for k in range(2)] for group in ("theta", "now"))
    x0, x1, share, e = g.input("x", 0), g.input("x", 1), g.input("share", 0), g.input("error_now", 1)
    scale = g.apply("mul", g.apply("add", t0, g.input("shared", 3)), t1)
    place = g.apply("to_integer", g.apply("abs", n1))
    table = g.lookup("shared", 1, place)
    drive = g.apply("sub", g.apply("mul", scale, n0), g.apply("mul", table, e))
    mixed = g.apply("add", g.apply("mul", x0, drive), g.apply("mul", share, g.constant(2.5)))
    return [mixed, g.apply("sub", mixed, g.apply("mul", x1, scale)), drive, scale, t1, g.constant(4.0), share, x1]


@pytest.mark.parametrize("lanes", [1, 4])
def test_values_are_those_of_every_node_on_its_own(lanes):
    """Two samples of two states each, with the share of the sample at each state."""
    rng, g, samples, states = np.random.default_rng(lanes), Graph(), 2, 2
    results = rich(g)
    shared, theta = rng.normal(size=6), rng.normal(size=(2, lanes))
    now, error = rng.uniform(0.0, 3.9, (samples, 2)), rng.normal(size=(samples, 2, lanes))
    x, share = rng.normal(size=(samples, states, 2, lanes)), np.array([0.25, 0.75])
    code, memory = Code(lanes), Memory(lanes)
    sections = Sections(g, results, code, memory)
    places = {"shared": Place("%shared"), "theta": Place("%theta", str(lanes))}
    sections.write(RUN, places)
    with code.loop(samples) as t:
        places["now"] = Place(code.address("%now", code.integer("mul", t, 2)))
        places["error_now"] = Place(code.address("%error", code.integer("mul", t, 2 * lanes)), str(lanes))
        sections.write(SAMPLE, places)
        with code.loop(states) as s:
            at = code.integer("add", code.integer("mul", t, states), s)
            places["x"] = Place(code.address("%x", code.integer("mul", at, 2 * lanes)), str(lanes))
            names = sections.write(STATE, places, code.spread("%share", s))
            out = code.address("%out", code.integer("mul", at, len(results) * lanes))
            for i, node in enumerate(results):
                code.store(names(node), out, i * lanes)
    made, scratch = np.zeros((samples, states, len(results), lanes)), aligned(memory.size)
    program = code.program(
        "tried", ("shared", "theta", "now", "error", "x", "share", "out", "scratch"), (), memory.size
    )
    compiled(program)(shared, theta, now, error, x, share, made, scratch)
    for t, s, lane in np.ndindex(samples, states, lanes):
        given = {"shared": shared, "theta": theta[:, lane], "now": now[t], "error_now": error[t, :, lane]}
        given |= {"x": x[t, s, :, lane], "share": [share[s]]}
        np.testing.assert_allclose(made[t, s, :, lane], g.evaluate(results, given), rtol=1e-13, atol=1e-14)


def test_a_long_chain_of_operations_is_no_obstacle():
    """Deeper than Python's stack."""
    g = Graph()
    node = g.input("x", 0)
    for _ in range(5000):
        node = g.apply("sqrt", node)
    code = Code(1)
    Sections(g, [node], code, Memory(1)).write(STATE, {"x": Place("%x")})(node)
    assert sum("@llvm.sqrt" in line for line in code.lines) == 5000


def test_operands_keep_their_sides_and_kinds():
    """A quotient, and a choice by a comparison of integers."""
    g = Graph()
    x, y = g.input("x", 0), g.input("x", 1)
    fewer = g.apply("lt", g.apply("to_integer", x), g.apply("to_integer", y))
    results = [g.apply("div", x, y), g.apply("select", fewer, x, g.constant(-1.0)), g.apply("max", x, g.constant(0.5))]
    code = Code(1)
    names = Sections(g, results, code, Memory(1)).write(STATE, {"x": Place("%x")})
    for i, node in enumerate(results):
        code.store(names(node), "%out", i)
    for given in ([3.0, 2.0], [2.0, 3.0], [-5.0, -4.5]):
        made = np.zeros(3)
        compiled(code.program("tried", ("x", "out"), (), 0))(np.array(given), made)
        np.testing.assert_array_equal(made, g.evaluate(results, {"x": given}))


def test_a_result_that_is_a_constant_or_an_input_needs_no_memory():
    g, memory = Graph(), Memory(2)
    results = [g.constant(3.0), g.input("theta", 0), g.input("x", 1)]
    code = Code(2)
    sections = Sections(g, results, code, memory)
    names = sections.write(STATE, {"theta": Place("%theta"), "x": Place("%x", "2")})
    assert memory.size == 0 and sections.operations == []
    assert names(results[0]) == code.constant(3.0) and g.kinds[results[0]] == FLOAT


@pytest.mark.parametrize("lanes", [1, 4])
def test_comparisons_and_whole_numbers_are_kept_between_levels(lanes):
    """What the parameters decide once, every state asks for."""
    g = Graph()
    theta, x = [g.input("theta", row) for row in range(2)], g.input("x", 0)
    decided, whole = g.apply("lt", *theta), g.apply("to_integer", g.apply("mul", theta[1], g.constant(10.0)))
    results = [
        g.apply("select", decided, x, g.constant(-1.0)), g.apply("to_float", g.apply("add", g.apply("to_integer", x), whole)),
        g.apply("to_float", decided), g.apply("to_float", g.apply("not", decided)),
    ]  # fmt: skip
    code, memory = Code(lanes), Memory(lanes)
    sections = Sections(g, results, code, memory)
    assert {decided, whole} <= set(sections.slots)
    places = {"theta": Place("%theta", str(lanes)), "x": Place("%x", str(lanes))}
    for level in (RUN, SAMPLE, STATE):
        name_of = sections.write(level, places)
    for i, node in enumerate(results):
        code.store(name_of(node), "%out", i * lanes)
    program = code.program("kept", ("theta", "x", "out", "scratch"), (), memory.size)
    for values in ([0.2, 0.75], [0.75, 0.2]):
        given, out = aligned(2, lanes), aligned(4, lanes)
        given[:], here = np.array(values)[:, None], aligned(1, lanes)
        here[:] = np.arange(lanes) + 3.0
        compiled(program)(given, here, out, aligned(memory.size))
        below = values[0] < values[1]
        np.testing.assert_array_equal(out[0], here[0] if below else -1.0)
        np.testing.assert_array_equal(out[1], here[0] + int(10.0 * values[1]))
        np.testing.assert_array_equal(out[2:], np.full((2, lanes), [[below], [not below]], float))
