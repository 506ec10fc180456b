"""Axes told by letters as the matrices that a reader would write down, and what letters and words are refused."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
import pytest

from bayeschute.records.foreign.conventions import USUAL, Conventions, convention_faults

NED = {"N": [1, 0, 0], "S": [-1, 0, 0], "E": [0, 1, 0], "W": [0, -1, 0], "D": [0, 0, 1], "U": [0, 0, -1]}
ALL_AXES = ["".join(made) for order in permutations(("NS", "EW", "UD")) for made in product(*order)]


@pytest.mark.parametrize("axes", ALL_AXES)
def test_a_step_along_each_axis_goes_where_its_letter_says(axes):
    said = Conventions(axes=axes)
    assert convention_faults(said, "x") == []
    for column, letter in zip(np.eye(3), axes, strict=True):
        np.testing.assert_array_equal(said.earth() @ column, NED[letter])


@pytest.mark.parametrize("text", ["-z y x", "+x,-y, -z", " y,z,x", "x y z"])
def test_the_vehicle_s_axes_are_named_by_those_of_the_record(text):
    said, record = Conventions(body_axes=text), dict(x=2.0, y=3.0, z=5.0)
    assert convention_faults(said, "x") == []
    wanted = [(-1.0 if "-" in part else 1.0) * record[part.strip("+-")] for part in text.replace(",", " ").split()]
    np.testing.assert_array_equal(said.body() @ [2.0, 3.0, 5.0], wanted)


def test_the_usual_ones_change_nothing():
    np.testing.assert_array_equal(USUAL.earth(), np.eye(3))
    np.testing.assert_array_equal(USUAL.body(), np.eye(3))
    assert convention_faults(USUAL, "x") == []


REFUSED = [
    ({"axes": "NE"}, "axes", "'NE'"),
    ({"axes": "NEDD"}, "axes", "'NEDD'"),
    ({"axes": "NSD"}, "axes", "'NSD'"),
    ({"axes": "ned"}, "axes", "'ned'"),
    ({"axes": "NEX"}, "axes", "'NEX'"),
    ({"body_axes": "x y"}, "body_axes", "'x y'"),
    ({"body_axes": "x y y"}, "body_axes", "'x y y'"),
    ({"body_axes": "x y -z"}, "body_axes", "right-handed"),
    ({"body_axes": "y x z"}, "body_axes", "right-handed"),
    ({"attitude": "earth"}, "attitude", "'earth to body'"[1:-1]),
    ({"euler": "zyz"}, "euler", "zyx"),
    ({"wind_is": "to"}, "wind_is", "towards, from"),
    ({"repeated_times": "median"}, "repeated_times", "first, last, mean"),
    ({"clock_wraps": 0.0}, "clock_wraps", "0 s"),
    ({"clock_wraps": float("nan")}, "clock_wraps", "nan s"),
]


@pytest.mark.parametrize(("said", "key", "words"), REFUSED)
def test_what_is_no_convention_is_refused_with_its_key(said, key, words):
    (fault,) = convention_faults(Conventions(**said), "flight 'a'")
    assert fault.where == f"flight 'a' {key}" and words in str(fault)


def test_all_faults_come_at_once():
    said = Conventions(
        axes="N", body_axes="x", attitude="a", euler="b", wind_is="c", repeated_times="d", clock_wraps=-1.0
    )
    assert len(convention_faults(said, "x")) == 7
