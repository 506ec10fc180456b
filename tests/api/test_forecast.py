"""A part of the time of a forecast: its statistics, probabilities and checks are of that part alone."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import bayeschute as bc
from bayeschute.api.forecast import Forecast

TIME = np.arange(100.0, 110.0)


@pytest.fixture
def slowing() -> Forecast:
    """Descent rates that fall by 1 m/s each second, 101 draws 0.1 m/s apart; the first three samples were fitted."""
    rate = 20.0 - np.arange(10.0) + 0.1 * np.arange(101.0)[:, None]
    draws = xr.Dataset({"descent_rate": (("draw", "time"), rate, {"units": "m/s"})}, {"time": TIME})
    draws.attrs = {"failed": 0, "flight": "a"}
    truth = xr.Dataset({"descent_rate": ("time", rate[50])}, {"time": TIME})
    held_out = np.arange(10) >= 3
    return Forecast("a", draws, held_out, {"descent_rate": rate[-1] + 5.0}, truth, {}, 101, {}, 0)


@pytest.mark.parametrize(
    ("start", "end", "first", "last"),
    [(None, None, 100, 109), ("105 s", None, 105, 109), (None, 106.0, 100, 106), ("0.1 ks", "1.75 min", 100, 105)],
)
def test_ends_are_on_the_clock_of_the_record_and_included(slowing, start, end, first, last):
    part = slowing.between(start, end)
    assert part.draws["time"].values[[0, -1]].tolist() == [first, last]
    assert part.held_out.size == part.record["descent_rate"].size == part.truth.sizes["time"] == last - first + 1
    assert part.draws.attrs == slowing.draws.attrs and part.name == "a"


def test_statistics_and_probabilities_are_of_the_part(slowing):
    part = slowing.between("107 s")
    seen = 20.0 - np.array([7.0, 8.0, 9.0]) + 5.0
    assert float(part.statistic("descent_rate").median()) == pytest.approx(seen.mean())
    assert float(part.statistic("descent_rate", "maximum").median()) == pytest.approx(seen.max())
    assert part.probability("descent_rate", at_most=17.04).met == pytest.approx(51 / 101)
    assert slowing.probability("descent_rate", at_most=17.04).met < 0.5
    assert part.band("descent_rate")["median"].values == pytest.approx(seen)


def test_only_samples_that_were_not_seen_count_in_the_part_too(slowing):
    assert slowing.between(end="104 s").counted.tolist() == [False] * 3 + [True] * 2
    rows = slowing.between("104 s", "106 s").check(levels=(0.9,)).set_index("reference")
    assert rows["samples"].tolist() == [3, 3] and rows.loc["truth", "inside 90 %"] == 1.0
    assert rows.loc["record", "inside 90 %"] == 0.0


@pytest.mark.parametrize(("start", "end"), [("200 s", None), ("104.2 s", "104.8 s"), ("106 s", "103 s"), (109.0, None)])
def test_a_part_without_samples_is_refused_with_what_there_is(slowing, start, end):
    with pytest.raises(bc.InputError, match="100 to 109 s"):
        slowing.between(start, end)


def test_a_length_is_no_time(slowing):
    with pytest.raises(bc.InputError, match="start"):
        slowing.between("3 m")
