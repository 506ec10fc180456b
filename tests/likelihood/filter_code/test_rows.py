"""Rows of small matrices in machine code against NumPy, for numbers of columns that fill registers and that don't."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.compiler.machine import compiled
from bayeschute.likelihood.filter_code.rows import WIDE, RowCode, padded, parts


def _run(code, pointers, *arrays):
    compiled(code.program("tried", pointers, (), 0))(*arrays)


@pytest.mark.parametrize("columns", [1, 3, 4, 5, 8, 11])
def test_rows_are_read_and_written_without_what_is_behind(columns):
    code = RowCode()
    code.put(code.times(code.constant(2.0), code.read("%given", columns)), "%made", columns)
    given, made = np.arange(1.0, columns + 1.0), np.full(columns + WIDE, -1.0)
    _run(code, ("given", "made"), given, made)
    np.testing.assert_array_equal(made, [*(2.0 * given), *[-1.0] * WIDE])


@pytest.mark.parametrize(("rows", "columns"), [(1, 4), (5, 12), (3, 8)])
def test_combined_is_a_product(rows, columns):
    rng = np.random.default_rng(0)
    start, numbers, matrix = (
        rng.standard_normal(columns),
        rng.standard_normal(rows),
        rng.standard_normal((rows, columns)),
    )
    code = RowCode()
    pairs = [(code.address("%numbers", k), code.address("%matrix", k * columns)) for k in range(rows)]
    code.put(code.combined(code.row("%start", columns), pairs), "%sum")
    code.put(code.combined(code.row("%start", columns), pairs, "fsub"), "%rest")
    made = np.zeros((2, columns))
    _run(code, ("start", "numbers", "matrix", "sum", "rest"), start, numbers, matrix, made[0], made[1])
    np.testing.assert_allclose(made, [start + numbers @ matrix, start - numbers @ matrix], rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("columns", [1, 4, 6])
def test_gathered_takes_rows_without_padding(columns):
    rng = np.random.default_rng(1)
    numbers, matrix = rng.standard_normal(3), rng.standard_normal((3, columns + 2))
    code, made = RowCode(), np.zeros(padded(columns))
    code.put(code.gathered(code.zeros(padded(columns)), "%numbers", "%matrix", 3, columns + 2, columns), "%made")
    _run(code, ("numbers", "matrix", "made"), numbers, matrix, made)
    np.testing.assert_allclose(made[:columns], numbers @ matrix[:, :columns], rtol=1e-13)
    np.testing.assert_array_equal(made[columns:], 0.0)


@pytest.mark.parametrize("size", [4, 8, 12])
def test_turned_is_the_transpose(size):
    given, made, code = np.arange(float(size * size)).reshape(size, size), np.zeros((size, size)), RowCode()
    code.turned("%given", "%made", size)
    _run(code, ("given", "made"), given, made)
    np.testing.assert_array_equal(made, given.T)


def test_numbers_are_copied_and_set_to_zero():
    given, made, code = np.arange(1.0, 4.0), np.ones(9), RowCode()
    code.emptied(8, "%made")
    code.copied(3, "%given", "%made", 3)
    _run(code, ("given", "made"), given, made)
    np.testing.assert_array_equal(made, [1, 0, 0, 2, 0, 0, 3, 0, 1])


@pytest.mark.parametrize("columns", [4, 48, 52, 76, 200])
def test_parts_cover_the_columns_in_whole_registers(columns):
    found = parts(columns)
    assert [k for first, count in found for k in range(first, first + count)] == list(range(columns))
    assert all(count % WIDE == 0 and count <= 48 for _, count in found)
    assert padded(columns) == columns and padded(columns - 3) == columns
