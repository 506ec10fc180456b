from __future__ import annotations

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.regression.equation_error import fit
from bayeschute.regression.fit_statistics import null_models, theil


def test_theil():
    rng = np.random.default_rng(7)
    z, e = rng.normal(size=300) + 1, rng.normal(size=300)
    assert theil(z, z) == (0.0, 0.0, 0.0, 0.0)
    assert theil(z, -z).coefficient == pytest.approx(1.0) and theil(z, 0 * z).coefficient == pytest.approx(1.0)
    shifted = theil(z, z + 2.0)
    assert shifted.bias == pytest.approx(1.0) and shifted.variance == pytest.approx(0.0, abs=1e-12)
    y = 0.5 * z + 0.3 * e
    t = theil(z, y)
    assert t.bias + t.variance + t.covariance == pytest.approx(1.0)
    corr = np.corrcoef(z, y)[0, 1]
    assert t.covariance == pytest.approx(2 * (1 - corr) * z.std() * y.std() / np.mean((z - y) ** 2))
    assert theil(np.r_[z, np.nan], np.r_[y, 1.0]) == t
    for bad in ((z, z[:5]), (np.array([np.nan]), np.array([1.0])), (np.array([np.inf]), np.array([1.0]))):
        with pytest.raises(InputError):
            theil(*bad)


def test_constant_force_explains_a_force_balance():
    rng = np.random.default_rng(8)
    q = 57.0 * (1 + 0.15 * np.sin(np.linspace(0, 30, 800)))
    z = 47.9 / q + 0.005 * rng.normal(size=800)
    constant, force = null_models(z, q)
    assert (constant.name, force.name) == ("constant", "constant force")
    assert constant.r2 == pytest.approx(0.0, abs=1e-12) and constant.coefficient == pytest.approx(z.mean())
    assert force.coefficient == pytest.approx(47.9, rel=1e-3) and force.r2 > 0.99
    assert force.rms == pytest.approx(0.005, rel=0.1)
    linear = fit(np.column_stack([np.ones(800), q]), z)
    assert force.r2 > linear.r2  # two free coefficients do no better than knowing the weight
    given = null_models(z, q, pressure=40.0)[1]
    assert given.coefficient == 40.0 and given.r2 < force.r2
    z[3], q[9] = np.nan, np.nan
    assert np.isnan(null_models(z, q)[1].prediction[[3, 9]]).all()
    assert len(null_models(z)) == 1


def test_null_model_of_a_vector_has_a_mean_for_each_component():
    z = np.r_[np.full(5, 2.0), np.full(5, -3.0)] + np.tile([0.1, -0.1, 0, 0.05, -0.05], 2)
    (model,) = null_models(z, components=np.repeat([0, 1], 5))
    assert model.r2 == pytest.approx(0.0, abs=1e-12) and model.prediction[[0, 9]].tolist() == pytest.approx([2.0, -3.0])
    with pytest.raises(InputError):
        null_models(z, np.zeros(10))
