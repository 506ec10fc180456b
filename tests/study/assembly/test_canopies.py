"""Coefficients that differ from canopy to canopy: their names, what they are in a flight, and what virtual drops fly."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bayeschute.likelihood.priors import Prior
from bayeschute.study.assembly import canopies
from bayeschute.study.assembly.assemble import cluster
from bayeschute.study.assembly.fits import structure_of
from bayeschute.study.load import check_study, load_study
from bayeschute.study.study import canonical

STUDY = Path(__file__).parents[3] / "models" / "studies" / "cdt-3-11.toml"
PRIORS = (
    Prior("axial[1]", 0.9, 0.3, False, "1", "x"),
    Prior("axial[proximity(0.8)]", 0.1, 0.1, False, "1", "y"),
    Prior("transverse[(e.rate)*c]", -0.2, 0.2, False, "1", "z"),
    Prior("riser_damping", 5.0, 0.5, True, "N s/m", "x"),
)
VARY = ("transverse[(e.rate)*c]", "axial[1]")
FLIGHTS = ("cdt-3.11", "b@c")
EACH = canopies.each(PRIORS, VARY, FLIGHTS, 2)


def test_every_canopy_of_every_flight_has_a_parameter_in_the_place_of_its_coefficient():
    assert [p.name for p in EACH] == [
        "axial[1]@cdt-3.11.canopy1", "axial[1]@cdt-3.11.canopy2", "axial[1]@b@c.canopy1", "axial[1]@b@c.canopy2",
        "axial[proximity(0.8)]",
        "transverse[(e.rate)*c]@cdt-3.11.canopy1", "transverse[(e.rate)*c]@cdt-3.11.canopy2",
        "transverse[(e.rate)*c]@b@c.canopy1", "transverse[(e.rate)*c]@b@c.canopy2",
        "riser_damping",
    ]  # fmt: skip
    assert all(replace(p, name="axial[1]") == PRIORS[0] for p in EACH[:4])
    assert [canopies.is_of_canopy(p.name) for p in EACH].count(True) == 8


def test_put_together_they_are_the_priors_again():
    assert canopies.together(EACH) == list(PRIORS) == canopies.together(PRIORS)


def test_a_flight_s_model_has_the_parameters_of_its_own_canopies():
    assert canopies.in_flight([p.name for p in EACH], "b@c") == (
        "", "", "axial[1].canopy1", "axial[1].canopy2", "axial[proximity(0.8)]",
        "", "", "transverse[(e.rate)*c].canopy1", "transverse[(e.rate)*c].canopy2", "riser_damping",
    )  # fmt: skip


def test_the_structure_is_that_of_the_coefficients():
    assert structure_of(EACH, 2) == structure_of(PRIORS, 2)
    assert structure_of(EACH, 2).transverse == ("(e.rate)*c",)


def differing(sd: float | None):
    study = load_study(STUDY)
    table = None if sd is None else {"axial[1]": sd, "transverse[rate]": 0.5 * sd}
    flights = (replace(f, virtual=f.virtual.model_copy(update={"canopy_sd": table})) for f in study.flights)
    return replace(study, flights=tuple(flights))


def test_canopies_of_virtual_drops_are_drawn_about_the_vehicle_s():
    study = differing(0.05)
    made = [canopies.flown(study, study.flights[0], seed) for seed in range(400)]
    axial = np.array([one["axial[1]"] for one in made])
    rate = np.array([one["transverse[rate]"] for one in made])
    aero = study.vehicle.aero
    assert axial.mean() == pytest.approx(aero.axial["1"], abs=4.0 * 0.05 / np.sqrt(800.0))
    assert axial.std() == pytest.approx(0.05, rel=0.1) and rate.std() == pytest.approx(0.025, rel=0.1)
    assert rate.mean() == pytest.approx(aero.transverse["rate"], abs=0.005)
    assert abs(np.corrcoef(axial.T)[0, 1]) < 0.2 and abs(np.corrcoef(axial[:, 0], rate[:, 0])[0, 1]) < 0.2
    again = canopies.flown(study, study.flights[0], 7)
    np.testing.assert_array_equal(again["axial[1]"], axial[7])


def test_where_none_differs_all_fly_with_the_vehicle_s():
    study = differing(None)
    assert canopies.flown(study, study.flights[0], 1) == {}
    assert canonical(study) == canonical(load_study(STUDY))


def test_they_take_the_place_of_the_vehicle_s_in_the_cluster():
    study = differing(0.05)
    own = canopies.flown(study, study.flights[0], 3)
    model, structure = cluster(study.vehicle, of_canopies=own)
    shared, same = cluster(study.vehicle)
    assert same == structure
    for kind in ("axial", "transverse"):
        rows = zip(getattr(structure, kind), getattr(model, kind), getattr(shared, kind), strict=True)
        for term, value, usual in rows:
            np.testing.assert_array_equal(value, own.get(f"{kind}[{term}]", usual))


def faults(folder: Path, *changes: tuple[str, str]) -> list[str]:
    text = STUDY.read_text(encoding="utf-8").replace("../vehicles", str(STUDY.parents[1] / "vehicles"))
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    (folder / "canopies.toml").write_text(text, encoding="utf-8")
    return [str(fault) for fault in check_study(folder / "canopies.toml")]


ASKED = ("inflation = 10.0", 'vary_canopies = ["axial[1]"]\ninflation = 10.0')


def test_one_drop_of_two_canopies_will_do(tmp_path):
    assert not faults(tmp_path, ASKED, ('fit = "search"', 'fit = "pool"'))


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ((ASKED, ('fit = "search"', 'fit = "selected"\nstack = 3')), "vary_canopies together with [structure] stack"),
        ((ASKED, ("floor = 0.05", 'vary = ["axial[1]"]\nfloor = 0.05')), "axial[1], which vary names too"),
        ((ASKED, ("floor = 0.05", 'spread = { "axial[q]" = 0.1 }\nfloor = 0.05')), "that vary or vary_canopies names"),
        ((ASKED, ("floor = 0.05", 'spread = { "axial[1]" = 0.0 }\nfloor = 0.05')), "spread"),
        ((('flyout = "9 deg"', 'canopy_sd = { "axial[q]" = 0.1 }\nflyout = "9 deg"'),), "what the vehicle flies with"),
        ((('flyout = "9 deg"', 'canopy_sd = { "axial[1]" = -0.1 }\nflyout = "9 deg"'),), "canopy_sd"),
    ],
)
def test_what_makes_no_population_is_a_fault(tmp_path, changes, told):
    found = faults(tmp_path, *changes)
    assert any(told in fault for fault in found), found
