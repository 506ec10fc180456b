"""Files of numbers beside a study: found from its folder or the data folder, in SI, all faults at once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError, ValidationInfo, model_validator

from bayeschute.study.schema.reading.strict import Strict
from bayeschute.study.schema.sidecar import Wanted, context, read_beside

WANTED = {"time": Wanted("t", "min", "s"), "height": Wanted("h", "ft", "m"), "more": Wanted("x", "", "", True)}
seen: dict[str, Any] = {}


class Named(Strict):
    file: str

    @model_validator(mode="after")
    def _read(self, info: ValidationInfo) -> Named:
        seen["found"] = read_beside(self.file, WANTED, info)
        return self


def read(folder: Path, name: str, data: str | None = None):
    Named.model_validate({"file": name}, context=context(folder, data))
    return seen["found"]


def test_columns_come_out_in_si_and_optional_ones_may_be_missing(tmp_path: Path):
    (tmp_path / "a.csv").write_text("h,t\n100,0\n200,1\n", encoding="utf-8")
    found = read(tmp_path, "a.csv")
    assert set(found) == {"time", "height"}
    np.testing.assert_allclose(found["time"], [0.0, 60.0])
    np.testing.assert_allclose(found["height"], [30.48, 60.96])


def test_a_name_may_begin_in_the_data_folder(tmp_path: Path):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "a.csv").write_text("h,t,x\n1,0,7\n", encoding="utf-8")
    assert read(tmp_path / "elsewhere", "${DATA}/a.csv", str(tmp_path / "data"))["more"].tolist() == [7.0]


def test_a_relative_data_folder_is_that_of_the_command_not_of_the_study(tmp_path: Path, monkeypatch):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "a.csv").write_text("h,t,x\n1,0,7\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert read(tmp_path / "elsewhere", "${DATA}/a.csv", "data")["more"].tolist() == [7.0]
    monkeypatch.setenv("BAYESCHUTE_DATA", "data")
    assert read(tmp_path / "elsewhere", "${DATA}/a.csv")["more"].tolist() == [7.0]


def test_all_faults_of_a_file_are_told_in_one(tmp_path: Path):
    (tmp_path / "a.csv").write_text("t,y\n0,1\nx,2\n", encoding="utf-8")
    with pytest.raises(ValidationError) as error:
        read(tmp_path, "a.csv")
    said = error.value.errors()[0]["ctx"]["got"]
    assert "column 't'" in said and "column 'h'" in said and "no such column" in said


@pytest.mark.parametrize("name", ["b.csv", ".", "x" * 5000, "\0"])
def test_no_file_is_told_as_such(tmp_path: Path, name: str):
    with pytest.raises(ValidationError) as error:
        read(tmp_path, name)
    assert "no such file" in error.value.errors()[0]["ctx"]["got"]
