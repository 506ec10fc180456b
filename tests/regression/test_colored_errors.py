from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from bayeschute.core.errors import InputError
from bayeschute.regression.colored_errors import residual_noise
from bayeschute.regression.equation_error import fit


def ar1(rng, n, phi, series=1):
    start = 300
    noise = lfilter([1.0], [1.0, -phi], rng.normal(size=(series, n + start)), axis=1)[:, start:]
    return noise[0] if series == 1 else noise


def pendulum(n):
    t = np.arange(n) / 10
    return np.column_stack([np.ones(n), np.sin(2 * np.pi * t / 15), np.cos(2 * np.pi * t / 15) ** 2, np.sin(t / 5.6)])


def dense(noise, rows):
    """R in full, from the covariances by lag."""
    R = np.zeros((rows, rows))
    for series, c in zip(noise.series, noise.covariance, strict=True):
        K = c.shape[2] // 2
        for i, (ri, pi) in enumerate(zip(series.rows, series.places, strict=True)):
            for j, (rj, pj) in enumerate(zip(series.rows, series.places, strict=True)):
                lag = pj[None, :] - pi[:, None]
                R[np.ix_(ri, rj)] = np.where(np.abs(lag) <= K, c[i, j, np.clip(lag, -K, K) + K], 0.0)
    return R


def parzen(K):
    k = np.arange(K + 1) / (K + 1)
    return np.where(k < 0.5, 1 - 6 * k**2 + 6 * k**3, 2 * (1 - k) ** 3)


def test_one_series_is_the_textbook_autocovariance():
    rng = np.random.default_rng(0)
    e = ar1(rng, 103, 0.8)
    noise = residual_noise(e)
    biased = np.array([e[: 103 - k] @ e[k:] / 103 for k in range(11)])
    np.testing.assert_allclose(noise.covariance[0][0, 0, 10:], biased * parzen(10), atol=1e-12)
    np.testing.assert_allclose(noise.covariance[0][0, 0, :10][::-1], noise.covariance[0][0, 0, 11:])
    U = rng.normal(size=(103, 3))
    np.testing.assert_allclose(noise.quadratic(U), U.T @ dense(noise, 103) @ U, atol=1e-10)
    assert np.linalg.eigvalsh(dense(noise, 103))[0] > -1e-12


@pytest.mark.parametrize("taper", ["parzen", "bartlett"])
def test_blocks_and_simultaneous_components_against_the_dense_matrix(taper):
    rng = np.random.default_rng(1)
    common = ar1(rng, 80, 0.7)
    e = np.concatenate([common + rng.normal(size=80), np.roll(common, 2) + rng.normal(size=80), ar1(rng, 50, 0.5)])
    blocks, groups = np.repeat(["y", "z", "other"], [80, 80, 50]), np.repeat([0, 0, 1], [80, 80, 50])
    noise = residual_noise(e, blocks=blocks, groups=groups, taper=taper, max_lag_fraction=0.2)
    R = dense(noise, 210)
    assert np.abs(R - R.T).max() < 1e-12 and np.linalg.eigvalsh(R)[0] > -1e-10
    assert np.abs(R[:160, 160:]).max() == 0.0 and np.abs(R[:80, 80:160]).max() > 0.1
    U = rng.normal(size=(210, 2))
    np.testing.assert_allclose(noise.quadratic(U), U.T @ R @ U, rtol=1e-9)
    c = noise.covariance[0]
    lag2 = 16 + 2  # component z follows y by 2 samples
    assert np.argmax(c[0, 1]) in (lag2 - 1, lag2, lag2 + 1)
    apart = residual_noise(e, blocks=blocks, taper=taper, max_lag_fraction=0.2)
    np.testing.assert_allclose(apart.covariance[1][0, 0], c[1, 1], atol=1e-12)


def test_what_fitting_removed_is_put_back_as_the_dense_algebra_says():
    rng = np.random.default_rng(2)
    n, K = 70, 14
    Q, _ = np.linalg.qr(pendulum(n))
    e = ar1(rng, n, 0.8)
    e = e - Q @ (Q.T @ e)
    plain = residual_noise(e, max_lag_fraction=0.2)
    R, keep = dense(plain, n), np.eye(n) - Q @ Q.T
    lost = R - keep @ R @ keep
    added = np.array([np.trace(lost, offset=k) for k in range(K + 1)]) / n
    expected = plain.covariance[0][0, 0, K:] + added * parzen(K)
    once = residual_noise(e, Q=Q, bias_passes=1, max_lag_fraction=0.2)
    np.testing.assert_allclose(once.covariance[0][0, 0, K:], expected, atol=1e-12)
    none = residual_noise(e, Q=Q, bias_passes=0, max_lag_fraction=0.2)
    np.testing.assert_allclose(none.covariance[0], plain.covariance[0] * n / (n - 4))


def test_gaps_keep_their_place_in_time():
    rng = np.random.default_rng(3)

    def at_lags_0_and_5(residual, **options):
        c = residual_noise(residual, **options).covariance[0][0, 0]
        return c[c.size // 2], c[c.size // 2 + 5]

    whole, with_gaps, closed_up = [], [], []
    for _ in range(60):
        e = ar1(rng, 400, 0.9)
        holes = rng.random(400) < 0.3
        whole.append(at_lags_0_and_5(e))
        with_gaps.append(at_lags_0_and_5(np.where(holes, np.nan, e)))
        closed_up.append(at_lags_0_and_5(e[~holes]))
    np.testing.assert_allclose(np.mean(with_gaps, 0), np.mean(whole, 0), rtol=0.04)
    assert np.mean(closed_up, 0)[1] < 0.9 * np.mean(whole, 0)[1]  # closing the gaps would hide memory
    noise = residual_noise(np.where(holes, np.nan, e))
    by_time = residual_noise(e[~holes], time=np.arange(400)[~holes] * 0.1)
    np.testing.assert_allclose(by_time.covariance[0], noise.covariance[0], atol=1e-12)
    U = rng.normal(size=(int((~holes).sum()), 2))
    assert (np.linalg.eigvalsh(noise.quadratic(U)) > 0).all()


def test_pooled_series_share_one_autocovariance():
    rng = np.random.default_rng(4)
    e = np.concatenate([ar1(rng, 60, 0.6), ar1(rng, 90, 0.6)])
    blocks = np.repeat([0, 1], [60, 90])
    noise = residual_noise(e, blocks=blocks, pool=True)
    np.testing.assert_array_equal(noise.covariance[0], noise.covariance[1])
    zero = noise.covariance[0].shape[2] // 2
    assert noise.covariance[0][0, 0, zero] == pytest.approx(e @ e / 150)
    with pytest.raises(InputError, match="unlike"):
        residual_noise(
            np.r_[e, e[:60]],
            blocks=np.repeat([0, 1, 2], [60, 90, 60]),
            groups=np.repeat([0, 1, 0], [60, 90, 60]),
            pool=True,
        )


@pytest.mark.parametrize(("phi", "white_range"), [(0.95, (0.12, 0.35)), (0.0, (0.9, 1.1))])
def test_colored_standard_errors_against_the_true_ones(phi, white_range):
    rng = np.random.default_rng(5)
    n = 1508
    X = pendulum(n)
    true = toeplitz(phi ** np.arange(n)) / (1 - phi**2)
    solve = np.linalg.pinv(X)
    true_se = np.sqrt(np.diag(solve @ true @ solve.T))
    colored, plain, white, inside = [], [], [], []
    for _ in range(60):
        f = fit(X, ar1(rng, n, phi))
        colored.append(f.se)
        white.append(f.white_se)
        plain.append(fit(X, f.residual, bias_passes=0).se)
        limits = f.intervals(0.9)
        inside.append((limits[:, 0] < 0) & (limits[:, 1] > 0))
    colored_ratio, plain_ratio = np.mean(colored, 0) / true_se, np.mean(plain, 0) / true_se
    assert (colored_ratio > 0.85).all() and (colored_ratio < 1.15).all()
    assert (plain_ratio > 0.78).all() and (colored_ratio > plain_ratio - 0.02).all()
    white_ratio = np.mean(white, 0) / true_se
    assert (white_ratio > white_range[0]).all() and (white_ratio < white_range[1]).all()
    assert 0.8 <= np.mean(inside) <= 0.97


def test_integrated_time_and_degrees_of_freedom():
    rng = np.random.default_rng(6)
    noise = residual_noise(ar1(rng, 20000, 0.8))
    assert noise.integrated_time == pytest.approx(9.0, rel=0.35)
    assert noise.dof == pytest.approx(3.71 * 20000 / 2001, rel=0.01)
    assert residual_noise(np.zeros(50)).integrated_time == 1.0


@pytest.mark.parametrize("options", [{"taper": "box"}, {"max_lag_fraction": 0.0}, {"max_lag_fraction": 1.0}])
def test_bad_options_are_refused(options):
    with pytest.raises(InputError):
        residual_noise(np.arange(20.0), **options)


def test_bad_residuals_are_refused():
    for bad in (np.full(5, np.nan), np.array([1.0, np.inf])):
        with pytest.raises(InputError):
            residual_noise(bad)


def test_rows_missing_at_the_ends_and_whole_series_are_no_part_of_the_record():
    rng = np.random.default_rng(10)
    e = ar1(rng, 90, 0.5)
    padded = np.r_[np.full(4, np.nan), e, np.full(7, np.nan), np.full(20, np.nan)]
    blocks = np.repeat([0, 1], [101, 20])
    noise = residual_noise(padded, blocks=blocks)
    np.testing.assert_allclose(noise.covariance[0], residual_noise(e).covariance[0], atol=1e-12)
    assert noise.series[0].length == 90 and noise.series[1].rows[0].size == 0
    U = rng.normal(size=(90, 2))
    np.testing.assert_allclose(noise.quadratic(U), residual_noise(e).quadratic(U), rtol=1e-10)
