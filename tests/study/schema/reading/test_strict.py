"""Strict tables: every fault of values and rules at once, and the sound part of a table that has faults."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from bayeschute.study.schema.quantities import Mass, PositiveLength
from bayeschute.study.schema.reading.strict import Strict, UnknownValueError, part_of, refuse, rule


class Line(Strict):
    length: PositiveLength
    mass: Mass = 1.0

    @rule
    def _is_light(self) -> None:
        if self.mass > 10.0:
            refuse("a line of 10 kg or less", f"{self.mass:g} kg", "Weigh it again.")


class Canopy(Strict):
    line: Line
    spare: Line | None = None
    mass: Mass
    label: str = "main"

    @rule
    def _holds(self) -> None:
        if self.line.length > self.mass:
            refuse("a line shorter than the canopy is heavy", "a long one")

    @rule
    def _is_named(self) -> None:
        if self.label == "":
            refuse("a label")


def places(table, raw) -> dict[tuple, str]:
    with pytest.raises(ValidationError) as refused:
        table.model_validate(raw)
    return {one["loc"]: one["msg"] for one in refused.value.errors()}


def test_values_and_rules_are_told_together():
    raw = {"line": {"length": "-3 m", "mass": "20 kg"}, "mass": "1 kg", "label": "", "colour": "red"}
    found = places(Canopy, raw)
    assert set(found) == {("line", "length"), ("line",), ("colour",), ()}
    assert "10 kg or less" in found["line",] and "a label" in found[()]


def test_a_rule_waits_for_the_values_that_it_asks_for():
    assert set(places(Canopy, {"line": {"length": "3 s"}, "mass": "1 kg"})) == {("line", "length")}
    assert set(places(Canopy, {"line": {"length": "3 m"}, "mass": "1 kg"})) == {()}


def test_nothing_changes_after_reading_and_infinity_is_no_number():
    line = Line(length="3 m")
    with pytest.raises(ValidationError, match="frozen"):
        line.length = 4.0
    with pytest.raises(ValidationError):
        Line.model_validate({"length": "1e999 m"})
    with pytest.raises(AttributeError):
        line.colour  # noqa: B018


def test_the_sound_part_of_a_table_is_known_and_asking_for_the_rest_says_so():
    raw = {"line": {"length": "3 m", "mass": "many kg"}, "mass": "2 kg", "labl": "aft"}
    part = part_of(Canopy, raw)
    assert part.line.length == 3.0 and part.mass == 2.0 and part.spare is None
    for unknown in (lambda: part.line.mass, lambda: part.label):  # a misspelt key may have meant it
        with pytest.raises(UnknownValueError):
            unknown()
    assert part_of(Canopy, {"line": {"length": "1 m"}, "mass": "2 kg"}) == Canopy(line=Line(length="1 m"), mass="2 kg")


def test_a_table_that_may_be_left_out_is_known_in_part():
    part = part_of(Canopy, {"line": {"length": "1 m"}, "spare": {"length": "2 m", "mass": "x"}})
    assert part.spare.length == 2.0
    with pytest.raises(UnknownValueError):
        part.spare.mass  # noqa: B018
    with pytest.raises(UnknownValueError):
        part.mass  # noqa: B018
