"""Tables that can't be interpolated are refused, each for its own reason."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.aero.capsule_grid import grid_faults

ANGLE, ROLL = np.deg2rad([0.0, 60.0, 120.0, 180.0]), np.deg2rad([0.0, 90.0, 180.0, 270.0])
C_N = np.array([[0.1] * 4, [0.2, 0.3, 0.1, 0.0], [0.1, 0.0, 0.4, 0.2], [0.3] * 4])


def told(angle=ANGLE, roll=ROLL, **coefficients):
    return "; ".join(map(str, grid_faults(angle, roll, coefficients or {"C_N": C_N}, "table")))


def test_a_sound_table_has_no_fault():
    assert told() == ""


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"angle": ANGLE[:2]}, "2 angles, 1 of them off the axis"),
        ({"angle": ANGLE[[0, 2, 1, 3]]}, "120 deg followed by 60 deg"),
        ({"angle": ANGLE * 1.1}, "0 to 198 deg"),
        ({"roll": ROLL + 0.1}, "a whole turn in even steps"),
        ({"roll": ROLL[:2]}, "2 rolls"),
        ({"C_N": C_N[:3]}, "shape (3, 4)"),
        ({"C_N": C_N * np.nan}, "16 values that are no number"),
        ({"C_N": 0.0 * C_N}, "no coefficient"),
        ({"C_D": C_N}, "an unknown coefficient"),
        ({"C_N": C_N + np.eye(4)}, "total angle 0 deg"),
        ({"roll": np.zeros(1), "C_N": C_N[:, :1]}, "0 on the axis of a body of revolution"),
    ],
)
def test_faults_are_told(change, words):
    assert words in told(**change)
