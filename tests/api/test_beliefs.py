"""`Priors` and `Structure`: distributions in closed form, and what two sets of priors make together."""

from __future__ import annotations

import numpy as np
import pytest

import bayeschute as bc
from bayeschute.api.beliefs import Priors, Structure
from bayeschute.core.errors import InputError
from bayeschute.study.schema.belief_schema import PriorsTable


def prior(name, centre=0.0, scale=1.0, logarithmic=False, unit="1"):
    return bc.Prior(name, centre, scale, logarithmic, unit, "a test")


def test_a_positive_parameter_with_a_mean_has_the_log_normal_of_these_moments():
    (one,) = Priors.given(riser_stiffness={"mean": "200 kN/m", "sd": "20 kN/m"}, source="pulled").parameters
    assert one.logarithmic and one.scale == pytest.approx(np.sqrt(np.log1p(0.01)))
    assert one.moments() == pytest.approx((2e5, 2e4)) and one.source == "pulled"
    (one,) = Priors.given(cds_over_mass={"median": "2 ft^2/lb", "log_sd": 0.4}).parameters
    assert float(one.value(one.centre)) == pytest.approx(2 * 0.3048**2 / 0.45359237) and one.scale == 0.4
    with pytest.raises(InputError):
        Priors.given(cds_over_mass={"median": "2 kg", "log_sd": 0.4})


def test_the_central_ninety_per_cent_are_told_in_the_shown_unit():
    told = Priors.of(prior("drag", np.log(2.0), 0.5, True, "m^2"), prior("tilt", 0.1, 0.01, unit="rad"), prior("share"))
    drag, tilt, share = repr(told).splitlines()
    assert drag == f"drag: 2 ({2 * np.exp(-0.8225):.4g} to {2 * np.exp(0.8225):.4g}) m^2"
    assert tilt == f"tilt: 5.73 ({np.rad2deg(0.1 - 0.01645):.4g} to {np.rad2deg(0.1 + 0.01645):.4g}) deg"
    assert share == "share: 0 (-1.645 to 1.645)"
    html = told._repr_html_()
    assert "<td>share</td><td>0</td><td>-1.645 to 1.645</td><td>1</td>" in html and len(told) == 3


def test_where_both_have_a_parameter_the_right_one_s_counts():
    left, right = Priors.of(prior("a", 1.0), prior("b", 2.0)), Priors.of(prior("c", 3.0), prior("a", 4.0))
    made = left | right
    assert made.names == ("b", "c", "a") and [p.centre for p in made.parameters] == [2.0, 3.0, 4.0]


def test_what_came_of_equation_error_stays_and_who_differs_is_the_right_one_s():
    left = Priors((), PriorsTable(inflation=3.0, floor=0.07), "terms", {"coefficients": {}}, ("k",))
    right = Priors((), PriorsTable(inflation=1.5), "others", {"other": 1}, ("k", "l"))
    made = left | right
    assert (made.table.inflation, made.table.floor) == (3.0, 0.07) and made.table is not right.table
    assert made.candidates == "terms" and made.found == {"coefficients": {}} and made.known == ("k", "l")
    made = Priors((), PriorsTable()) | right
    assert made.candidates == "others" and made.found == {"other": 1}


def test_terms_stand_with_the_share_of_replicates_that_select_them():
    row = {"term": "alpha^2", "estimate": -0.5, "se": 0.1, "white_se": 0.05}
    shares = {"frequency": {"terms": {"alpha^2": 0.8, "q": 0.1}}, "structures": [{"share": 0.6}]}
    found = {
        "axial": {"selected": [row], **shares},
        "transverse": {"selected": [row | {"term": "e"}], "frequency": None, "structures": []},
    }
    structure = Structure(None, {"coefficients": found}, "")
    assert structure.table["term"].tolist() == ["alpha^2", "e"] and structure.table["selected"][0] == 0.8
    assert structure.table["coefficient"].tolist() == ["axial", "transverse"]
    assert structure.stability == {"axial": [{"share": 0.6}], "transverse": []}
    assert repr(structure) == "axial: alpha^2\ntransverse: e"
    assert "<td>axial</td><td>alpha^2</td><td>-0.5</td><td>0.1</td>" in structure._repr_html_()
