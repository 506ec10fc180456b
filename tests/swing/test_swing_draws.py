"""Draws of a swing's posterior: the optimum is one, and draws agree with chains made otherwise."""

from dataclasses import replace

import numpy as np
import pytest
from tests.twins import damped_swing as twin

from bayeschute.swing import swing_draws
from bayeschute.swing.swing_draws import importance, optimum
from bayeschute.swing.swing_posterior import SwingProblem, solve

GUSTY = twin.Swing(forcing=0.09, colored=0.1, tau=1.5, white=0.005)
BAND = (0.5, 1.6)


def posed(data, swing, forcing=True):
    nothing = np.zeros((*data.shape, 0))
    return SwingProblem(data, nothing, swing.dt, swing.observed, forcing, 1.0, BAND, float(np.nanstd(data)))


def test_nothing_beside_the_optimum_is_more_likely():
    problem = posed(twin.make(GUSTY, np.random.default_rng(2)), GUSTY)
    at = optimum(problem)
    best = solve(problem, at.psi[None]).log_density[0]
    beside = (
        at.psi
        + np.random.default_rng(0).standard_normal((300, 6)) * problem.step * np.logspace(-1.5, 1.0, 300)[:, None]
    )
    assert solve(problem, beside).log_density.max() < best + 0.01


def test_the_search_starts_near_the_frequency_of_the_swing():
    """Which lies aside of the middle of the grid."""
    swing = twin.Swing(frequency=0.95)
    problem = posed(twin.make(swing, np.random.default_rng(5)), swing)
    assert np.exp(swing_draws._start(problem)[0]) / (2.0 * np.pi) == pytest.approx(0.95, abs=0.01)


def test_without_forcing_it_stays_out():
    problem = posed(twin.make(twin.Swing(), np.random.default_rng(2)), twin.Swing(), forcing=False)
    drawn = importance(problem, optimum(problem), np.random.default_rng(0))
    assert np.ptp(drawn.psi[:, 2]) == 0.0 and np.exp(drawn.psi[0, 2]) < 1e-15
    assert drawn.weight.sum() == 1.0 or abs(drawn.weight.sum() - 1.0) < 1e-12


def test_noise_without_a_swing_keeps_inside_the_band():
    """No mode at all: whatever is found, nothing runs away, and the damping says so."""
    rng = np.random.default_rng(3)
    problem = posed(rng.standard_normal((120, 1)), GUSTY)
    drawn = importance(problem, optimum(problem), rng)
    assert np.isfinite(drawn.weight).all()
    frequency = np.exp(drawn.psi[:, 0]) / (2.0 * np.pi)
    assert drawn.weight @ ((frequency > 0.4) & (frequency < 2.0)) > 0.999


def test_importance_draws_agree_with_a_long_random_walk():
    """Metropolis chains on the same density, made without the importance sampler."""
    swing = replace(GUSTY, samples=60)
    data = twin.make(swing, np.random.default_rng(4))
    problem = posed(data, swing)
    at = optimum(problem)
    drawn = importance(problem, at, np.random.default_rng(0), draws=800)
    rng, chains = np.random.default_rng(1), 96
    psi = drawn.psi[rng.choice(len(drawn.psi), chains, p=drawn.weight)] + 0.0
    root = np.linalg.cholesky(at.covariance) * problem.step[:, None]
    density, kept = solve(problem, psi).log_density, []
    for i in range(230):
        tried = psi + 0.8 * rng.standard_normal((chains, 6)) @ root.T
        new = solve(problem, tried).log_density
        accept = np.log(rng.random(chains)) < new - density
        psi, density = np.where(accept[:, None], tried, psi), np.where(accept, new, density)
        if i >= 30:
            kept.append(psi)
    walk = np.concatenate(kept)[:, :2]
    mean, second = drawn.weight @ drawn.psi[:, :2], drawn.weight @ drawn.psi[:, :2] ** 2
    sd = walk.std(axis=0)
    np.testing.assert_array_less(np.abs(mean - walk.mean(axis=0)), 0.15 * sd)
    np.testing.assert_allclose(np.sqrt(second - mean**2), sd, rtol=0.15)
