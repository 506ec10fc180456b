"""Mistakes made on purpose are named, with the right cause first: on a virtual flight, and on one of another program."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from other_records import flights_of, read_flight, record
from other_studies import toml, vehicle
from physical_mistakes import FOOT, KNOT, MADE, Case, Made, _along, _axis, _late, _times, judge

import bayeschute as bc
from bayeschute.records.foreign.attitudes import in_schema, of_matrix, product
from bayeschute.records.foreign.conventions import Conventions
from bayeschute.records.plausibility.evidence import Nominal, conjugate
from bayeschute.records.plausibility.mistakes import known_mistakes
from bayeschute.records.plausibility.reading import NAMES
from bayeschute.records.plausibility.verdict import Laws, readings
from bayeschute.study.load import load_vehicle
from bayeschute.study.plausible import nominal, told, warned

ROOT = Path(__file__).parents[3]

OTHERS = Path(os.environ.get("BAYESCHUTE_SHARED", ROOT.parent / "shared")) / "otherflights"
needs_others = pytest.mark.skipif(not OTHERS.is_dir(), reason="no flights of another program in ../shared")


@pytest.fixture(scope="module")
def virtual() -> Case:
    """The default study's drop, with what instruments make of it."""
    study = bc.Study.example()
    flown = study.flights[0]
    assert study.vehicle is not None
    return Case(flown.record, nominal(study.vehicle, flown.spec.capsule_mass))


@pytest.fixture(scope="module")
def other(tmp_path_factory) -> Case:
    return _case("P_1", tmp_path_factory.mktemp("P"))


def _case(name: str, folder: Path) -> Case:
    flight = read_flight(OTHERS, name)
    path = folder / f"{name}.toml"
    path.write_text(toml(vehicle(flight)), encoding="utf-8")

    def profile(height):
        columns = (flight.profile[:, 1], flight.profile[:, 2], 0.0 * flight.profile[:, 0])
        return np.stack([np.interp(height, flight.profile[:, 0], x) for x in columns], axis=1)

    return Case(record(flight), nominal(load_vehicle(path)), None, profile)


UNSEEN = {  # on the virtual flight
    "canopies 1 and 2 swapped against load cells": "it has no load cells",
    "a third of the payload omitted": "it has no load cells",
    "load cells in pound-force": "it has no load cells",
    "load cells in kilonewtons": "it has no load cells",
    "a body axis of the accelerometers inverted": "its payload hangs along x: across it, specific force is next to zero",
}
QUICK = MADE[::5]


def test_a_virtual_flight_keeps_all_laws(virtual):
    found = virtual.verdict()
    assert found.findings == () and found.causes == ()
    assert {r.law for r in found.readings} <= set(NAMES) and len(found.readings) > 25
    assert not any(" rad" in r.got + r.wanted for r in found.readings)  # people read deg


def test_laws_that_remember_say_what_they_say_anew(virtual):
    e = virtual.verdict().evidence
    laws = Laws(e)
    for mistake in known_mistakes()[::3]:
        made = mistake.undone(e)
        if made is not None:
            remembered, anew = laws.readings(made), readings(made)
            assert list(remembered) == list(anew) and remembered == anew, mistake.cause


@pytest.mark.parametrize(
    "made",
    [pytest.param(m, marks=[] if m in QUICK else [pytest.mark.slow]) for m in MADE if m.name not in UNSEEN],
    ids=lambda made: made.name,
)
def test_mistakes_on_a_virtual_flight(virtual, made):
    outcome = judge(virtual, made)
    assert outcome.named and outcome.right, outcome


@pytest.mark.parametrize("axes", ["ENU", "NWU"])
@pytest.mark.parametrize(
    ("order", "signs", "cause"),
    [([1, 2, 3, 0], 1.0, "scalar-last, read as scalar-first"), ([0, 1, 2, 3], [1.0, -1.0, -1.0, -1.0], "conjugated")],
)
def test_order_and_sense_are_named_where_the_axes_of_the_quaternion_were_said(virtual, axes, order, signs, cause):
    """What was written along those axes in another order or sense, and read by `in_schema` as the study says."""
    said = Conventions(axes=axes)

    def make(case: Case) -> None:
        attitude = case.record["capsule_attitude"]
        whole = np.isfinite(attitude.values).all(axis=1)
        along = product(np.broadcast_to(conjugate(of_matrix(said.earth())), (whole.sum(), 4)), attitude.values[whole])
        attitude.values[whole] = in_schema((along * signs)[:, order], said)

    outcome = judge(virtual, Made(cause, make, cause))
    assert outcome.named and outcome.right, outcome


@pytest.fixture(scope="module")
def with_imus(virtual) -> Case:
    """The same drop with IMUs in the canopies: true motion and noise."""
    truth = bc.Study.example().flights[0].truth
    assert truth is not None
    step = float(np.diff(truth["time"].values[:2])[0])
    moving = np.gradient(truth["canopy_position"].transpose("time", "canopy", "axis").values, step, axis=0)
    seen = moving + 0.1 * np.random.default_rng(1).normal(size=moving.shape)
    record = virtual.record.assign(canopy_velocity=(("time", "canopy", "axis"), seen, {"units": "m/s"}))
    return Case(record, virtual.vehicle)


def test_velocities_of_canopies_keep_their_laws(with_imus):
    found = with_imus.verdict()
    assert found.findings == () and {"canopy_velocity.horizontal", "canopy_velocity.down"} <= {
        r.law for r in found.readings
    }


def _over_capsule(*names):
    def make(case: Case) -> None:
        for name in names:
            case.record[f"canopy_{name}"].values -= case.record[f"capsule_{name}"].values[:, None]

    return make


def _other_canopy(case: Case) -> None:
    case.record["canopy_velocity"].values = case.record["canopy_velocity"].values[:, ::-1]


_ENU = [[0, 1, 0], [1, 0, 0], [0, 0, -1]]
_SWAPPED = [[0, 1, 0], [1, 0, 0], [0, 0, 1]]
OF_IMUS = (
    Made("canopy velocities up", _axis(2, "canopy_velocity"), r"^canopy velocities: z points up"),
    Made("both velocities up", _axis(2, "canopy_velocity", "capsule_velocity"),
         r"^velocities of capsule and canopies: z points up"),
    Made("canopy velocities in ENU", _along(_ENU, "canopy_velocity"), r"^canopy velocities are east, north, up"),
    Made("canopy velocities swapped", _along(_SWAPPED, "canopy_velocity"), r"swapped in canopy velocities"),
    Made("canopy velocities in feet", _times(1 / FOOT, "canopy_velocity"), r"^canopy velocities are in ft/s, read"),
    Made("canopy velocities in knots", _times(1 / KNOT, "canopy_velocity"), r"^canopy velocities are in knots, read"),
    Made("both velocities in feet", _times(1 / FOOT, "canopy_velocity", "capsule_velocity"),
         r"^velocities of capsule and canopies are in ft/s, read"),
    Made("all lengths in feet", _times(1 / FOOT, "canopy_velocity", "capsule_velocity", "canopy_position", "capsule_position"),
         r"^positions and velocities of capsule and canopies are in feet, read"),
    Made("over the capsule", _over_capsule("velocity"), r"^canopy velocities are relative to the capsule"),
    Made("all of the canopies over the capsule", _over_capsule("velocity", "position"),
         r"^canopy positions and velocities are relative to the capsule"),
    Made("the other canopy's", _other_canopy, r"^order of the canopies differs in positions and velocities"),
    Made("late", _late(3.0, "canopy_velocity"), r"^canopy velocities are (2\.9|3\.[01]) s late"),
)  # fmt: skip


@pytest.mark.parametrize("made", OF_IMUS, ids=lambda made: made.name)
def test_mistakes_with_velocities_of_canopies(with_imus, made):
    outcome = judge(with_imus, made)
    assert outcome.named and outcome.right, outcome


@pytest.mark.slow
@needs_others
def test_mistakes_on_a_flight_of_another_program(other):
    outcomes = [judge(other, made) for made in MADE]
    assert [o.made.name for o in outcomes if not o.named] == []
    assert sum(o.right for o in outcomes) >= 0.9 * len(MADE), [o for o in outcomes if not o.right]


@needs_others
@pytest.mark.parametrize("letter", list("PQRSTU"))
def test_flights_of_another_program_keep_all_laws(letter, tmp_path):
    for name in flights_of(OTHERS, letter)[:2]:
        assert _case(name, tmp_path).verdict().findings == (), name


def test_two_mistakes_are_both_named(virtual):
    spoilt = Case(
        virtual.record.copy(deep=True), replace(virtual.vehicle, riser_length=2.0 * virtual.vehicle.riser_length)
    )
    spoilt.record["capsule_attitude"].values = spoilt.record["capsule_attitude"].values[:, [1, 2, 3, 0]]
    causes = spoilt.verdict().causes
    assert len(causes) == 2 and any("scalar-last" in c for c in causes) and any("risers' length" in c for c in causes)


def test_a_point_mass_needs_no_vehicle():
    time = np.arange(0.0, 200.0, 0.5)
    from bayeschute.records.record import make_record

    down = Case(make_record(time=time, altitude=2000.0 - 6.0 * time), vehicle=_none())
    assert down.verdict().findings == ()
    up = Case(make_record(time=time, altitude=6.0 * time), vehicle=_none())
    assert [one.law for one in up.verdict().faults] == ["falling.altitude"]


def _none() -> Nominal:
    return None  # type: ignore[return-value]


def _reordered(order: list[int], *names: str):
    def make(case: Case) -> None:
        for name in names:
            case.record[name].values = case.record[name].values[..., order]

    return make


_YZ, _XZ = [0, 2, 1], [2, 1, 0]
AXES = {  # whose wind by altitude is looked up at wrong heights
    "capsule positions: z points up": _axis(2, "capsule_position"),
    "canopy positions: z points up": _axis(2, "canopy_position"),
    "capsule positions and velocities: z points up": _axis(2, "capsule_position", "capsule_velocity"),
    "capsule positions are in feet": _times(1 / FOOT, "capsule_position"),
    "east and down are swapped in capsule velocities": _reordered(_YZ, "capsule_velocity"),
    "east and down are swapped in canopy positions": _reordered(_YZ, "canopy_position"),
    "east and down are swapped in capsule positions": _reordered(_YZ, "capsule_position"),
    "North and down are swapped in capsule velocities": _reordered(_XZ, "capsule_velocity"),
}


@pytest.fixture(scope="module")
def aloft(virtual) -> Case:
    """The virtual drop with its wind by altitude beside the recorded one."""
    height, wind = -virtual.record["capsule_position"].values[:, 2], virtual.record["wind"].values
    seen = np.isfinite(height) & np.isfinite(wind).all(axis=1)
    order = np.argsort(height[seen])
    at, blows = height[seen][order], wind[seen][order]

    def profile(h):
        return np.stack([np.interp(h, at, x) for x in blows.T], axis=1)

    return Case(virtual.record, virtual.vehicle, None, profile)


@pytest.mark.parametrize("cause", AXES)
def test_one_wrong_axis_is_the_only_cause_and_the_wind_is_not_blamed(aloft, cause):
    assert aloft.verdict().findings == ()
    spoilt = Case(aloft.record.copy(deep=True), aloft.vehicle, None, aloft.profile)
    AXES[cause](spoilt)
    found = spoilt.verdict()
    (only,) = found.causes
    assert only.startswith(cause) and all(one.likely == only for one in found.faults)
    (line,) = told(found, "flight 'a'")
    assert cause in str(line) and "wind is" not in str(line) and warned(found, "flight 'a'") == []


def test_a_second_mistake_is_told_after_the_first_and_says_so(aloft):
    spoilt = Case(aloft.record.copy(deep=True), aloft.vehicle, None, aloft.profile)
    _axis(2, "capsule_position")(spoilt)
    spoilt.record["capsule_attitude"].values = spoilt.record["capsule_attitude"].values[:, [1, 2, 3, 0]]
    first, *others = [str(fault) for fault in told(spoilt.verdict(), "flight 'a'")]
    assert "Likely cause: " in first and len(others) == 1
    assert "With the first cause mended, likely is: " in others[0]
    assert "z points up" in first + others[0] and "scalar-last" in first + others[0]
