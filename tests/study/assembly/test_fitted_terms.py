"""Terms that a fit may ask for: their priors, and their place among the others."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations
from types import SimpleNamespace

import numpy as np
import pytest

import bayeschute as bc
from bayeschute.likelihood.priors import Prior, covariance, working
from bayeschute.study.assembly.fitted_terms import (
    ADDED,
    at_own_apparent_mass,
    in_order,
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


def test_every_coefficient_of_a_record_carries_the_angle_beyond_which_its_term_is_held():
    """Selected, of the library or left out: all are coefficients of the same terms."""
    entry = {
        "selected": [{"term": "e", "estimate": 0.1, "se": 0.01}],
        "covariance": [[1e-4]],
        "left_out": [{"term": "c", "estimate": -0.1, "se": 0.05}],
        "together": {
            "terms": ["e", "c"], "rms": [0.1, 0.1], "estimate": [0.1, -0.1], "fitted": ["e", "c"],
            "covariance": [[1e-4, 0.0], [0.0, 1e-4]],
        },
    }  # fmt: skip
    for saturation in (None, 0.37):
        told = entry if saturation is None else entry | {"saturation": saturation}
        for make in (of_selected, of_library):
            made = make(CLUSTER, "transverse", told, "one")
            assert made and [p.saturation for p in made] == [saturation] * len(made)
        job = _job()
        job.load = lambda name, told=told: {"coefficients": {"transverse": told}}
        assert [p.saturation for p in terms_left_out(job)] == [saturation]
