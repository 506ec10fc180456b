"""Calibration of a study, its replicates made up: arguments, results, the same by any number of workers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bayeschute.calibration.scores import LEVELS
from bayeschute.core.errors import InputError
from bayeschute.study import calibrate as module
from bayeschute.study.calibrate import FIRST_SEED, calibrate
from bayeschute.study.evidence.identity import configuration, with_noise
from bayeschute.study.evidence.numerics_hash import numerics
from bayeschute.study.load import load_study

STUDIES = Path(__file__).parents[2] / "models/studies"
STUDY = STUDIES / "cdt-3-11.toml"


def made_up(seed, study, disturbance, quick):
    """A row of a replicate that took no time; the seventh failed."""
    if seed % 10 == 7:
        return {"seed": seed, "ok": False, "error": "FloatingPointError in fly: lost", "wall_s": 0.1}
    rng = np.random.default_rng(seed)
    z = rng.standard_normal()
    one = {"truth": 1.0, "mean": 1.0 + 0.1 * z, "sd": 0.1, "inside": [abs(z) < 1.0] * len(LEVELS)}
    band = {
        "coverage": [0.9] * len(LEVELS), "width": [1.0] * len(LEVELS), "interval_score": [1.2] * len(LEVELS),
        "crps": 0.1, "pit": [0.1] * 10, "by_time": {"0-30 s": [0.9] * len(LEVELS)}, "role": "predict",
    }  # fmt: skip
    return {
        "seed": seed, "ok": True, "parameters": {"axial[1]": one}, "left_out": [], "missed_checks": [],
        "bands": {"cdt-3-12": {"swing_angle": band}},
        "statistics": {"cdt-3-12": {"maximum swing_angle": one | {"pit": 0.5}}},
        "conditions": {
            "numbers": {"duration of fitted flights": [90.0]}, "names": {"sampler": ["nuts"]},
            "units": {"duration of fitted flights": "s"},
        },
        "simulations_failed": 0, "wall_s": 0.1,
    }  # fmt: skip


@pytest.fixture
def fast(monkeypatch):
    monkeypatch.setattr(module, "replicate", made_up)


def test_results_are_stored_with_what_they_are_results_of(fast, tmp_path):
    result = calibrate(STUDY, tmp_path, 20, noise="ar1")
    assert json.loads((tmp_path / "ar1.none.json").read_text()) == result
    assert result["study"] == "cdt-3-11" and result["noise"] == "ar1" and result["disturbance"] == "none"
    assert result["replicates"] == 18 and set(result["failed"]) == {str(FIRST_SEED + 7), str(FIRST_SEED + 17)}
    assert result["nominal"] == 0.9
    assert set(result["coverage"]) == set(result["standard_error"]) == {"axial[1]", "cdt-3-12/swing_angle"}
    assert result["hash"] == configuration(with_noise(load_study(STUDY), "ar1"))
    assert {"bayeschute", "jax", "python"} <= set(result["versions"])
    assert (
        result["command"].endswith("cdt-3-11.toml --replicates 20 --noise ar1")
        and str(tmp_path) not in result["command"]
    )
    assert result["numerics"] == numerics() and {"commit", "date", "machine"} <= set(result)
    duration = {"low": 90.0, "high": 90.0, "unit": "s"}
    assert (
        result["domain"]["numbers"] == {"duration of fitted flights": duration} and result["domain"]["replicates"] == 18
    )
    assert result["statistics"]["cdt-3-12/maximum swing_angle"]["role"] == "predict"


def test_a_campaign_goes_on_where_it_was(fast, tmp_path, monkeypatch):
    calibrate(STUDY, tmp_path / "two", 5)
    seen = []

    def watched(seed, **given):
        seen.append(seed)
        return made_up(seed, **given)

    monkeypatch.setattr(module, "replicate", watched)
    resumed = calibrate(STUDY, tmp_path / "two", 8)
    assert seen == [FIRST_SEED + i for i in (5, 6, 7)]
    assert resumed == calibrate(STUDY, tmp_path / "one", 8)


def test_rows_of_another_campaign_are_refused(fast, tmp_path):
    calibrate(STUDY, tmp_path, 3)
    rows = tmp_path / "latent.none.rows"
    rows.rename(tmp_path / "latent.mass.rows")
    with pytest.raises(InputError, match="campaign"):
        calibrate(STUDY, tmp_path, 3, disturbance="mass")


def test_all_faults_of_the_arguments_at_once(tmp_path):
    with pytest.raises(InputError) as caught:
        calibrate(STUDY, tmp_path, 1, disturbance="hail", noise="pink")
    said = str(caught.value)
    assert "'hail'" in said and "'pink'" in said and "at least 2" in said
    assert not any(tmp_path.iterdir())


def test_flights_without_known_truth_are_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("BAYESCHUTE_DATA", str(tmp_path))
    with pytest.raises(InputError):
        calibrate(STUDIES / "dropsondes.toml", tmp_path, 5)
