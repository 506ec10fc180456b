"""The records of the power study have the mistakes that they are named for."""

from __future__ import annotations

import json

import numpy as np
import predictive_checks as power
import pytest

from bayeschute.core.errors import FitError
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


def test_a_fit_that_finds_no_mode_is_a_row(monkeypatch, tmp_path):
    def no_fit(job, predictions):
        raise FitError("fit of all: no flight of the model follows the record.", ("all: tried",))

    monkeypatch.setattr(power.stage_list, "fit", no_fit)
    row = power.one(7, "sound", 20.0)
    assert row["seed"] == 7 and not row["ok"] and row["error"].startswith("FitError: fit of all: no flight")


def test_the_page_counts_flagged_and_refused_flights_and_judges_them():
    one = {
        "flights": 8,
        "flagged": 7,
        "failed": {"3": "FitError: no", "5": "FitError: no"},
        "smallest": ["mean of x, p"],
    }
    result = json.loads(power.STORED.read_text("utf-8"))
    result["cases"] = {"sound": one | {"flagged": 1, "failed": {}}, "mass": one, "wind": one | {"flagged": 6}}
    lines = [row.split(" | ") for row in power.page(result).splitlines() if row.startswith("| `")]
    assert [row[2:6] for row in lines] == [
        ["8", "1", "0", "**no**"], ["10", "7", "2", "yes"], ["10", "6", "2", "**no**"],
    ]  # fmt: skip


def test_the_page_is_what_the_script_writes_from_what_is_stored():
    assert power.PAGE.read_text("utf-8") == power.page(json.loads(power.STORED.read_text("utf-8")))
