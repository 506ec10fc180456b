"""Fits joined equal the joint hierarchical posterior, on Gaussian data whose every answer is a matrix."""

from __future__ import annotations

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from bayeschute.posterior.combine import hierarchy
from bayeschute.posterior.combine.hierarchy import Likelihood, fit, joint, likelihood_of, others

CENTRE, SCALE = np.array([0.5, -0.3, 1.0, 0.2]), np.array([0.8, 0.5, 1.2, 0.6])
VARY = (2, 0)  # in an order of their own
SHARED = (1, 3)
DROPS = 5
SIZES = (DROPS, DROPS)
PLACES = [[0, 1, 2 + d, 2 + DROPS + d] for d in range(DROPS)]  # shared, then the members of each population
ORDER = [*SHARED, *VARY]
SPREAD = np.array([1.0, 0.7])
KNOWN = CENTRE[ORDER], SCALE[ORDER], SPREAD


@pytest.fixture(scope="module")
def case():
    """Five drops, each seen through a matrix of its own with noise, and the fit of each drop alone."""
    rng = np.random.default_rng(3)
    shared, mean, sd = np.array([-0.1, 0.6]), np.array([1.4, 0.9]), np.array([0.5, 0.3])
    by, seen, noise, likelihoods = [], [], 0.4, []
    prior = np.diag(1.0 / SCALE**2)
    for _ in range(DROPS):
        x = np.empty(4)
        x[list(SHARED)], x[list(VARY)] = shared, mean + sd * rng.standard_normal(2)
        a = rng.standard_normal((7, 4)) + np.array([0.0, 0.8, 0.8, 0.0])  # the second and third are confounded
        y = a @ x + noise * rng.standard_normal(7)
        covariance = np.linalg.inv(prior + a.T @ a / noise**2)
        posterior = covariance @ (prior @ CENTRE + a.T @ y / noise**2)
        likelihoods.append(likelihood_of(posterior, covariance, CENTRE, SCALE))
        by.append(a)
        seen.append(y)
    told = joint([Likelihood(one.precision[np.ix_(ORDER, ORDER)], one.shift[ORDER]) for one in likelihoods], PLACES, 12)
    law = jax.tree.map(jnp.asarray, hierarchy._Population(told, *KNOWN, np.repeat([0, 1], DROPS)))
    return SimpleNamespace(likelihoods=likelihoods, told=told, law=law, by=by, seen=np.concatenate(seen), noise=noise)


def _dense(case, sd):
    """Log density of all data given the populations' sd, and the law of (shared, means, members), by dense matrices."""
    size = 2 + 2 + 2 * DROPS
    prior = np.diag([*SCALE[list(SHARED)] ** 2, *SCALE[list(VARY)] ** 2, *np.repeat(sd**2, DROPS)])
    lift = np.eye(size)  # members are their means plus what is their own
    lift[4:, 2:4] = np.repeat(np.eye(2), DROPS, axis=0)
    mean, prior = (
        lift @ np.array([*CENTRE[list(SHARED)], *CENTRE[list(VARY)], *[0.0] * 2 * DROPS]),
        lift @ prior @ lift.T,
    )
    whole = np.zeros((7 * DROPS, size))
    for d, a in enumerate(case.by):
        whole[7 * d : 7 * d + 7, :2] = a[:, list(SHARED)]
        whole[7 * d : 7 * d + 7, [4 + d, 4 + DROPS + d]] = a[:, list(VARY)]
    total = whole @ prior @ whole.T + case.noise**2 * np.eye(len(whole))
    off = case.seen - whole @ mean
    gain = np.linalg.solve(total, whole @ prior).T
    log = -0.5 * off @ np.linalg.solve(total, off) - 0.5 * np.linalg.slogdet(total)[1]
    return log, mean + gain @ off, prior - gain @ whole @ prior


@pytest.fixture(scope="module")
def grid(case):
    """The joint posterior by quadrature over the two standard deviations: weights, values, dense laws."""
    u = np.exp(np.linspace(-5.0, 1.5, 60))
    points = np.array([(a, b) for a in u for b in u])
    laws = [_dense(case, SPREAD * p) for p in points]
    log = np.array([law[0] for law in laws]) - 0.5 * np.sum(points**2, axis=1) + np.log(points).sum(axis=1)
    weight = np.exp(log - log.max())
    return weight / weight.sum(), points * SPREAD, laws


def test_a_prior_is_taken_out_again(case):
    """What is left is the likelihood of the drop's data alone."""
    for one, a, y in zip(case.likelihoods, case.by, case.seen.reshape(DROPS, 7), strict=True):
        np.testing.assert_allclose(one.precision, a.T @ a / case.noise**2, atol=1e-9)
        np.testing.assert_allclose(one.shift, a.T @ y / case.noise**2, atol=1e-9)


def test_a_posterior_no_narrower_than_its_prior_tells_nothing():
    made = likelihood_of(CENTRE + 0.1, np.diag((1.01 * SCALE) ** 2), CENTRE, SCALE)
    assert np.abs(made.precision).max() < 1e-9 and np.abs(made.shift).max() < 1e-9


def test_the_density_of_the_spread_is_that_of_all_data_at_once(case):
    points = np.array([[0.3, 0.4], [1.0, 0.1], [0.02, 2.0], [0.001, 0.5], [1e-9, 1e-9]])
    made = np.array([float(hierarchy._given(case.law, jnp.asarray(p))[2]) for p in points])
    wanted = np.array([_dense(case, p)[0] for p in points])
    np.testing.assert_allclose(made - made[0], wanted - wanted[0], atol=1e-9)


def test_the_law_given_the_spread_is_that_of_all_data_at_once(case):
    """Draws given one spread: moments of shared parameters, means and members together."""
    sd, count = np.array([0.5, 0.3]), 40_000
    z = np.random.default_rng(0).standard_normal((count, 4 + 2 * DROPS))
    made = np.asarray(jax.vmap(hierarchy._draw, (None, None, 0))(case.law, jnp.asarray(sd), z))
    _, mean, covariance = _dense(case, sd)
    width = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((made.mean(axis=0) - mean) / width, 0.0, atol=0.03)
    np.testing.assert_allclose(np.cov(made.T) / np.outer(width, width), covariance / np.outer(width, width), atol=0.03)


def test_draws_are_those_of_the_joint_hierarchical_posterior(case, grid):
    made = fit(case.told, SIZES, *KNOWN, 2, 200, 800, seed=1)
    assert made.shared.shape == made.mean.shape == made.sd.shape == (2, 800, 2) and made.failed == 0
    assert made.members.shape == (2, 800, 2 * DROPS)
    weight, spread, laws = grid
    drawn = np.concatenate([made.shared, made.mean, made.members], axis=2).reshape(1600, -1)
    means, variances = np.array([law[1] for law in laws]), np.array([np.diag(law[2]) for law in laws])
    mean = weight @ means
    width = np.sqrt(weight @ (variances + (means - mean) ** 2))
    np.testing.assert_allclose((drawn.mean(axis=0) - mean) / width, 0.0, atol=0.15)
    np.testing.assert_allclose(drawn.std(axis=0) / width, 1.0, atol=0.12)
    sd = weight @ spread
    away = np.sqrt(weight @ (spread - sd) ** 2)
    np.testing.assert_allclose((made.sd.reshape(-1, 2).mean(axis=0) - sd) / away, 0.0, atol=0.15)
    another = others(made, (1, 0, 1), np.random.default_rng(2)).reshape(-1, 3)
    wanted = np.sqrt(width[2:4] ** 2 + weight @ spread**2)[[1, 0, 1]]
    np.testing.assert_allclose(another.std(axis=0) / wanted, 1.0, atol=0.15)
    alike = (weight @ variances[:, 3] + weight @ (means[:, 3] - mean[3]) ** 2) / wanted[0] ** 2
    assert np.corrcoef(another[:, 0], another[:, 2])[0, 1] == pytest.approx(alike, abs=0.15)


def test_half_normal_numbers_are_those():
    standard = stats.norm.ppf(np.linspace(1e-6, 1.0 - 1e-6, 101))
    wanted = stats.halfnorm.ppf(stats.norm.cdf(standard))
    np.testing.assert_allclose(hierarchy.half_normal(standard), wanted, rtol=1e-9)


def test_without_shared_parameters_it_is_the_random_effects_model():
    """One parameter: the members integrated out one by one, their mean on a grid."""
    mean, sd = np.array([0.2, 1.1, 0.6]), np.array([0.3, 0.2, 0.25])
    told = Likelihood(np.diag(sd**-2), mean / sd**2)
    law = hierarchy._Population(told, np.array([0.4]), np.array([0.9]), np.array([0.9]), np.zeros(3, dtype=int))

    def two_stage(x):
        mu = np.linspace(-8.0, 8.0, 201)[:, None]
        wide = np.hypot(sd, 0.9 * stats.halfnorm.ppf(stats.norm.cdf(x)))
        rows = stats.norm.logpdf(mean, mu, wide).sum(axis=1) + stats.norm.logpdf(mu[:, 0], 0.4, 0.9)
        return np.log(np.sum(np.exp(rows))) + stats.norm.logpdf(x)

    at = (-2.0, -0.5, 0.3)
    made = np.array([float(hierarchy._log_density(law, jnp.array([x]))) for x in at])
    wanted = np.array([two_stage(x) for x in at])
    np.testing.assert_allclose(made - made[0], wanted - wanted[0], atol=1e-6)


def test_marginals_of_each_drop_alone_are_not_enough(case, grid):
    """With shared parameters the two-stage population is another law: its mean is a good deal less well known."""
    weight, _, laws = grid
    means, variances = np.array([law[1][2] for law in laws]), np.array([law[2][2, 2] for law in laws])
    together = np.sqrt(weight @ (variances + (means - weight @ means) ** 2))
    told = []
    for one in case.likelihoods:
        covariance = np.linalg.inv(one.precision + np.diag(1.0 / SCALE**2))
        posterior = covariance @ (one.shift + CENTRE / SCALE**2)
        told.append(likelihood_of(posterior[[2]], covariance[2:3, 2:3], CENTRE[[2]], SCALE[[2]]))
    bodies = joint(told, [[d] for d in range(DROPS)], DROPS)
    alone = fit(bodies, [DROPS], CENTRE[[2]], SCALE[[2]], SCALE[[2]], 2, 200, 500, seed=1)
    assert alone.mean.std() > 1.1 * together


@pytest.mark.parametrize("sizes", [(), (DROPS, 0), (DROPS,), (DROPS, DROPS, 2), (1,) * 12])
def test_populations_have_members_that_are_told(case, sizes):
    with pytest.raises(ValueError, match="members of each"):
        fit(case.told, sizes, *KNOWN, 2, 50, 50, seed=1)


def test_a_known_population_of_bodies_is_recovered():
    rng = np.random.default_rng(0)
    true_mean, true_sd, bodies = -1.5, 0.25, 60
    sd = rng.uniform(0.05, 0.3, bodies)
    seen = true_mean + true_sd * rng.standard_normal(bodies) + sd * rng.standard_normal(bodies)
    told = Likelihood(np.diag(sd**-2), seen / sd**2)
    made = fit(told, [bodies], np.array([-1.0]), np.array([1.0]), np.array([1.0]), 2, 300, 400, seed=1)
    assert made.mean.shape == made.sd.shape == (2, 400, 1) and made.diverging.shape == (2, 400)
    assert made.mean.mean() == pytest.approx(true_mean, abs=0.15)
    assert made.sd.mean() == pytest.approx(true_sd, abs=0.1)
    # Weak priors and many bodies: the spread of the mean is that of weighted averaging.
    weighted = np.sum(1.0 / (true_sd**2 + sd**2)) ** -0.5
    assert made.mean.std() == pytest.approx(weighted, rel=0.3)
    # Against the exact posterior on a grid.
    mu, spread = np.linspace(-2.2, -0.8, 141)[:, None, None], np.linspace(0.005, 0.8, 160)[None, :, None]
    variance = sd**2 + spread**2
    log_p = -0.5 * np.sum((seen - mu) ** 2 / variance + np.log(variance), axis=2)
    log_p = log_p - 0.5 * (mu[..., 0] + 1.0) ** 2 - 0.5 * spread[..., 0] ** 2
    p = np.exp(log_p - log_p.max())
    p /= p.sum()
    assert made.mean.mean() == pytest.approx(float(np.sum(p * mu[..., 0])), abs=0.01)
    assert made.sd.mean() == pytest.approx(float(np.sum(p * spread[..., 0])), abs=0.012)


@pytest.mark.parametrize(("bodies", "warmup"), [(2, 100), (2, 300), (3, 300), (6, 300)])
def test_few_bodies_leave_no_neck_in_which_nuts_diverges(bodies, warmup):
    """The mean integrated out and the spread in a coordinate without a long tail; known values far apart or as one."""
    for seed, apart in ((1, 0.0), (2, 0.3), (3, 2.0)):
        told = Likelihood(np.eye(bodies) * 50.0**2, 50.0**2 * apart * np.arange(bodies))
        made = fit(told, [bodies], np.zeros(1), np.ones(1), np.ones(1), 4, warmup, 500, seed=seed)
        assert made.diverging.mean() < 0.005
