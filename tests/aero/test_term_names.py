"""What may be written as an aerodynamic term."""

from __future__ import annotations

import subprocess
import sys

import pytest

from bayeschute.aero.term_names import check_axial, check_transverse, parse_term


@pytest.mark.parametrize(
    "name",
    ["1", "alpha", "alpha^2", "q", "speed", "proximity(0.8)", "closing", "restoring(35)", "(e.rate)", "speed*alpha^2"],
)
def test_scalars_are_axial_and_not_transverse(name):
    assert check_axial(name) is None
    assert "0 vector factors" in check_transverse(name)


@pytest.mark.parametrize("name", ["e", "angle", "rate", "c", "repulsion(.8)", "e*alpha^2", "side*c*q", "e * (e.rate)"])
def test_vectors_are_transverse_and_not_axial(name):
    assert check_transverse(name) is None
    assert "an axial term is a scalar" in check_axial(name)


@pytest.mark.parametrize("name", ["", "beta", "alpha^0", "alpha^-1", "e**2", "proximity", "repulsion(-1)", "E", "e+c"])
def test_unknown_factors_are_refused_by_name(name):
    assert "is no factor" in check_axial(name)
    assert "is no factor" in check_transverse(name)
    with pytest.raises(ValueError, match="is no factor"):
        parse_term(name)


def test_two_vectors_are_refused():
    assert "2 vector factors" in check_transverse("e*rate")


def test_factors_come_in_the_order_written():
    assert parse_term("alpha^2 * e*side") == ("alpha^2", "e", "side")


def test_grammar_does_not_import_jax():
    code = "import sys, bayeschute.aero.term_names; sys.exit('jax' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
