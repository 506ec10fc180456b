"""In what a run lies outside the replicates of a calibration."""

from __future__ import annotations

import json

import numpy as np
import pytest

from bayeschute.calibration.domain import Conditions, domain, outside

UNITS = {"duration": "s", "gusts": "m/s", "offset": "m"}


def conditions(duration=90.0, gusts=0.7, offset=0.0, channels=("position",), sampler="nuts"):
    numbers = {"duration": [duration], "gusts": [gusts], "offset": [offset]}
    return Conditions(numbers, {"channels": list(channels), "sampler": [sampler]}, UNITS)


@pytest.fixture(scope="module")
def stored():
    rng = np.random.default_rng(1)
    many = [
        conditions(gusts=0.7 * np.exp(0.15 * rng.standard_normal()), offset=rng.standard_normal()) for _ in range(120)
    ]
    return json.loads(json.dumps(domain(many)))


def test_a_run_like_the_replicates_is_inside(stored):
    assert outside(conditions(), stored) == []
    assert stored["replicates"] == 120 and stored["numbers"]["duration"] == {"low": 90.0, "high": 90.0, "unit": "s"}


def test_runs_like_the_replicates_are_seldom_called_outside(stored):
    rng = np.random.default_rng(2)
    runs = [
        conditions(gusts=0.7 * np.exp(0.15 * rng.standard_normal()), offset=rng.standard_normal()) for _ in range(2000)
    ]
    assert sum(bool(outside(run, stored)) for run in runs) <= 10


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"duration": 30.0}, "duration 30 s, replicates had 90 s"),
        ({"duration": 300.0}, "duration 300 s"),
        ({"duration": 6020.0}, "duration 6,020 s"),
        ({"gusts": 1.8}, "gusts 1.8 m/s, replicates had"),
        ({"gusts": 0.1}, "gusts 0.1 m/s"),
        ({"offset": 9.0}, "offset 9 m"),
        ({"channels": ()}, "channels none, replicates had position"),
        ({"channels": ("position", "tension")}, "channels position, tension, replicates had position"),
        ({"sampler": "emcee"}, "sampler emcee, replicates had nuts"),
    ],
)
def test_what_differs_is_named(stored, change, words):
    (said,) = outside(conditions(**change), stored)
    assert words in said


def test_equal_within_five_percent_is_the_same(stored):
    assert outside(conditions(duration=92.0), stored) == []


def test_numbers_that_no_replicate_had_are_named(stored):
    run = conditions()
    run.numbers["fitted roll"] = [0.2]
    assert outside(run, stored) == ["fitted roll 0.2, replicates had none"]


@pytest.mark.parametrize("none", [None, {}, {"replicates": 0, "numbers": {}, "names": {}}])
def test_a_calibration_without_a_domain_speaks_for_no_run(none):
    assert outside(conditions(), none) == ["the calibration does not say which flights its replicates had"]
