"""Excess over a limit, and which breaches a study accepts by a name."""

from __future__ import annotations

import numpy as np
import pytest
from tests.records.plausibility.made_up import evidence

from bayeschute.records.plausibility.motion_laws import LAWS as OF_MOTION
from bayeschute.records.plausibility.reading import FAULT, NAMES, WARNING, accepts, reading
from bayeschute.records.plausibility.vehicle_laws import LAWS as OF_VEHICLES


@pytest.mark.parametrize("value", [3.0, -3.0])
def test_excess_is_the_size_of_the_statistic_over_its_limit(value):
    (made,) = reading("clock", "steps", value, 2.0, "{:.1f} s apart")
    assert made.excess == 1.5 and made.got == f"{value:.1f} s apart" and made.wanted == "below 2.0 s apart"
    (told,) = reading("clock", "steps", value, 2.0, "{:.1f} s", "none")
    assert told.wanted == "none"
    assert WARNING < FAULT == reading("clock", "steps", 2.0, 2.0, "{}")[0].excess


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_statistic_that_is_no_number_is_no_reading(value):
    assert reading("clock", "steps", value, 2.0, "{}") == []


def test_a_group_is_accepted_by_its_name_and_a_name_by_itself_alone():
    assert accepts(("wind",), "wind.drift") and accepts(("clock", "wind.drift"), "wind.drift")
    for accepted in ((), ("win",), ("wind.d",), ("wind.drift.more",), ("drift",)):
        assert not accepts(accepted, "wind.drift"), accepted


def test_laws_have_names_that_can_be_accepted():
    assert len(set(NAMES)) == len(NAMES)
    with np.errstate(all="ignore"):
        told = {found.law for law in (*OF_MOTION, *OF_VEHICLES) for found in law(evidence())}
    assert told <= set(NAMES) and len(told) > 20
