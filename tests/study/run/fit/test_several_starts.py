"""A study that asks for several starts: kept one by one, told in checks and report; one that doesn't is as it was."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from bayeschute.study.load import load_study
from bayeschute.study.run.fit import several_starts
from bayeschute.study.run.stages import run_study
from bayeschute.study.study import canonical


@pytest.fixture
def sondes(descents, tmp_path: Path, spoil) -> Path:
    """The two sondes, each fitted from three starts."""
    path = Path(shutil.copytree(descents.study.parent, tmp_path / "study")) / descents.study.name
    return spoil(path, r"^\[sampler\]", "[sampler]\nstarts = 3")


def test_what_is_not_asked_for_leaves_no_trace(descents, sondes: Path, finished):
    assert "starts" not in canonical(load_study(descents.study))["sampler"]
    assert canonical(load_study(sondes))["sampler"]["starts"] == 3
    assert "optima" not in finished.summary["checks"]
    assert "starts" not in json.loads((finished.folder / "fit/facts.json").read_text(encoding="utf-8"))


def test_starts_are_kept_compared_and_told(finished, sondes: Path, tmp_path: Path, monkeypatch):
    """A run is stopped after the second start: on resuming two are there already, a failed one is counted."""
    honest, begun = several_starts.settle_from, []

    def watched(flights, priors, prior, number, *rest, **named):
        begun.append((priors[0].name, number))
        if priors[0].name.endswith("[low]") and number == 2:
            if len(begun) == 3:
                raise KeyboardInterrupt
            return several_starts.Start(2, None, "lost on purpose")
        return honest(flights, priors, prior, number, *rest, **named)

    monkeypatch.setattr(several_starts, "settle_from", watched)
    with pytest.raises(KeyboardInterrupt):
        run_study(sondes, tmp_path / "run", until="fit")
    summary = run_study(sondes, tmp_path / "run", resume=True)
    low, high = "cds_over_mass[low]", "cds_over_mass[high]"
    assert begun == [(low, 0), (low, 1), (low, 2), (low, 2), (high, 0), (high, 1), (high, 2)]
    check = summary["checks"]["optima"]
    assert check["passed"] and check["value"] < check["bound"] == 0.1
    assert "2 of 3 starts led to the same optimum" in check["detail"]
    assert "1 failed (start 2: lost on purpose)" in check["detail"]
    (line,) = [n for n in summary["notes"] if n.startswith("Multistart check of the fit of high: 3 of 3")]
    assert line in (tmp_path / "run/report.html").read_text(encoding="utf-8")
    for name in ("low", "high"):  # the best of several starts in one place is where one start leads
        with np.load(tmp_path / f"run/fit/{name}.npz") as a, np.load(finished.folder / f"fit/{name}.npz") as b:
            assert abs(a["optimum/theta"] - b["optimum/theta"])[0] < 0.05 * np.sqrt(b["optimum/covariance"][0, 0])
    assert not (tmp_path / "run/fit/kept").exists()


def test_a_fit_all_of_whose_starts_fail_says_why(sondes: Path, tmp_path: Path, monkeypatch):
    failed = several_starts.Start(0, None, "lost on purpose")
    monkeypatch.setattr(several_starts, "settle_from", lambda *given, **named: failed)
    fit = run_study(sondes, tmp_path / "run", until="fit")["fit"]
    assert fit["converged"] is False and "lost on purpose (none of 3 starts led anywhere)" in fit["reason"]
