from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from bayeschute.errors import InputError
from bayeschute.regression.colored import residual_noise
from bayeschute.regression.diagnostics import (
    autocorrelation,
    collinearity,
    null_models,
    press,
    signal_to_noise,
    theil,
)
from bayeschute.regression.equation_error import fit


def two_columns(r, n=500):
    rng = np.random.default_rng(0)
    pair = rng.normal(size=(n, 2))
    pair = np.linalg.qr(pair - pair.mean(axis=0))[0]
    return np.column_stack([3.0 + pair[:, 0], -1.0 + r * pair[:, 0] + np.sqrt(1 - r**2) * pair[:, 1]])


@pytest.mark.parametrize("r", [-0.95, 0.0, 0.5, 0.99])
def test_vif_of_two_columns_is_closed(r):
    c = collinearity(two_columns(r), ["a", "b"])
    assert c.correlation[0, 1] == pytest.approx(r, abs=1e-9) and c.max_correlation == pytest.approx(abs(r), abs=1e-9)
    np.testing.assert_allclose(c.vif, 1 / (1 - r**2), rtol=1e-8)
    assert ("correlation" in c.flags) == (abs(r) > 0.9) and ("vif" in c.flags) == (r**2 > 0.9)
    assert c.pair == ("a", "b") and c.sentences


def test_vif_is_the_inverse_correlation_matrix_and_constants_have_none():
    rng = np.random.default_rng(1)
    X = rng.normal(size=(100, 4)) @ rng.normal(size=(4, 4)) + 5.0
    c = collinearity(np.column_stack([np.ones(100), X]))
    np.testing.assert_allclose(c.vif[1:], np.diag(np.linalg.inv(np.corrcoef(X.T))), rtol=1e-8)
    assert np.isnan(c.vif[0]) and np.isnan(c.correlation[0]).all()
    np.testing.assert_allclose(c.correlation[1:, 1:], np.corrcoef(X.T), atol=1e-12)


def test_condition_index_of_nearly_equal_columns():
    angle = 0.01
    X = np.zeros((4, 2))
    X[:2] = [[1.0, np.cos(angle)], [0.0, np.sin(angle)]]
    c = collinearity(X, ["a", "b"], centred=False)
    assert c.condition_index == pytest.approx(1 / np.tan(angle / 2), rel=1e-9) and "condition" in c.flags
    assert c.correlation[0, 1] == pytest.approx(np.cos(angle))


def test_a_dependent_set_is_flagged_as_infinite():
    rng = np.random.default_rng(2)
    x = rng.normal(size=(60, 3))
    c = collinearity(np.column_stack([x, x[:, 0] + x[:, 1]]), ["a", "b", "c", "sum"])
    assert np.isinf(c.vif[[0, 1, 3]]).all() and c.vif[2] < 2 and c.max_vif == np.inf and c.flagged
    assert c.condition_index > 1e8 and any("a, b, sum" in s for s in c.sentences)
    wide = collinearity(rng.normal(size=(5, 9)))
    assert wide.condition_index == np.inf and wide.max_vif == np.inf


def test_good_regressors_raise_no_flag():
    c = collinearity(np.random.default_rng(3).normal(size=(500, 3)))
    assert not c.flagged and len(c.sentences) == 1
    alone = collinearity(np.ones((5, 1)))
    assert alone.pair == ("", "") and alone.max_vif == 1.0 and not alone.flagged


def test_autocorrelation_and_spectrum_of_an_ar1():
    rng = np.random.default_rng(4)
    phi, dt = 0.7, 0.1
    e = lfilter([1.0], [1.0, -phi], rng.normal(size=20200))[200:]
    a = autocorrelation(residual_noise(e, max_lag_fraction=0.02), dt)
    np.testing.assert_allclose(a.correlation[:8], phi ** np.arange(8), atol=0.05)
    exact = 2 * dt / np.abs(1 - phi * np.exp(-2j * np.pi * a.frequency * dt)) ** 2
    np.testing.assert_allclose(a.spectrum, exact, rtol=0.4)
    area = np.trapezoid(a.spectrum, a.frequency)
    assert area == pytest.approx(np.var(e), rel=0.02) and a.frequency[-1] == pytest.approx(5.0)
    assert a.integrated_time == pytest.approx(dt * (1 + phi) / (1 - phi), rel=0.2)
    with pytest.raises(InputError):
        autocorrelation(residual_noise(e), 0.0)


def test_press_is_leaving_out_one_by_one():
    rng = np.random.default_rng(5)
    X = np.column_stack([np.ones(40), rng.normal(size=(40, 3))])
    z = X @ [1.0, 2.0, 0.0, -1.0] + rng.normal(size=40)
    out = [z[i] - X[i] @ np.linalg.lstsq(np.delete(X, i, 0), np.delete(z, i), rcond=None)[0] for i in range(40)]
    p = press(X, z)
    np.testing.assert_allclose(p.residual, out, rtol=1e-9)
    assert p.press == pytest.approx(np.sum(np.square(out))) and p.rms == pytest.approx(np.sqrt(p.press / 40))
    assert p.r2 == pytest.approx(1 - np.mean(np.square(out)) / np.var(z)) and p.ratio > 1


def test_press_by_blocks_is_leaving_out_blocks():
    rng = np.random.default_rng(6)
    X, z = rng.normal(size=(50, 3)), rng.normal(size=50)
    z[4] = np.nan
    folds = np.array(list("abcde"))[rng.integers(5, size=50)]
    p = press(X, z, folds=folds)
    for label in "abcde":
        out, rest = (folds == label) & ~np.isnan(z), (folds != label) & ~np.isnan(z)
        theta = np.linalg.lstsq(X[rest], z[rest], rcond=None)[0]
        np.testing.assert_allclose(p.residual[out], z[out] - X[out] @ theta, rtol=1e-8)
    assert np.isnan(p.residual[4])


def test_press_refuses_rows_that_nothing_can_replace():
    X = np.column_stack([np.ones(10), np.eye(10)[:, 0]])
    with pytest.raises(InputError, match="alone carry"):
        press(X, np.arange(10.0))
    for bad in (np.ones((2, 2)), np.column_stack([np.ones(10), np.ones(10)]), np.zeros((10, 1))):
        with pytest.raises(InputError):
            press(bad, np.arange(float(len(bad))))


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


def test_signal_to_noise_names_both_variants():
    signal = 3.0 + np.sqrt(2.0) * np.sin(np.linspace(0, 20 * np.pi, 2001)[:-1])
    s = signal_to_noise(signal, 0.5)
    assert s.about_mean == pytest.approx(2.0, rel=1e-6) and s.with_mean == pytest.approx(np.sqrt(10) / 0.5, rel=1e-6)
    assert not s.sufficient and signal_to_noise(signal, 0.1).sufficient
    for bad in (0.0, np.nan):
        with pytest.raises(InputError):
            signal_to_noise(signal, bad)


def test_collinearity_refuses_bad_columns():
    for bad in (np.zeros((5, 2)), np.ones(5), np.full((5, 2), np.nan), np.full((5, 1), np.inf)):
        with pytest.raises(InputError):
            collinearity(bad)
