"""The table of curves of a run: bands of every curve that has a term, over what was flown and what is compared."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.study.aerodynamics.curve_bands import curve_draws, known_curves, table

RANGES = {"alpha": (0.1, 0.4), "D_prox": (0.5, 0.75), "rate": (0.0, 0.2), "speed": (0.9, 1.1)}


@pytest.fixture(scope="module")
def draws():
    rng = np.random.default_rng(0)
    names = ("axial[1]", "transverse[e]", "transverse[repulsion(0.8)]", "riser_length")
    return {name: rng.standard_normal((2, 1000)) for name in names}


def test_curves_are_those_that_have_a_term(draws):
    assert known_curves(list(draws)) == ("C_A", "C_N", "proximity")
    assert known_curves(["riser_length", "sd(axial[1])"]) == ()


def test_bands_are_quantiles_of_closed_forms(draws):
    made = table(draws, draws, RANGES, {"C_N": 0.6, "C_N from": 0.05}, {"transverse[e]": 0.5, "axial[1]": 0.9})
    normal = made[made["curve"] == "C_N"]
    assert normal["at"].min() == 0.05 and normal["at"].max() == 0.6
    np.testing.assert_array_equal(normal["flown"], normal["at"].between(0.1, 0.4))
    q95 = np.quantile(draws["transverse[e]"], 0.95)
    np.testing.assert_allclose(normal["posterior_q95"], q95 * np.sin(normal["at"]), rtol=1e-9)
    np.testing.assert_allclose(normal["truth"], 0.5 * np.sin(normal["at"]), rtol=1e-9)
    near = made[made["curve"] == "proximity"]
    assert (near["symbol"] == "D_prox").all() and near["at"].max() == 0.75 and (near["truth"] == 0.0).all()


def test_without_canopies_there_is_no_table(draws):
    assert table(draws, None, {}, {}).empty
    assert curve_draws("C_A", draws, {"axial[alpha]": draws["axial[1]"]}, np.array([0.1])).prior is None
