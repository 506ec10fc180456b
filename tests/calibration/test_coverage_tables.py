"""What rows say, on rows small enough to count by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bayeschute.calibration.coverage_tables import lines, summarise
from bayeschute.calibration.promises import promised

NAMES = ("axial[1]", "riser_length")


def _row(seed: int, inside: bool, share: float, left_out: bool = False) -> dict[str, Any]:
    def entry(held: bool) -> dict[str, Any]:
        return {"truth": 0.0, "mean": 1.0 if held else 2.0, "sd": 1.0, "inside": [False, False, held, held, True]}

    band = {
        "coverage": [0.5, 0.8, share, 0.95, 1.0], "width": [1.0] * 5, "interval_score": [2.0] * 5, "crps": 0.3,
        "pit": [0.5] * 10, "by_time": {"0-30 s": [0.5, 0.8, share, 0.95, 1.0]},
    }  # fmt: skip
    parameters = {"riser_length": entry(True)} | ({} if left_out else {"axial[1]": entry(inside)})
    return {
        "seed": seed, "ok": True, "wall_s": 2.0, "parameters": parameters,
        "left_out": ["axial[1]"] if left_out else [], "missed_checks": ["innovations"] if left_out else [],
        "bands": {"seen": {"swing_angle": band | {"role": "identify"}}, "new": {"swing_angle": band | {"role": "predict"}}},
    }  # fmt: skip


ROWS = [_row(1, True, 1.0), _row(2, False, 0.8), _row(3, True, 0.9, left_out=True)]
FAILED = {"seed": 4, "ok": False, "error": "lost", "wall_s": 1.0}
MADE = summarise([*ROWS, FAILED])


def test_shares_are_counted():
    assert MADE["coverage"]["riser_length"] == 1.0
    assert MADE["coverage"]["new/swing_angle"] == pytest.approx(0.9)
    assert MADE["bands"]["new/swing_angle"]["by_time"] == {"0-30 s": pytest.approx(0.9)}
    assert MADE["standard_error"]["new/swing_angle"] == pytest.approx(0.1 / np.sqrt(3.0))


def test_a_flown_term_left_out_counts_as_missed():
    assert MADE["coverage"]["axial[1]"] == pytest.approx(1.0 / 3.0)
    assert MADE["parameters"]["axial[1]"]["left_out"] == 1
    assert MADE["parameters"]["axial[1]"]["rms_z"] == pytest.approx(np.sqrt(2.5))


def test_failures_and_missed_checks_are_told():
    assert MADE["replicates"] == 3 and MADE["failed"] == {"4": "lost"}
    assert MADE["missed_checks"] == {"innovations": 1}
    assert MADE["wall_s"] == pytest.approx(1.75)


def test_corrections_that_can_be_trusted_are_counted():
    tails = ({"pareto_k": 0.2}, {"pareto_k": 0.8}, {"pareto_k": None}, {})
    made = summarise([ROWS[0] | one for one in tails])
    assert made["pareto_k"] == {"replicates": 3, "below": 1} and MADE["pareto_k"]["replicates"] == 0


def test_every_interval_is_judged():
    assert promised(MADE) == ["riser_length", "axial[1]", "seen/swing_angle", "new/swing_angle"]
    assert MADE["bands"]["new/swing_angle"]["lowest"] == 0.8


def test_lines_hold_every_name():
    text = "\n".join(lines(MADE))
    assert all(name in text for name in (*NAMES, "seen/swing_angle", "left out 1 times", "too few replicates"))


def test_no_row_is_no_table():
    nothing = summarise([FAILED])
    assert nothing["replicates"] == 0 and nothing["coverage"] == {} and promised(nothing) == []


def test_modes_are_counted_apart_and_rows_without_them_left_out():
    def scored(row: dict[str, Any], held: bool) -> dict[str, Any]:
        one = {"truth": 0.0, "mean": 1.0, "sd": 0.5, "inside": [False, False, held, held, True], "pit": 0.25}
        return row | {"modes": {"new": {"pendulum amplitude": one}}}

    made = summarise([scored(ROWS[0], True), scored(ROWS[1], False), ROWS[2], FAILED])
    mode = made["modes"]["new/pendulum amplitude"]
    assert mode["share"] == 0.5 and mode["replicates"] == 2 and mode["role"] == "predict"
    assert mode["mean_z"] == 2.0 and mode["rms_z"] == 2.0 and mode["pit"] == 0.25
    assert mode["coverage"]["0.99"] == 1.0
    assert made["coverage"] == MADE["coverage"] and MADE["modes"] == {} == MADE["statistics"]
    assert "new/pendulum amplitude" in "\n".join(lines(made))
