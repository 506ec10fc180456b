"""Units that are none, or of something else: the message says what was likely meant, and its unit can be read."""

from __future__ import annotations

import pytest

import bayeschute as bc
from bayeschute.api.quantity import si
from bayeschute.core.units import to_si
from bayeschute.study.load import check_study
from bayeschute.study.schema.reading.unit_meant import unit_meant

MEANT = [
    ("g", "m/s^2", "g_0"), ("G", "m/s^2", "g_0"), ("gs", "m/s^2", "g_0"), ("mg", "m/s^2", "millig_0"),
    ("degc", "K", "degC"), ("C", "K", "degC"), ("Celsius", "K", "degC"), ("deg C", "K", "degC"), ("F", "K", "degF"),
    ("dps", "rad/s", "deg/s"), ("FPS", "m/s", "fps"), ("kmhr", "m/s", "km/h"), ("KMH", "m/s", "km/h"), ("hpa", "Pa", "hPa"),
    ("mb", "Pa", "mbar"), ("FT", "m", "ft"), ("m/s2", "m/s^2", "m/s^2"), ("slug/ft3", "kg/m^3", "slug/ft^3"),
    ("M", "m", "m"), ("S", "s", "s"), ("KT", "m/s", "kt"),
    ("lb", "N", "lbf"), ("lb s/ft", "N s/m", "lbf s/ft"),
]  # fmt: skip


@pytest.mark.parametrize(("written", "wanted", "meant"), MEANT)
def test_what_a_unit_was_meant_to_be(written, wanted, meant):
    with pytest.raises(ValueError, match="wanted"):
        to_si(f"1 {written}", wanted)
    assert unit_meant(written, wanted).startswith(f"Did you mean {meant!r}")
    assert unit_meant(f"-2.5e3 {written}", wanted) == unit_meant(written, wanted)
    to_si(f"1 {meant}", wanted)


@pytest.mark.parametrize(
    ("written", "wanted"),
    [
        ("Pa", "s"),
        ("A", "s"),
        ("kN", "s"),
        ("ft", "s"),
        ("m", ""),
        ("m", "m"),
        ("0.3", "rad"),
        ("", "m"),
        ("1,5 m", "m"),
        ("x" * 5000, "m"),
        ("m^9^9", "m"),
    ],
)
def test_no_advice_where_nothing_of_the_kind_is_known(written, wanted):
    assert unit_meant(written, wanted) == ""


def test_both_doors_tell_it(descent, spoil, tmp_path):
    columns = {"time": ("t", "s"), "capsule_specific_force.x": ("fx", "g"), "temperature": ("temp", "degc")}
    written = [f'"{name}" = {{ column = "{c}", unit = "{u}" }}' for name, (c, u) in columns.items() if name != "time"]
    spoil(descent, r"^\[columns\]", "\n".join(["[columns]", *written]))
    told = "\n".join(map(str, check_study(descent)))
    (tmp_path / "drop.csv").write_text("t,fx,temp\n0,1,2\n", encoding="utf-8")
    with pytest.raises(bc.InputError) as refused:
        bc.read_record(tmp_path / "drop.csv", columns)
    for said in (told, str(refused.value)):
        assert "Did you mean 'g_0' (standard gravity)?" in said
        assert "Did you mean 'degC' (degrees Celsius)?" in said
    with pytest.raises(bc.InputError, match="Did you mean 'fps'"):
        si("at_most", "33 FPS", "m/s")


def test_a_quantity_of_a_study_tells_it(cluster, spoil):
    (fault,) = check_study(spoil(cluster, r'^swing = "17 deg"', 'swing = "17 DEG"'))
    assert fault.do == "Did you mean 'deg'?" and "'17 DEG'" in fault.got
