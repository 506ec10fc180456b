"""Clocks that begin anew, stamps, and rows sorted and merged, against loops."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from bayeschute.records.foreign.clocks import continued, in_order, of_stamps
from bayeschute.records.foreign.conventions import Conventions


def test_stamps_are_seconds_since_the_first_whatever_their_zone():
    column = pd.Series(["2024-02-28T23:59:58.25Z", "2024-02-29 00:00:00", "2024-02-29T02:00:01+02:00", "2024-03-01"])
    found, faults = of_stamps(column, "here", 2)
    np.testing.assert_allclose(found, [0.0, 1.75, 2.75, 86401.75])
    assert faults == [] and found.dtype == np.float64


def test_the_first_bad_stamp_is_told_by_its_row():
    column = pd.Series(["2024-02-28", "yesterday", "2024-02-31"], index=[0, 4, 5])
    found, (fault,) = of_stamps(column, "r.csv t", 2)
    assert np.isnan(found).all() and fault.where == "r.csv t" and fault.got == "'yesterday' in row 6 (2 such)"


def test_a_clock_of_weeks():
    week = np.array([np.nan, 2329.0, 2329.0, 2330.0, 2332.0])
    made = continued(np.array([1.0, 2.0, 604799.0, 3.0, 4.0]), week, Conventions())
    np.testing.assert_allclose(made[1:], [2.0, 604799.0, 604803.0, 3 * 604800.0 + 4.0])
    unseen = continued(np.array([1.0, 2.0]), np.full(2, np.nan), Conventions())
    assert np.isnan(unseen).all()


def test_a_clock_that_wraps_goes_on_and_a_step_back_stays_one():
    true = np.arange(0.0, 400.0, 7.0)
    said = Conventions(clock_wraps=60.0)
    np.testing.assert_allclose(continued((true + 31.0) % 60.0, None, said), true + 31.0)
    back = np.array([10.0, 40.0, 11.0, 12.0])  # by less than half a round
    np.testing.assert_array_equal(continued(back, None, said), back)
    np.testing.assert_array_equal(continued(back, None, Conventions()), back)
    assert continued(np.array([3.0]), None, said).tolist() == [3.0]


@pytest.fixture
def found():
    rng = np.random.default_rng(0)
    time = rng.permutation(np.repeat(np.arange(20.0), rng.integers(1, 5, 20)))
    x = rng.standard_normal(time.size)
    x[rng.random(time.size) < 0.4] = np.nan
    return {"time": time, "x": x}


@pytest.mark.parametrize("which", ["first", "last", "mean"])
def test_rows_of_one_time_are_merged_as_a_loop_would(found, which):
    rows = np.arange(found["time"].size)
    made, kept, merged = in_order(found, rows, Conventions(sort_times=True, repeated_times=which))
    np.testing.assert_array_equal(made["time"], np.arange(20.0))
    assert merged == found["time"].size - 20
    for i in range(20):
        of = np.flatnonzero(found["time"] == i)
        seen = found["x"][of][np.isfinite(found["x"][of])]
        mean = seen.mean() if seen.size else np.nan
        wanted = {"first": found["x"][of[0]], "last": found["x"][of[-1]], "mean": mean}[which]
        assert made["x"][i] == pytest.approx(wanted, nan_ok=True)
        assert kept[i] == (of[-1] if which == "last" else of[0])


def test_what_is_not_asked_for_is_not_done(found):
    rows = np.arange(found["time"].size)
    made, kept, merged = in_order(found, rows, Conventions(repeated_times="mean"))
    np.testing.assert_array_equal(made["time"], found["time"])  # runs backward: told elsewhere
    assert merged == 0 and (kept == rows).all()
    made, kept, merged = in_order(found, rows, Conventions(sort_times=True))
    assert (np.diff(made["time"]) >= 0.0).all() and merged == 0 and sorted(kept) == list(rows)
    np.testing.assert_array_equal(found["x"][kept], made["x"])
    lost = {"time": np.array([2.0, np.nan, 1.0])}
    made, _, _ = in_order(lost, np.arange(3), Conventions(sort_times=True, repeated_times="first"))
    np.testing.assert_array_equal(made["time"], lost["time"])
