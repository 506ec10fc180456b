"""Every noise model fits a flight of the default study, whose gusts only one of them knows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bayeschute.study.evidence.identity import with_noise
from bayeschute.study.load import load_study
from bayeschute.study.replicate import replicate

STUDY = Path(__file__).parents[2] / "models" / "studies" / "cdt-3-11.toml"


@pytest.mark.slow
@pytest.mark.parametrize("model", ["latent", "ar1", "white", "sandwich"])
def test_a_replicate_is_fitted_and_predicted(model):
    study = with_noise(load_study(STUDY), model)
    row = replicate(40_001, study, quick=True)
    assert row["ok"], row.get("error")
    assert all(np.isfinite(one["sd"]) and one["sd"] > 0.0 for one in row["parameters"].values())
    assert set(row["bands"]) == {"cdt-3-11", "cdt-3-12"}
