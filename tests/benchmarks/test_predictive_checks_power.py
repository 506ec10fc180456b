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
MADE = {"commit": "0123456789", "date": "2026-01-02", "numerics": "89abcdef01"}


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


@pytest.mark.parametrize("case", ["mass", "canopy", "terms"])
def test_other_mistakes_change_the_motion(record, case):
    sound, other = record("sound"), record(case)
    np.testing.assert_array_equal(sound["wind"].shape, other["wind"].shape)
    assert np.abs(sound["capsule_position"].values - other["capsule_position"].values).max() > 0.05


def test_the_identification_is_not_told(record):
    assert power.identified(STUDY, "white").noise.model == "white"
    sound = power.identified(STUDY, "sound")
    assert sound.noise.model == "latent" and all(power.identified(STUDY, c) == sound for c in ("mass", "wind", "terms"))


def test_another_form_is_the_flown_one_without_a_term():
    sound, form = (power.identified(STUDY, case).structure for case in ("sound", "form"))
    assert set(sound.core) - set(form.core) == {power.LEFT_OUT} and form.axial == sound.axial
    assert [t for t in sound.transverse if t not in form.transverse] == ["e*alpha^2"]


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
        "made": MADE,
    }
    result = json.loads(power.STORED.read_text("utf-8"))
    result["cases"] = {"sound": one | {"flagged": 1, "failed": {}}, "mass": one, "wind": one | {"flagged": 6}}
    lines = [row.split(" | ") for row in power.page(result).splitlines() if row.startswith("| `")]
    assert all(row[-1] == "0123456, 2026-01-02, 89abcdef |" for row in lines)
    assert [row[2:6] for row in lines] == [
        ["8", "1", "0", "**no**"], ["10", "7", "2", "yes"], ["10", "6", "2", "**no**"],
    ]  # fmt: skip


def test_the_page_tells_what_the_most_powerful_test_could_flag():
    result = json.loads(power.STORED.read_text("utf-8"))
    one = {"flights": 10, "flagged": 0, "failed": {}, "smallest": ["mean of x, p"], "power": 0.034, "made": MADE}
    result["cases"]["terms"] = one
    assert "would flag\n3 % of such flights" in power.page(result)


def test_cases_are_stored_one_by_one_beside_those_that_are_known(monkeypatch, tmp_path):
    stored = tmp_path / "stored.json"
    stored.write_text(power.STORED.read_text("utf-8"), "utf-8")
    monkeypatch.setattr(power, "STORED", stored)
    monkeypatch.setattr(power, "PAGE", tmp_path / "page.md")
    found = {"flights": 3, "flagged": 3, "failed": {}, "smallest": ["mean of x, p"]}
    monkeypatch.setattr(power, "test", lambda case, n, *given: found | {"asked": n})
    before = json.loads(stored.read_text("utf-8"))["cases"]
    power.main(["--flights", "3", "--cases", "mass", "--store"])
    after = json.loads(stored.read_text("utf-8"))["cases"]
    assert list(after) == [case for case in power.CASES if case in {*before, "mass"}]
    assert all(after[case] == before[case] for case in before if case != "mass")
    assert after["mass"]["asked"] == 3 and after["mass"]["made"]["command"].endswith(
        "--flights 3 --duration 90 --store --cases mass"
    )
    assert "| `mass` |" in (tmp_path / "page.md").read_text("utf-8")


def test_the_page_is_what_the_script_writes_from_what_is_stored():
    assert power.PAGE.read_text("utf-8") == power.page(json.loads(power.STORED.read_text("utf-8")))
