"""Errors, bounds and ratios; a flight that failed never passes."""

from __future__ import annotations

import json

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.verification.all_cases import document, verdict
from bayeschute.verification.case_results import all_members, elastic, table
from bayeschute.verification.catalogue import CASES, choose
from bayeschute.verification.limit_cycle import cycle
from bayeschute.verification.sets import FOOT

ROUGH, FINE = 0.1 * FOOT, 0.01 * FOOT


def test_errors_are_told_in_the_unit_of_the_bound_and_of_both_signs():
    lines = all_members("1", "x", "y", "ft/s", [[-ROUGH, FINE], [0.0], [0.2 * FOOT], [FINE]], 0.1)
    assert [line.error for line in lines] == pytest.approx([0.1, 0.0, 0.2, 0.01])
    assert [line.passed for line in lines] == [True, True, False, True]


def test_elastic_errors_must_fall_as_the_stiffness_grows():
    good = [np.array([ROUGH, -ROUGH]), np.array([FINE, FINE]), np.array([ROUGH]), np.array([FINE])]
    assert all(line.passed for line in elastic("1", "x", "y", "ft", good, 0.11))
    late = [good[0], 1.04 * good[1], good[2], good[3] / 1.04]
    lines = elastic("1", "x", "y", "ft", late, 0.11)
    assert [line.passed for line in lines] == [True, True, False, True, True, False]
    assert [line.stiffness for line in lines[:3]] == [1.0, 10.0, None]


@pytest.mark.parametrize("wrong", [np.nan, np.inf, 0.0])
def test_a_flight_that_failed_never_passes(wrong):
    lines = elastic("1", "x", "y", "ft", [[ROUGH], [wrong], [wrong], [FINE]], 0.11)
    assert [line.passed for line in lines][2::3] == [False, False]
    if wrong != 0.0:
        assert not lines[1].passed and not lines[3].passed
    text = json.dumps(document(lines, 1.0), allow_nan=False)
    assert json.loads(text)["passed"] is False


def test_document_and_table_tell_the_same():
    lines = all_members("6a", "x", "y", "deg", [[0.0]] * 4, 1.0) + all_members("14", "x", "y", "", [[9.0]] * 4, 1.0)
    told = document(lines, 2.5)
    assert told["cases"] == [
        {"name": "6a", "title": "pendulum without aerodynamic stiffness", "passed": True},
        {"name": "14", "title": "limit cycle of the pendulum", "passed": False},
    ]
    assert set(told) == {"program", "version", "seconds", "passed", "cases", "results"}
    fields = {"case", "set", "stiffness", "quantity", "reference", "unit", "error", "bound", "passed"}
    assert all(set(result) == fields for result in told["results"])
    assert len(table(lines)) == 1 + len(lines)
    assert verdict(lines) == "1 of 2 cases passed; failed: 14"


def test_names_of_cases():
    assert choose(()) == CASES
    assert [case.name for case in choose(["10", "3b", "3b"])] == ["3b", "10p", "10n"]
    with pytest.raises(InputError, match=r"--case 15: got no such case; wanted one of 1, 2, 3a") as caught:
        choose(["1", "15", "a"])
    assert len(caught.value.faults) == 2


def test_cycle_of_a_sine_and_of_nothing():
    time = np.arange(0.0, 100.0, 0.1)
    got = cycle(time, 0.38 * np.sin(0.44 * time), 10.0 + np.cos(0.88 * time))
    assert got.amplitude == pytest.approx(0.38, rel=1e-4)
    assert got.frequency == pytest.approx(0.44 / (2.0 * np.pi), rel=1e-4)
    assert got.sink == pytest.approx(10.0, abs=1e-2)
    assert np.isnan(cycle(time, np.full_like(time, np.nan), time)).all()
    assert np.isnan(cycle(time, np.exp(-time), time)).all()
