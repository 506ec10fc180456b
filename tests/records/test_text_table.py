"""Rows, columns and values of tables as an editor counts them."""

from __future__ import annotations

import gzip

import numpy as np
import pandas as pd
import pytest

from bayeschute.core.errors import InputError
from bayeschute.records import text_table
from bayeschute.records.text_table import numbers, read_csv, read_parquet


def _file(folder, content, name="a.csv"):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def test_samples_know_their_rows_over_blank_lines(tmp_path):
    """Row 1 is the header; sample i stands in row i + first_row, however many lines before it are blank."""
    table = read_csv(_file(tmp_path, "t,x,y\n0,1,7\n\n,,7\n3,oops,7\n"), {"t", "x"})
    assert table.names == ["t", "x", "y"] and [*table.frame.columns] == ["t", "x"]
    assert [*table.frame.index] == [0, 3] and table.first_row == 2
    values, (fault,) = numbers(table.frame["x"], "x", table.first_row)
    assert "'oops' in row 5 (1 such rows)" in fault.got and np.isnan(values[1])


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_the_delimiter_is_the_one_that_the_header_has_most_of(tmp_path, delimiter):
    text = delimiter.join(["t", '" x "', "y"]) + "\n" + delimiter.join(["1", "2.5", "3"]) + "\n"
    table = read_csv(_file(tmp_path, text), {"t", "x"})
    assert table.names == ["t", "x", "y"] and table.frame.iloc[0].tolist() == [1.0, 2.5]


def test_packed_and_plain_are_the_same_with_any_line_end(tmp_path):
    text = "\ufefft,x\r\n0,1\r1,2\n"
    plain = read_csv(_file(tmp_path, text), {"t", "x"})
    packed = read_csv(_file(tmp_path, gzip.compress(text.encode()), "a.CSV.GZ"), {"t", "x"})
    pd.testing.assert_frame_equal(plain.frame, packed.frame)
    assert plain.frame["x"].tolist() == [1, 2]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"  \n ", "an empty file"),
        (b"t,x\n0,\0\n", "binary data"),
        (b"t,x\n0,1\n1,\xff\n", "not UTF-8 (first in row 3)"),
        (b"t,x\n0,1\n1,2,3\n4\n", "3 fields in row 3 (2 such rows)"),
        (b"t,x,t\n0,1,2\n", "column 't' 2 times"),
    ],
)
def test_files_that_are_no_table_say_where(tmp_path, content, words):
    with pytest.raises(InputError) as told:
        read_csv(_file(tmp_path, content), {"t", "x"})
    assert words in str(told.value) and "a.csv" in str(told.value)


def test_columns_that_nobody_wants_may_repeat(tmp_path):
    table = read_csv(_file(tmp_path, "t,note,note\n0,1,2\n"), {"t"})
    assert table.frame["t"].tolist() == [0]


def test_commas_inside_quotes_are_no_fields(tmp_path):
    table = read_csv(_file(tmp_path, 't,note\n0,"a, b"\n1,"c"\n'), {"t"})
    assert table.frame["t"].tolist() == [0, 1]


def test_a_file_that_unpacks_without_end_is_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr(text_table, "LARGEST_FILE", 100)
    read_csv(_file(tmp_path, "t\n" + "1\n" * 49), {"t"})
    with pytest.raises(InputError, match="more than 100 bytes"):
        read_csv(_file(tmp_path, gzip.compress(b"t\n" + b"1\n" * 50), "a.csv.gz"), {"t"})


def test_parquet_counts_its_rows_from_one_and_is_bounded(tmp_path, monkeypatch):
    path = tmp_path / "a.parquet"
    pd.DataFrame({"t": [0.0, 1.0], "x": [1, 2], "note": ["a", "b"]}).to_parquet(path)
    table = read_parquet(path, {"x", "t"})
    assert table.names == ["t", "x", "note"] and table.first_row == 1 and table.frame["x"].tolist() == [1, 2]
    monkeypatch.setattr(text_table, "LARGEST_TABLE", 3)
    with pytest.raises(InputError, match="2 rows"):
        read_parquet(path, {"x", "t"})
    assert len(read_parquet(path, {"t"}).frame) == 2
    with pytest.raises(InputError, match="can't be read"):
        read_parquet(_file(tmp_path, b"PAR1 no", "b.parquet"), {"t"})


def _column(values, dtype=None, first=0):
    return pd.Series(values, dtype=dtype, index=range(first, first + len(values)))


def test_numbers_in_any_type_and_nothing_where_nothing_is():
    for column in (_column([1, 2]), _column([1.0, None]), _column(["1", None], object), _column([1, None], "Int64")):
        values, faults = numbers(column, "x", 1)
        assert faults == [] and values.dtype == float and values[0] == 1.0
        assert np.isnan(values[1]) == bool(column.isna()[1])


@pytest.mark.parametrize(
    ("column", "words"),
    [
        (_column(["1", "1_0"], object), "text '1_0' in row 8"),
        (_column(["a" * 99, "1"], object), f"text '{'a' * 60}' in row 7"),
        (_column([1.0, True], object), "text 'True' in row 8"),
        (_column([[1.0], 2.0], object), "text '[1.0]' in row 7"),
        (_column([np.array([1.0]), 2.0], object), "in row 7"),
        (_column(["1", 10**400], object), "an infinite value in row 8 (1 such rows)"),
        (_column([np.inf, -np.inf]), "an infinite value in row 7 (2 such rows)"),
        (_column([np.nan, np.nan]), "no value at all"),
        (_column([True, False]), "values of type bool"),
        (_column(pd.to_datetime(["2020-01-01", "2020-01-02"])), "values of type datetime64"),
    ],
)
def test_what_is_no_number_is_told_by_its_row(column, words):
    column.index = range(5, 7)
    values, (fault,) = numbers(column, "x", 2)
    assert words in fault.got and fault.where == "x" and len(values) == 2


def test_a_column_that_occurs_twice_is_none():
    twice = pd.DataFrame([[1.0, 2.0]], columns=["x", "x"])
    values, (fault,) = numbers(twice["x"], "x", 2)
    assert values.size == 0 and "twice" in fault.got
