"""Numbers of a vehicle written wrongly on purpose, and the inverse that puts them right."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from tests.records.plausibility.made_up import evidence

from bayeschute.records.plausibility.vehicle_mistakes import vehicle_mistakes

FOOT, POUND, SLUG = 0.3048, 0.45359237, 14.593903
WRITTEN = {  # by what the true number has to be multiplied to get the one that stands in the file
    "the capsule's mass is in pounds, read as kilograms": {"mass": 1 / POUND},
    "the capsule's mass is in kilograms, read as pounds": {"mass": POUND},
    "the capsule's mass is in slugs, read as kilograms": {"mass": 1 / SLUG},
    "the capsule's mass is in grams, read as kilograms": {"mass": 1e3},
    "the capsule's mass is in tonnes, read as kilograms": {"mass": 1e-3},
    "the capsule's mass is ten times too great": {"mass": 10.0},
    "the capsule's mass is ten times too small": {"mass": 0.1},
    "the risers' length is in feet, read as metres": {"riser_length": 1 / FOOT},
    "the risers' length is in metres, read as feet": {"riser_length": FOOT},
    "the risers' length is twice what it should be": {"riser_length": 2.0},
    "the risers' length is half of what it should be": {"riser_length": 0.5},
    "the canopies' area is in square feet, read as square metres": {"area": FOOT**-2},
    "the canopies' area is in square metres, read as square feet": {"area": FOOT**2},
    "the canopies' diameter is in feet, read as metres": {"diameter": 1 / FOOT},
    "the canopies' diameter is in metres, read as feet": {"diameter": FOOT},
    "the canopies' area and diameter are in feet, read as metres": {"area": FOOT**-2, "diameter": 1 / FOOT},
    "the canopies' diameter is a radius": {"diameter": 0.5},
    "the canopies' volume is in cubic feet, read as cubic metres": {"volume": FOOT**-3},
    "the canopies' area is that of all canopies together": {"area": 2.0},
    "the attach point is on the wrong side of the centre of mass": {"attach_b": -1.0},
    "the capsule's inertia is in slug ft^2, read as kg m^2": {"inertia": 1 / (SLUG * FOOT**2)},
}
COUNTED = "the vehicle has another number of canopies than the record"
MISTAKES = {one.cause: one for one in vehicle_mistakes()}


@pytest.mark.parametrize("cause", WRITTEN)
def test_the_number_that_should_stand_there(cause):
    right = evidence()
    wrong = {name: factor * getattr(right.vehicle, name) for name, factor in WRITTEN[cause].items()}
    made = MISTAKES[cause].undone(replace(right, vehicle=replace(right.vehicle, **wrong)))
    for one in fields(right.vehicle):
        np.testing.assert_allclose(getattr(made.vehicle, one.name), getattr(right.vehicle, one.name), rtol=1e-6)


def test_all_mistakes_are_tried_here():
    assert {*MISTAKES} == {*WRITTEN, COUNTED}
    assert {one.undone(evidence(vehicle=None)) for one in MISTAKES.values()} == {None}


def test_one_canopy_has_the_area_of_all():
    e = evidence()
    single = replace(e, vehicle=replace(e.vehicle, canopies=1))
    assert MISTAKES["the canopies' area is that of all canopies together"].undone(single) is None


def test_canopies_are_counted_by_their_positions_else_by_load_cells():
    one = MISTAKES[COUNTED]
    e = evidence()
    wrong = replace(e, vehicle=replace(e.vehicle, canopies=3))
    assert one.undone(wrong).vehicle.canopies == 2 and one.undone(e) is None
    three = np.ones((24, 3))
    assert one.undone(replace(e, tension=three)) is None
    assert one.undone(replace(e, tension=three, canopies=None)).vehicle.canopies == 3
    assert one.undone(replace(e, tension=None, canopies=None)) is None
