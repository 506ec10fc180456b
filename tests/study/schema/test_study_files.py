"""Files of a study: TOML that can be read, records that are there, and what stands for `${DATA}`."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from bayeschute.study.schema import study_files as module
from bayeschute.study.schema.draft import Draft
from bayeschute.study.schema.study_files import read_toml, record_paths


@pytest.fixture(autouse=True)
def no_data(monkeypatch):
    monkeypatch.delenv("BAYESCHUTE_DATA", raising=False)


def draft(*files):
    flights = {i: SimpleNamespace(file=file) for i, file in enumerate(files)}
    raw = {"flight": [{"name": f"flight {i}"} for i in range(len(files))]}
    return Draft("x.toml", raw, {}, flights)


def told(faults):
    return [f"{fault.where}|{fault.got}|{fault.wanted}|{fault.do}" for fault in faults]


def test_content_and_text_of_a_sound_file(tmp_path):
    path = tmp_path / "a.toml"
    path.write_bytes(b"\xef\xbb\xbfa = 1\r\n")
    assert read_toml(path) == ({"a": 1}, "a = 1\r\n", [])


def test_a_file_may_be_as_large_as_the_limit_and_no_larger(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "LARGEST", 5)
    path = tmp_path / "a.toml"
    path.write_text("a = 1")
    assert read_toml(path)[0] == {"a": 1}
    path.write_text("a = 12")
    (fault,) = read_toml(path)[2]
    assert fault.got == "6 bytes" and fault.wanted == "a TOML file of at most 5 bytes"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"a == 1", "line 1"),
        (b"\xff\xfe", "bytes that are no UTF-8 text"),
        (b"a = " + b"[" * 50_000, "brackets nested too deep"),
        (b"a = 1" + b"0" * 5000, "a value that can't be read"),
    ],
)
def test_a_file_that_is_no_toml_is_told(tmp_path, content, words):
    path = tmp_path / "a.toml"
    path.write_bytes(content)
    found, text, faults = read_toml(path)
    assert found is None and text == "" and len(faults) == 1
    assert words in told(faults)[0] and str(path) in faults[0].where and len(faults[0].got) <= 200


def test_what_is_no_file_is_told(tmp_path, monkeypatch):
    assert [read_toml(path)[2][0].got for path in (tmp_path, tmp_path / "b")] == ["a folder", "no such file"]
    path = tmp_path / "a.toml"
    path.write_text("a = 1")

    def locked(self):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(module.Path, "read_bytes", locked)
    assert read_toml(path)[2][0].got == "a file that can't be read (Permission denied)"


def test_records_are_beside_the_study_and_must_have_content(tmp_path):
    (tmp_path / "a.csv").write_text("x")
    (tmp_path / "empty.csv").write_text("")
    (tmp_path / "sub").mkdir()
    paths, faults = record_paths(
        draft("a.csv", "none.csv", "empty.csv", "sub/../a.csv", None, "sub", "a\0b"), tmp_path, None
    )
    assert paths == {0: tmp_path / "a.csv", 3: tmp_path / "a.csv"}
    first, second, third, fourth = told(faults)
    assert "flight 1" in first and f"no such file {tmp_path / 'none.csv'}" in first
    assert second.startswith(f"{tmp_path / 'empty.csv'}|an empty file|a record")
    assert "flight 5" in third and "no such file" in third  # a folder is no record
    assert "flight 6" in fourth


def test_a_folder_stands_for_data(tmp_path, monkeypatch):
    (tmp_path / "d").mkdir()
    (tmp_path / "d" / "a.csv").write_text("x")
    asked, found = draft("${DATA}/a.csv"), {0: tmp_path / "d" / "a.csv"}
    assert record_paths(asked, tmp_path, tmp_path / "d") == (found, [])
    monkeypatch.setenv("BAYESCHUTE_DATA", str(tmp_path / "d"))
    assert record_paths(asked, tmp_path, None) == (found, [])
    (fault,) = record_paths(asked, tmp_path, tmp_path / "other")[1]
    assert fault.got == "no such folder" and "other" in fault.where and "--data DIR" in fault.do


def test_a_missing_data_folder_is_told_once_and_other_records_are_found(tmp_path):
    (tmp_path / "a.csv").write_text("x")
    paths, faults = record_paths(draft("a.csv", "${DATA}/b.csv", "${DATA}/c.csv"), tmp_path, None)
    assert paths == {0: tmp_path / "a.csv"} and len(faults) == 1
    assert "flight 1" in faults[0].where and "'${DATA}/b.csv' and no data folder" in faults[0].got
    (fault,) = record_paths(draft("none.csv"), tmp_path, tmp_path / "nowhere")[1]  # nothing asks for the folder
    assert "none.csv" in fault.got
