"""Words of faults: where a value stands, what was got, and what a key may have meant."""

from __future__ import annotations

import tomllib
from typing import Literal

import pytest
from pydantic import BaseModel, ConfigDict

from bayeschute.core.errors import InputError
from bayeschute.study.schema.schema_faults import fault_of_toml, known_keys, place, show, unknown_key, validated

RAW = {"flight": [{"name": "a"}, {"name": ""}, {"nome": "c"}, 5]}


class Inner(BaseModel):
    model_config = ConfigDict(extra="forbid")
    height: float
    pair: tuple[int, int] = (1, 2)


class Other(BaseModel):
    width: float = 1.0


class File(BaseModel):
    model_config = ConfigDict(extra="forbid")
    kind: Literal["b", "c", "d"] = "b"
    inner: Inner | None = None
    flight: tuple[Inner, ...] = ()
    named: dict[str, Inner] = {}
    either: Inner | Other | None = None
    many: list[int] = []


@pytest.mark.parametrize(
    ("loc", "told"),
    [
        ((), "x.toml"),
        (("seed",), "x.toml seed"),
        (("noise", "wind", "vertical"), "x.toml [noise.wind] vertical"),
        (("noise", ""), "x.toml [noise]"),
        (("flight", 0), "x.toml [flight] (flight 'a')"),
        (("flight", 0, "virtual", "swing"), "x.toml [flight.virtual] swing (flight 'a')"),
        (("flight", 1, "name"), "x.toml [flight] name (flight 2)"),
        (("flight", 2, "name"), "x.toml [flight] name (flight 3)"),
        (("flight", 3, "name"), "x.toml [flight] name (flight 4)"),
        (("flight", 9, "name"), "x.toml [flight] name (flight 10)"),
        (("flight", 0, "roles", 1), "x.toml [flight] roles, item 2 (flight 'a')"),
        (("structure", "canopies", 0), "x.toml [structure] canopies, item 1"),
        (("a b", "y" * 61), f"x.toml ['a b'] '{'y' * 61}'"),
    ],
)
def test_places_are_told_as_the_reader_finds_them(loc, told):
    assert place("x.toml", loc, RAW) == told


def test_what_is_shown_is_short():
    assert show("a") == "'a'" and show(1.5) == "1.5"
    assert show("x" * 78) == f"'{'x' * 78}'" and show("x" * 79) == f"'{'x' * 76}..." and len(show("x" * 500)) == 80
    assert show(1 << 40_000) == "a number of thousands of digits"


def test_keys_of_a_table_are_found_through_unions_lists_and_names():
    assert known_keys(File, ()) == ["kind", "inner", "flight", "named", "either", "many"]
    for loc in (("inner",), ("flight", 3), ("named", "x")):
        assert known_keys(File, loc) == ["height", "pair"], loc
    assert known_keys(File, ("either",)) == ["height", "pair", "width"] and known_keys(File, ("many",)) == []


def test_a_near_key_is_suggested_and_a_far_one_is_to_be_removed():
    near = unknown_key("x.toml", ("inner", "hight"), ["height", "pair"], {})
    assert (
        near.got == "the unknown key 'hight'"
        and near.do == "Did you mean 'height'?"
        and near.wanted == "one of height, pair"
    )
    assert unknown_key("x.toml", ("inner", "zzz"), ["height", "pair"], {}).do == "Remove it."


@pytest.mark.parametrize(
    ("raw", "where", "got", "wanted"),
    [
        ({"inner": {}}, "[inner] height", "nothing", "this key is required"),
        ({"inner": {"height": 1.0, "hight": 2.0}}, "[inner] hight", "the unknown key 'hight'", "one of height, pair"),
        ({"kind": "e"}, "kind", "'e'", "one of 'b', 'c', 'd'"),
        ({"inner": {"height": 1.0, "pair": [1, 2, 3]}}, "[inner] pair", "[1, 2, 3]", "a list of 2 values"),
        ({"inner": {"height": 1.0, "pair": 1}}, "[inner] pair", "1", "a list"),
        ({"inner": 3}, "inner", "3", "a table"),
        ({"named": 3}, "named", "3", "a table"),
        ({"inner": {"height": "much"}}, "[inner] height", "'much'", "input should be a valid number"),
    ],
)
def test_faults_of_pydantic_in_our_words(raw, where, got, wanted):
    with pytest.raises(InputError) as told:
        validated(File, "x.toml", raw)
    (fault,) = told.value.faults
    assert fault.where == f"x.toml {where}" and fault.got == got and wanted in fault.wanted


def test_all_faults_at_once_but_not_more_than_anyone_reads():
    with pytest.raises(InputError) as told:
        validated(File, "x.toml", {"kind": "e", "inner": {"pair": 1}, "sead": 1})
    assert len(told.value.faults) == 4
    with pytest.raises(InputError) as told:
        validated(File, "x.toml", {"many": ["x"] * 500})
    assert len(told.value.faults) == 200
    assert validated(File, "x.toml", {"inner": {"height": 2}}).inner.height == 2.0


@pytest.mark.parametrize(
    ("text", "where"), [("a = 1\nb = \n", "x.toml line 2, column 5"), ("a = [1,", "x.toml end of document")]
)
def test_toml_that_stops_is_told_with_its_line(text, where):
    with pytest.raises(tomllib.TOMLDecodeError) as error:
        tomllib.loads(text)
    fault = fault_of_toml("x.toml", error.value)
    assert fault.where == where and "(at" not in fault.got and fault.got.startswith("TOML that can't be read: ")
    assert (
        fault.got.split(": ")[1][0].islower() and len(fault_of_toml("x", tomllib.TOMLDecodeError("Y" * 999)).got) == 300
    )
