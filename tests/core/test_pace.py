"""Pace of a stage: shares never fall, time left is told of a steady pace alone, and what is told never grows."""

from __future__ import annotations

import re

import numpy as np
import pytest

from bayeschute.core import pace as module
from bayeschute.core.pace import Pace, percent


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


def _steady(pace: Pace, clock: list[float], seconds: float, until: float, steps: int = 200) -> None:
    """Reach a share after so many seconds, at one pace."""
    began = clock[0]
    for i in range(steps + 1):
        clock[0] = began + seconds * i / steps
        pace.at("fit", until * i / steps)


@pytest.mark.parametrize(
    ("passed", "share", "words"),
    [
        (600.0, 0.5, "about 8 to 16 min left"),
        (60.0, 0.25, "about 2 to 5 min left"),
        (60.0, 0.9, "under 1 min left"),
        (150.0, 0.9, "under 1 min left"),
        (120.0, 0.6, "about 1 to 2 min left"),
        (3600.0, 0.25, "about 2.4 to 4.8 h left"),
        (10.0, 0.5, ""),
        (600.0, 0.04, ""),
        (600.0, 1.0, ""),
    ],
)
def test_time_left_is_that_of_a_steady_pace(clock, passed: float, share: float, words: str):
    pace, clock[0] = Pace(), 100.0
    _steady(pace, clock, passed, share)
    assert pace.left("fit") == words


def test_of_a_pace_that_is_not_steady_the_time_that_passed_is_told(clock):
    pace = Pace()
    for seconds, share in [(0.0, 0.0), (30.0, 0.3), (59.0, 0.31)]:
        clock[0] = seconds
        pace.at("fit", share)
    assert pace.left("fit") == pace.told("fit") == ""
    for seconds, words in [(60.0, "1 min so far"), (239.0, "3 min so far"), (7200.0, "2.0 h so far")]:
        clock[0] = seconds
        pace.at("fit", 0.32)
        assert pace.left("fit") == "" and pace.told("fit") == words
    pace.at("fit", 1.0)
    assert pace.told("fit") == ""


@pytest.mark.parametrize(
    ("reached", "told"),
    [
        ([(0, 0.0), (600, 0.6)], True),
        ([(0, 0.0), (300, 0.45), (450, 0.45), (600, 0.6)], False),
        ([(0, 0.0), (300, 0.3), (450, 0.525), (525, 0.525), (600, 0.6)], False),
        ([(0, 0.0), (450, 0.45), (525, 0.57), (600, 0.6)], False),
    ],
    ids=["steady", "half", "quarter", "eighth"],
)
def test_the_last_half_quarter_and_eighth_alone_make_a_pace_unsteady(clock, reached, told: bool):
    """Each goes on at most half as fast as the whole, which all the others do."""
    pace = Pace()
    for second in range(0, 601, 5):
        clock[0] = float(second)
        pace.at("fit", float(np.interp(second, *zip(*reached, strict=True))))
    assert bool(pace.left("fit")) == told


def test_a_jump_is_no_pace(clock):
    pace = Pace()
    pace.at("fit", 0.0)
    clock[0] = 300.0
    pace.at("fit", 0.5)
    assert pace.told("fit") == "5 min so far"


def test_time_left_ends_where_nothing_goes_on(clock):
    pace = Pace()
    _steady(pace, clock, 160.0, 0.5)
    assert pace.left("fit").endswith("min left")
    clock[0] += 19.0
    assert pace.left("fit").endswith("min left")
    clock[0] += 10.0
    assert pace.left("fit") == "" and pace.told("fit") == "3 min so far"


FIVE_MINUTES = [
    (0, 0.0), (9, 0.07), (32, 0.24), (40, 0.26), (54, 0.3), (66, 0.31), (76, 0.6), (91, 0.6), (99, 0.6), (125, 0.67),
    (141, 0.67), (156, 0.68), (173, 0.76), (235, 0.79), (250, 0.8), (258, 0.85), (267, 0.89), (282, 0.97), (296, 1.0),
]  # fmt: skip
"""Times [s] and shares of a fit by turns."""
LONG = [
    (0, 0.0), (24, 0.03), (54, 0.13), (84, 0.19), (107, 0.23), (125, 0.23), (143, 0.23), (180, 0.3), (231, 0.3),
    (566, 0.31), (1016, 0.32), (1300, 0.33), (1390, 0.34), (1519, 0.36), (1530, 0.37), (1550, 0.37), (1730, 0.38),
]  # fmt: skip
"""Of one whose chosen terms start far from the mode; told by the mean pace: 13, 6, 7, 8, 7, 9, 21, 36, 44 .. min."""
MANY_DROPS = [
    (0, 0.0), (12, 0.08), (20, 0.11), (30, 0.17), (38, 0.2), (47, 0.23), (57, 0.25), (69, 0.32), (78, 0.38), (87, 0.38),
    (99, 0.45), (107, 0.48), (118, 0.5), (131, 0.57), (140, 0.61), (150, 0.62), (163, 0.7), (173, 0.75), (182, 0.82),
    (190, 0.88), (203, 0.88), (217, 0.95), (226, 0.97), (269, 1.0),
]  # fmt: skip
"""Of many drops fitted one after the other."""


def _ends_told(clock: list[float], shares: list[tuple[int, float]]) -> list[tuple[int, int, int]]:
    """Times [s] at which a time left was told, and its range [min]."""
    pace, told = Pace(), []
    for seconds, share in shares:
        clock[0] = float(seconds)
        pace.at("fit", share)
        if words := pace.left("fit"):
            low, high = (int(found) for found in (re.findall(r"\d+", "0 " * ("under" in words) + words) * 2)[:2])
            told.append((seconds, low, high))
    return told


@pytest.mark.parametrize("shares", [FIVE_MINUTES, LONG, MANY_DROPS])
def test_what_fits_were_told_never_grows_and_comes_true(clock, shares):
    told = _ends_told(clock, shares)
    highs = [high for _, _, high in told]
    assert highs == sorted(highs, reverse=True)
    if shares[-1][1] == 1.0:
        assert all(low - 0.5 <= (shares[-1][0] - at) / 60.0 <= high + 0.5 for at, low, high in told)


def test_jumping_shares_promise_nothing_and_even_ones_do(clock):
    assert _ends_told(clock, LONG) == []
    assert len(_ends_told(clock, FIVE_MINUTES)) <= 2
    assert len(_ends_told(clock, MANY_DROPS)) >= 8


def test_each_stage_has_its_own_beginning(clock):
    pace = Pace()
    pace.at("check", 0.0)
    clock[0] = 1000.0
    _steady(pace, clock, 120.0, 0.5)
    assert pace.left("fit") == "about 2 to 3 min left" and pace.left("check") == pace.left("report") == ""


def test_all_is_done_only_when_all_is_done():
    assert [percent(share) for share in (0.0, 0.004, 0.506, 0.994, 0.9999, 1.0)] == [0, 0, 51, 99, 99, 100]
