"""Rows of campaigns: what is written is read, by us and by pandas; what is no row is told."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from bayeschute.calibration.replicate_rows import entries, read_rows, row_of, write_row
from bayeschute.core.errors import InputError


def row(seed: int) -> dict[str, Any]:
    """Everything that a row may hold, in names that JSON pointers have to escape too."""
    return {
        "seed": seed,
        "ok": True,
        "parameters": {"axial[alpha^2]": {"mean": 0.1 + 0.2, "inside": {"90": True}}, "a/b~c": {"mean": -1e-300}},
        "bands": {"cdt-3-12": {"swing_angle": {"crps": 3, "by_time": {}}}},
        "missed_checks": ["rhat", {"0": [1.5, []]}],
        "left_out": [],
        "pareto_k": None,
        "says": 'a "text"\n of two lines',
    }


def test_what_is_written_is_read(tmp_path: Path):
    for seed in (7, 5):
        write_row(tmp_path, "a", row(seed))
    assert read_rows(tmp_path, "a") == {5: row(5), 7: row(7)} == read_rows(tmp_path)
    assert list(read_rows(tmp_path)[5]) == list(row(5))  # in their order
    assert row_of(entries(row(5))) == row(5)
    assert read_rows(tmp_path / "not there", "a") == {}


def test_pandas_reads_a_folder_as_one_table(tmp_path: Path):
    for seed in (7, 5):
        write_row(tmp_path, "a", row(seed))
    write_row(tmp_path, "a", {"seed": 6, "ok": False, "error": "no flight"})
    (tmp_path / ".8.0a1b2c.part.parquet").write_bytes(b"cut")  # what a kill leaves
    table = pd.read_parquet(tmp_path)
    assert set(read_rows(tmp_path)) == {5, 6, 7}
    assert list(table) == ["seed", "entry", "value", "text"]
    means = table[table.entry.str.fullmatch("/parameters/.*/mean")].pivot(index="seed", columns="entry", values="value")
    assert means.loc[7, "/parameters/axial[alpha^2]/mean"] == 0.1 + 0.2
    assert means.loc[5, "/parameters/a~1b~0c/mean"] == -1e-300
    ok = table[table.entry == "/ok"].set_index("seed").value
    assert dict(ok) == {5: 1.0, 6: 0.0, 7: 1.0}
    (error,) = table[table.entry == "/error"].itertuples()
    assert math.isnan(error.value) and error.text == '"no flight"'


def test_a_row_written_again_takes_the_place_of_the_first(tmp_path: Path):
    write_row(tmp_path, "a", {"seed": 1, "ok": False})
    write_row(tmp_path, "a", {"seed": 1, "ok": True})
    assert read_rows(tmp_path, "a") == {1: {"seed": 1, "ok": True}}
    assert [path.name for path in tmp_path.iterdir()] == ["1.parquet"]


def test_files_that_are_no_rows_and_rows_of_other_campaigns_are_told_at_once(tmp_path: Path):
    write_row(tmp_path, "mine", row(1))
    for seed in (2, 3):
        write_row(tmp_path, "other", row(seed))
    (tmp_path / "4.parquet").write_bytes(b"cut by a full disk")
    pq.write_table(pa.table({"x": [1.0]}), tmp_path / "5.parquet")
    pq.write_table(pq.read_table(tmp_path / "1.parquet").slice(1), tmp_path / "6.parquet")  # without its seed
    with pytest.raises(InputError) as caught:
        read_rows(tmp_path, "mine")
    said = str(caught.value)
    assert len(caught.value.faults) == 4 and "2 rows of campaign other" in said and "rows of campaign mine" in said
    assert all(
        f"{number}.parquet: a file that is no row" in said or f"{number}.parquet" in said for number in (4, 5, 6)
    )
    assert "made again" in said and "another --out" in said
