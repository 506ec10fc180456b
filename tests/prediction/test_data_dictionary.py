"""The data dictionary: a column's own meaning before the common one, and none that nobody explained."""

from __future__ import annotations

import pytest

from bayeschute.core.errors import InputError
from bayeschute.prediction.data_dictionary import COLUMNS, OWN_UNIT, data_dictionary
from bayeschute.prediction.flight_statistics import MEANINGS, STATISTICS


def told(file, column, units=None):
    """Unit and meaning of one column."""
    (row,) = data_dictionary({file: [column]}, units or {}).itertuples(index=False)
    assert (row.file, row.column) == (file, column)
    return row.unit, row.meaning


def test_rows_are_in_the_order_of_files_and_columns():
    table = data_dictionary({"b.csv": ["run", "draw"], "a.csv": ["run"]}, {})
    assert list(map(tuple, table[["file", "column"]].to_numpy())) == [
        ("b.csv", "run"),
        ("b.csv", "draw"),
        ("a.csv", "run"),
    ]
    assert list(table.columns) == ["file", "column", "unit", "meaning"]


def test_a_file_s_own_meaning_goes_before_the_common_one():
    assert told("requirements.json", "draws") == ("1", "draws of the parameters")
    assert "including those whose simulation failed" in told("exceedance.csv", "draws")[1]
    assert "one-sided" in told("tolerance.csv", "confidence")[1] and "level" in told("exceedance.csv", "confidence")[1]
    assert told("draws_units.csv", "unit") == ("-", "its unit")
    assert told("marginals.csv", "unit") == ("-", "unit of the values in this row")
    assert told("marginals.csv", "mean")[0] == OWN_UNIT == told("exceedance.parquet", "threshold")[0]


def test_columns_of_parameters_have_their_units_among_draws_and_none_among_correlations():
    units = {"riser_length": "m"}
    assert told("draws.csv", "riser_length", units)[0] == "m" and told("draws.csv", "axial[1]", units)[0] == "1"
    assert told("correlation.csv", "riser_length", units) == ("1", "correlation with riser_length")


def test_quantities_at_the_end_of_the_record_have_their_unit_and_meaning():
    for name, meaning in MEANINGS.items():
        assert told("end_of_record.parquet", name, {name: "x"}) == ("x", f"{meaning}, {STATISTICS['final']}")
        assert told("end_of_record.parquet", name)[0] == "1"


def test_every_file_is_explained_column_by_column():
    table = data_dictionary({f"{stem}.csv": list(columns) for stem, columns in COLUMNS.items()}, {})
    assert len(table) == sum(map(len, COLUMNS.values())) and (table.meaning.str.len() > 4).all()


@pytest.mark.parametrize(
    ("file", "column"),
    [("exceedance.csv", "descent_rate"), ("marginals.csv", "riser_length"), ("tolerance.csv", "threshold")],
)
def test_a_name_known_elsewhere_is_not_known_here(file, column):
    with pytest.raises(InputError, match=file):
        told(file, column, {column: "m"})


def test_a_column_that_nobody_explained_is_refused():
    with pytest.raises(InputError, match="a column whose meaning is stated"):
        data_dictionary({"tolerance.csv": ["limit", "mystery"]}, {})
