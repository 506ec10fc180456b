"""The window of a record that tells none: a climb, a fast fall and the ground are cut, a plain descent is left whole."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import bayeschute as bc
from bayeschute.records.descent_window import descent_window
from bayeschute.records.record import make_record

SHARED = Path(os.environ.get("BAYESCHUTE_SHARED", Path(__file__).parents[3] / "shared")) / "realdata"
TIME = np.arange(0.0, 150.0, 0.1)


def _flown(rates, position: bool = False):
    """A record of rates of climb, each from a time on."""
    rate = np.zeros(TIME.size)
    for start, value in rates:
        rate[TIME >= start] = value
    height = 500.0 + np.cumsum(rate) * 0.1 + np.random.default_rng(1).normal(0.0, 0.3, TIME.size)
    if position:
        return make_record(time=TIME, capsule_position=np.stack([0 * height, 0 * height, -height], axis=1))
    return make_record(time=TIME, altitude=height)


@pytest.mark.parametrize("position", [False, True])
def test_apogee_opening_and_ground_are_found(position):
    found = descent_window(_flown([(0, 40.0), (10, -30.0), (18, -6.0), (110, 0.0)], position))
    assert 18.0 < found.start < 28.0 and 106.0 < found.end < 111.0
    assert "highest point at 10" in found.words and "on the ground" in found.words and "opening" in found.words


def test_a_plain_descent_is_left_whole():
    record = _flown([(0, -6.0)])
    found = descent_window(record)
    assert found == (TIME[0], TIME[-1], "")
    jumped = record.copy(deep=True)
    jumped["altitude"].values[700:] -= 140.0  # as a receiver that finds itself
    assert descent_window(jumped).words == ""


def test_a_descent_of_twelve_seconds_is_no_window():
    assert descent_window(_flown([(0, 6.0), (138, -6.0)])).words == ""
    assert descent_window(_flown([(0, 6.0), (130, -6.0)])).start == pytest.approx(130.0, abs=1.0)


def test_the_start_is_left_to_a_study_that_skips_some():
    found = descent_window(_flown([(0, 40.0), (10, -6.0), (110, 0.0)]), begins=False)
    assert found.start == 0.0 and 106.0 < found.end < 111.0


def test_gusts_near_the_ground_are_no_opening():
    found = descent_window(_flown([(0, -6.0), (120, -14.0), (126, -6.0)]))
    assert found.words == ""


@pytest.mark.skipif(not SHARED.is_dir(), reason="no measured descents in ../shared/realdata")
def test_a_rocket_s_record():
    path = SHARED / "halcyon" / "altimeter_halcyon_10hz.csv.gz"
    record = bc.read_record(path, {"time": ("ts", "s"), "altitude": ("filtered_altitude_AGL", "m")})
    found = descent_window(record)  # apogee at 29 s, canopy open at 35 s
    assert 34.0 < found.start < 45.0 and "highest point at 2" in found.words
