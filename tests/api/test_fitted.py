"""`Fit`: parameters of all sets of flights in their units, and a search that ended at a mode only if all did."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from bayeschute.api.fitted import Fit
from bayeschute.likelihood.priors import Prior


def group(flight, priors, theta, covariance, converged=True, is_mode=True, lost=()):
    optimum = SimpleNamespace(theta=np.array(theta), covariance=np.array(covariance), converged=converged)
    found = SimpleNamespace(
        optimum=optimum, profile=SimpleNamespace(is_mode=is_mode), lost=lost, hyper=f"noise {flight}"
    )
    return SimpleNamespace(found=found, group=SimpleNamespace(priors=priors, flights=[SimpleNamespace(name=flight)]))


PRIORS = [Prior("drag", 0.0, 1.0, True, "m^2/kg", ""), Prior("axial[1]", 0.0, 1.0, False, "1", "")]
FIRST = ("a", PRIORS, [np.log(0.2), 0.85], [[0.0025, 0.001], [0.001, 0.04]])
SECOND = ("b", [Prior("mass", 0.0, 1.0, False, "kg", "")], [9.0], [[0.25]])


def test_modes_and_deviations_are_of_the_values_not_of_their_logarithms():
    table = Fit(None, (group(*FIRST), group(*SECOND)), {}).parameters
    assert table.index.tolist() == ["drag", "axial[1]", "mass"] and table["unit"].tolist() == ["m^2/kg", "1", "kg"]
    assert table["mode"].tolist() == pytest.approx([0.2, 0.85, 9.0])
    assert table["sd"].tolist() == pytest.approx([0.2 * 0.05, 0.2, 0.5])


@pytest.mark.parametrize(("converged", "is_mode"), [(True, True), (True, False), (False, True)])
def test_one_search_without_a_mode_is_enough(converged, is_mode):
    fit = Fit(None, (group(*FIRST), group(*SECOND, converged, is_mode, ("a correction",))), {})
    assert fit.converged is (converged and is_mode) and fit.notes == ["a correction"]
    said = "converged" if fit.converged else "not converged"
    assert repr(fit) == f"Fit of a, b: 3 parameters, {said}" and fit.noise == ["noise a", "noise b"]
    assert "<td>mass</td><td>9</td><td>0.5</td><td>kg</td>" in fit._repr_html_() and "a correction" in fit._repr_html_()
