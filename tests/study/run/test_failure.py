"""A fit that fails: what is kept, what is told, and that it can be tried again."""

from __future__ import annotations

import json
import shutil
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from bayeschute.cli import app
from bayeschute.core.errors import FitError
from bayeschute.core.trees import load_tree
from bayeschute.posterior.best_path import BestPath
from bayeschute.study.run import stage_fit, stage_list
from bayeschute.study.run.stages import run_study

REASON = "the flight of low did not come to rest within 40 steps; look at the wind."
TRIED = ("from the prior means: lost at 31 s", "along the record: defects of 3.1 left")


def _error() -> FitError:
    time = np.arange(80.0)
    residual = np.stack([0.3 * np.sin(time), 4.0 * np.cos(time)], axis=1)
    residual[10:20, 0] = np.nan
    outputs = ("descent_rate", "capsule_velocity.east")
    path = BestPath("low", time, outputs, residual, np.array([0.3, 0.5]), np.abs(np.sin(time[1:])))
    return FitError(REASON, TRIED, (path,), (("cds_over_mass[low]", 0.151, 0.004, "m^2/kg"), ("odd", 1.0, np.nan, "1")))


def _raise(error: Exception) -> Callable[..., None]:
    def fails(*given: object, **named: object) -> None:
        raise error

    return fails


@pytest.fixture
def failed(descents, tmp_path: Path, monkeypatch) -> Path:
    """A run whose fit failed."""
    with monkeypatch.context() as patch:
        patch.setattr(stage_list, "fit", _raise(_error()))
        run_study(descents.study, tmp_path / "run")
    return tmp_path / "run"


def test_what_is_known_all_the_same_is_kept(failed: Path):
    summary = json.loads((failed / "summary.json").read_text(encoding="utf-8"))
    assert summary["label"] == "no fit" and summary["seed"] == 4 and summary["title"] == "Two made-up sondes"
    assert {"bayeschute", "python"} <= set(summary["versions"]) and set(summary["hashes"]) == {"study", "run"}
    assert set(summary["flights"]) == {"low", "high"} and "parameters" not in summary
    fit = summary["fit"]
    assert fit["converged"] is False and fit["reason"] == REASON and fit["tried"] == list(TRIED)
    rms = fit["residuals"]["low"]["capsule_velocity.east"]
    assert rms["noise"] == 0.5 and rms["samples"] == 80 and rms["rms"] == pytest.approx(4.0 / np.sqrt(2.0), rel=0.02)
    assert fit["residuals"]["low"]["descent_rate"]["samples"] == 70
    facts = json.loads((failed / "fit/failed.json").read_text(encoding="utf-8"))
    assert [row["name"] for row in facts["parameters"]] == ["cds_over_mass[low]", "odd"]
    assert facts["parameters"][1]["standard_error"] is None
    assert {key: facts[key] for key in ("reason", "tried", "residuals")} == {
        key: fit[key] for key in ("reason", "tried", "residuals")
    }
    (path,) = load_tree(failed / "fit/failed.npz", tuple[BestPath, ...])
    assert path.flight == "low" and path.residual.shape == (80, 2)
    assert {marker.name for marker in (failed / ".stages").iterdir()} == {"ingest", "structure", "priors"}
    assert not list(failed.rglob(".*.part*"))


def test_the_log_tells_of_it(failed: Path):
    lines = (failed / "log.txt").read_text(encoding="utf-8").splitlines()
    assert "sondes.toml: Two made-up sondes" in lines[0]
    stages = dict.fromkeys(line.split()[4] for line in lines[1:])
    assert list(stages) == ["ingest", "structure", "priors", "fit"]
    assert lines[-1].endswith(f"failed: {REASON}")


def test_the_report_is_built_again_from_what_was_kept(failed: Path):
    before = (failed / "report.html").read_text(encoding="utf-8")
    (failed / "report.html").unlink()
    result = CliRunner().invoke(app, ["report", str(failed)])
    assert result.exit_code == 0, result.output
    assert (failed / "report.html").read_text(encoding="utf-8") == before


def test_it_can_be_tried_again(failed: Path, finished, descents):
    told = []
    summary = run_study(descents.study, failed, until="fit", resume=True, progress=lambda *said: told.append(said))
    assert ("priors", 1.0, "kept from an earlier run") in told and summary == {}
    assert not list((failed / "fit").glob("failed.*")) and not (failed / "report.html").exists()
    with np.load(failed / "fit/low.npz") as a, np.load(finished.folder / "fit/low.npz") as b:
        assert a["xi"].tobytes() == b["xi"].tobytes()


def test_a_fit_that_fails_takes_away_what_an_earlier_one_left(finished, descents, tmp_path: Path, monkeypatch):
    folder = Path(shutil.copytree(finished.folder, tmp_path / "run"))
    (folder / ".stages/fit").unlink()
    monkeypatch.setattr(stage_list, "fit", _raise(FitError("no")))
    summary = run_study(descents.study, folder, resume=True)
    assert summary["label"] == "no fit" and summary["fit"]["residuals"] == {} and "checks" not in summary
    assert "No trajectory came close to the data" in (folder / "report.html").read_text(encoding="utf-8")
    assert not (folder / ".stages/report").exists()


@pytest.mark.parametrize("kind", [FloatingPointError, np.linalg.LinAlgError])
def test_simulations_that_are_not_finite_are_no_fault_of_the_input(descents, tmp_path: Path, monkeypatch, kind):
    monkeypatch.setattr(stage_fit, "_found", _raise(kind("the simulation at the start is not finite")))
    fit = run_study(descents.study, tmp_path / "run", until="fit")["fit"]
    assert fit["reason"].startswith("fit of low: the simulation at the start is not finite; look at priors.json")
    assert fit["tried"] == ["low: the simulation at the start is not finite"]


def test_draws_that_fail_are_a_fit_that_failed(descents, tmp_path: Path, monkeypatch):
    monkeypatch.setattr(stage_list, "fit", _raise(FloatingPointError("no draw has a density")))
    assert run_study(descents.study, tmp_path / "run")["fit"]["reason"] == "no draw has a density"


def test_another_stage_has_no_fit_to_fail(descents, tmp_path: Path, monkeypatch):
    monkeypatch.setattr(stage_list, "priors", _raise(FitError("not here")))
    with pytest.raises(FitError, match="not here"):
        run_study(descents.study, tmp_path / "run")
    assert not (tmp_path / "run/summary.json").exists()
    assert "ended by FitError: not here" in (tmp_path / "run/log.txt").read_text(encoding="utf-8")


def test_the_shell_says_why_and_what_was_tried(descents, tmp_path: Path, monkeypatch):
    monkeypatch.setattr(stage_list, "fit", _raise(_error()))
    arguments = ["run", str(descents.study), "--out", str(tmp_path / "run")]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 1
    assert [line for line in result.stderr.splitlines() if line.startswith(("No fit", "Tried"))] == [
        f"No fit: {REASON}", *(f"Tried: {line}" for line in TRIED)
    ]  # fmt: skip
    assert result.stdout.splitlines()[-1] == f"Report: {tmp_path / 'run/report.html'}"
    until = CliRunner().invoke(app, [*arguments, "--resume", "--until", "priors"])
    assert until.exit_code == 0 and "No fit" not in until.stderr  # that stage was well


def test_warnings_of_libraries_go_to_the_log_and_not_to_the_screen(descents, tmp_path: Path, monkeypatch, capfd):
    honest = stage_list.priors

    def careless(job: object) -> str:
        np.log(np.array([-1.0]))
        warnings.warn("some library is not at ease", UserWarning, stacklevel=1)
        return honest(job)

    monkeypatch.setattr(stage_list, "priors", careless)
    run_study(descents.study, tmp_path / "run", until="priors")
    log = (tmp_path / "run/log.txt").read_text(encoding="utf-8")
    assert log.count("invalid value encountered in log") == log.count("some library is not at ease") == 1
    assert "Warning" not in "".join(capfd.readouterr())


def test_a_flight_whose_simulations_all_fail_has_no_bands(finished, descents, tmp_path: Path, monkeypatch):
    from bayeschute.prediction import bands

    honest = bands._simulate

    def lost(flight: object, *rest: object) -> tuple[np.ndarray, ...]:
        return tuple(np.nan * np.asarray(part) for part in honest(flight, *rest))

    folder = Path(shutil.copytree(finished.folder, tmp_path / "run"))
    (folder / ".stages/predict").unlink()
    monkeypatch.setattr(bands, "_simulate", lost)
    told = []
    summary = run_study(descents.study, folder, resume=True, progress=lambda *said: told.append(said))
    words = "2 flights, no bands of low, high: every simulation failed"
    assert ("predict", 1.0, words) in told
    for table in summary["coverage"].values():
        assert {(e["truth"], e["record"], e["draws"], e["failed"]) for e in table.values()} == {(None, None, 0, 100)}
    assert summary["checks"]["bands"]["passed"] is False and summary["checks"]["bands"]["value"] == 1.0
    assert "bands" in summary["label"]
    assert all(row["probability_met"] == 0.0 and row["failed"] == 100 for row in summary["requirements"])
    assert {row["widened_by"] for row in summary["requirements"]} == {1.0}  # nothing is recalibrated
    text = (folder / "report.html").read_text(encoding="utf-8")
    lost = "; ".join(f"100 of 100 simulations of {name} failed: it has no bands" for name in ("low", "high")) + "."
    assert lost in text and ">none</td>" in text
    assert "0 %</td>" not in text[text.index('id="predictions"') : text.index('id="checks"')]
    result = CliRunner().invoke(app, ["run", str(descents.study), "--out", str(folder), "--resume"])
    assert result.exit_code == 1
    assert lost in result.stderr


def test_simulations_that_fail_in_part_are_counted(finished):
    for table in finished.summary["coverage"].values():
        assert {(entry["draws"], entry["failed"]) for entry in table.values()} == {(100, 0)}
    assert "bands" not in finished.summary["checks"] and finished.summary["fit"] == {"converged": True}
