"""Names of coefficients: what is written is read back, and other parameters are none."""

from __future__ import annotations

from itertools import product
from types import SimpleNamespace

import pytest

from bayeschute.aero.coefficient import KINDS, Coefficient, coefficient_names, is_coefficient, shared_name

TERMS = ("1", "alpha^2", "e*alpha^2", "(e.rate)*c", "proximity(0.8)")
FLIGHTS = (None, "cdt-3.11", "b@c", "drop 7", "a.canopy")


@pytest.mark.parametrize(("kind", "term", "flight", "canopy"), list(product(KINDS, TERMS, FLIGHTS, (None, 1, 12))))
def test_what_is_written_is_read_back(kind, term, flight, canopy):
    one = Coefficient(kind, term, flight, canopy)
    assert Coefficient.parse(str(one)) == one
    assert one.shared == Coefficient(kind, term) and one.is_shared == (flight is None and canopy is None)
    assert shared_name(str(one)) == f"{kind}[{term}]"


def test_names_are_those_of_the_files():
    one = Coefficient("axial", "alpha^2")
    assert str(one) == "axial[alpha^2]"
    assert str(one.of("cdt-3-11", 2)) == "axial[alpha^2]@cdt-3-11.canopy2"
    assert str(one.of(None, 2)) == "axial[alpha^2].canopy2"


@pytest.mark.parametrize(
    "name",
    [
        "", "riser_length", "riser_length@drop", "sd(axial[1])", "drag_area[low]", "axial", "axial[1", "axial[1]x",
        "axial[1].canopy0", "axial[1].canopy", "axial[1]@", "C_A[1]", " axial[1]", "axial[1][a]",
    ],
)  # fmt: skip
def test_another_name_is_no_coefficient_and_stays_as_it_is(name):
    assert Coefficient.parse(name) is None and not is_coefficient(name) and shared_name(name) == name


def test_names_of_terms_are_axial_ones_first():
    terms = SimpleNamespace(transverse=("e", "rate"), axial=("1",))
    assert coefficient_names(terms) == ["axial[1]", "transverse[e]", "transverse[rate]"]
