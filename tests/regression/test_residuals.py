from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from bayeschute.core.errors import InputError
from bayeschute.regression.colored_errors import residual_noise
from bayeschute.regression.residuals import autocorrelation, press


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
