"""Terms that a fit may ask for: their priors, and their place among the others."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations
from types import SimpleNamespace

import numpy as np
import pytest

import bayeschute as bc
from bayeschute.aero.coefficient import terms_of
from bayeschute.aero.curves import regressors
from bayeschute.likelihood.priors import Prior, covariance, working
from bayeschute.study.assembly.fitted_terms import (
    ADDED,
    at_own_apparent_mass,
    in_order,
    known_at_large_angles,
    of_library,
    of_selected,
    terms_left_out,
    with_terms,
)


def _job(model="cluster"):
    found = {
        "axial": {"left_out": [{"term": "closing", "estimate": 0.2, "se": 0.001}]},
        "transverse": {"left_out": [{"term": "c", "estimate": -0.1, "se": 0.05}]},
    }
    study = SimpleNamespace(
        model=model,
        vehicle=None,
        knowledge=(),
        priors=SimpleNamespace(inflation=6.0, floor=0.05),
        with_role=lambda role: (SimpleNamespace(name="one"),),
    )
    return SimpleNamespace(study=study, load=lambda name: {"coefficients": found})


def test_priors_come_from_the_fit_of_all_candidates():
    made = terms_left_out(_job())
    assert [p.name for p in made] == ["axial[closing]", "transverse[c]"]
    assert [p.centre for p in made] == [0.2, -0.1]
    np.testing.assert_allclose([p.scale for p in made], [0.05, 0.3])  # the floor, and six standard errors
    assert all(ADDED in p.source and "one" in p.source for p in made)


def test_a_descent_has_none():
    assert terms_left_out(_job("descent")) == []


CLUSTER = bc.Study.example().spec


def test_priors_of_transverse_terms_are_at_the_vehicles_own_apparent_mass():
    """Where nobody else knows the coefficients, and no population or classical noise needs them as they are."""
    some, canopies = _priors("axial[1]", "transverse[e]", "riser_length"), CLUSTER.vehicle.canopies
    air = 1.225 * canopies.enclosed_volume
    wanted = [0.0, air / (air + canopies.dry_mass), 0.0]
    assert [p.air_share for p in at_own_apparent_mass(CLUSTER, some)] == pytest.approx(wanted)
    known = replace(CLUSTER, knowledge=(SimpleNamespace(use="prior"),))
    other = replace(CLUSTER, knowledge=(SimpleNamespace(use="compare"),))
    classical = replace(CLUSTER, noise=CLUSTER.noise.model_copy(update={"model": "white"}))
    assert [p.air_share for p in at_own_apparent_mass(other, some)] == pytest.approx(wanted)
    for study in (known, classical):
        assert at_own_apparent_mass(study, some) == some


STUDY = SimpleNamespace(
    structure=SimpleNamespace(axial=("1", "closing", "alpha^2"), transverse=("c", "e")),
)


def _priors(*names):
    return [Prior(name, 0.0, 1.0, False, "1", "") for name in names]


def test_terms_join_the_others_where_the_study_names_them():
    here = _priors("axial[1]", "axial[alpha^2]", "transverse[e]", "riser_length")
    made, kept = with_terms(STUDY, here, terms_left_out(_job()))
    names = ["axial[1]", "axial[closing]", "axial[alpha^2]", "transverse[c]", "transverse[e]", "riser_length"]
    assert [p.name for p in made] == names
    np.testing.assert_array_equal(kept, [True, False, True, False, True, True])


def test_the_order_of_parameters_does_not_hang_on_the_ranking():
    coefficients = _priors("axial[1]", "axial[alpha^2]@drop.canopy1", "axial[alpha^2]@drop.canopy2", "transverse[e]")
    rest = _priors("riser_stiffness", "capsule_mass", "riser_length")
    for ranked in permutations([coefficients[0], coefficients[1:3], coefficients[3]]):
        flat = [p for one in ranked for p in (one if isinstance(one, list) else [one])]
        assert in_order(STUDY, [*flat, *rest]) == [*coefficients, *rest]
    assert in_order(SimpleNamespace(structure=None), rest) == rest


TABLE = SimpleNamespace(priors=SimpleNamespace(inflation=6.0, floor=0.05))
LAW = np.array([[4e-4, -3e-4, 0.0], [-3e-4, 9e-4, 1e-4], [0.0, 1e-4, 1e-2]])  # of the fit of all candidates
RMS = np.array([1.0, 0.1, 0.3])
NAMES = ("1", "alpha^2", "q")


def _entry(together=True, selected=("alpha^2", "1")):
    """Of structure.json: what was selected, as ranked, and all candidates together."""
    known = {"1": 0.9, "alpha^2": -0.7}
    rows = [
        {"term": t, "estimate": known[t], "se": float(np.sqrt(LAW[NAMES.index(t), NAMES.index(t)]))} for t in selected
    ]
    place = [NAMES.index(t) for t in selected]
    told = {"terms": list(NAMES), "rms": RMS.tolist(), "fitted": [], "estimate": None, "covariance": None}
    if together:
        told |= {"fitted": list(NAMES), "estimate": [0.8, -0.5, 0.2], "covariance": LAW.tolist()}
    return {"selected": rows, "covariance": LAW[np.ix_(place, place)].tolist(), "together": told}


def test_selected_terms_have_the_covariance_of_their_fit_inflated():
    made = of_selected(TABLE, "axial", _entry(), "one")
    assert [p.name for p in made] == ["axial[alpha^2]", "axial[1]"]
    np.testing.assert_array_equal(working(made)[0], [-0.7, 0.9])
    np.testing.assert_allclose(covariance(made), 36.0 * LAW[np.ix_([1, 0], [1, 0])] + 0.05**2 * np.eye(2), rtol=1e-12)
    assert made[0].correlation["axial[1]"] < -0.3 and all("one" in p.source and "6 x" in p.source for p in made)


def test_selected_terms_of_a_run_before_covariances_are_independent():
    made = of_selected(TABLE, "axial", {"selected": _entry()["selected"]}, "one")
    np.testing.assert_allclose(working(made)[1], [6.0 * 0.03, 6.0 * 0.02])
    assert all(p.correlation == {} for p in made)
    assert of_selected(TABLE, "axial", {"selected": [], "covariance": []}, "one") == []


def _product(means, precisions):
    """Mean and covariance of a product of Gaussians."""
    law = np.linalg.inv(sum(precisions))
    return law @ sum(p @ m for m, p in zip(means, precisions, strict=True)), law


def test_a_library_s_priors_are_equation_error_times_what_is_plausible():
    """Terms but the constant add 0.2 in root mean square at most; the covariance of all of them is inflated."""
    made = of_library(TABLE, "transverse", _entry(), "one")
    assert [p.name for p in made] == [f"transverse[{name}]" for name in NAMES]
    told = np.linalg.inv(36.0 * LAW + 0.05**2 * np.eye(3))
    plausible = np.diag([0.0, (0.1 / 0.2) ** 2, (0.3 / 0.2) ** 2])
    mean, law = _product([np.array([0.8, -0.5, 0.2]), np.zeros(3)], [told, plausible])
    np.testing.assert_allclose(working(made)[0], mean, rtol=1e-9)
    np.testing.assert_allclose(covariance(made), law, rtol=1e-9)
    assert (
        abs(mean[2]) < 0.15 and abs(mean[0] - 0.8) < 0.02
    )  # an implausible term is drawn towards zero, the constant is not
    assert all("all candidates together" in p.source and "tell" not in p.source for p in made)


def test_sums_that_the_record_tells_are_known_where_their_terms_are_not():
    """Two candidates that the record hardly tells apart: each is as wide as is plausible, their sum as it was told."""
    entry = _entry()
    law = np.diag([1e-4, 0.0, 0.0])
    law[1:, 1:] = [[25.0, -24.999], [-24.999, 25.0]]
    entry["together"] |= {"covariance": law.tolist(), "rms": [1.0, 0.3, 0.3], "estimate": [0.9, 3.0, -2.7]}
    found = covariance(
        of_library(SimpleNamespace(priors=SimpleNamespace(inflation=6.0, floor=0.0)), "axial", entry, "one")
    )
    assert np.sqrt(np.diag(found))[1:] == pytest.approx([0.47, 0.47], abs=0.05)  # 0.2/0.3, less by what their sum tells
    both = np.array([0.0, 1.0, 1.0])
    assert np.sqrt(both @ found @ both) == pytest.approx(6.0 * np.sqrt(both @ law @ both), rel=0.05)


def test_where_all_together_can_not_be_told_apart_the_selected_ones_are():
    made = of_library(TABLE, "axial", _entry(together=False), "one")
    told = np.zeros((3, 3))
    told[:2, :2] = np.linalg.inv(36.0 * LAW[:2, :2] + 0.05**2 * np.eye(2))
    plausible = np.diag([0.0, (0.1 / 0.2) ** 2, (0.3 / 0.2) ** 2])
    mean, law = _product([np.array([0.9, -0.7, 0.0]), np.zeros(3)], [told, plausible])
    np.testing.assert_allclose(working(made)[0], mean, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(covariance(made), law, rtol=1e-9, atol=1e-12)
    assert made[2].centre == 0.0 and made[2].scale == pytest.approx(0.2 / 0.3)
    assert all("can't separate all of them" in p.source for p in made)


def test_a_regressor_that_is_zero_all_along_costs_the_others_nothing():
    """It is left out of the joint fit; its own coefficient is wide, and independent of theirs."""
    entry = _entry()
    entry["together"] |= {"terms": [*NAMES, "speed"], "rms": [*RMS, 0.0]}
    found, plain = (covariance(of_library(TABLE, "axial", e, "one")) for e in (entry, _entry()))
    np.testing.assert_allclose(found[:3, :3], plain, rtol=1e-9)
    assert np.abs(found[3, :3]).max() == 0.0 and 1e3 < np.sqrt(found[3, 3]) < 1e4


def _curve(priors, name, degrees):
    """Mean and standard deviation of a curve under priors."""
    axial, transverse, places = terms_of([p.name for p in priors])
    row = np.zeros(len(priors))
    row[places] = regressors(name, axial, transverse, np.deg2rad([degrees]))[0]
    return row @ working(priors)[0], np.sqrt(row @ covariance(priors) @ row)


def _unknown(kind, **terms):
    return [Prior(f"{kind}[{term}]", 0.0, sd, False, "1", "x") for term, sd in terms.items()]


AXIAL = {"1": 0.3, "alpha^2": 5.0, "alpha^4": 30.0, "closing": 1.0}
STATIC = {"e": 0.3, "e*alpha^2": 5.0, "e*alpha^4": 30.0}
DAMPING = {"rate": 1.0, "rate*alpha^2": 15.0, "e*(e.rate)": 15.0, "e*alpha^2*(e.rate)": 140.0}


@pytest.mark.parametrize(
    ("kind", "terms", "curve", "mean", "sd"),
    [
        ("axial", AXIAL, "C_A", 0.7, 0.4),
        ("transverse", STATIC | DAMPING, "C_N", 0.5, 0.7),
        ("transverse", STATIC | DAMPING, "C_N_rate", 0.0, 3.0),
    ],
)
def test_far_beyond_the_range_flown_curves_are_those_of_canopies(kind, terms, curve, mean, sd):
    """Where a record says nothing of 45 deg a curve is there what is known; where small angles are, as wide as before."""
    before = _unknown(kind, **terms)
    after = known_at_large_angles(before)
    assert _curve(before, curve, 45.0)[1] > 5.0 * sd
    found = _curve(after, curve, 45.0)
    assert found[0] == pytest.approx(mean, abs=0.05 * sd) and found[1] == pytest.approx(sd, rel=0.03)
    assert _curve(after, curve, 5.0)[1] == pytest.approx(_curve(before, curve, 5.0)[1], rel=0.05)


def test_damping_across_the_plane_is_known_beside_that_along_it():
    """The terms in (e.rate) have no part across; without them both are one, which is known once."""
    isotropic = {name: sd for name, sd in DAMPING.items() if "(e.rate)" not in name}
    before = _curve(_unknown("transverse", **isotropic), "C_N_rate", 45.0)[1]
    known = (before**-2 + 3.0**-2) ** -0.5
    across = [p for p in known_at_large_angles(_unknown("transverse", **DAMPING)) if "(e.rate)" not in p.name]
    both = known_at_large_angles(_unknown("transverse", **isotropic))
    for priors in (across, both):
        assert _curve(priors, "C_N_rate", 45.0)[1] == pytest.approx(known, rel=0.01)


def test_what_equation_error_knows_stays():
    """A constant that is known to a hundredth moves by no more than that, and terms without a curve not at all."""
    one, closing = known_at_large_angles(_unknown("axial", **{"1": 0.01, "closing": 1.0}))
    assert abs(one.centre) < 0.01 and one.scale == pytest.approx(0.01, rel=0.01)
    assert (closing.centre, closing.scale) == (0.0, 1.0)
    alone = _unknown("axial", closing=1.0)
    assert known_at_large_angles(alone) == alone and known_at_large_angles([]) == []
