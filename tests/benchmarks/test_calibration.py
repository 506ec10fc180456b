"""The shipped calibration's clock: what is stored tells the time it took, in one go or in several."""

from __future__ import annotations

import json

import calibration as benchmark
import pytest

RANKS = {
    "study": "dumbbell", "replicates": 3, "failed": 0, "passed": True, "quantities": {"a": {"passed": True}},
    "spoiled": {"shift": 0.3, "passed": False, "quantities": {"a": {"passed": False}}},
}  # fmt: skip


@pytest.fixture
def calibration(tmp_path, monkeypatch):
    """The benchmark; results and page go to a folder of the test's."""
    monkeypatch.setattr(benchmark, "STORED", tmp_path / "stored")
    monkeypatch.setattr(benchmark, "PAGE", tmp_path / "page.md")
    return benchmark


def test_a_part_that_was_stopped_counts_the_minutes_of_all_its_beginnings(calibration, tmp_path, monkeypatch):
    def stopped():
        raise KeyboardInterrupt

    def make(name, minutes, fly):
        looks = iter([0.0, 60.0 * minutes])
        monkeypatch.setattr(calibration, "perf_counter", lambda: next(looks))
        calibration.timed(name, tmp_path / "rows", 2, fly)

    with pytest.raises(KeyboardInterrupt):
        make("ranks.dumbbell", 5.0, stopped)
    assert not calibration.STORED.exists()
    make("ranks.dumbbell", 3.0, lambda: RANKS)
    make("ranks.cluster", 4.0, lambda: RANKS)
    made = json.loads((calibration.STORED / "ranks.dumbbell.json").read_text())
    assert made == RANKS | {"clock": {"minutes": 8.0, "workers": 2}}
    said = "All of it took 0.2 hours on the clock with 2 processes, 8 minutes of it for the longest part."
    assert said in calibration.PAGE.read_text()
