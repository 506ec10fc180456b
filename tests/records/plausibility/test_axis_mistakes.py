"""Axes mistaken on purpose, by hand and by SciPy's rotations, and the inverse that brings the record back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.records.plausibility.made_up import alike, changed_channels, evidence

from bayeschute.records.foreign.attitudes import of_matrix, product
from bayeschute.records.foreign.conventions import Conventions
from bayeschute.records.plausibility.axis_mistakes import attitude_mistakes, axis_mistakes, wind_mistakes
from bayeschute.records.plausibility.evidence import conjugate

GROUPS = {
    "capsule positions": "position",
    "capsule velocities": "velocity",
    "canopy positions": "canopies",
    "canopy velocities": "canopy_velocity",
    "velocities of capsule and canopies": "velocity canopy_velocity",
    "canopy positions and velocities": "canopies canopy_velocity",
    "capsule positions and velocities": "position velocity",
    "positions of capsule and canopies": "position canopies",
    "positions and velocities of capsule and canopies": "position velocity canopies",
    "all positions and velocities": "position velocity canopies canopy_velocity",
    "positions, velocities and winds": "position velocity canopies wind profile shear",
    "all positions, velocities and winds": "position velocity canopies canopy_velocity wind profile shear",
}
WRITTEN = {  # what stands in the record for north, east, down
    "{}: z points up, not down": lambda n, e, d: (n, e, -d),
    "{} are east, north, up, read as north, east, down": lambda n, e, d: (e, n, -d),
    "{} are north, west, up, read as north, east, down": lambda n, e, d: (n, -e, -d),
    "North and east are swapped in {}": lambda n, e, d: (e, n, d),
    "{}: the second axis points west, not east": lambda n, e, d: (n, -e, d),
    "{}: the first axis points south, not north": lambda n, e, d: (-n, e, d),
    "east and down are swapped in {}": lambda n, e, d: (n, d, e),
    "North and down are swapped in {}": lambda n, e, d: (d, e, n),
}
ONES = {one.cause: one for one in axis_mistakes()}
ATTITUDES = list(attitude_mistakes())
_Q = np.array([1.0, -1.0, -1.0, -1.0])


def _written(e, names, how):
    moved = {name: np.stack(how(*np.moveaxis(getattr(e, name), -1, 0)), axis=-1) for name in names}
    return replace(e, **moved)


def _in_earth(e, axes):
    """The attitude as of other earth axes, whose components are the matrix times those of the schema's."""
    turn = Rotation.from_matrix(axes) * Rotation.from_quat(e.attitude[:, [1, 2, 3, 0]])
    return replace(e, attitude=turn.as_quat()[:, [3, 0, 1, 2]])


@pytest.mark.parametrize("cause", WRITTEN)
@pytest.mark.parametrize("words", GROUPS)
def test_vectors_come_back(words, cause):
    e = evidence()
    wrong = _written(e, GROUPS[words].split(), WRITTEN[cause])
    made = ONES[cause.format(words)].undone(wrong)
    assert changed_channels(wrong, made) == {*GROUPS[words].split()} and alike(made, e)


OTHERS = {"east, north, up": [[0, 1, 0], [1, 0, 0], [0, 0, -1]], "north, west, up": np.diag([1, -1, -1])}


@pytest.mark.parametrize("axes", OTHERS)
def test_all_of_it_along_other_axes_comes_back_with_the_quaternion(axes):
    e = evidence()
    names = ("position", "velocity", "canopies", "canopy_velocity", "wind", "profile", "shear")
    wrong = _in_earth(_written(e, names, WRITTEN[f"{{}} are {axes}, read as north, east, down"]), OTHERS[axes])
    assert alike(ONES[f"all of it is {axes}, read as north, east, down"].undone(wrong), e)
    only = ONES[f"the quaternion is of axes {axes}, read as of north, east, down"]
    assert alike(only.undone(_in_earth(e, OTHERS[axes])), e)
    assert only.undone(evidence(attitude=None)) is None
    fewer = evidence(canopies=None, attitude=wrong.attitude, wind=None, profile=None, shear=None)
    again = _written(
        fewer, ("position", "velocity", "canopy_velocity"), WRITTEN[f"{{}} are {axes}, read as north, east, down"]
    )
    back = ONES[f"all of it is {axes}, read as north, east, down"].undone(again)
    assert alike(replace(back, attitude=None), replace(fewer, attitude=None))


def test_all_vectors_of_the_list_are_tried_here():
    told = {cause.format(words) for cause in WRITTEN for words in GROUPS}
    assert {cause for cause in ONES if "quaternion" not in cause and "all of it" not in cause} == told


WINDS = {  # what stands in the record for a wind to the north, east and down
    'wind is "from", read as "towards"': lambda n, e, d: (-n, -e, d),
    "north and east are swapped in the wind": lambda n, e, d: (e, n, d),
    "wind is east, north, up, read as north, east, down": lambda n, e, d: (e, n, -d),
    'north and east are swapped in the wind, and it is "from"': lambda n, e, d: (-e, -n, d),
    "wind: the second axis points west, not east": lambda n, e, d: (n, -e, d),
    "wind: the first axis points south, not north": lambda n, e, d: (-n, e, d),
}


@pytest.mark.parametrize("cause", WINDS)
def test_winds_come_back_both_or_one_of_the_two(cause):
    e = evidence()
    made = {one.cause: one for one in wind_mistakes()}
    of = {"wind": "wind profile shear", "recorded wind": "wind", "wind by altitude": "profile shear"}
    for words, names in of.items():
        wrong = _written(e, names.split(), WINDS[cause])
        one = made[cause.replace("wind", words, 1)]
        assert changed_channels(wrong, one.undone(wrong)) == {*names.split()} and alike(one.undone(wrong), e)
    lone = evidence(profile=None, shear=None)
    assert made[cause.replace("wind", "recorded wind", 1)].undone(lone) is None


def test_a_wind_that_lacks_is_that_which_the_capsule_drifts_with():
    (one,) = (one for one in wind_mistakes() if one.cause == "the wind is missing")
    calm = evidence(wind=None, profile=None, shear=None)
    np.testing.assert_array_equal(one.undone(calm).wind, calm.velocity * [1.0, 1.0, 0.0])
    assert one.undone(evidence(profile=None, shear=None)) is None and one.undone(evidence(wind=None)) is None
    assert one.undone(replace(calm, velocity=None)) is None


ORDERS = {  # what stands in the record for the quaternion
    "the quaternion is scalar-last, read as scalar-first": lambda q: q[:, [1, 2, 3, 0]],
    "the quaternion is scalar-first, read as scalar-last": lambda q: q[:, [3, 0, 1, 2]],
    "the quaternion is conjugated: it turns body onto earth axes, not earth onto body axes": lambda q: q * _Q,
    "the quaternion is scalar-last and conjugated": lambda q: (q * _Q)[:, [1, 2, 3, 0]],
}


@pytest.mark.parametrize("cause", ORDERS)
def test_order_and_sense_come_back_along_the_axes_that_were_said(cause):
    e = evidence()
    of_cause = [one for one in ATTITUDES if one.cause == cause]
    plain, *as_said = of_cause
    assert len(as_said) == 2 and all(one.doubt > plain.doubt for one in as_said)
    assert alike(plain.undone(replace(e, attitude=ORDERS[cause](e.attitude))), e)
    for one, axes in zip(as_said, OTHERS.values(), strict=True):  # written along them, read as if in the right order
        written = replace(e, attitude=ORDERS[cause](_in_earth(e, axes).attitude))
        assert alike(one.undone(_in_earth(written, np.array(axes).T)), e)


def test_a_quaternion_of_another_norm_is_divided_by_it():
    e = evidence()
    (one,) = (one for one in ATTITUDES if "norm one" in one.cause)
    assert alike(one.undone(replace(e, attitude=e.attitude * np.linspace(0.5, 2.0, 24)[:, None])), e)


BODY = {  # the record's body axes x, y, z along those of the vehicle
    "z down, x forward, where the vehicle's x is up": [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
    "x down": [[-1, 0, 0], [0, 1, 0], [0, 0, -1]],
    "turned by half a turn about x": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    "x up, where the vehicle's z is down": [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
}


@pytest.mark.parametrize("words", BODY)
def test_body_axes_come_back_of_all_or_of_the_quaternion_alone(words):
    e, rows = evidence(), np.array(BODY[words], float)
    body = Rotation.from_quat(e.attitude[:, [1, 2, 3, 0]]) * Rotation.from_matrix(rows.T)
    only = replace(e, attitude=body.as_quat()[:, [3, 0, 1, 2]])
    wrong = replace(only, rate=e.rate @ rows.T, force=e.force @ rows.T)
    whole, quaternion = (one for one in ATTITUDES if words in one.cause)
    assert "quaternion" in quaternion.cause and whole.doubt < quaternion.doubt
    assert alike(whole.undone(wrong), e) and alike(quaternion.undone(only), e)
    blind = replace(wrong, attitude=None, force=None)
    assert whole.undone(blind) is None
    felt = whole.undone(replace(wrong, attitude=None))
    np.testing.assert_allclose(felt.force, e.force, atol=1e-12)


@pytest.mark.parametrize("cause", ORDERS)
@pytest.mark.parametrize("body_axes", ["-z y x", "y -x z"])
def test_order_and_sense_are_those_before_the_body_axes_that_were_said_turned_it(cause, body_axes):
    """What is read is what was written in another order, then turned from the file's body axes to the vehicle's."""
    e = evidence()
    turn = of_matrix(Conventions(body_axes=body_axes).body().T)
    axes = np.broadcast_to(turn, e.attitude.shape)
    written = ORDERS[cause](product(e.attitude, conjugate(axes)))
    read = replace(e, attitude=product(written, axes), body_turn=turn)
    plain = next(one for one in attitude_mistakes() if one.cause.startswith(cause))
    assert alike(plain.undone(read), replace(e, body_turn=turn))
    if not cause.endswith("conjugated"):  # whose order commutes with some turns
        assert not alike(plain.undone(replace(read, body_turn=None)), e)


def test_one_wrong_table_is_believed_before_two_and_the_third_axis_before_the_others():
    def doubt(words):
        return ONES[words].doubt

    assert (
        doubt("capsule positions: z points up, not down") == doubt("capsule velocities: z points up, not down") == 0.1
    )
    assert doubt("capsule positions and velocities: z points up, not down") == 0.15
    assert doubt("capsule positions: the second axis points west, not east") == pytest.approx(0.3)
