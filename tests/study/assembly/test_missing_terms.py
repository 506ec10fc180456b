"""Terms that a model lacks: each comes with its coefficient alone, and none that it has or that needs more canopies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.twins import small_cluster as small

from bayeschute.aero.coefficient import Coefficient
from bayeschute.dynamics.parameters import Structure
from bayeschute.likelihood.disturbances import Latent
from bayeschute.likelihood.joint import FlightData
from bayeschute.study.assembly.missing_terms import missing_terms

LIBRARY = {"axial": ("1", "alpha^2", "closing"), "transverse": ("e", "e*alpha^2", "repulsion(0.8)")}


def case(directions):
    """A flight with one term of either kind."""
    structure = Structure(("1",), ("e",), len(directions[0]), "riser")
    start = small.start(directions, velocity=(1.0, -2.0, 10.0))
    model = small.flight(small.cluster((0.95,), (0.1,)), start, structure, names=("axial[1]",))
    nothing = np.zeros((4, 1))
    return FlightData(model, nothing, nothing == 0.0, small.DT, np.ones(17), (0,), Latent((), (), 3))


@pytest.fixture(scope="module")
def pair():
    return case(((0.2, -0.1), (0.1, -0.2), (-1.0, -1.0)))


def test_terms_of_two_canopies_are_for_two_and_none_is_there_twice(pair):
    found = [str(coefficient) for coefficient, _ in missing_terms(pair, LIBRARY)]
    assert found == ["axial[alpha^2]", "axial[closing]", "transverse[e*alpha^2]", "transverse[repulsion(0.8)]"]
    alone = case(((0.2,), (0.1,), (-1.0,)))
    assert [str(c) for c, _ in missing_terms(alone, LIBRARY)] == ["axial[alpha^2]", "transverse[e*alpha^2]"]
    assert list(missing_terms(pair, {"axial": ("1",)})) == []


def test_a_term_is_added_with_its_coefficient_alone(pair):
    by_name = {coefficient: alternative for coefficient, alternative in missing_terms(pair, LIBRARY)}
    added = by_name[Coefficient("transverse", "e*alpha^2")].changed(0.3).model
    values = dict(zip(added.structure.transverse, map(float, added.base.transverse), strict=True))
    assert values == {"e": 0.1, "e*alpha^2": 0.3, "repulsion(0.8)": 0.0} and not any(added.base.axial[1:])
    nothing = by_name[Coefficient("axial", "closing")].changed(0.0).model
    before, same, other = (small.fly(replace(model, names=())) for model in (pair.model, nothing, added))
    np.testing.assert_allclose(same, before, atol=1e-12)
    assert np.abs(other - before).max() > 1e-4
