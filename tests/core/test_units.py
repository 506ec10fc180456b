from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayeschute.core.units import factor_to_si, to_si

# Expected values are the defining constants of the units (foot 0.3048 m, pound 0.45359237 kg, g0 9.80665 m/s^2).
FOOT, POUND, GRAVITY = 0.3048, 0.45359237, 9.80665


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("116 ft", "m", 116 * FOOT),
        ("-14 ft/s", "m/s", -14 * FOOT),
        ("10568.3 ft^2", "m^2", 10568.3 * FOOT**2),
        ("21906 lbf", "N", 21906 * POUND * GRAVITY),
        ("1 slug", "kg", POUND * GRAVITY / FOOT),
        ("20340 lb", "kg", 20340 * POUND),
        ("20340 lbm", "kg", 20340 * POUND),
        ("15000 lbf/ft", "N/m", 15000 * POUND * GRAVITY / FOOT),
        ("10000 lbf s/ft", "N s/m", 10000 * POUND * GRAVITY / FOOT),
        ("36 kmph", "m/s", 10.0),
        ("36 kmh", "m/s", 10.0),
        ("36 kph", "m/s", 10.0),
        ("600 fpm", "m/s", 10 * FOOT),
        ("2 psf", "Pa", 2 * POUND * GRAVITY / FOOT**2),
        ("180 deg", "rad", math.pi),
        ("90 °", "rad", math.pi / 2),
        ("3 deg/s", "rad/s", math.pi / 60),
        ("10 Hz", "Hz", 10.0),
        ("15 degC", "K", 288.15),
        ("1013.25 hPa", "Pa", 101325.0),
        ("65 %", "", 0.65),
        ("0.7", "", 0.7),
        ("0.7", "1", 0.7),
        ("5 m/s²", "m/s^2", 5.0),
        ("1e-3 km", "m", 1.0),
    ],
)
def test_quantities_become_si(text: str, unit: str, value: float):
    assert to_si(text, unit) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "unit", "words"),
    [
        ("116", "m", "has no unit"),
        ("0.3", "rad", "has no unit"),
        ("0.2 Hz", "rad/s", "is in Hz"),
        ("3 deg/s", "Hz", "is in deg/s"),
        ("30 %", "rad", "is in %"),
        ("5 kg", "m", "is in kg"),
        ("3 parsnips", "m", "no known unit"),
        ("ten feet", "m", "is not a quantity"),
        ("", "m", "is not a quantity"),
        ("nan m", "m", "is not a quantity"),
        ("inf m", "m", "is not a quantity"),
        ("1e400 m", "m", "finite"),
        ("9**9**9**9 m", "m", "no known unit"),
        ("1 m^999999999", "m", "no known unit"),
        ("1 (((m", "m", "no known unit"),
        ("5 m", "", "is in m"),
        ("1 " + "m" * 10_000, "m", "is not a quantity"),
        ("__import__('os')", "m", "is not a quantity"),
    ],
)
def test_what_is_no_such_quantity_is_refused_with_what_was_wanted(text: str, unit: str, words: str):
    with pytest.raises(ValueError, match="wanted a quantity convertible to") as caught:
        to_si(text, unit)
    assert words in str(caught.value)


@settings(max_examples=300, deadline=None)
@given(
    st.text(alphabet="0123456789.eE+-*/^() mskgftdegradlbfHz%°_²", max_size=20), st.sampled_from(["m", "rad", "", "kg"])
)
def test_any_text_is_a_finite_number_or_a_value_error(text: str, unit: str):
    try:
        assert math.isfinite(to_si(text, unit))
    except ValueError as error:
        assert "wanted" in str(error)


@pytest.mark.parametrize(
    ("unit", "si", "scale", "offset"),
    [("ft", "m", FOOT, 0.0), ("degC", "K", 1.0, 273.15), ("deg", "rad", math.pi / 180, 0.0), ("", "1", 1.0, 0.0)],
)
def test_columns_are_scaled_and_shifted(unit: str, si: str, scale: float, offset: float):
    assert factor_to_si(unit, si) == pytest.approx((scale, offset), rel=1e-12)


def test_columns_of_another_dimension_are_refused():
    with pytest.raises(ValueError, match="wanted"):
        factor_to_si("furlong", "s")
