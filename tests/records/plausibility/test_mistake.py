"""Changes that inverses are composed of: which channels they take along, and when there is nothing to change."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.records.plausibility.made_up import changed_channels, evidence

from bayeschute.records.plausibility.mistake import (
    Mistake,
    changed,
    of_vehicle,
    scaled,
    turned_attitude,
    turned_axes,
    with_profile,
)

TURN = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])  # its inverse is another matrix


def _aloft(height):
    return np.stack([0.01 * height, 0.02 * height, 0.0 * height], axis=1)


def test_axes_of_vectors_of_any_rank_are_turned_as_columns():
    e = evidence()
    made = turned_axes(e, ("position", "canopies"), TURN)
    assert changed_channels(e, made) == {"position", "canopies"}
    for t in (0, 7):
        np.testing.assert_allclose(made.position[t], TURN @ e.position[t])
        np.testing.assert_allclose(made.canopies[t, 1], TURN @ e.canopies[t, 1])


def test_the_wind_takes_its_profile_along_however_much_of_it_there_is():
    e = evidence(aloft=_aloft)
    made = turned_axes(e, ("wind",), TURN)
    assert changed_channels(e, made) == {"wind", "profile", "shear"}
    height = np.array([300.0, 700.0])
    np.testing.assert_allclose(made.aloft(height), _aloft(height) @ TURN.T)
    np.testing.assert_allclose(scaled(e, ("profile",), 3.0).aloft(height), 3.0 * _aloft(height))
    assert scaled(e, ("wind",), 3.0).aloft is e.aloft
    alone = evidence(wind=None)
    assert changed_channels(alone, turned_axes(alone, ("wind",), TURN)) == {"profile", "shear"}
    assert turned_axes(evidence(wind=None, profile=None, shear=None), ("wind",), TURN) is None
    assert with_profile(("velocity", "wind"), alone) == ("velocity", "profile", "shear")
    assert with_profile(("velocity",), e) == ("velocity",)


def test_nothing_is_undone_where_one_of_several_channels_lacks():
    e = evidence(canopies=None)
    assert scaled(e, ("position", "canopies"), 2.0) is None and turned_axes(e, ("canopies",), TURN) is None
    np.testing.assert_allclose(scaled(e, ("position",), 2.0).position, 2.0 * e.position)


def test_earth_axes_of_an_attitude_are_turned_before_the_earth():
    """The quaternion takes body components into those along earth axes: the earth's turn comes after it."""
    e, turn = evidence(), Rotation.from_rotvec([0.2, -0.4, 0.9])
    made = turned_attitude(turn.as_quat()[[3, 0, 1, 2]])(e)
    before, after = (Rotation.from_quat(q[:, [1, 2, 3, 0]]) for q in (e.attitude, made.attitude))
    body = np.array([0.3, -1.0, 2.0])
    np.testing.assert_allclose(after.apply(body), turn.apply(before.apply(body)), atol=1e-12)


def test_numbers_of_the_vehicle():
    e = evidence()
    made = of_vehicle(lambda v: {"mass": 2.0 * v.mass})(e)
    assert made.vehicle.mass == 1800.0 and made.vehicle.area == e.vehicle.area
    assert of_vehicle(lambda v: None)(e) is None and of_vehicle(lambda v: {})(replace(e, vehicle=None)) is None


@pytest.mark.parametrize("name", ["position", "canopies", "altitude"])
def test_winds_by_altitude_are_looked_up_again_where_places_change(name):
    e = evidence(aloft=_aloft, altitude=None) if name != "altitude" else evidence(aloft=_aloft)
    made = Mistake("", "", changed((name,), lambda x: 2.0 * x)).undone(e)
    np.testing.assert_allclose(made.profile, _aloft(made.height()))
    assert "shear" in changed_channels(e, made)


def test_winds_stay_where_places_stay():
    e = evidence(aloft=_aloft)
    made = Mistake("", "", changed(("velocity",), np.negative)).undone(e)
    assert made.profile is e.profile and made.shear is e.shear
    assert Mistake("", "", lambda _: None).undone(e) is None
