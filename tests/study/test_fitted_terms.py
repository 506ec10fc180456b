"""Terms that a fit may ask for: their priors, and their place among the others."""

from __future__ import annotations

from itertools import permutations
from types import SimpleNamespace

import numpy as np

from bayeschute.inference.priors import Prior
from bayeschute.study.fitted_terms import ADDED, KEPT, in_order, terms_left_out, with_terms


def _job(model="cluster"):
    found = {
        "axial": {"left_out": [{"term": "closing", "estimate": 0.2, "se": 0.001}]},
        "transverse": {"left_out": [{"term": "c", "estimate": -0.1, "se": 0.05}]},
    }
    study = SimpleNamespace(
        model=model,
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


def test_why_a_term_is_there_is_told():
    assert all(p.source.endswith(KEPT) for p in terms_left_out(_job(), KEPT))


def test_a_descent_has_none():
    assert terms_left_out(_job("descent")) == []


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
