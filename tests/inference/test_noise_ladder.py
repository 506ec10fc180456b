"""Every rung against a dense Gaussian, a naive loop or a state-space library; gaps, edges and gradients."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import pytest
import scipy.stats
from numpyro.infer.util import log_density as numpyro_log_density
from scipy.linalg import solve_discrete_lyapunov, toeplitz

from bayeschute.inference.noise import Noise
from bayeschute.inference.noise import log_density as uniform_log_density
from bayeschute.inference.noise_ladder import (
    AR1,
    ARMA11,
    OU,
    AR1White,
    StudentT,
    VectorAR1,
    White,
    innovation_terms,
    log_density,
)

N = 60
GRID = 0.1 * np.arange(N)
UNEVEN = np.cumsum(np.random.default_rng(5).exponential(0.7, N))
ROOT = np.array([[0.3, 0.0, 0.0], [0.2, 0.4, 0.0], [-0.1, 0.05, 0.2]])
PHI = np.array([0.9, 0.5, -0.3])
GAUSSIAN = {
    "white": White(0.7),
    "ar1": AR1(0.7, 0.85),
    "ar1 alternating": AR1(0.7, -0.6),
    "ar1+white": AR1White(0.7, 0.9, 0.3),
    "arma": ARMA11(0.5, 0.8, 0.4),
    "arma that cancels": ARMA11(0.5, 0.8, -0.8),
    "ou": OU(0.7, 1.3),
    "ou+white": OU(0.7, 1.3, 0.2),
}


def covariance(rung, time):
    """Dense covariance of a rung at all times, from textbook formulas."""
    lag = np.abs(np.subtract.outer(np.arange(time.size), np.arange(time.size)))
    if isinstance(rung, White):
        return rung.sd**2 * np.eye(time.size)
    if isinstance(rung, AR1):
        return rung.sd**2 * np.power(float(rung.coefficient), lag)
    if isinstance(rung, AR1White):
        return rung.sd**2 * np.power(rung.coefficient, lag) + rung.white**2 * np.eye(time.size)
    if isinstance(rung, OU):
        apart = np.abs(np.subtract.outer(time, time))
        return rung.sd**2 * np.exp(-apart / rung.time_constant) + rung.white**2 * np.eye(time.size)
    s, a, m = rung  # Box and Jenkins, section 3.4.3
    zero = (1.0 + 2.0 * a * m + m**2) / (1.0 - a**2)
    one = (1.0 + a * m) * (a + m) / (1.0 - a**2)
    return s**2 * toeplitz(np.concatenate([[zero], one * a ** np.arange(time.size - 1)]))


def with_gaps(size, seed=1):
    """Standard normal numbers with scattered gaps and a long one, the first sample missing."""
    rng = np.random.default_rng(seed)
    z = rng.standard_normal(size)
    z[rng.random(size) < 0.15] = np.nan
    z[20:27] = np.nan
    z[0] = np.nan
    return z


def by_vector_lyapunov(time):
    """Dense covariance of the vector autoregression, columns of a sample next to each other."""
    a = np.diag(PHI)
    p = solve_discrete_lyapunov(a, ROOT @ ROOT.T)
    full = np.zeros((time.size, 3, time.size, 3))
    for i in range(time.size):
        for j in range(i + 1):
            full[i, :, j, :] = np.linalg.matrix_power(a, i - j) @ p
            full[j, :, i, :] = full[i, :, j, :].T
    return full.reshape(3 * time.size, -1)


@pytest.mark.parametrize("gaps", [False, True])
@pytest.mark.parametrize("name", list(GAUSSIAN))
def test_a_rung_is_the_dense_gaussian(dense, name, gaps):
    rung, time = GAUSSIAN[name], UNEVEN if name.startswith("ou") else GRID
    z = with_gaps(N) if gaps else np.random.default_rng(2).standard_normal(N)
    here = np.isfinite(z)
    wanted = dense.gaussian_log_density(z[here], covariance(rung, time)[np.ix_(here, here)])
    np.testing.assert_allclose(float(log_density(z, time, rung)), wanted, rtol=1e-9)


def test_correlated_channels_are_the_dense_gaussian(dense):
    z = with_gaps((N, 3))
    here = np.isfinite(z).ravel()
    assert (np.isfinite(z).any(axis=1) & ~np.isfinite(z).all(axis=1)).any()  # samples seen in part
    wanted = dense.gaussian_log_density(z.ravel()[here], by_vector_lyapunov(GRID)[np.ix_(here, here)])
    np.testing.assert_allclose(float(log_density(z, GRID, VectorAR1(ROOT, PHI))), wanted, rtol=1e-9)


@pytest.mark.parametrize("gaps", [False, True])
def test_arma_is_that_of_a_state_space_library(gaps):
    sarimax = pytest.importorskip("statsmodels.tsa.statespace.sarimax")
    z = with_gaps(N) if gaps else np.random.default_rng(2).standard_normal(N)
    model = sarimax.SARIMAX(z, order=(1, 0, 1), trend=None)
    model.ssm.tolerance = 0.0  # else its gains are held once they hardly change
    wanted = model.loglike([0.8, 0.4, 0.5**2])
    np.testing.assert_allclose(float(log_density(z, GRID, ARMA11(0.5, 0.8, 0.4))), wanted, rtol=1e-9)
    terms = np.asarray(innovation_terms(z, GRID, ARMA11(0.5, 0.8, 0.4)))
    np.testing.assert_allclose(terms[~np.isnan(z)], model.loglikeobs([0.8, 0.4, 0.25])[~np.isnan(z)], atol=1e-9)


def test_student_innovations_are_a_naive_product():
    z, (scale, tau, nu) = with_gaps(N), (0.6, 1.5, 4.0)
    last, when, total = 0.0, -np.inf, 0.0
    for value, t in zip(z, UNEVEN, strict=True):
        if np.isfinite(value):
            keep = np.exp(-(t - when) / tau)
            total += scipy.stats.t.logpdf(value, nu, keep * last, scale * np.sqrt(1.0 - keep**2))
            last, when = value, t
    np.testing.assert_allclose(float(log_density(z, UNEVEN, StudentT(scale, tau, nu))), total, rtol=1e-10)


def test_many_degrees_of_freedom_are_normal():
    z = with_gaps(N)
    wanted = float(log_density(z, UNEVEN, OU(0.6, 1.5)))
    np.testing.assert_allclose(float(log_density(z, UNEVEN, StudentT(0.6, 1.5, 1e9))), wanted, rtol=1e-5)


def test_an_outlier_costs_student_less():
    z = np.zeros(N)
    z[30] = 8.0
    loss = [
        float(log_density(0.0 * z, GRID, r) - log_density(z, GRID, r)) for r in (OU(0.3, 1.0), StudentT(0.3, 1.0, 4.0))
    ]
    assert 0.0 < loss[1] < 0.1 * loss[0]


def test_rungs_hold_the_ones_below():
    z, keep, tau = with_gaps(N), 0.85, -0.1 / np.log(0.85)
    ar1 = float(log_density(z, GRID, AR1(0.7, keep)))
    for other in (
        AR1White(0.7, keep, 0.0),
        OU(0.7, tau),
        ARMA11(0.7 * np.sqrt(1.0 - keep**2), keep, 0.0),
        VectorAR1(np.array([[0.7 * np.sqrt(1.0 - keep**2)]]), np.array([keep])),
    ):
        np.testing.assert_allclose(float(log_density(z, GRID, other)), ar1, rtol=1e-10)
    white = float(log_density(z, GRID, White(0.7)))
    np.testing.assert_allclose(float(log_density(z, GRID, AR1(0.7, 0.0))), white, rtol=1e-12)


def test_the_rung_of_the_fit_is_ar1_and_white():
    z = with_gaps((N, 2))
    noise = Noise(np.array([0.1, 0.3]), np.array([0.5, 0.2]), np.array([1.0, 3.0]))
    here = jnp.asarray(np.isfinite(z))
    wanted = uniform_log_density(noise, 0.1, here, jnp.asarray(np.nan_to_num(z)))
    rung = AR1White(noise.correlated, np.exp(-0.1 / noise.time_constant), noise.white)
    np.testing.assert_allclose(float(log_density(z, GRID, rung)), float(wanted), rtol=1e-11)


def test_terms_are_the_density_of_a_sample_given_earlier_ones():
    z = with_gaps(N)
    for rung, time in ((GAUSSIAN["arma"], GRID), (GAUSSIAN["ou+white"], UNEVEN), (StudentT(0.6, 1.5, 4.0), UNEVEN)):
        terms = np.asarray(innovation_terms(z, time, rung))
        assert (terms[np.isnan(z)] == 0.0).all() and terms.shape == (N,)
        for k in (10, 24, 40):
            cut = np.where(np.arange(N) < k, z, np.nan)  # the same shape, the rest missing
            np.testing.assert_allclose(terms[:k].sum(), float(log_density(cut, time, rung)), rtol=1e-10, atol=1e-12)


EDGES = {
    "white, tiny": White(1e-9),
    "ar1, none": AR1(0.7, 0.0),
    "ar1, all but one": AR1(0.7, 1.0 - 1e-12),
    "ar1, all but minus one": AR1(0.7, -1.0 + 1e-12),
    "no white": AR1White(0.7, 0.9, 0.0),
    "hardly anything but white": AR1White(1e-9, 0.9, 0.3),
    "drift and no white": AR1White(0.7, 1.0 - 1e-12, 0.0),
    "arma, none": ARMA11(0.5, 0.0, 0.0),
    "arma, all but one": ARMA11(0.5, 1.0 - 1e-12, 0.4),
    "arma, moving at one": ARMA11(0.5, 0.8, -1.0),
    "ou, quick": OU(0.7, 1e-9),
    "ou, slow": OU(0.7, 1e12, 0.0),
    "student, quick": StudentT(0.6, 1e-9, 4.0),
    "student, slow": StudentT(0.6, 1e12, 4.0),
    "student, Cauchy": StudentT(0.6, 1.5, 1.0),
    "vector, edges": VectorAR1(ROOT, np.array([0.0, 1.0 - 1e-12, -1.0 + 1e-12])),
    "vector, nearly one series": VectorAR1(np.array([[0.3, 0, 0], [0.3, 1e-8, 0], [0.3, 0, 1e-8]]), PHI),
}
_gradient = jax.jit(jax.value_and_grad(log_density, argnums=(0, 2)))


@pytest.mark.parametrize("name", list(EDGES))
def test_gradients_are_finite_at_the_edges(name):
    rung = jax.tree.map(lambda a: jnp.asarray(a, float), EDGES[name])
    z = with_gaps((N, 3) if isinstance(rung, VectorAR1) else N)
    value, (by_residual, by_rung) = _gradient(z, UNEVEN, rung)
    assert np.isfinite(float(value))
    assert np.isfinite(np.asarray(by_residual)[np.isfinite(z)]).all()
    assert all(np.isfinite(np.asarray(leaf)).all() for leaf in jax.tree.leaves(by_rung))


@pytest.mark.parametrize("name", ["ar1+white", "arma", "ou+white", "student", "vector"])
def test_gradients_are_those_of_differences(name):
    rung = {"student": StudentT(0.6, 1.5, 4.0), "vector": VectorAR1(ROOT, PHI)}.get(name) or GAUSSIAN[name]
    rung = jax.tree.map(lambda a: jnp.asarray(a, float), rung)
    z = with_gaps((N, 3) if name == "vector" else N)
    _, (_, made) = _gradient(z, UNEVEN, rung)
    leaves, tree = jax.tree.flatten(rung)
    for i, leaf in enumerate(leaves):
        for at in np.ndindex(leaf.shape):
            if name == "vector" and i == 0 and at[1] > at[0]:
                continue  # beyond the lower triangle
            values = [
                float(log_density(z, UNEVEN, tree.unflatten([*leaves[:i], leaf.at[at].add(h), *leaves[i + 1 :]])))
                for h in (1e-5, -1e-5)
            ]
            wanted = (values[0] - values[1]) / 2e-5
            np.testing.assert_allclose(np.asarray(jax.tree.leaves(made)[i])[at], wanted, rtol=1e-5, atol=1e-4)


def test_a_numpyro_model_takes_a_rung():
    z = with_gaps(N)

    def model():
        sd = numpyro.sample("sd", numpyro.distributions.LogNormal(0.0, 1.0))
        numpyro.factor("noise", log_density(z, UNEVEN, OU(sd, 1.3)))

    given = {"sd": jnp.asarray(0.7)}
    made, _ = numpyro_log_density(model, (), {}, given)
    prior = float(numpyro.distributions.LogNormal(0.0, 1.0).log_prob(0.7))
    np.testing.assert_allclose(float(made), prior + float(log_density(z, UNEVEN, OU(0.7, 1.3))), rtol=1e-6)
