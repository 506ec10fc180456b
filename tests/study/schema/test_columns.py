"""Column maps: names and units of the schema, one column for one variable, and what the model needs."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from bayeschute.core.errors import Fault
from bayeschute.study.schema.columns import check_columns, known_columns, tells_columns, with_units_meant
from bayeschute.study.schema.draft import Draft
from bayeschute.study.schema.study_schema import Column

TIME, HEIGHT = Column(column="t", unit="s"), Column(column="h", unit="ft")


def _flight(file="a.csv", columns=None):
    return SimpleNamespace(file=file, columns=columns, conventions=None, wind_profile=None)


def _told(columns, model="descent", flights=None, raw=None):
    tables = {"model": model} | ({} if columns is None else {"columns": columns})
    return check_columns(Draft("x.toml", raw or {}, tables, flights or {}))


def test_names_of_vectors_canopies_and_quaternions():
    known = known_columns()
    assert known[0] == "time" and len(set(known)) == len(known)
    assert {"altitude", "capsule_position.north", "canopy_position.N.down", "capsule_attitude.w", "capsule_rate.z"} <= {
        *known
    }
    assert {"riser_tension.N", "wind.east"} <= {*known} and "canopy_position.north" not in known


@pytest.mark.parametrize(
    ("name", "unit", "told"),
    [
        ("canopy_position.3.north", "ft", None),
        ("riser_tension.0", "N", "unknown variable 'riser_tension.0'"),
        ("canopy_position.0.north", "m", "unknown variable 'canopy_position.0.north'"),
        ("canopy_position.q.x", "m", "unknown variable 'canopy_position.q.x'"),
        ("canopy_position.2.up", "m", None),
        ("canopy_position.north", "m", "unknown variable"),
        ("altitud", "m", "Did you mean 'altitude'"),
        ("capsule_attitude.rol", "deg", "Did you mean 'capsule_attitude.roll'"),
        ("wind.sped", "m/s", "Did you mean 'wind.speed'"),
        ("capsule_velocity.nort", "m/s", "Did you mean 'capsule_velocity.north' or "),
        ("capsule_velocity.upp", "m/s", "Did you mean 'capsule_velocity.up'"),
        ("qqqq", "m", "Known are time, "),
        ("capsule_rate.x", "deg/s", None),
        ("capsule_rate.x", "m/s", "a unit convertible to rad/s"),
        ("capsule_specific_force.x", "g", "Did you mean 'g_0'"),
        ("wind.speed", "knot", None),
        ("capsule_attitude.yaw", "deg", None),
        ("riser_tension.1", "lbf", None),
        ("pressure", "hPa", None),
    ],
)
def test_each_column_has_a_name_and_a_unit_of_the_schema(name, unit, told):
    faults = _told({"time": TIME, name: Column(column="c", unit=unit)}, "cluster")
    assert len(faults) == (told is not None) and (told is None or told in str(faults[0]))
    if told is not None:
        assert faults[0].where.startswith(f"x.toml [columns.{name}]")


def test_a_time_may_be_a_date_and_nothing_else_may():
    assert _told({"time": Column(column="t", unit="iso"), "altitude": HEIGHT}) == []
    (fault,) = _told({"time": TIME, "altitude": Column(column="h", unit="iso")})
    assert "a unit convertible to m" in str(fault)


def test_a_column_is_taken_once_and_all_faults_come_at_once():
    same = Column(column="t", unit="kg")
    told = [str(one) for one in _told({"density": same, "wind.north": same, "altitide": HEIGHT})]
    assert len(told) == 6  # two units, one name, one column twice, no time, no altitude
    (twice,) = [one for one in told if "separate" in one]
    assert "[columns.wind.north] column: got 't', which density takes already" in twice


@pytest.mark.parametrize(("columns", "model", "lacks"), [
    ({"time": TIME}, "descent", ["no altitude"]),
    ({"time": TIME, "pressure": Column(column="p", unit="hPa")}, "descent", []),
    ({"altitude": HEIGHT}, "descent", ["no time"]),
    ({"time": TIME}, "cluster", []),
    ({}, "descent", ["no time", "no altitude"]),
])  # fmt: skip
def test_what_a_model_needs(columns, model, lacks):
    assert [one.got for one in _told(columns, model)] == lacks
    assert [one.got for one in _told(None, model, {2: _flight(columns=columns)})] == lacks


def test_a_record_has_columns_somewhere():
    assert [one.got for one in _told(None, flights={0: _flight()})] == ["nothing"]
    assert _told({"time": TIME, "altitude": HEIGHT}, flights={0: _flight()}) == []
    assert _told(None, flights={0: _flight()}, raw={"columns": {"bad": 1}}) == []  # its faults are told elsewhere
    assert _told(None, flights={0: _flight("a.nc")}) == [] and _told(None, flights={0: _flight(None)}) == []
    for file, tells in (
        ("a.nc", True),
        ("a.h5", True),
        ("a.nc4", True),
        ("a.csv", False),
        ("nc", False),
        (None, False),
    ):
        assert tells_columns(_flight(file)) is tells
    assert tells_columns(_flight("a.csv", {}))


def test_advice_goes_to_the_unit_that_it_is_of():
    faults = [
        Fault(f"[columns.{name}] unit", "x", "y", "z") for name in ("capsule_specific_force.x", "altitude", "qqq")
    ]
    units = {"capsule_specific_force.x": "g", "altitude": "furlongs", "qqq": "g"}
    made = with_units_meant(faults, units)
    assert [one.do for one in made] == ["Did you mean 'g_0' (standard gravity)?", "z", "z"]
    assert [(one.where, one.got) for one in made] == [(one.where, one.got) for one in faults]
