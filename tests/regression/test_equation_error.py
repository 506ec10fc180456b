from __future__ import annotations

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.regression.equation_error import fit
from bayeschute.regression.orthogonal import select
from bayeschute.regression.stacked import stack_components


def problem(seed=0, n=200):
    rng = np.random.default_rng(seed)
    X = np.column_stack([np.ones(n), rng.normal(size=(n, 2)) * [1.0, 1e4]])
    return X, X @ [1.0, -2.0, 3e-4] + 0.5 * rng.normal(size=n)


def test_estimate_and_white_covariance_are_the_normal_equations():
    X, z = problem()
    f = fit(X, z, ["1", "a", "b"])
    inverse = np.linalg.inv(X.T @ X)
    np.testing.assert_allclose(f.estimate, inverse @ X.T @ z, rtol=1e-9)
    rest = z - X @ f.estimate
    np.testing.assert_allclose(f.residual, rest, atol=1e-12)
    np.testing.assert_allclose(f.white_covariance, rest @ rest / 197 * inverse, rtol=1e-8)
    np.testing.assert_allclose(f.white_se, np.sqrt(np.diag(f.white_covariance)))
    np.testing.assert_allclose(f.se, np.sqrt(np.diag(f.covariance)))
    assert f.sigma == pytest.approx(np.sqrt(rest @ rest / 197)) and f.rms == pytest.approx(np.sqrt(np.mean(rest**2)))
    assert f.r2 == pytest.approx(1 - np.mean(rest**2) / np.var(z)) and f.dof == 197 and f.samples == 200
    assert f.condition == pytest.approx(np.linalg.cond(X / np.linalg.norm(X, axis=0)))
    assert f.names == ("1", "a", "b") and f.autocorrelation_time == pytest.approx(1.0, abs=0.6)
    np.testing.assert_allclose(f.leverage(X), np.einsum("ij,jk,ik->i", X, inverse, X), rtol=1e-8)
    assert f.max_leverage == pytest.approx(f.leverage(X).max())
    np.testing.assert_allclose(f.predict(X), z - rest)


def test_colored_covariance_is_the_sandwich():
    X, z = problem(1, 120)
    z = z + np.cumsum(np.random.default_rng(2).normal(size=120)) * 0.2
    f = fit(X, z)
    c = f.noise.covariance[0][0, 0]
    K = c.size // 2
    lag = np.subtract.outer(np.arange(120), np.arange(120))
    R = np.where(np.abs(lag) <= K, c[np.clip(lag, -K, K) + K], 0.0)
    inverse = np.linalg.inv(X.T @ X)
    np.testing.assert_allclose(f.covariance, inverse @ X.T @ R @ X @ inverse, rtol=1e-7, atol=1e-16)
    assert f.se[0] > 1.5 * f.white_se[0]


def test_intervals():
    X, z = problem(3)
    f = fit(X, z)
    narrow, wide = f.intervals(0.5), f.intervals(0.9)
    assert (wide[:, 0] < narrow[:, 0]).all() and (narrow.mean(axis=1) == pytest.approx(f.estimate))
    half = (f.intervals(0.9, white=True)[:, 1] - f.estimate) / f.white_se
    np.testing.assert_allclose(half, 1.6526, atol=1e-3)
    for level in (0.0, 1.0, np.nan):
        with pytest.raises(InputError):
            f.intervals(level)


def test_missing_rows_are_gaps():
    X, z = problem(4)
    z[50:70], X[100, 1] = np.nan, np.nan
    keep = np.ones(200, dtype=bool)
    keep[50:70], keep[100] = False, False
    f = fit(X, z)
    g = fit(X[keep], z[keep], time=np.flatnonzero(keep) * 0.1)
    np.testing.assert_allclose(f.estimate, g.estimate, rtol=1e-12)
    np.testing.assert_allclose(f.covariance, g.covariance, rtol=1e-9)
    assert f.samples == 179 and np.isnan(f.residual[~keep]).all() and (f.used == keep).all()


def test_fit_of_a_selection_is_its_back_transformation():
    X, z = problem(5)
    s = select(X, z, ["1", "a", "b"], noise_variance=0.25)
    f = fit(X[:, list(s.selected)], z, s.terms)
    assert f.names == s.terms
    np.testing.assert_allclose(f.estimate, s.estimate, rtol=1e-10)


def test_vector_regression_does_not_depend_on_the_axes():
    rng = np.random.default_rng(6)
    T = 300
    terms = rng.normal(size=(T, 2, 3))
    noise = np.cumsum(rng.normal(size=(T, 2)), axis=0) @ np.array([[1.0, 0.5], [0.0, 0.4]]) * 0.1
    force = terms @ [1.0, -0.5, 0.2] + noise

    def at_angle(angle):
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        stack = stack_components(np.einsum("cd,tdp->tcp", turn, terms), force @ turn.T)
        return fit(stack.X, stack.z, blocks=stack.blocks, groups=stack.groups, components=stack.components)

    first, other = at_angle(0.0), at_angle(0.7)
    np.testing.assert_allclose(other.estimate, first.estimate, rtol=1e-10)
    np.testing.assert_allclose(other.covariance, first.covariance, rtol=1e-8)
    assert other.r2 == pytest.approx(first.r2)


@pytest.mark.parametrize(
    ("X", "z", "message"),
    [
        (np.ones((3, 3)), np.arange(3.0), "more rows"),
        (np.column_stack([np.arange(9.0), 2 * np.arange(9.0)]), np.ones(9), "combinations"),
        (np.column_stack([np.ones(9), np.ones(9), np.arange(9.0)]), np.ones(9), "combinations"),
        (np.column_stack([np.ones(9), np.zeros(9)]), np.ones(9), "zeros"),
        (np.full((9, 1), np.nan), np.ones(9), "no row"),
        (np.full((9, 1), np.inf), np.ones(9), "infinite"),
        (np.ones((9, 1)), np.ones(8), "same N"),
    ],
)
def test_bad_input_is_refused(X, z, message):
    with pytest.raises(InputError, match=message):
        fit(X, z)


def test_prediction_wants_the_same_columns():
    X, z = problem(8)
    with pytest.raises(InputError):
        fit(X, z).predict(X[:, :2])
