"""The records of the power study have the mistakes that they are named for."""

from __future__ import annotations

import numpy as np
import predictive_checks as power
import pytest

from bayeschute.records.record import load_record
from bayeschute.study.load import load_study

STUDY = load_study(power.STUDY)


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drops")

    def made(case):
        path = folder / f"{case}.nc"
        if not path.exists():
            power.fly_case(STUDY, case, 7, 6.0, path)
        return load_record(path)

    return made


def test_only_the_recorded_wind_is_off(record):
    sound, wind = record("sound"), record("wind")
    np.testing.assert_allclose((wind["wind"] - sound["wind"]).values.mean(axis=0), [3.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_array_equal(sound["capsule_velocity"], wind["capsule_velocity"])


@pytest.mark.parametrize("case", ["mass", "canopy", "form"])
def test_other_mistakes_change_the_motion(record, case):
    sound, other = record("sound"), record(case)
    np.testing.assert_array_equal(sound["wind"].shape, other["wind"].shape)
    assert np.abs(sound["capsule_position"].values - other["capsule_position"].values).max() > 0.05


def test_the_identification_is_not_told(record):
    assert power.identified(STUDY, "white").noise.model == "white"
    sound = power.identified(STUDY, "sound")
    assert sound.noise.model == "latent" and all(power.identified(STUDY, c) == sound for c in ("mass", "wind", "form"))
