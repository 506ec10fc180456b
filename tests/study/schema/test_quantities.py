"""Values of files: SI numbers within their bounds, and what is told of those that are refused."""

from __future__ import annotations

from typing import Annotated

import pytest
from pydantic import TypeAdapter, ValidationError
from pydantic_core import PydanticCustomError

from bayeschute.study.schema import quantities as q


def read(kind, value):
    return TypeAdapter(kind).validate_python(value)


def fault(kind, value) -> dict[str, str]:
    with pytest.raises(ValidationError) as refused:
        read(kind, value)
    (one,) = refused.value.errors()
    assert one["type"] == "fault"
    return one["ctx"]


@pytest.mark.parametrize(
    ("kind", "text", "si"),
    [
        (q.Length, "-116 ft", -35.3568), (q.Mass, "648.44 slug", 648.44 * 14.593903), (q.Stiffness, "15000 lbf/ft", 218908.5),
        (q.Azimuth, "-40 deg", -0.6981317), (q.NoiseAngle, "0 deg", 0.0), (q.Rate, "1 kHz", 1000.0),
        (q.Altitude, "-1000 m", -1000.0), (q.NoiseCeiling, "25 sigma^2", 25.0), (q.NoiseCeiling, "sigma^2", 1.0),
    ],
)  # fmt: skip
def test_quantities_become_si(kind, text, si):
    assert read(kind, text) == pytest.approx(si, rel=1e-6)


@pytest.mark.parametrize(
    ("kind", "value", "wanted"),
    [
        (q.PositiveLength, "0 m", "> 0 m"), (q.NoiseLength, "-1 mm", ">= 0 m"), (q.Rate, "1001 Hz", "<= 1000 Hz"),
        (q.Altitude, "81 km", ">= -1000 m and <= 80000 m"), (q.Length, "3 s", "convertible"), (q.Length, None, "'116 ft'"),
        (q.Length, True, "'116 ft'"), (q.Length, "nan m", "convertible"), (q.Number, "3", "a number"), (q.Number, True, "a number"),
        (q.Number, float("nan"), "a number"), (q.Number, 1e101, "a number"), (q.Fraction, 0.96, ">= 0 and <= 0.95"),
        (q.NoiseCeiling, "0 sigma^2", "25 sigma^2"), (q.NoiseCeiling, "25", "25 sigma^2"),
    ],
)  # fmt: skip
def test_what_is_refused_tells_what_would_do(kind, value, wanted):
    assert wanted in fault(kind, value)["wanted"]


def test_a_bare_number_is_told_how_to_write_it():
    told = fault(q.PositiveLength, 35)
    assert told["got"] == "a bare number" and "'35 m'" in told["do"]
    assert "'116 ft'" in fault(q.PositiveLength, 1e300)["do"]


def test_ends_of_bounds_belong_to_them_but_for_the_open_one():
    bounds = q.Bounds(above=0.0, least=-1.0, most=2.0)
    assert [bounds.hold(x) for x in (0.0, 1e-300, 2.0, 2.1, float("nan"))] == [False, True, True, False, False]
    assert bounds.words("kg") == "> 0 kg and >= -1 kg and <= 2 kg" and q.Bounds().words("m") == ""


def test_whole_numbers_and_words():
    three = Annotated[int, q.whole(1, 3)]
    assert [read(three, n) for n in (1, 3)] == [1, 3]
    for bad in (0, 4, True, 2.0, "2"):
        assert fault(three, bad)["wanted"] == "a whole number from 1 to 3"
    word = Annotated[str, q.one_of("riser", "airflow")]
    assert read(word, "airflow") == "airflow" and fault(word, "wind")["wanted"] == "one of 'riser', 'airflow'"
    assert "one of" in fault(word, ["riser"])["wanted"]


@pytest.mark.parametrize(("kind", "good", "bad"), [
    (q.Text, "a b", ["", "  ", "x" * 501, "a\x00b", 3]),
    (q.Label, "drop 1", ["=1+1", "+x", "-x", "@x", ""]),
    (q.Name, "drop-1_b.c", ["", ".hidden", "a/b", "a b", "x" * 61, 3]),
])  # fmt: skip
def test_texts_that_become_cells_or_files(kind, good, bad):
    assert read(kind, good) == good
    for one in bad:
        fault(kind, one)


@pytest.mark.parametrize(("text", "time"), [("65 %", 10.0 + 0.65 * 40.0), ("58 s", 58.0), ("0.5 min", 30.0)])
def test_a_cut_is_a_share_of_the_window_or_a_time(text, time):
    assert read(q.Until, text).at(10.0, 50.0) == pytest.approx(time)


@pytest.mark.parametrize("text", ["0 %", "100 %", "65", "58 m", 58.0, "% 5"])
def test_a_cut_that_is_none(text):
    assert "'65 %'" in fault(q.Until, text)["wanted"]


def test_terms_are_refused_all_at_once():
    even = Annotated[
        list[str], q.each(lambda term: "" if len(term) % 2 == 0 else f"{term} is odd", "even terms", "no term")
    ]
    assert read(even, ["ab", "abcd"]) == ["ab", "abcd"]
    assert fault(even, ["a", "ab", "abc"])["got"] == "a is odd; abc is odd"
    assert fault(even, [])["got"] == "no term"
    assert read(Annotated[list[str], q.each(lambda term: None, "any")], []) == []


def test_a_limit_is_read_in_the_unit_of_its_quantity():
    class Wanted(q.Limited):
        UNITS_OF = {"speed": ("m/s", "33 ft/s"), "swing": ("rad", "20 deg")}
        quantity: str
        at_most: float | None = None
        at_least: float | None = None

    assert Wanted(quantity="speed", at_most="10 ft/s").at_most == pytest.approx(3.048)
    assert Wanted(quantity="swing", at_least="180 deg").at_least == pytest.approx(3.14159265)
    for limits, got in (({}, "neither"), ({"at_most": "1 m/s", "at_least": "0 m/s"}, "both")):
        with pytest.raises(ValidationError, match="exactly one") as refused:
            Wanted(quantity="speed", **limits)
        assert refused.value.errors()[0]["ctx"]["got"] == got
    with pytest.raises(ValidationError, match="'33 ft/s'"):
        Wanted(quantity="speed", at_most="10 deg")


def test_the_reader_outside_of_tables_raises_the_same_fault():
    with pytest.raises(PydanticCustomError) as refused:
        q.read_quantity("3 FPS", "m/s", "5 ft/s")
    assert refused.value.context["do"] == "Did you mean 'fps'?"
