"""The door for the shell: exit codes, words, and what it must not import."""

from __future__ import annotations

import subprocess
import sys
import types
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from bayeschute import __version__
from bayeschute.cli import app
from bayeschute.console import Bars
from bayeschute.core.errors import Fault, InputError
from bayeschute.study.templates import NAMES, copy_templates

ROOT = Path(__file__).parents[1]
STUDY = ROOT / "models/studies/cdt-3-11.toml"


@pytest.fixture
def stages(monkeypatch: pytest.MonkeyPatch) -> types.ModuleType:
    """A stand-in for the stages, to see what they are given and to let them fail; the real ones: tests/acceptance."""
    module = types.ModuleType("bayeschute.study.run.stages")
    monkeypatch.setitem(sys.modules, module.__name__, module)
    return module


def _python(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, cwd=ROOT)


@pytest.mark.parametrize(
    "arguments",
    [["--help"], ["check", str(STUDY)], ["check", str(ROOT / "models/studies/halcyon.toml")], ["run", "--help"]],
)
def test_help_and_check_import_neither_jax_nor_matplotlib(arguments: list[str]):
    code = f"""
import sys
sys.argv = ['bayeschute', *{arguments!r}]
from bayeschute.cli import main
try:
    main()
except SystemExit as stop:
    assert stop.code in (0, 2), stop.code
print([name for name in ('jax', 'matplotlib', 'numpyro') if name in sys.modules])
"""
    done = _python(code)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "[]"


def test_help_imports_nothing_slow():
    done = _python("import sys, bayeschute.cli; print([n for n in ('numpy', 'pydantic', 'pint') if n in sys.modules])")
    assert done.stdout.strip() == "[]", done.stderr


def test_reading_studies_and_records_sets_up_no_jax():
    modules = "bayeschute.cli, bayeschute.study.schema.study_schema, bayeschute.study.load, bayeschute.records.read"
    done = _python(
        f"import sys, {modules}; print([n for n in ('jax', 'bayeschute.core.numerics') if n in sys.modules])"
    )
    assert done.stdout.strip() == "[]", done.stderr


def test_the_package_is_run_as_a_module_too():
    done = subprocess.run(
        [sys.executable, "-m", "bayeschute", "--help"], capture_output=True, text=True, timeout=60, cwd=ROOT
    )
    assert done.returncode == 0 and "Usage: python -m bayeschute [OPTIONS] COMMAND" in done.stdout, done.stderr


def test_version():
    result = CliRunner().invoke(app, ["--version"])
    assert result.exit_code == 0
    assert result.stdout.strip() == f"bayeschute {__version__}"


def test_check_of_a_sound_study():
    result = CliRunner().invoke(app, ["check", str(STUDY)])
    assert result.exit_code == 0
    assert result.stdout.strip() == f"{STUDY}: no fault found"


@pytest.mark.parametrize(
    "arguments",
    [["frob"], ["check"], ["run", "x.toml", "--until", "tea"], ["simulate", "x.toml"], ["run", "--seed", "-1"]],
)
def test_a_wrong_command_line_is_exit_code_2(arguments: list[str]):
    assert CliRunner().invoke(app, arguments).exit_code == 2


def test_run_hands_everything_on(stages: types.ModuleType, tmp_path: Path):
    seen: dict[str, Any] = {}

    def run_study(path: Path, out: Path, **options: Any) -> dict[str, Any]:
        seen.update(path=path, out=out, **options)
        out.mkdir(exist_ok=True)
        (out / "report.html").touch()
        options["progress"]("fit", 1.0, "done")
        return {}

    stages.run_study = run_study  # type: ignore[attr-defined]
    out = tmp_path / "out"
    options = ["--out", str(out), "--resume", "--quick", "--seed", "7", "--data", str(tmp_path), "--workers", "3"]
    result = CliRunner().invoke(app, ["run", str(STUDY), *options])
    assert result.exit_code == 0, result.output
    assert isinstance(seen.pop("progress"), Bars)
    assert seen == {
        "path": STUDY, "out": out, "until": None, "resume": True, "quick": True, "data_dir": tmp_path, "seed": 7,
        "workers": 3, "address": None, "force": False,
    }  # fmt: skip
    assert str(out / "report.html") in result.stdout
    assert "the results are not for use" in result.stdout


def test_replicates_that_missed_their_promise_are_told_and_no_failure_of_the_run(
    stages: types.ModuleType, tmp_path: Path
):
    summary = {
        "label": "not checked: why",
        "claim": {"sentences": ["Landings are not promised."]},
        "checks": {"r_hat": {"passed": True}, "calibration": {"passed": False}},
    }
    stages.run_study = lambda *_, **__: summary  # type: ignore[attr-defined]
    result = CliRunner().invoke(app, ["run", str(STUDY), "--out", str(tmp_path)])
    assert result.exit_code == 0 and "Intervals: not checked: why\n  Landings are" in result.stdout


def test_a_failed_check_of_the_result_is_exit_code_1(stages: types.ModuleType, tmp_path: Path):
    summary = {"checks": {"r_hat": {"passed": False}, "coverage": {"passed": True}, "truth": {"passed": None}}}
    stages.run_study = lambda *_, **__: summary  # type: ignore[attr-defined]
    result = CliRunner().invoke(app, ["run", str(STUDY), "--out", str(tmp_path)])
    assert result.exit_code == 1
    assert "Failed checks: r_hat." in result.stderr
    until = CliRunner().invoke(app, ["run", str(STUDY), "--out", str(tmp_path), "--until", "fit"])
    assert until.exit_code == 0


def test_a_fit_that_failed_is_exit_code_1(stages: types.ModuleType, tmp_path: Path):
    summary = {"label": "no fit", "fit": {"converged": False, "reason": "lost\nat 3 s", "tried": ["one", "two"]}}
    stages.run_study = lambda *_, **__: summary  # type: ignore[attr-defined]
    arguments = ["run", str(STUDY), "--out", str(tmp_path)]
    for more in ([], ["--quick"], ["--until", "fit"], ["--until", "risk"]):
        result = CliRunner().invoke(app, [*arguments, *more])
        assert result.exit_code == 1
        assert result.stderr.splitlines()[-3:] == ["No fit: lost at 3 s", "Tried: one", "Tried: two"]
        assert f"Report: {tmp_path / 'report.html'}" in result.stdout
    assert CliRunner().invoke(app, [*arguments, "--until", "priors"]).exit_code == 0


def test_flights_without_bands_are_told(stages: types.ModuleType, tmp_path: Path):
    check = {"passed": False, "value": 1, "bound": 0, "detail": "flights without bands because of this: a"}
    summary = {"checks": {"bands": check}}
    stages.run_study = lambda *_, **__: summary  # type: ignore[attr-defined]
    result = CliRunner().invoke(app, ["run", str(STUDY), "--out", str(tmp_path)])
    assert "Failed check: flights without bands because of this: a." in result.stderr.splitlines()


def test_a_run_that_is_stopped_says_how_to_go_on(stages: types.ModuleType, tmp_path: Path):
    def run_study(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    stages.run_study = run_study  # type: ignore[attr-defined]
    result = CliRunner().invoke(app, ["run", str(STUDY), "--out", str(tmp_path)])
    assert result.exit_code == 130
    assert f"--out {tmp_path} --resume` goes on; it keeps finished stages" in result.stderr
    options = ["--quick", "--until", "fit", "--seed", "3", "--workers", "2"]
    result = CliRunner().invoke(app, ["run", str(STUDY), "--out", str(tmp_path), *options])
    assert f"--out {tmp_path} --resume --quick --until fit --seed 3 --workers 2` goes on" in result.stderr


def test_faults_found_late_are_told_line_by_line(stages: types.ModuleType, tmp_path: Path):
    def run_study(*_: object, **__: object) -> None:
        raise InputError([Fault("a", "b\nb", "c"), Fault("d", "e", "f")])

    stages.run_study = run_study  # type: ignore[attr-defined]
    result = CliRunner().invoke(app, ["run", str(STUDY), "--out", str(tmp_path)])
    assert result.exit_code == 2
    assert result.stderr.splitlines()[-2:] == ["a: got b b; wanted c.", "d: got e; wanted f."]


def test_out_must_not_be_a_file(tmp_path: Path):
    (tmp_path / "x").touch()
    for command in ("run", "simulate"):
        result = CliRunner().invoke(app, [command, str(STUDY), "--out", str(tmp_path / "x")])
        assert result.exit_code == 2
        assert "got a file" in result.stderr


def test_simulate_takes_a_study(tmp_path: Path):
    copy_templates(tmp_path)
    study = tmp_path / "virtual.toml"
    study.write_text(study.read_text(encoding="utf-8").replace('"90 s"', '"10 s"'), encoding="utf-8")
    arguments = ["simulate", str(study), "--out", str(tmp_path / "f"), "--draws", "3", "--seed", "3"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert len(list((tmp_path / "f").iterdir())) == 2 * 2 * 3
    lines = result.stdout.splitlines()
    assert [Path(line).name for line in lines[:2]] == ["cdt-3-11.00000.nc", "cdt-3-11.00000.truth.nc"]
    assert lines[-3:-1] == [f"and 2 more in {tmp_path / 'f'}", "Outcome: ok 6"]
    assert lines[-1].startswith("Integration error of drops that are ok: up to ")


def test_simulate_takes_a_vehicle_and_tells_of_drops_that_failed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    from bayeschute.study.run.simulate import Drops

    copy_templates(tmp_path)
    seen = []

    def simulate_study(study: object, out: Path, **options: object) -> Drops:
        wanted = [options[key] for key in ("draws", "seed", "workers", "address")]
        seen.append((study.vehicle_path.name, *wanted))  # type: ignore[attr-defined]
        return Drops([out / "x.nc"], {"ok": 1, "ill-posed": 1}, {"y": "ill-posed at 0.0 s"}, (1e-5, 1e-4))

    monkeypatch.setattr("bayeschute.study.run.simulate.simulate_study", simulate_study)
    arguments = [
        "simulate",
        str(tmp_path / "vehicle.toml"),
        "--out",
        str(tmp_path / "f"),
        "--draws",
        "12",
        "--seed",
        "3",
        "--workers",
        "2",
        "--dask",
        "tcp://x:1",
    ]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 1, result.output
    assert result.stdout.splitlines()[-2] == "Outcome: ok 1, ill-posed 1"
    assert result.stderr.splitlines()[-1] == "y: ill-posed at 0.0 s"
    assert seen == [("vehicle.toml", 12, 3, 2, "tcp://x:1")]


def test_simulate_needs_something_virtual(tmp_path: Path):
    copy_templates(tmp_path)
    (tmp_path / "my-descent.csv").write_text("time_s,altitude_m\n0,1\n", encoding="utf-8")
    result = CliRunner().invoke(app, ["simulate", str(tmp_path / "descent.toml"), "--out", str(tmp_path / "f")])
    assert result.exit_code == 2
    assert "[flight.virtual]" in result.stderr


def test_init_then_init_again(tmp_path: Path):
    assert CliRunner().invoke(app, ["init", str(tmp_path)]).exit_code == 0
    again = CliRunner().invoke(app, ["init", str(tmp_path)])
    assert again.exit_code == 2
    assert len(again.stderr.splitlines()) == len(NAMES)


def test_report_of_no_run(tmp_path: Path):
    for folder in (tmp_path / "nowhere", tmp_path):
        result = CliRunner().invoke(app, ["report", str(folder)])
        assert result.exit_code == 2
        assert "Traceback" not in result.output
