from __future__ import annotations

import math

import pytest

from bayeschute.report import wording


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0.123456, 3, "0.123"),
        (1234.56, 3, "1,230"),
        (-0.5, 2, "−0.50"),
        (9.996, 3, "10.0"),
        (0.99999, 3, "1.00"),
        (999.9, 3, "1,000"),
        (2.5e-7, 3, "2.50e−7"),
        (3.2e9, 2, "3.2e9"),
        (900, 3, "900"),
        (0.0, 3, "0"),
        (None, 3, "–"),
        (math.nan, 3, "–"),
        (math.inf, 3, "–"),
        ("abc", 3, "abc"),
    ],
)
def test_number(value, digits, text):
    assert wording.number(value, digits) == text


def test_short_and_whole():
    assert [wording.short(v) for v in (30.0, 33.4, 0.004, 1200.0, True, None)] == [
        "30",
        "33.4",
        "0.004",
        "1,200",
        "True",
        "–",
    ]
    assert [wording.whole(v) for v in (900.0, 12345, None)] == ["900", "12,345", "–"]


def test_a_mean_carries_the_decimals_of_its_sd():
    assert wording.at_precision(0.95612, 0.0059) == "0.9561"
    assert wording.at_precision(218_909.0, 42_000.0) == "219,000"
    assert wording.at_precision(-0.0004, 0.12) == "−0.00"
    assert wording.at_precision(3.14159, None) == "3.142"
    assert wording.at_precision(math.nan, 1.0) == "–"


def test_shares_in_percent_have_a_proper_minus_and_no_minus_zero():
    shown = [wording.percent(x, n) for x, n in ((-0.764, 0), (1.1e-16, 1), (-1e-9, 0), (0.3684, 1), (math.nan, 0))]
    assert shown == ["−76 %", "0.0 %", "0 %", "36.8 %", "–"]


def test_probability_is_never_rounded_to_certainty():
    assert [wording.probability(p) for p in (0.0004, 0.9996, 1.0, 0.0, 0.5, 0.995)] == [
        "< 0.001",
        "> 0.999",
        "1.000",
        "0.000",
        "0.50",
        "0.995",
    ]


def test_units_are_those_of_the_reader():
    assert wording.quantity(math.pi, "rad") == "180 deg"
    assert wording.quantity(10.0584, "m/s") == "10.1 m/s (33.0 ft/s)"
    assert wording.quantity(218_909.0, "N/m") == "219 kN/m (15,000 lbf/ft)"
    assert wording.quantity(71.3, "m") == "71.3 m (234 ft)" and wording.quantity(9463.0, "kg") == "9,460 kg (20,900 lb)"
    assert wording.quantity(2.0, "1") == "2.00"
    assert wording.shown_unit("m^2/kg") == (1.0, "m^2/kg")
    assert wording.also([9.0, 10.0], "m/s") == "29.5 … 32.8 ft/s"
    assert wording.also(0.3, "rad") == wording.also(None, "m") == wording.also([1.0, None], "m") == ""


def test_parameters_in_words():
    assert wording.parameter_meaning("axial[alpha^2]") == "axial force: angle of attack squared"
    assert wording.parameter_meaning("transverse[e*(e.rate)]").endswith("× angle times rate")
    assert wording.parameter_meaning("cds_over_mass[D20200117]") == "drag area over mass, C_D S / m, D20200117"
    assert wording.parameter_meaning("something_else") == ""
    error = "constant error of the recorded wind north"
    assert wording.parameter_meaning("wind_bias.north") == error
    assert wording.parameter_meaning("wind_bias.north@drop-2") == f"{error}, drop-2"
