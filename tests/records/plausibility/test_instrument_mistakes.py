"""Instruments written wrongly on purpose, and the inverse that brings the record back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.records.plausibility.made_up import alike, evidence

from bayeschute.records.plausibility.instrument_mistakes import canopy_mistakes, instrument_mistakes

G = 9.80665
ONES = {one.cause: one for one in (*instrument_mistakes(), *canopy_mistakes())}


def _axes(e):
    return Rotation.from_quat(e.attitude[:, [1, 2, 3, 0]])


def _signed(name, axis, sign=-1.0):
    return lambda e: {name: getattr(e, name) * np.where(np.arange(3) == axis, sign, 1.0)}


def _swapped(name, order):
    return lambda e: {name: getattr(e, name)[:, order]}


def _gravity(share):
    return lambda e: {"force": e.force + share * _axes(e).inv().apply([0.0, 0.0, G])}


def _over_capsule(e, signs=1.0):
    return (e.canopies - e.position[:, None]) * signs


MADE = {  # cause: what stands in the record, of a true one
    "angular rates have the opposite sign": lambda e: {"rate": -e.rate},
    "specific force has the opposite sign: it is gravity less acceleration": lambda e: {"force": -e.force},
    "specific force is without gravity: it is the acceleration of the capsule": _gravity(1.0),
    "specific force has gravity subtracted twice": _gravity(-1.0),
    "angular rates are along earth axes, not body axes": lambda e: {"rate": _axes(e).apply(e.rate)},
    "specific forces are along earth axes, not body axes": lambda e: {"force": _axes(e).apply(e.force)},
    "canopy positions are relative to the capsule": lambda e: {"canopies": _over_capsule(e)},
    "canopy positions are relative to the capsule, z up": lambda e: {"canopies": _over_capsule(e, [1.0, 1.0, -1.0])},
    "canopy velocities are relative to the capsule": lambda e: {
        "canopy_velocity": e.canopy_velocity - e.velocity[:, None]
    },
    "canopy positions and velocities are relative to the capsule": lambda e: {
        "canopies": _over_capsule(e),
        "canopy_velocity": e.canopy_velocity - e.velocity[:, None],
    },
    "order of the canopies differs in positions and velocities (1 and 2 are swapped)": lambda e: {
        "canopy_velocity": e.canopy_velocity[:, [1, 0]]
    },
    "order of the canopies and of the load cells differs (1 and 2 are swapped)": lambda e: {
        "tension": e.tension[:, [1, 0]]
    },
}
for name, words in (("rate", "angular rate"), ("force", "specific force")):
    for i, letter in enumerate("xyz"):
        MADE[f"body axis {letter} of the {words} is inverted"] = _signed(name, i)
    for pair, order in (("x and y", [1, 0, 2]), ("x and z", [2, 1, 0]), ("y and z", [0, 2, 1])):
        MADE[f"body axes {pair} of the {words} are swapped"] = _swapped(name, order)
for i, letter in enumerate("xyz"):
    MADE[f"body axis {letter} is inverted in angular rate and specific force"] = lambda e, i=i: {
        **_signed("rate", i)(e),
        **_signed("force", i)(e),
    }
OVER = {"canopies": "position", "canopy_velocity": "velocity"}


def test_all_mistakes_are_tried_here():
    assert {*ONES} == {*MADE}


@pytest.mark.parametrize("cause", MADE)
def test_the_record_comes_back(cause):
    e = evidence()
    wrong = replace(e, **MADE[cause](e))
    assert not alike(wrong, e) and alike(ONES[cause].undone(wrong), e)


@pytest.mark.parametrize("cause", MADE)
def test_nothing_is_undone_without_its_channels(cause):
    needed = {*MADE[cause](evidence())}
    if "relative" in cause:
        needed |= {OVER[name] for name in needed}
    if "earth axes" in cause or ("gravity" in cause and "opposite" not in cause):
        needed.add("attitude")
    for name in needed:
        assert ONES[cause].undone(evidence(**{name: None})) is None, name


def test_an_order_of_three_is_not_guessed():
    e = evidence(tension=np.ones((24, 3)), canopy_velocity=np.ones((24, 3, 3)))
    assert {one.undone(e) for cause, one in ONES.items() if cause.startswith("order")} == {None}
