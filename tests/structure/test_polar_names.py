from __future__ import annotations

import subprocess
import sys

import pytest

from bayeschute.aero.published import load_published
from bayeschute.core.units import to_si
from bayeschute.structure.polar_names import (
    Spline,
    canonical,
    check_term,
    check_variable,
    coefficient_unit,
    factors,
    parse_spline,
)


def test_splines_are_read():
    assert parse_spline("(1.2-distance)_+") == Spline("distance", 1.2, False, "below", 1)
    assert parse_spline("(alpha-16deg)_+^2") == Spline("alpha", 16.0, True, "above", 2)
    assert parse_spline("(.5-alpha_rate)_+") == Spline("alpha_rate", 0.5, False, "below", 1)
    assert parse_spline("alpha") is None and parse_spline("(alpha-16deg)") is None


@pytest.mark.parametrize("name", ["alpha", "closing", "overlap", "(alpha-16deg)_+", "(60-q)_+", "(distance-0.5)_+^3"])
def test_variables_that_are_known(name):
    assert check_variable(name) is None


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("beta", "no variable"),
        ("(alpha-0.3)_+", "degrees"),
        ("(16deg-distance)_+", "without unit"),
        ("(1.2-beta)_+", "no variable"),
        ("(1.2-distance)+", "no variable"),
        ("", "no variable"),
    ],
)
def test_variables_that_are_not(name, says):
    assert says in check_variable(name)
    assert check_term(f"q*{name}") is not None


def test_products_and_powers():
    assert factors("q^2*alpha") == (("q", 2), ("alpha", 1))
    assert factors("1") == ()
    assert factors("(1.2-distance)_+^2*q") == (("(1.2-distance)_+^2", 1), ("q", 1))
    with pytest.raises(ValueError, match="gamma"):
        factors("q*gamma")


def test_one_product_has_one_form():
    same = ["overlap*sin_proximity", "sin_proximity*(0.8-distance)_+", "sin_proximity * (0.80-distance)_+"]
    assert len({canonical(term) for term in same}) == 1
    assert canonical("(0.8-distance)_+^2") == canonical("overlap*overlap") == canonical("overlap^2")
    assert canonical("alpha*q*alpha") == canonical("q*alpha^2") != canonical("q*alpha")
    assert canonical("1") == canonical("1*1") == ()


def test_units_turn_a_product_into_a_pure_number():
    assert coefficient_unit("1") == coefficient_unit("speed^2") == "1"
    assert coefficient_unit("q") == "1/Pa" and coefficient_unit("alpha^2*q") == "1/(rad^2 Pa)"
    assert coefficient_unit("closing") == "s" and coefficient_unit("q*closing") == "s/Pa"
    assert coefficient_unit("(alpha-16deg)_+^2") == "1/rad^2"


def test_the_published_table_can_be_written_and_has_the_same_units():
    table = load_published("table-7.3-1")
    for parameter in table.parameters:
        assert check_term(parameter.term) is None
        assert to_si(f"1 {coefficient_unit(parameter.term)}", parameter.unit) == pytest.approx(1.0)


def test_the_grammar_needs_no_jax():
    code = "import sys, bayeschute.structure.polar_names, bayeschute.structure.candidates; print('jax' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "False"
