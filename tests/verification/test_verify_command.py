"""`bayeschute verify`: exit codes, table, JSON, and what its help must not import."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from bayeschute.cli import app
from bayeschute.verification import all_cases
from bayeschute.verification.case_results import all_members

ROOT = Path(__file__).parents[2]


@pytest.fixture
def stand_ins(monkeypatch):
    """Cases that take no time: 1 passes, 2 fails, others would be noticed."""

    def case(name, error):
        return lambda: all_members(name, "error", "nothing", "ft/s", [[error]] * 4, 1e-3)

    monkeypatch.setattr(all_cases, "RUNS", {"1": case("1", 1e-5), "2": case("2", float("nan"))})


def test_all_well_is_exit_code_0(stand_ins, tmp_path):
    out = tmp_path / "verify.json"
    result = CliRunner().invoke(app, ["verify", "--case", "1", "--json", str(out)])
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    assert lines[0].split()[:2] == ["case", "set"]
    assert sum(line.endswith("pass") for line in lines) == 4
    assert lines[-1].startswith("1 of 1 cases passed, in ")
    assert json.loads(out.read_text())["passed"] is True


def test_a_failed_case_is_exit_code_1_and_json_holds_no_nan(stand_ins):
    result = CliRunner().invoke(app, ["verify", "--case", "1", "--case", "2", "--json", "-"])
    assert result.exit_code == 1
    told = json.loads(result.stdout)
    assert told["passed"] is False
    assert [case["passed"] for case in told["cases"]] == [True, False]
    assert [r["error"] is None for r in told["results"]] == [False] * 4 + [True] * 4


@pytest.mark.parametrize(
    "arguments, words",
    [(["--case", "15"], "got no such case"), (["--json", "/nowhere/x.json"], "folder that exists")],
)
def test_bad_input_is_exit_code_2(arguments, words):
    result = CliRunner().invoke(app, ["verify", *arguments])
    assert result.exit_code == 2
    assert words in result.stderr


@pytest.mark.parametrize("arguments", [["verify", "--help"], ["verify", "--case", "15"]])
def test_help_and_wrong_names_import_neither_jax_nor_numpy(arguments):
    code = f"""
import sys
sys.argv = ['bayeschute', *{arguments!r}]
from bayeschute.cli import main
try:
    main()
except SystemExit as stop:
    assert stop.code in (0, 2), stop.code
print([name for name in ('jax', 'numpy', 'scipy', 'matplotlib') if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "[]"
