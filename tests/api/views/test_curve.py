"""Curves as values: bands, tables, figures, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import bayeschute as bc
from bayeschute.api.views.curve import curve

RANGES = {"alpha": (0.1, 0.4), "D_prox": (0.5, 0.75)}
KNOWN = [
    {"kind": "curve", "target": "C_A", "name": "tunnel", "at": [0.2, 0.6], "values": [0.9, 0.8], "sd": [0.02, 0.03]},
    {"kind": "coefficient", "target": "axial[1]", "name": "book", "at": [], "values": [0.9], "sd": [0.1]},
]


@pytest.fixture(scope="module")
def draws():
    rng = np.random.default_rng(0)
    centre = {
        "axial[1]": 0.9,
        "axial[alpha^2]": -0.5,
        "transverse[e]": 0.2,
        "transverse[rate]": -0.4,
        "riser_length": 71.0,
    }
    return {name: value + 0.05 * rng.standard_normal((4, 500)) for name, value in centre.items()}


def asked(draws, name="C_A", level=0.9, points=31, over=None, distance=None, speed=1.0, prior=None):
    return curve(name, draws, prior, RANGES, KNOWN, level, points, over, distance, speed)


def test_a_curve_is_that_of_every_draw(draws):
    made = asked(draws)
    assert made.grid[[0, -1]] == pytest.approx(RANGES["alpha"]) and made.draws.shape == (2000, 31)
    wanted = draws["axial[1]"].ravel()[:, None] + np.multiply.outer(draws["axial[alpha^2]"].ravel(), made.grid**2)
    np.testing.assert_allclose(made.draws, wanted, atol=1e-12)
    low, high = made.band
    np.testing.assert_allclose([low, high], np.quantile(wanted, [0.05, 0.95], axis=0))
    narrow = made.at_level(0.5).band
    assert (narrow[0] > low).all() and (narrow[1] < high).all()


def test_the_table_says_what_was_flown(draws):
    table = asked(draws, over=(0.0, 0.8), prior=draws).to_frame()
    assert list(table) == ["alpha [deg]", "low", "median", "high", "flown", "prior_low", "prior_high"]
    np.testing.assert_array_equal(table["flown"], np.deg2rad(table["alpha [deg]"]).between(0.1 - 1e-9, 0.4 + 1e-9))
    assert table.attrs == {"curve": "C_A", "level": 0.9, "unit": "deg"}


def test_a_curve_draws_itself_with_what_others_know(draws):
    ax = asked(draws, over=(0.0, 0.8), prior=draws).plot()
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert {"tunnel, 90 %", "prior, 90 %", "posterior, 90 %", "median", "range flown"} == set(labels)
    assert "angle of attack [deg]" in ax.get_xlabel()
    assert asked(draws, "C_N").plot(ax) is ax
    assert asked(draws)._repr_html_().count("<tr>") >= 6 and "deg (flown 5.73 to 22.92)" in repr(asked(draws))


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        ({"name": "C_m"}, "one of C_A, C_N, C_N_rate, proximity"),
        ({"name": "proximity"}, "a curve of the posterior's terms: C_A, C_N, C_N_rate"),
        ({"level": 90.0}, "a probability between 0 and 1"),
        ({"points": 1}, "2 at least"),
        ({"over": (0.4, 0.1)}, "two increasing values of alpha"),
        ({"speed": 0.0}, "numbers > 0"),
    ],
)
def test_what_makes_no_sense_is_refused(draws, ask, words):
    with pytest.raises(bc.InputError, match=words):
        asked(draws, **ask)


def test_a_point_mass_has_no_curves(posterior):
    with pytest.raises(bc.InputError, match="it has none"):
        posterior.curve("C_A")
    assert posterior.ranges == {} and posterior.knowledge == [] and posterior.proposals().empty
