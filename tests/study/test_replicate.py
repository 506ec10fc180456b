"""Scores of a replicate: over what the fit did not see, by time since the start, and a failure that stays its own."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from bayeschute.calibration.coverage_tables import lines, summarise
from bayeschute.calibration.recalibration import FACTORS
from bayeschute.calibration.replicate_rows import read_rows, write_row
from bayeschute.calibration.scores import LEVELS
from bayeschute.study import replicate as module
from bayeschute.study.run.forecasts import FlightForecast

JOB = SimpleNamespace(study=SimpleNamespace(predict=SimpleNamespace(quantities=("descent_rate",))))
DRAWS = np.linspace(-1.0, 1.0, 41)[:, None]


def forecast(truth, step=10.0, held_out=None, draws=DRAWS):
    """A flight whose draws lie evenly about zero at all times."""
    truth = np.asarray(truth, float)
    time = 500.0 + step * np.arange(truth.size)
    seen = np.zeros(truth.size, bool) if held_out is None else np.asarray(held_out)
    known = xr.Dataset({"descent_rate": ("time", truth), "swing_angle": ("time", truth)})
    drawn = {name: np.broadcast_to(draws, (len(draws), truth.size)) for name in known}
    return FlightForecast(None, None, SimpleNamespace(draws=drawn), time, seen, None, known, 0)


def bands(one):
    return module._bands(one, JOB)["descent_rate"]


def test_windows_are_of_thirty_seconds_since_the_start_and_the_last_takes_its_end():
    inside, outside = 0.0, 5.0
    found = bands(forecast([inside] * 3 + [outside] * 3 + [inside, outside, outside, outside]))  # to 90 s
    assert {name: shares[0] for name, shares in found["by_time"].items()} == {
        "0-30 s": 1.0, "30-60 s": 0.0, "60-90 s": 0.25,
    }  # fmt: skip
    assert found["coverage"] == pytest.approx([0.4] * len(LEVELS))
    assert list(bands(forecast([inside] * 8))["by_time"]) == ["0-30 s", "30-60 s", "60-70 s"]


def test_only_what_was_held_out_is_scored_where_anything_was():
    truth, held_out = [5.0] * 6 + [0.0] * 3, [False] * 6 + [True] * 3
    found = bands(forecast(truth, held_out=held_out))
    assert found["coverage"] == pytest.approx([1.0] * 5) and list(found["by_time"]) == ["60-80 s"]
    assert found["role"] == "predict" and found["scaled"][0] == 1.0
    fitted = bands(forecast(truth))
    assert fitted["coverage"] == pytest.approx([1 / 3] * 5) and fitted["role"] == "identify"


def test_statistics_are_of_each_draw_over_the_scored_samples():
    ramp = np.arange(10.0)
    held_out = ramp >= 4.0
    one = forecast(ramp, held_out=held_out, draws=DRAWS + ramp)
    found = module._statistics(one, JOB)
    assert {name: facts["truth"] for name, facts in found.items()} == {
        "final descent_rate": 9.0, "maximum descent_rate": 9.0, "mean descent_rate": 6.5,
    }  # fmt: skip
    assert found["mean descent_rate"]["mean"] == pytest.approx(6.5)
    assert found["final descent_rate"]["sd"] == pytest.approx(DRAWS.std(), rel=0.02)


def test_modes_have_the_frequency_of_the_record_s_clock():
    """The clock starts anywhere; half of the draws swing as fast as the truth, the others twice as fast."""
    step, at = 0.05, 0.05 * np.arange(2000)
    swing, fast = np.sin(2.0 * np.pi * 0.1 * at), np.sin(2.0 * np.pi * 0.2 * at)
    found = module._modes(forecast(swing, step, draws=np.stack([swing, fast])))
    assert found["pendulum frequency"]["truth"] == pytest.approx(0.1, rel=1e-3)
    assert found["pendulum frequency"]["mean"] == pytest.approx(0.15, rel=2e-3)
    assert found["pendulum amplitude"]["truth"] == pytest.approx(1.0, rel=1e-3)
    assert found["mean descent rate"]["truth"] == pytest.approx(0.0, abs=1e-9) and "scissors amplitude" not in found


def test_a_flight_that_no_draw_could_fly_counts_as_missed_in_everything(tmp_path):
    """From draws to the table, through the stored row: the replicate is not dropped, which would flatter the fit."""
    truth = 0.1 * np.sin(np.arange(10.0))
    unseen = {"held_out": [True] * 10}
    flown, lost = forecast(truth, **unseen), forecast(truth, **unseen, draws=np.full((5, 1), np.nan))
    for seed, one in enumerate((flown, lost)):
        row = {"seed": seed, "ok": True, "wall_s": 1.0, "parameters": {}, "left_out": [], "missed_checks": []}
        row |= {"bands": {"new": module._bands(one, JOB)}, "modes": {"new": module._modes(one)}}
        write_row(tmp_path, "campaign", row | {"statistics": {"new": module._statistics(one, JOB)}})
    alone, both = (summarise(rows) for rows in ([read_rows(tmp_path)[0]], list(read_rows(tmp_path).values())))
    name, at = "new/descent_rate", str(LEVELS[2])
    assert alone["bands"][name]["coverage"][at] == 1.0 and both["bands"][name]["coverage"][at] == 0.5
    assert both["bands"][name]["lowest"] == 0.0 and (
        alone["bands"][name]["not_flown"],
        both["bands"][name]["not_flown"],
    ) == (0, 1)
    assert both["bands"][name]["scaled"] == [0.5] * len(FACTORS)
    for key in ("width", "interval_score", "crps", "pit"):
        assert both["bands"][name][key] == alone["bands"][name][key]
    for kind in ("modes", "statistics"):
        assert alone[kind].keys() == both[kind].keys() and alone[kind]
        for one, entry in both[kind].items():
            assert entry["coverage"]["0.99"] == alone[kind][one]["coverage"]["0.99"] / 2.0
            assert entry["pit"] == alone[kind][one]["pit"] and entry["replicates"] == 2
    assert "not flown by any draw 1 times" in "\n".join(lines(both))
    only = summarise([read_rows(tmp_path)[1]])["bands"][name]
    assert only["share"] == 0.0 and only["width"] is None


@dataclass(frozen=True)
class Seeded:
    """A study as far as it matters here."""

    seed: int = 0


@pytest.fixture
def study(monkeypatch):
    monkeypatch.setattr(module, "clear_compiled", lambda: None)
    return Seeded()


def test_an_error_fails_its_replicate_and_is_told_in_a_line(study, monkeypatch):
    def lost(study, *_):
        raise FloatingPointError("the flight\n   was lost " + 600 * "x")

    monkeypatch.setattr(module, "_scored", lost)
    row = module.replicate(7, study)
    assert (row["seed"], row["ok"]) == (7, False) and row["wall_s"] >= 0.0 and len(row["error"]) == 500
    assert row["error"].startswith("FloatingPointError in replicate: the flight was lost xxx")


def test_a_replicate_flies_with_its_own_seed(study, monkeypatch):
    monkeypatch.setattr(module, "_scored", lambda study, kind, quick: {"ok": True, "said": (study.seed, kind, quick)})
    assert module.replicate(11, study, "gusts", True)["said"] == (11, "gusts", True)
