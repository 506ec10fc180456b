"""Code written by hand, run by the machine, against NumPy: constants, operations of all kinds, memory, loops."""

from __future__ import annotations

import re

import numpy as np
import pytest

from bayeschute.compiler.emit import Code
from bayeschute.compiler.graph import BOOLEAN, FLOAT, INTEGER
from bayeschute.compiler.machine import compiled

pytest.importorskip("llvmlite")

LANES = [1, 2, 8]
FLOATS = [0.0, -0.0, 1.0, -1.0, 0.1, -2.5, 1e300, 5e-324, np.inf, -np.inf, np.nan, 3.7, -7.9, 2.0, 7.0, -1e-300]
INTEGERS = [0.0, 1.0, -1.0, 7.0, -7.0, 3.0, -3.0, 1000.0]


def run(code, pointers, *given):
    """Run what was written; arrays are changed in place, integers are sizes %s0, %s1 ..."""
    arrays = [a for a in given if isinstance(a, np.ndarray)]
    sizes = [f"s{i}" for i in range(len(given) - len(arrays))]
    compiled(code.program("tried", pointers, sizes, 0))(*given)


def pairs(values, lanes):
    """All pairs of some values, as blocks of lanes: two arrays."""
    a, b = (np.ravel(side) for side in np.meshgrid(values, values))
    return a[: a.size // lanes * lanes].copy(), b[: b.size // lanes * lanes].copy()


def made_of(lanes, values, write):
    """What `write`, which gets the code and the names of two numbers, makes of all pairs of some values."""
    code, (a, b) = Code(lanes), pairs(values, lanes)
    with code.loop("%s0") as block:
        at = code.integer("mul", block, lanes)
        code.store(write(code, code.load("%a", at), code.load("%b", at)), "%c", at)
    c = np.full(a.size, 99.0)
    run(code, ("a", "b", "c"), a, b, c, a.size // lanes)
    return a, b, c


@pytest.mark.parametrize("lanes", LANES)
@pytest.mark.parametrize("value", [*FLOATS, 0.1 + 0.2, np.pi])
def test_a_constant_is_the_number_itself_on_every_lane(lanes, value):
    code, made = Code(lanes), np.full(lanes, 5.0)
    code.store(code.constant(value), "%made", 0)
    run(code, ("made",), made)
    assert made.tobytes() == np.full(lanes, value).tobytes()


@pytest.mark.parametrize("lanes", LANES)
def test_constants_of_integers_and_truth(lanes):
    code, made = Code(lanes), np.zeros((4, lanes))
    for row, value in enumerate((-3, 40)):
        code.store(code.operation("to_float", INTEGER, [code.constant(value)]), "%made", row * lanes)
    for row, value in ((2, True), (3, False)):
        code.store(code.operation("to_float", BOOLEAN, [code.constant(value)]), "%made", row * lanes)
    run(code, ("made",), made)
    np.testing.assert_array_equal(made, np.repeat([[-3.0], [40.0], [1.0], [0.0]], lanes, axis=1))


@pytest.mark.parametrize("lanes", LANES)
@pytest.mark.parametrize(
    ("op", "wanted"), [("add", np.add), ("sub", np.subtract), ("mul", np.multiply), ("div", np.divide)]
)
def test_arithmetic_of_floats_is_ieee(lanes, op, wanted):
    a, b, c = made_of(lanes, FLOATS, lambda code, *ab: code.operation(op, FLOAT, list(ab)))
    with np.errstate(all="ignore"):
        np.testing.assert_array_equal(c, wanted(a, b))


def whole(code, *names):
    return [code.operation("to_integer", FLOAT, [name]) for name in names]


@pytest.mark.parametrize("lanes", LANES)
@pytest.mark.parametrize(
    ("op", "wanted"),
    [
        ("add", np.add), ("sub", np.subtract), ("mul", np.multiply), ("max", np.maximum), ("min", np.minimum),
        ("div", lambda a, b: np.trunc(a / b)),
    ],
)  # fmt: skip
def test_arithmetic_of_integers(lanes, op, wanted):
    """A quotient is cut towards zero; none by zero is tried, which the processor refuses."""
    values = [v for v in INTEGERS if v or op != "div"]
    a, b, c = made_of(
        lanes, values, lambda code, *ab: code.operation("to_float", INTEGER, [code.operation(op, INTEGER, whole(code, *ab))])
    )  # fmt: skip
    np.testing.assert_array_equal(c, wanted(a, b))


@pytest.mark.parametrize("lanes", LANES)
@pytest.mark.parametrize(
    ("op", "wanted"), [("lt", np.less), ("le", np.less_equal), ("eq", np.equal), ("ne", np.not_equal)]
)
def test_comparisons(lanes, op, wanted):
    """Of floats nothing holds of NaN but that it is another; of integers by their sign."""

    def told(code, kind, names):
        return code.operation("to_float", BOOLEAN, [code.operation(op, kind, names)])

    a, b, c = made_of(lanes, FLOATS, lambda code, *ab: told(code, FLOAT, list(ab)))
    np.testing.assert_array_equal(c, wanted(a, b))
    a, b, c = made_of(lanes, INTEGERS, lambda code, *ab: told(code, INTEGER, whole(code, *ab)))
    np.testing.assert_array_equal(c, wanted(a, b))


@pytest.mark.parametrize("lanes", LANES)
@pytest.mark.parametrize(
    ("op", "wanted"),
    [
        ("and", np.logical_and), ("or", np.logical_or), ("xor", np.logical_xor), ("eq", np.equal), ("ne", np.not_equal),
        ("not", lambda p, q: ~p),
    ],
)  # fmt: skip
def test_logic(lanes, op, wanted):
    def told(code, a, b):
        zero = code.constant(0.0)
        flags = [code.operation("lt", FLOAT, [zero, x]) for x in ((a,) if op == "not" else (a, b))]
        number = code.operation("to_integer", BOOLEAN, [code.operation(op, BOOLEAN, flags)])
        return code.operation("to_float", INTEGER, [number])

    a, b, c = made_of(lanes, [1.0, -1.0, 2.0, -2.0], told)
    np.testing.assert_array_equal(c, wanted(a > 0.0, b > 0.0))


@pytest.mark.parametrize("lanes", LANES)
def test_a_choice_is_made_on_every_lane_for_itself(lanes):
    def told(code, a, b):
        return code.operation("select", FLOAT, [code.operation("lt", FLOAT, [a, b]), a, code.operation("neg", FLOAT, [b])])  # fmt: skip

    a, b, c = made_of(lanes, FLOATS, told)
    np.testing.assert_array_equal(c, np.where(a < b, a, -b))


@pytest.mark.parametrize("lanes", LANES)
def test_the_opposite_number(lanes):
    a, _, c = made_of(lanes, FLOATS, lambda code, a, b: code.operation("neg", FLOAT, [a]))
    np.testing.assert_array_equal(np.signbit(c), ~np.signbit(a))
    np.testing.assert_array_equal(np.abs(c), np.abs(a))
    opposite = lambda code, a, b: code.operation("to_float", INTEGER, [code.operation("neg", INTEGER, whole(code, a))])  # noqa: E731
    a, _, c = made_of(lanes, INTEGERS, opposite)
    np.testing.assert_array_equal(c, -a)


@pytest.mark.parametrize("lanes", LANES)
@pytest.mark.parametrize(("op", "wanted"), [("max", np.maximum), ("min", np.minimum)])
@pytest.mark.parametrize("last", [None, 0.7, -2.5])
def test_extremes_hand_a_nan_on(lanes, op, wanted, last):
    """Whatever the last number is: one that is only known when the code runs, or a constant."""

    def told(code, a, b):
        return code.operation(op, FLOAT, [a, b if last is None else code.constant(last)], last)

    a, b, c = made_of(lanes, FLOATS, told)
    np.testing.assert_array_equal(c, wanted(a, b if last is None else last))


@pytest.mark.parametrize("lanes", LANES)
def test_whole_parts_saturate_and_that_of_nan_is_zero(lanes):
    def told(code, a, b):
        return code.operation("to_float", INTEGER, whole(code, a))

    a, _, c = made_of(lanes, [*FLOATS, 1e18, -1e18], told)
    with np.errstate(all="ignore"):
        np.testing.assert_array_equal(c, np.where(np.isnan(a), 0.0, np.clip(np.trunc(a), -(2.0**63), 2.0**63)))


@pytest.mark.parametrize("lanes", LANES)
def test_powers_of_two_of_all_normal_numbers(lanes):
    def told(code, a, b):
        return code.operation("power_of_two", INTEGER, whole(code, a))

    a, _, c = made_of(lanes, [-1022.0, -1021.0, -1.0, 0.0, 1.0, 52.0, 1022.0, 1023.0], told)
    np.testing.assert_array_equal(c, np.ldexp(1.0, a.astype(int)))


@pytest.mark.parametrize("lanes", LANES)
@pytest.mark.parametrize(
    ("op", "wanted"),
    [
        ("sqrt", np.sqrt), ("abs", np.abs), ("floor", np.floor), ("log", np.log), ("tan", np.tan), ("tanh", np.tanh),
        ("asin", np.arcsin), ("acos", np.arccos), ("atan", np.arctan), ("sinh", np.sinh), ("cosh", np.cosh),
    ],
)  # fmt: skip
def test_functions_of_one_number(lanes, op, wanted):
    a, _, c = made_of(lanes, [0.2, -0.3, 0.9, 1.7], lambda code, a, b: code.operation(op, FLOAT, [a]))
    with np.errstate(all="ignore"):
        np.testing.assert_allclose(c, wanted(a), rtol=4e-15, atol=0.0)


@pytest.mark.parametrize("lanes", LANES)
@pytest.mark.parametrize(("op", "wanted"), [("pow", np.power), ("copysign", np.copysign)])
def test_functions_of_two_numbers(lanes, op, wanted):
    a, b, c = made_of(lanes, [0.2, 0.5, 2.0, 3.5], lambda code, *ab: code.operation(op, FLOAT, list(ab)))
    np.testing.assert_allclose(c, wanted(a, b), rtol=4e-15)


def test_every_function_in_use_is_declared_once():
    code = Code(4)
    x = code.load("%x", 0)
    for _ in range(2):
        x = code.operation("sqrt", FLOAT, [code.operation("pow", FLOAT, [x, x])])
    text = code.program("tried", ("x",), (), 0).text
    assert re.findall(r"^declare.*$", text, re.M) == [
        "declare <4 x double> @llvm.pow.v4f64(<4 x double>, <4 x double>)",
        "declare <4 x double> @llvm.sqrt.v4f64(<4 x double>)",
    ]


@pytest.mark.parametrize("lanes", LANES)
def test_neighbours_are_read_and_written_and_no_others(lanes):
    code, given, made = Code(lanes), np.arange(20.0), np.full(20, -1.0)
    code.store(code.load("%given", 3), "%made", code.integer("add", 2, 3))
    run(code, ("given", "made"), given, made)
    np.testing.assert_array_equal(made, [*[-1.0] * 5, *given[3 : 3 + lanes], *[-1.0] * (15 - lanes)])


@pytest.mark.parametrize("lanes", LANES)
def test_one_number_on_every_lane(lanes):
    code, given, made = Code(lanes), np.arange(20.0), np.zeros((2, lanes))
    code.store(code.spread("%given", 7), "%made", 0)
    one = code.new(f"load double, ptr {code.address('%given', 5)}, align 8")
    code.store(code.everywhere(one), "%made", lanes)
    run(code, ("given", "made"), given, made)
    np.testing.assert_array_equal(made, np.repeat([[7.0], [5.0]], lanes, axis=1))


@pytest.mark.parametrize("lanes", LANES)
def test_each_lane_reads_at_its_own_index_and_writes_to_its_own_address(lanes):
    rng = np.random.default_rng(lanes)
    code, given, made = Code(lanes), rng.normal(size=20), np.full(20, -1.0)
    index, places = rng.permutation(20)[:lanes], rng.permutation(20)[:lanes]
    number = code.operation("to_integer", FLOAT, [code.load("%index", 0)])
    code.scatter(code.gather("%given", number), [code.address("%made", place) for place in places])
    run(code, ("given", "index", "made"), given, index * 1.0, made)
    want = np.full(20, -1.0)
    want[places] = given[index]
    np.testing.assert_array_equal(made, want)


@pytest.mark.parametrize("lanes", [1, 2, 4, 8])
def test_a_square_of_vectors_is_transposed(lanes):
    code, given, made = Code(lanes), np.arange(1.0 * lanes * lanes).reshape(lanes, lanes), np.zeros((lanes, lanes))
    for i, row in enumerate(code.transposed([code.load("%given", i * lanes) for i in range(lanes)])):
        code.store(row, "%made", i * lanes)
    run(code, ("given", "made"), given, made)
    np.testing.assert_array_equal(made, given.T)


def counted(count, first):
    """The counters that a loop goes through, written one after the other."""
    code, made = Code(1), np.full(12, -1.0)
    if first is None:
        with code.loop("%s0") as i:
            code.store(code.operation("to_float", INTEGER, [i]), "%made", i)
        run(code, ("made",), made, count)
    else:
        with code.loop("%s0", "%s1") as i:
            code.store(code.operation("to_float", INTEGER, [i]), "%made", i)
        run(code, ("made",), made, count, first)
    return made[made >= 0.0].tolist()


@pytest.mark.parametrize(("count", "first"), [(5, None), (1, None), (0, None), (-3, None), (7, 3), (4, 3), (3, 3), (2, 3)])  # fmt: skip
def test_a_loop_goes_from_the_first_to_below_the_last(count, first):
    assert counted(count, first) == list(range(first or 0, count))


def test_loops_in_loops_and_one_after_the_other():
    """Of the entries below the diagonal of a square, then of a row that is known when the code is made."""
    code, made = Code(1), np.zeros((4, 4))
    with code.loop("%s0") as i:
        with code.loop(i) as j:
            code.store(code.constant(1.0), "%made", code.integer("add", code.integer("mul", i, 4), j))
    with code.loop(4, 2) as j:
        code.store(code.constant(7.0), "%made", j)
    run(code, ("made",), made, 4)
    want = np.tril(np.ones((4, 4)), -1)
    want[0, 2:] = 7.0
    np.testing.assert_array_equal(made, want)


@pytest.mark.parametrize(("a", "b"), [(3, 5), (5, 3), (-2, 1), (4, 4)])
def test_counters(a, b):
    code, made = Code(1), np.zeros(3)
    numbers = code.least("%s0", "%s1"), code.integer("sub", "%s0", "%s1"), code.integer("mul", "%s0", "%s1")
    for i, number in enumerate(numbers):
        code.store(code.operation("to_float", INTEGER, [number]), "%made", i)
    run(code, ("made",), made, a, b)
    np.testing.assert_array_equal(made, [min(a, b), a - b, a * b])


def test_a_program_says_what_it_takes():
    code = Code(8)
    code.store(code.constant(1.0), "%made", 0)
    program = code.program("tried", ["made", "scratch"], ["samples"], 17)
    assert program[1:] == ("tried", ("made", "scratch"), ("samples",), 17)
    assert program.text.startswith(
        "define void @tried(ptr noalias %made, ptr noalias %scratch, i64 %samples) {\nentry:\n"
    )
    assert program.text.count("ret void\n}\n") == 1


@pytest.mark.parametrize(("lanes", "frames"), [(1, 0), (2, 1), (8, 1)])
def test_only_code_of_several_lanes_has_an_aligned_frame(lanes, frames):
    """So that vectors that don't stay in registers lie within a cache line."""
    text = Code(lanes).program("tried", (), (), 0).text
    assert text.count("align 64") == frames == text.count("store volatile")


def test_what_is_written_alike_has_one_text():
    """By which machine code is found again."""

    def text(value):
        code = Code(4)
        with code.loop("%s0") as i:
            code.store(code.operation("sqrt", FLOAT, [code.constant(value)]), "%made", i)
        return code.program("tried", ("made",), ("s0",), 0).text

    assert text(2.0) == text(2.0) != text(3.0)
