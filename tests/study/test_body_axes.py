"""Body axes of a record: the turn that mends it is told exactly, several where nothing tells them apart, else none."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from other_records import read_flight, record
from other_studies import toml, vehicle

import bayeschute as bc
from bayeschute.records.foreign.attitudes import product
from bayeschute.records.foreign.conventions import Conventions
from bayeschute.records.plausibility import estimated_mistakes
from bayeschute.records.plausibility import verdict as verdicts
from bayeschute.records.plausibility.axis_mistakes import attitude_mistakes
from bayeschute.records.plausibility.evidence import Evidence, evidence_of, turned
from bayeschute.records.plausibility.instrument_mistakes import instrument_mistakes
from bayeschute.records.plausibility.vehicle_mistakes import vehicle_mistakes
from bayeschute.records.plausibility.verdict import readings, verdict
from bayeschute.study.body_axes import TURNS, body_axes_of, text_of, turned_body, with_axes
from bayeschute.study.load import load_vehicle
from bayeschute.study.plausible import axes_said, judge, nominal

OTHERS = Path(os.environ.get("BAYESCHUTE_SHARED", Path(__file__).parents[3] / "shared")) / "otherflights"
CHANNELS = ("rate", "force", "attitude")


@pytest.fixture(scope="module", autouse=True)
def _clocks_at_most_half_a_second_apart():
    """Their search has tests of its own, and takes most of a verdict's time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(estimated_mistakes, "_FARTHEST", 0.5)
        yield


@pytest.fixture
def mistakes_of_the_body(monkeypatch):
    """Only mistakes of attitude, instruments and vehicle are tried: those that a turn of body axes may be taken for."""
    found = (*attitude_mistakes(), *instrument_mistakes(), *vehicle_mistakes())
    monkeypatch.setattr(verdicts, "known_mistakes", lambda: found)


@pytest.fixture(scope="module")
def flight():
    """The default study's drop."""
    return bc.Study.example().flights[0]


@pytest.fixture(scope="module")
def on_axis(flight) -> Evidence:
    """Of that drop, whose attach point lies on the axis."""
    return evidence_of(flight.record, nominal(flight.vehicle, flight.spec.capsule_mass))


@pytest.fixture(scope="module")
def off_axis(on_axis) -> Evidence:
    """The same along body axes that are some degrees off, so that the attach point is off theirs."""
    small = np.array([0.0, np.sin(0.03), np.sin(0.06)])
    q = np.array([np.sqrt(1.0 - small @ small), *small])
    matrix = turned(np.tile(q, (3, 1)), np.eye(3)).T
    back = np.broadcast_to([q[0], *-small], on_axis.attitude.shape)
    return replace(
        on_axis, rate=on_axis.rate @ matrix.T, force=on_axis.force @ matrix.T, attitude=product(on_axis.attitude, back),
        vehicle=replace(on_axis.vehicle, attach_b=matrix @ on_axis.vehicle.attach_b),
    )  # fmt: skip


def _same(one: Evidence, other: Evidence) -> bool:
    """Whether body channels agree, quaternions but for their sign."""
    alike = np.abs(np.sum(one.attitude * other.attitude, axis=1))
    return np.allclose(alike, 1.0) and all(
        np.allclose(getattr(one, name), getattr(other, name), equal_nan=True) for name in ("rate", "force")
    )


def test_there_are_24_turns_and_their_text_is_read_back():
    assert len({text_of(turn) for turn in TURNS}) == 24 and text_of(TURNS[0]) == "x y z"
    for turn in TURNS:
        np.testing.assert_allclose(Conventions(body_axes=text_of(turn)).body(), turn)
        assert np.linalg.det(turn) == pytest.approx(1.0)


@pytest.mark.parametrize("turn", TURNS, ids=text_of)
def test_a_turn_keeps_laws_between_the_channels_and_is_found(off_axis, turn):
    spoilt = turned_body(off_axis, turn)
    before, after = readings(off_axis), readings(spoilt)
    for law in ("force.horizontal", "force.down", "force.turn"):
        assert after[law].excess == pytest.approx(before[law].excess, rel=1e-6)
    found = body_axes_of(spoilt)
    assert found is not None and found.columns == {} and len(found.turns) == 1
    assert _same(turned_body(spoilt, found.turns[0]), off_axis)


@pytest.mark.parametrize("turn", TURNS[::5], ids=text_of)
def test_an_attach_point_on_the_axis_leaves_four(on_axis, turn):
    spoilt = turned_body(on_axis, turn)
    found = body_axes_of(spoilt)
    assert found is not None and len(found.turns) == 4
    assert sum(_same(turned_body(spoilt, one), on_axis) for one in found.turns) == 1


@pytest.mark.parametrize("names", [("rate", "force"), ("rate",), ("force",), ("attitude",)])
@pytest.mark.parametrize("turn", TURNS[3::7], ids=text_of)
def test_instruments_that_are_mounted_otherwise_than_the_attitude_says(off_axis, names, turn):
    spoilt = turned_body(off_axis, turn, names)
    found = body_axes_of(spoilt)
    assert found is not None and len(found.turns) == 1
    mended = spoilt
    for name, own in found.columns.items():
        mended = turned_body(mended, own, (name,))
    assert _same(turned_body(mended, found.turns[0]), off_axis)


def test_a_dead_gyro_does_not_spoil_the_others(off_axis):
    dead = replace(off_axis, rate=off_axis.rate * [1.0, np.nan, 1.0])
    spoilt = turned_body(dead, TURNS[7])
    assert np.isfinite(spoilt.rate).any(axis=0).sum() == 2
    assert _same(turned_body(spoilt, body_axes_of(spoilt).turns[0]), dead)


def test_nothing_is_told_where_nothing_tells_it(on_axis, off_axis):
    assert body_axes_of(replace(off_axis, vehicle=None)) is None
    assert body_axes_of(replace(off_axis, force=None)) is None
    unknown = replace(off_axis.vehicle, attach_b=np.full(3, np.nan))
    assert body_axes_of(replace(off_axis, vehicle=unknown)) is None
    aside = replace(off_axis.vehicle, attach_b=np.ones(3))  # no turn puts a pull along an axis there
    assert body_axes_of(replace(off_axis, vehicle=aside)) is None
    for e in (on_axis, off_axis):
        sound = verdict(e)
        assert with_axes(sound, "x y z") is sound


def test_what_to_write_is_told_on_top_of_what_was_said(off_axis):
    """Of a record read with `-z y x` whose axes were those already."""
    wrong = Conventions(body_axes="-z y x").body()
    judged = verdict(turned_body(off_axis, wrong))
    found = with_axes(judged, "-z y x")
    told = {one.do for one in found.faults}
    assert told == {'Say body_axes = "x y z".'} and found.causes[0].startswith("body axes of the record are not")
    (plain,) = {one.do for one in with_axes(judged, None).faults}
    assert plain == "Turn its body axes: the vehicle's x, y, z are its z, y, -x."


def test_columns_of_instruments_are_told(off_axis, mistakes_of_the_body):
    wrong = Conventions(body_axes="y -x z").body()
    found = with_axes(verdict(turned_body(off_axis, wrong, ("rate", "force"))), "x y z")
    (told,) = {one.do for one in found.faults}
    each = "x from y with scale = -1; y from x; z from z."
    assert told == " ".join(f"Take the columns of capsule_{n} so: {each}" for n in ("rate", "specific_force"))


def test_a_turn_about_the_pull_is_a_warning(off_axis):
    """It breaks no law: only the place of the attach point off the axis tells it."""
    spoilt = turned_body(off_axis, Conventions(body_axes="x -y -z").body())
    found = with_axes(verdict(spoilt), "x -y -z")
    (told,) = found.warnings
    assert found.faults == () and told.law == "hanging.force"
    assert told.do.startswith('Say body_axes = "x y z". Or mind the signs of attach_point')


def test_other_mistakes_keep_their_causes(off_axis):
    for spoilt in (
        replace(off_axis, attitude=off_axis.attitude[:, [1, 2, 3, 0]]),
        replace(off_axis, force=-off_axis.force),
        replace(off_axis, rate=off_axis.rate * [1.0, -1.0, 1.0]),
    ):
        found = verdict(spoilt)
        assert found.causes and with_axes(found, "x y z") is found


def test_both_doors_tell_it(flight, mistakes_of_the_body):
    attach = dict(zip("xyz", (2.5, 0.2, -0.3), strict=True))
    other = flight.record.copy(deep=True)
    e = evidence_of(other, replace(nominal(flight.vehicle), attach_b=np.array([*attach.values()])))
    wrong = Conventions(body_axes="-z y x").body()
    for name, values in zip(("rate", "specific_force"), (e.rate, e.force), strict=True):
        other[f"capsule_{name}"].values = values @ wrong.T
    other["capsule_attitude"].values = turned_body(e, wrong).attitude
    memory = other.assign_attrs(body_axes="-z y x")
    told = judge(memory, flight.vehicle, body_axes=axes_said(memory, None, None))
    assert any('body_axes = "x' in one.do for one in told.faults)
    looked = bc.Flight(memory, flight.vehicle).plausibility()
    assert 'Say body_axes = "x' in repr(looked)
    assert axes_said(memory, Path("drop.nc"), None) is None and axes_said(memory, Path("drop.csv"), None) == "x y z"


@pytest.mark.skipif(not OTHERS.is_dir(), reason="no flights of another program in ../shared")
@pytest.mark.parametrize(("first", "name"), [*enumerate(["P_1", "R_3", "S_1", "T_1", "U_2"])])
def test_flights_of_another_program(first, name, tmp_path):
    """All 24 turns, exactly, every fifth on each flight; and sound records are left alone."""
    flight = read_flight(OTHERS, name)
    path = tmp_path / "vehicle.toml"
    path.write_text(toml(vehicle(flight)), encoding="utf-8")
    e = evidence_of(record(flight), nominal(load_vehicle(path)))
    for turn in (TURNS[0], *TURNS[first::5]):
        found = body_axes_of(turned_body(e, turn))
        assert found is not None and len(found.turns) == 1 and not found.columns
        np.testing.assert_allclose(found.turns[0] @ turn, np.eye(3))
