"""Pace of a stage: shares never fall, time left is that of a steady pace, and nothing is promised too soon."""

from __future__ import annotations

import pytest

from bayeschute.core import pace as module
from bayeschute.core.pace import Pace


@pytest.fixture
def clock(monkeypatch):
    """A clock that stands still until it is set."""
    now = [0.0]
    monkeypatch.setattr(module.time, "perf_counter", lambda: now[0])
    return now


def test_shares_never_fall_and_stay_between_none_and_all(clock):
    pace = Pace()
    given = [-0.5, 0.0, 0.3, 0.2, 0.31, 7.0, 0.9]
    assert [pace.at("fit", share) for share in given] == [0.0, 0.0, 0.3, 0.3, 0.31, 1.0, 1.0]
    assert pace.at("check", 0.1) == 0.1


@pytest.mark.parametrize(
    ("passed", "share", "words"),
    [
        (600.0, 0.5, "about 10 min left"),
        (60.0, 0.25, "about 3 min left"),
        (60.0, 0.9, "under 1 min left"),
        (3600.0, 0.25, "about 3.0 h left"),
        (10.0, 0.5, ""),
        (600.0, 0.01, ""),
        (600.0, 1.0, ""),
    ],
)
def test_time_left_is_that_of_a_steady_pace(clock, passed: float, share: float, words: str):
    pace = Pace()
    clock[0] = 100.0
    pace.at("fit", 0.0)
    clock[0] += passed
    pace.at("fit", share)
    assert pace.left("fit") == words


def test_each_stage_has_its_own_beginning(clock):
    pace = Pace()
    pace.at("fit", 0.0)
    clock[0] = 1000.0
    pace.at("check", 0.0)
    clock[0] = 1060.0
    pace.at("check", 0.5)
    assert pace.left("check") == "about 1 min left" and pace.left("report") == ""
