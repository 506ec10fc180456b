from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from bayeschute.core.errors import InputError
from bayeschute.regression.orthogonal import select
from bayeschute.structure.polar_equation import (
    PolarPool,
    polar_candidates,
    polar_problem,
    polar_variables,
    product,
    variable,
)

LENGTH, SPEED = 35.0, 9.75
REPORT_POOL = PolarPool(
    (
        "speed", "alpha", "alpha_rate", "q", "distance", "closing",
        "(1.0-distance)_+", "(1.1-distance)_+", "(1.2-distance)_+", "(1.3-distance)_+", "(1.4-distance)_+",
        "(alpha-16deg)_+", "(alpha-20deg)_+", "(alpha-24deg)_+",
    )
)  # fmt: skip


@pytest.fixture
def made():
    """Reconstructed quantities of two canopies, made up."""
    rng = np.random.default_rng(0)
    T = 200
    low_high = {
        "airspeed": (8, 12), "alpha_T": (0.1, 0.6), "alpha_T_rate": (-0.3, 0.3), "phi_a_rate": (-1, 1),
        "dynamic_pressure": (40, 80), "D_prox": (0.3, 1.6), "V_prox": (-0.1, 0.1), "phi_prox": (-3, 3),
        "C_A": (0.7, 0.9), "C_Y": (-0.1, 0.1), "C_N": (-0.1, 0.1),
    }  # fmt: skip
    data = {name: (("time", "canopy"), rng.uniform(*ends, size=(T, 2))) for name, ends in low_high.items()}
    return xr.Dataset(data, {"time": 0.1 * np.arange(T)})


def test_variables_are_those_of_the_report(made):
    x = polar_variables(made, 1, LENGTH, SPEED)
    V, alpha = made["airspeed"].values[:, 1], made["alpha_T"].values[:, 1]
    np.testing.assert_allclose(x["speed"], V / SPEED - 1)
    np.testing.assert_allclose(x["alpha_rate"], made["alpha_T_rate"].values[:, 1] * LENGTH / (2 * V))
    np.testing.assert_allclose(x["azimuth_rate"], made["phi_a_rate"].values[:, 1] * np.sin(alpha) * LENGTH / (2 * V))
    np.testing.assert_allclose(x["overlap"], np.maximum(0.8 - x["distance"], 0))
    np.testing.assert_allclose(x["sin_proximity"] ** 2 + x["cos_proximity"] ** 2, 1.0)
    np.testing.assert_allclose(variable("(alpha-16deg)_+", x), np.maximum(alpha - np.deg2rad(16), 0))
    np.testing.assert_allclose(product("q^2*(1.1-distance)_+", x), x["q"] ** 2 * np.maximum(1.1 - x["distance"], 0))
    assert (product("1", x) == 1.0).all()


def test_the_report_s_pool_has_its_120_candidates_and_indices(made):
    pool = polar_candidates(REPORT_POOL, polar_variables(made, 0, LENGTH, SPEED))
    index = dict(zip(pool.names, pool.indices, strict=True))
    assert len(pool) == 120
    assert (index["1"], index["q"], index["speed^2"]) == ("0", "1000", "2")  # rows 1 to 3 of the print-out
    assert index["alpha_rate*distance"] == "10100" and index["closing^2"] == "200000"
    assert index["(1.3-distance)_+*(alpha-24deg)_+"] == "10001000000000"


def test_known_terms_are_found_in_the_report_s_pool(made):
    x = polar_variables(made, 0, LENGTH, SPEED)
    made["C_A"].values[:, 0] = 1.9577 - 0.0194 * x["q"] + 2.2803 * x["speed"] ** 2
    pool = polar_candidates(REPORT_POOL, x)
    stack = polar_problem("C_A", pool, made, 0)
    found = select(stack.X, stack.z, pool.names, indices=pool.indices, sigma_max2=1e-9, forced=[0])
    assert set(found.terms) == {"1", "q", "speed^2"} and found.certain
    estimates = dict(zip(found.terms, found.estimate, strict=True))
    assert estimates["q"] == pytest.approx(-0.0194) and estimates["speed^2"] == pytest.approx(2.2803)


def test_rows_without_an_azimuth_are_missing(made):
    made["phi_a_rate"].values[5, 0] = np.nan
    pool = polar_candidates(PolarPool(("azimuth_rate",), 1), polar_variables(made, 0, LENGTH, SPEED))
    stack = polar_problem("C_Y", pool, made, 0)
    assert np.flatnonzero(np.isnan(stack.X).any(axis=1)).tolist() == [5]
    assert select(stack.X, stack.z, pool.names).samples == 199


def test_extra_terms_by_name(made):
    x = polar_variables(made, 0, LENGTH, SPEED)
    pool = polar_candidates(PolarPool(("alpha",), 1, ("alpha^3", "q*overlap")), x)
    assert pool.names == ("1", "alpha", "alpha^3", "q*overlap")
    np.testing.assert_allclose(pool.column(3), x["q"] * x["overlap"])


def test_bad_names_are_refused(made):
    x = polar_variables(made, 0, LENGTH, SPEED)
    for call in (
        lambda: variable("beta", x),
        lambda: product("alpha*beta", x),
        lambda: polar_candidates(PolarPool(("overlap", "(0.8-distance)_+")), x),
        lambda: polar_candidates(PolarPool(("alpha", "alpha")), x),
        lambda: polar_problem("C_D", polar_candidates(PolarPool(("alpha",)), x), made, 0),
    ):
        with pytest.raises(InputError):
            call()
