"""Published sets: what the tables print, both readings of signs, and every fault of a file told at once."""

from __future__ import annotations

import copy
import tomllib
from importlib.resources import files

import pytest

from bayeschute.aero.published import load_published, parse_published, published_names
from bayeschute.core.errors import InputError
from bayeschute.core.units import to_si

PSF = to_si("1 psf", "Pa")


def raw(name):
    return tomllib.loads(files("bayeschute.aero").joinpath("tables", f"{name}.toml").read_text(encoding="utf-8"))


def test_sets_that_come_with_the_package():
    assert published_names() == ("table-7.1-2", "table-7.3-1")
    for name in published_names():
        found = load_published(name)
        assert "NASA/TM-2019-220410" in found.source
        assert all(p.standard_error > 0.0 for p in found.parameters)


def test_planar_set():
    found = load_published("table-7.1-2")
    assert found.estimates() == {
        "C_A0": 0.927, "C_Aalpha": -0.329, "alpha_0": 0.189, "C_Nalpha": 0.1901, "C_Nalphadot": -0.988,
    }  # fmt: skip
    assert [p.standard_error for p in found.parameters] == [0.034, 0.179, 0.038, 0.091, 0.0684]
    assert found.parameters[-1].unit == "s/rad"


def test_polar_set_and_its_readings():
    printed, conventional = load_published("table-7.3-1", "as_printed"), load_published("table-7.3-1")
    assert [len(printed.of(c)) for c in ("C_A", "C_Y", "C_N")] == [3, 6, 3]
    assert printed.of("C_A")["q"] * PSF == pytest.approx(0.9297)
    assert printed.of("C_Y")["azimuth_rate*q"] * PSF == pytest.approx(-0.2544)
    assert conventional.of("C_N") == {"alpha_rate": -0.3630, "alpha": 0.0964, "overlap*cos_proximity": -0.1030}
    for coefficient, sign in (("C_A", -1.0), ("C_Y", 1.0), ("C_N", -1.0)):
        for term, value in printed.of(coefficient).items():
            assert conventional.of(coefficient)[term] == sign * value
    assert [p.standard_error for p in printed.parameters] == [p.standard_error for p in conventional.parameters]


def test_reading_decides_whether_the_axial_force_carries_the_weight():
    """PHYSICS 4: at 1.2 psf the printed C_A is about -0.83, weight needs +0.84."""
    for reading, want in (("as_printed", -0.84), ("conventional", 0.84)):
        c = load_published("table-7.3-1", reading).of("C_A")
        assert c["1"] + c["q"] * 1.2 * PSF == pytest.approx(want, abs=0.01)


def test_unknown_names_are_told():
    with pytest.raises(InputError, match=r"table-9.*table-7\.1-2, table-7\.3-1"):
        load_published("table-9")
    with pytest.raises(InputError, match=r"no reading 'upside'.*conventional, as_printed"):
        load_published("table-7.3-1", "upside")


def test_own_file(tmp_path):
    text = files("bayeschute.aero").joinpath("tables", "table-7.1-2.toml").read_text(encoding="utf-8")
    path = tmp_path / "mine.toml"
    path.write_text(text.replace('"-0.988 s/rad"', '"-20 ms/deg"'), encoding="utf-8")
    assert load_published(path).estimates()["C_Nalphadot"] == pytest.approx(-1.1459, abs=1e-4)
    path.write_text("title = ", encoding="utf-8")
    with pytest.raises(InputError, match="valid TOML"):
        load_published(path)
    with pytest.raises(InputError, match="readable"):
        load_published(tmp_path / "none.toml")
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="readable"):
        load_published(path)


@pytest.mark.parametrize(
    "place, value, told",
    [
        (("form",), "round", "form: got 'round'"),
        (("title",), "  ", "title"),
        (("sourcce",), "x", "sourcce: got an unknown key"),
        (("readings",), {}, "readings"),
        (("readings", "conventional"), {"C_A": 1}, "readings.conventional.*C_A, C_N, C_Y"),
        (("readings", "as_printed"), {"C_A": 1, "C_Y": 1, "C_N": 0.5}, "1 or -1"),
        (("readings", "as_printed"), {"C_A": 1, "C_Y": 1, "C_N": True}, "1 or -1"),
        (("parameter",), [], r"\[\[parameter\]\]"),
        (("parameter", 0), "C_A", r"\[\[parameter\]\] 1"),
        (("parameter", 1, "coefficient"), "C_D", "coefficient: got 'C_D'"),
        (("parameter", 1, "term"), "q*mood", "term: got 'q.mood'"),
        (("parameter", 1, "term"), 3, "term: got 3"),
        (("parameter", 1, "estimate"), "0.9297", r"estimate.*no unit.*1/Pa"),
        (("parameter", 1, "estimate"), 0.9297, "estimate.*not a quantity"),
        (("parameter", 1, "standard_error"), "0 1/psf", "standard_error: got '0 1/psf'; wanted a number > 0"),
        (("parameter", 1, "standard_error"), "-0.1 1/psf", "> 0"),
        (("parameter", 1, "note"), "x", "note: got an unknown key"),
        (("parameter", 1, "term"), "1", r"'C_A\[1\]' again"),
    ],
)
def test_every_fault_is_named(place, value, told):
    contents = copy.deepcopy(raw("table-7.3-1"))
    if place[-1] == "term" and value == "1":
        contents["parameter"][1].update(estimate="1", standard_error="1")
    target = contents
    for key in place[:-1]:
        target = target[key]
    target[place[-1]] = value
    with pytest.raises(InputError, match=told) as caught:
        parse_published(contents, "x.toml", "conventional")
    assert all(str(fault).startswith("x.toml") for fault in caught.value.faults)


def test_all_faults_at_once():
    contents = raw("table-7.3-1")
    contents["title"] = ""
    contents["parameter"][0]["estimate"] = "often"
    contents["parameter"][5]["standard_error"] = "nan"
    contents["parameter"][7]["term"] = "guess"
    with pytest.raises(InputError) as caught:
        parse_published(contents, "x.toml", "conventional")
    assert len(caught.value.faults) == 4


def test_planar_set_needs_all_five():
    contents = raw("table-7.1-2")
    del contents["parameter"][2]
    with pytest.raises(InputError, match="no 'alpha_0'"):
        parse_published(contents, "x.toml", "conventional")
    contents["parameter"][0]["name"] = "C_D0"
    with pytest.raises(InputError, match="name: got 'C_D0'"):
        parse_published(contents, "x.toml", "conventional")
