"""The report of a fit that failed: why, what was tried, residuals, and what is known without a fit."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from bayeschute.core.trees import save_tree
from bayeschute.posterior.best_path import BestPath
from bayeschute.report import failed_fit
from bayeschute.report.page import build_report
from bayeschute.report.run_results import read_results

OUTPUTS = ("canopy_position.1.north", "canopy_position.1.east", "capsule_attitude.x", "odd")
NOISE = (0.2, 0.2, 0.002, 1.0)
RMS = (0.25, 0.1, 0.04, None)


@pytest.fixture
def failed(run_dir: Path, tmp_path: Path) -> Path:
    """The made-up run, its fit failed; what an earlier fit left still lies there."""
    folder = Path(shutil.copytree(run_dir, tmp_path / "run"))
    shutil.rmtree(folder / "figures")
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    kept = {k: v for k, v in summary.items() if k in ("title", "model", "seed", "flights", "versions", "hashes")}
    rows = {o: {"rms": r, "noise": n, "samples": 900} for o, r, n in zip(OUTPUTS, RMS, NOISE, strict=True)}
    fit = {"converged": False, "reason": "It is lost <here>.", "tried": ["one", "two"], "residuals": {"cdt-3-11": rows}}
    (folder / "summary.json").write_text(json.dumps(kept | {"label": "no fit", "fit": fit}), encoding="utf-8")
    time, rng = np.arange(0.0, 90.0, 0.1), np.random.default_rng(2)
    residual = rng.normal(size=(900, 4)) * NOISE
    residual[:, 3] = np.nan
    path = BestPath("cdt-3-11", time, OUTPUTS, residual, np.array(NOISE), np.abs(rng.normal(size=899)))
    (folder / "fit").mkdir()
    save_tree(folder / "fit/failed.npz", (path,))
    row = {"name": "riser_stiffness", "value": 2.2e5, "standard_error": 1e4, "unit": "N/m"}
    row |= {"prior_mean": 2.0e5, "prior_sd": 6e4}
    odd = {"name": "axial[1]", "value": 0.9, "standard_error": None, "unit": "1"}
    (folder / "fit/failed.json").write_text(json.dumps({"parameters": [row, odd, 3]}), encoding="utf-8")
    return folder


def _visible(text: str) -> str:
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", re.sub(r"(?s)<style>.*?</style>", "", text)))


def test_it_says_why_what_was_tried_and_what_is_known(failed: Path):
    text = build_report(failed).read_text(encoding="utf-8")
    words = _visible(text)
    for phrase in (
        "It is lost &lt;here&gt;.",
        "no fit",
        "The largest residuals of the best trajectory found are those of capsule_attitude.x on cdt-3-11: 20 times",
        "The failed fit: what was tried",
        "2 terms selected out of 6 candidates",
        "-141 m in one sample",
        "riser_stiffness stiffness of a riser 220 15,070 10 690 200 13,700 60 4,100 kN/m lbf/ft",
        "Seed 1.",
    ):
        assert phrase in words, phrase
    assert not re.search(r"\b(nan|None|inf|Undefined|True|False)\b", words)
    ids = re.findall(r'<section id="([\w-]+)"', text)
    assert ids == ["input", "fit", "structure", "provenance"]
    assert re.findall(r'<a href="#([\w-]+)"', text) == ids
    assert {path.name for path in (failed / "figures").glob("*.svg")} == {
        "failed-1.svg", "record-cdt-3-11.svg", "record-cdt-3-12.svg", "structure-pse.svg"
    }  # fmt: skip


def test_wide_residuals_stand_out(failed: Path):
    table = failed_fit.residual_table(read_results(failed))
    assert [row[5].kind for row in table.rows] == ["", "", "bad", ""]
    assert [row[5].text for row in table.rows] == ["1.2", "0.50", "20", "–"]
    assert [row[6].text for row in table.rows] == ["m", "m", "deg", ""]


def test_one_panel_a_channel_and_one_for_defects(failed: Path):
    time = np.arange(10.0)
    path = BestPath("a", time, OUTPUTS, np.zeros((10, 4)), np.array(NOISE), np.zeros(9))
    assert len(failed_fit.residual_figure(path).axes) == 3
    loose = BestPath("a", time, OUTPUTS, np.full((10, 4), np.nan), np.array(NOISE), np.ones(9))
    figure = failed_fit.residual_figure(loose)
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert titles[0] == "Canopy position: measured minus simulated"
    assert titles[-1].startswith("Largest continuity defect")


def test_without_its_files_it_says_what_is_missing(failed: Path):
    shutil.rmtree(failed / "fit")
    (failed / "structure.json").unlink()
    summary = json.loads((failed / "summary.json").read_text(encoding="utf-8"))
    summary["fit"] |= {"tried": None, "residuals": []}
    (failed / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    words = _visible(build_report(failed).read_text(encoding="utf-8"))
    for phrase in (
        "The run did not record what was tried.",
        "there are no residuals to show",
        "The search stopped before it had parameter values",
        "failed.json is not in the run folder: no parameters of the best point are shown.",
        "failed.npz is not in the run folder: no residuals are drawn.",
        "structure.json is not in the run folder",
    ):
        assert phrase in words, phrase
    assert "posterior.nc" not in words
