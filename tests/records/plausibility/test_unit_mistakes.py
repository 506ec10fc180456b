"""Units that are mistaken: every inverse is the factor of the tables, on the channels that it names and no other."""

from __future__ import annotations

import re

import numpy as np
import pytest
from tests.records.plausibility.made_up import changed_channels, evidence

from bayeschute.atmosphere.standard import standard_density
from bayeschute.records.plausibility.unit_mistakes import air_mistakes, clock_mistakes, unit_mistakes

CHANNELS = {
    "capsule positions": {"position"},
    "canopy positions": {"canopies"},
    "capsule velocities": {"velocity"},
    "canopy velocities": {"canopy_velocity"},
    "winds": {"wind", "profile", "shear"},
    "recorded winds": {"wind"},
    "winds by altitude": {"profile", "shear"},
    "altitudes": {"altitude"},
    "descent rates": {"descent_rate"},
    "angular rates": {"rate"},
    "specific forces": {"force"},
    "densities": {"density"},
    "pressures": {"pressure"},
    "load cells": {"tension"},
    "positions": {"position", "canopies"},
    "positions and velocities": {"position", "canopies", "velocity"},
    "positions and velocities of capsule and canopies": {"position", "canopies", "velocity", "canopy_velocity"},
    "velocities of capsule and canopies": {"velocity", "canopy_velocity"},
}
IN_SI = {  # NIST SP 811, appendix B.8
    "feet": 0.3048, "km": 1e3, "yards": 0.9144, "ft/s": 0.3048, "knots": 1852.0 / 3600.0, "km/h": 1.0 / 3.6,
    "ft/min": 5.08e-3, "deg/s": np.pi / 180.0, "rpm": np.pi / 30.0, "g": 9.80665, "ft/s^2": 0.3048,
    "slug/ft^3": 515.3788, "lb/ft^3": 16.01846, "g/m^3": 1e-3, "hPa": 100.0, "kPa": 1e3, "psi": 6894.757,
    "inHg": 3386.389, "lbf": 4.448222, "kN": 1e3, "kgf": 9.80665,
}  # fmt: skip
WRITTEN = {"feet": "ft", "yards": "yd", "knots": "knot", "g": "g_0", "metres": "m"}
KELVIN = "temperatures are in degrees Celsius, read as kelvin"
HEIGHTS = "altitudes of the wind profile"
MISTAKES = [one for one in unit_mistakes() if one.cause != KELVIN and not one.cause.startswith(HEIGHTS)]


@pytest.mark.parametrize("one", MISTAKES, ids=lambda one: one.cause)
def test_the_factor_is_that_of_the_unit_and_the_unit_to_write_is_told(one):
    channels, unit, read, si, other = re.fullmatch(
        r"(.+) are in (?:(\S+), read as (\S+)|(\S+) already, converted as if in (\S+))", one.cause
    ).groups()
    e = evidence()
    made = one.undone(e)
    assert changed_channels(e, made) == CHANNELS[channels]
    factor, right = (IN_SI[unit], unit) if unit else (1.0 / IN_SI[other], si)
    for name in CHANNELS[channels]:
        np.testing.assert_allclose(getattr(made, name), factor * getattr(e, name), rtol=1e-6)
    size, off = re.fullmatch(
        rf"Give their unit as '{re.escape(WRITTEN.get(right, right))}'; as it is given now they are (\S+) times too (\w+)\.",
        one.do,
    ).groups()
    assert float(size) == pytest.approx({"small": factor, "large": 1.0 / factor}[off], rel=5e-3) and float(size) > 1.0
    assert (read or si) not in IN_SI


def test_no_cause_is_told_twice_and_a_converted_unit_is_the_less_likely_mistake():
    doubt = {one.cause: one.doubt for one in MISTAKES}
    assert len(doubt) == len(MISTAKES)
    assert {x for cause, x in doubt.items() if "already" in cause} == {0.3}
    assert max(x for cause, x in doubt.items() if "already" not in cause) == 0.2


def test_temperatures_are_shifted():
    e = evidence()
    (one,) = (one for one in unit_mistakes() if one.cause == KELVIN)
    np.testing.assert_allclose(one.undone(e).temperature - e.temperature, 273.15)


def test_one_wind_alone_is_not_blamed_where_there_is_only_one():
    for lack in ({"wind": None}, {"profile": None, "shear": None}):
        e = evidence(**lack)
        made = {one.cause: one.undone(e) for one in MISTAKES}
        assert made["winds are in knots, read as m/s"] is not None
        assert {made[f"{w} are in knots, read as m/s"] for w in ("recorded winds", "winds by altitude")} == {None}


@pytest.mark.parametrize(
    ("words", "seconds"), [("milliseconds", 1e-3), ("microseconds", 1e-6), ("minutes", 60.0), ("seconds already", 1e3)]
)
def test_clocks(words, seconds):
    """Of seconds that were taken for milliseconds, each is a thousandth of what it should be."""
    e = evidence()
    (one,) = (one for one in clock_mistakes() if one.cause.startswith(f"times are in {words}"))
    np.testing.assert_allclose(one.undone(e).time, seconds * e.time)


@pytest.mark.parametrize(
    ("words", "factor"), [("in feet, as if in metres", 1.0 / 0.3048), ("in metres, as if in feet", 0.3048)]
)
def test_densities_looked_up_at_other_heights_are_mended(words, factor):
    height = np.linspace(500.0, 900.0, 24)
    wrong = evidence(altitude=height, density=standard_density(factor * height))
    (one,) = (one for one in air_mistakes() if words in one.cause)
    np.testing.assert_allclose(one.undone(wrong).density, standard_density(height), rtol=1e-12)


def test_a_density_of_the_sea_is_mended_and_one_that_varies_is_none():
    height = np.linspace(500.0, 4000.0, 24)
    (one,) = (one for one in air_mistakes() if "of the sea" in one.cause)
    wrong = evidence(altitude=height, density=np.full(24, float(standard_density(0.0))))
    np.testing.assert_allclose(one.undone(wrong).density, standard_density(height), rtol=1e-12)
    assert one.undone(evidence(altitude=height, density=standard_density(height))) is None
    for lack in ({"density": None}, {"altitude": None, "position": None}):
        assert {one.undone(evidence(**lack)) for one in air_mistakes()} == {None}


@pytest.mark.parametrize(("told", "factor"), [("feet, read as metres", 0.3048), ("metres already", 1.0 / 0.3048)])
def test_a_profile_whose_altitudes_have_another_unit_is_read_at_other_heights(told, factor):
    def aloft(height):
        return np.stack([1e-5 * height**2, 0.02 * height, 0.0 * height], axis=1)

    (one,) = [one for one in unit_mistakes() if one.cause.startswith(f"{HEIGHTS} are in {told}")]
    e = evidence(aloft=aloft)
    made = one.undone(e)
    assert changed_channels(e, made) == {"profile", "shear"}
    np.testing.assert_allclose(made.profile, aloft(e.height() / factor))
    np.testing.assert_allclose(made.aloft(np.array([100.0 * factor])), aloft(np.array([100.0])))
    assert one.undone(evidence()) is None
