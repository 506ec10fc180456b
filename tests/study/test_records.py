"""The bad records of issue 2: one clear message each, from `check` and from `run`, and nothing written."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from typer.testing import CliRunner

from bayeschute.cli import app

RECORD = "time_s,altitude_m\n" + "".join(f"{i},{1000 - 5 * i}\n" for i in range(200))
GOOD = RECORD.splitlines()


def _with_row(row: int, text: str) -> bytes:
    return "\n".join([*GOOD[:row], text, *GOOD[row + 1 :]]).encode()


RECORDS = [
    (RECORD.replace("altitude_m", "height_m").encode(), "[columns.altitude]", "'altitude_m', which", "a column of"),
    (_with_row(40, "39,high"), "column 'altitude_m'", "'high' in row 41", "numbers"),
    (_with_row(40, "12,800"), "column 'time_s'", "backward", "increase"),
    (_with_row(40, "38,800"), "column 'time_s'", "repeated", "increase"),
    (
        ("time_s,altitude_m\n" + "".join(f"{i},\n" for i in range(99))).encode(),
        "'altitude_m'",
        "no value",
        "one number",
    ),
    (b"", "my-descent.csv", "an empty file", "a record"),
    (os.urandom(4000) + b"\0", "my-descent.csv", "binary data", "text"),
    (b"\n".join(line.encode() for line in GOOD[:5]), "my-descent.csv", "4 rows", "at least 10"),
]


@pytest.mark.parametrize("command", ["check", "run"])
@pytest.mark.parametrize(("content", "where", "got", "wanted"), RECORDS)
def test_a_bad_record_is_one_message_and_exit_code_2(
    descent: Path, command: str, content: bytes, where: str, got: str, wanted: str
):
    (descent.parent / "my-descent.csv").write_bytes(content)
    _is_refused(descent, command, where, got, wanted)


SPOILT = [
    ('unit = "m" }', 'unit = "kg" }', "descent.toml [columns.altitude] unit", "'kg'", "to m"),
    ("seed = 1", "seed = 1\nseeds = 2", "descent.toml seeds", "unknown key", "one of title"),
    ('vertical = "0.5 m/s"', 'vertical = "-0.5 m/s"', "descent.toml [noise.wind] vertical", "'-0.5 m/s'", "> 0 m/s"),
    ("log_sd = 0.5 }", "log_sd = -0.5 }", "[priors.given.cds_over_mass] log_sd", "-0.5", "> 0"),
    (
        "skip_first = ",
        'window = ["0 s", "500 s"]\nskip_first = ',
        "my-descent.csv",
        "0 to 199 s",
        "the window 0 to 500",
    ),
]


@pytest.mark.parametrize("command", ["check", "run"])
@pytest.mark.parametrize(("old", "new", "where", "got", "wanted"), SPOILT)
def test_a_bad_study_is_one_message_and_exit_code_2(
    descent: Path, command: str, old: str, new: str, where: str, got: str, wanted: str
):
    text = descent.read_text(encoding="utf-8")
    assert old in text
    descent.write_text(text.replace(old, new, 1), encoding="utf-8")
    _is_refused(descent, command, where, got, wanted)


def _is_refused(study: Path, command: str, where: str, got: str, wanted: str) -> None:
    """One line on stderr with where, got and wanted; exit code 2; nothing made or changed on the disk."""
    out = study.parent / "out"
    before = {path: path.read_bytes() for path in study.parent.rglob("*") if path.is_file()}
    arguments = [command, str(study)] + (["--out", str(out)] if command == "run" else [])
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2
    lines = result.stderr.splitlines()
    assert len(lines) == 1, result.stderr
    place, _, rest = lines[0].partition(": got ")
    assert where in place
    assert got in rest
    assert wanted in rest.partition("; wanted ")[2]
    assert result.stdout == ""
    assert {path: path.read_bytes() for path in study.parent.rglob("*") if path.is_file()} == before
    assert not out.exists()
