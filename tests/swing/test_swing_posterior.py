"""The density of a swing's parameters against dense Gaussian algebra."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm
from tests.twins import damped_swing as twin

from bayeschute.swing import swing_posterior
from bayeschute.swing.oscillator import free_response
from bayeschute.swing.swing_posterior import SwingProblem, solve

BASE = twin.Swing(frequency=0.9, damping_ratio=0.04, forcing=0.4, colored=0.3, tau=0.8, white=0.1, samples=48)
OTHER = replace(BASE, frequency=0.95, damping_ratio=-0.01, forcing=0.25, colored=0.4, tau=0.5, white=0.15)


def row(swing):
    omega = 2.0 * np.pi * swing.frequency
    b = swing.damping_ratio * omega
    noise = np.log([swing.forcing, swing.colored, swing.tau, swing.white])
    return np.r_[0.5 * np.log(omega**2 - b**2), b, noise]


@pytest.fixture(scope="module")
def problem():
    rng = np.random.default_rng(1)
    data = twin.make(BASE, rng) + 3.0
    data[[5, 6, 20]] = np.nan
    return SwingProblem(data, rng.standard_normal((48, 2, 2)), BASE.dt, "rate", True, 0.9, (0.3, 2.0), 1.0)


def dense(problem, swing):
    """Log density without the prior, and the coefficients, from covariance matrices."""
    seen, psi = np.isfinite(problem.data[:, 0]), row(swing)[None]
    inverse = np.linalg.inv(twin.covariance(swing)[np.ix_(seen, seen)])
    wave = free_response(psi, np.arange(48) * problem.dt)[0][seen]
    zero, one = np.zeros_like(wave), np.ones((seen.sum(), 1))
    X = [
        np.hstack([wave, zero, one, 0 * one, problem.nuisance[seen, 0]]),
        np.hstack([zero, wave, 0 * one, one, problem.nuisance[seen, 1]]),
    ]
    G = sum(x.T @ inverse @ x for x in X) + np.diag([0.01] * 4 + [0.0] * 4)
    g = sum(x.T @ inverse @ problem.data[seen, c] for c, x in enumerate(X))
    square = sum(problem.data[seen, c] @ inverse @ problem.data[seen, c] for c in (0, 1)) - g @ np.linalg.solve(G, g)
    blocks = np.linalg.slogdet(G[:4, :4])[1] + np.linalg.slogdet(G[4:, 4:])[1]
    cost = -2.0 * np.linalg.slogdet(inverse)[1] + blocks + square
    return -0.5 * cost, np.linalg.solve(G, g)


def test_dense_gaussian(problem):
    rows = np.stack([row(BASE), row(OTHER)])
    made = solve(problem, rows)
    prior = swing_posterior._log_prior(problem, rows)
    for i, swing in enumerate((BASE, OTHER)):
        wanted, linear = dense(problem, swing)
        assert made.log_density[i] - prior[i] == pytest.approx(wanted, abs=0.05)
        np.testing.assert_allclose(made.linear[i], linear, atol=0.01)


def test_chunks_change_nothing(problem, monkeypatch):
    rows = np.stack([row(BASE), row(OTHER)] * 5)
    whole = solve(problem, rows)
    monkeypatch.setattr(swing_posterior, "_CHUNK", 1000)
    for a, b in zip(whole, solve(problem, rows), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12)


def test_what_cannot_be_computed_has_no_density(problem):
    bad = row(BASE)
    bad[1] = -1e6
    made = solve(problem, np.stack([row(BASE), bad]))
    assert np.isfinite(made.log_density[0]) and made.log_density[1] == -np.inf


def test_a_nuisance_that_repeats_the_swing_gains_nothing(problem):
    """Where the swing's columns equal nuisances the density must not rise: it is no place to find a mode."""
    t = np.arange(48) * problem.dt
    wave = np.stack([np.sin(2.0 * np.pi * 1.3 * t), np.cos(2.0 * np.pi * 1.3 * t)], axis=1)
    one = SwingProblem(problem.data[:, :1], wave[:, None], problem.dt, "rate", True, 0.9, (0.3, 2.0), 1.0)
    rows = np.stack([row(replace(BASE, frequency=f, damping_ratio=1e-9)) for f in np.linspace(1.2, 1.4, 21)])
    density = solve(one, rows).log_density
    assert density[10] < density[5] + 3.0


def test_the_prior_is_that_of_its_description(problem):
    """Parameter by parameter against scales that are written out here: above, the density's own prior is taken off."""

    def gained(place, values):
        rows = np.tile(row(BASE), (len(values) + 1, 1))
        rows[1:, place] = values
        made = swing_posterior._log_prior(problem, rows)
        return made[1:] - made[0]

    start, size, f = row(BASE), problem.scale, problem.frequency
    logs = np.log([1e-7, 0.02, 0.3, 1.0, 40.0, 1e7])
    forced = 0.3 * size * np.sqrt(2.0 * f)
    for place, scale, density in (
        (2, forced, lambda s: s**2 / (1.0 + s**2) ** 2),  # of the standard deviation; rises as the square
        (3, 0.5 * size, lambda s: s / (1.0 + s**2) ** 1.5),  # flat in the variance
        (5, 0.1 * size, lambda s: s / (1.0 + s**2) ** 1.5),
    ):
        at, there = np.exp(logs) / scale, np.exp(start[place]) / scale
        wanted = np.log(at * density(at)) - np.log(there * density(there))
        np.testing.assert_allclose(gained(place, logs), wanted, rtol=1e-9, atol=1e-9)
    tau = norm(np.log(0.3 / f), 1.0)
    np.testing.assert_allclose(gained(4, logs), tau.logpdf(logs) - tau.logpdf(start[4]), rtol=1e-9, atol=1e-9)
    inside, twice = np.log(2.0 * np.pi * np.array([0.31, 1.2, 1.9])), np.log(2.0 * np.pi * np.array([0.15, 4.0]))
    np.testing.assert_allclose(gained(0, inside), 0.0, atol=1e-12)
    np.testing.assert_allclose(gained(0, twice), -0.5 * (np.log(2.0) / 0.05) ** 2, rtol=1e-9)


def test_the_prior_of_damping_is_the_energy_of_the_motion(problem):
    """It falls as 1/b, ends softly where b is the damped frequency, and growing swings get no more than a steady one."""
    long = replace(problem, data=np.zeros((40_000, 2)))
    omega = np.exp(row(BASE)[0])
    rows = np.tile(row(BASE), (6, 1))
    rows[:, 1] = omega * np.array([0.1, 0.2, 0.4, 1.1, -1e-6, -0.4])
    p = swing_posterior._log_prior(long, rows)
    np.testing.assert_allclose(np.diff(p[:3]), -np.log(2.0), rtol=1e-2)
    assert p[3] - p[2] == pytest.approx(-np.log(1.1 / 0.4) - 0.5 * (0.1 / 0.05) ** 2, rel=1e-2)
    assert p[4] < p[5] < p[4] + 1.0


def test_the_prior_of_damping_counts_the_energy_over_the_whole_record(problem):
    """Energy falls as exp(-2 b t): half a decay constant of the swing over the record is one of the energy."""
    record = problem.dt * len(problem.data)
    rows = np.tile(row(BASE), (2, 1))
    rows[:, 1] = [0.0, 0.5 / record]
    still, damped = swing_posterior._log_prior(problem, rows)
    assert damped - still == pytest.approx(np.log1p(np.log(2.0)) - np.log1p(np.log1p(np.e)), rel=1e-9)


def test_without_forcing_its_prior_says_nothing(problem):
    still = replace(problem, forcing=False)
    rows = np.tile(row(BASE), (2, 1))
    rows[1, 2] = swing_posterior.LEAST_FORCING
    assert np.diff(swing_posterior._log_prior(still, rows)) == 0.0
