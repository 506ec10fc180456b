"""Two flights of a cluster with constant errors of their own, fitted together after a search of terms."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from bayeschute.study.load import load_study
from bayeschute.study.run.stages import run_study
from bayeschute.study.schema.belief_schema import Bias

STUDY = Path(__file__).parents[2] / "models" / "studies" / "cdt-3-11.toml"


@pytest.mark.slow
def test_they_are_fitted_and_checked(tmp_path):
    study = load_study(STUDY)
    (flown,) = study.with_role("identify")
    both = (flown, replace(flown, name="second", roles=("identify",)))
    given = study.priors.given.model_copy(update={"wind_bias": Bias[float](sd=1.0)})
    study = replace(study, flights=both, priors=study.priors.model_copy(update={"given": given}))
    run_study(study, tmp_path / "run", until="check", quick=True)
    checks = json.loads((tmp_path / "run" / "checks.json").read_text(encoding="utf-8"))["checks"]
    fitted = json.loads((tmp_path / "run" / "fit" / "priors.json").read_text(encoding="utf-8"))
    own = [p["name"] for p in fitted if "@" in p["name"]]
    assert own == [f"wind_bias.{axis}@{name}" for axis in ("north", "east") for name in (flown.name, "second")]
    assert checks["mode"]["passed"]
