"""Terms that a fit may ask for: their priors, and their place among the others."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from bayeschute.inference.priors import Prior
from bayeschute.study.fitted_terms import ADDED, KEPT, terms_left_out, with_terms


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


def test_terms_join_those_of_their_kind():
    here = [Prior(name, 0.0, 1.0, False, "1", "") for name in ("axial[1]", "transverse[e]", "riser_length")]
    made, kept = with_terms(here, terms_left_out(_job()))
    assert [p.name for p in made] == ["axial[1]", "axial[closing]", "transverse[e]", "transverse[c]", "riser_length"]
    np.testing.assert_array_equal(kept, [True, False, True, False, True])
