"""Drawn disturbances against loops of one landing and process, and against the laws that they are drawn from."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from bayeschute.landing.latent_draws import latent_rows, without_wind
from bayeschute.likelihood.disturbances import Latent

# wind north and down of one drift and down of another; a canopy's force by a drift and by an oscillator
LATENT = Latent(("drift", "drift", "oscillator", "drift"), ((0, 0), (2, 0), (2, 1), (4, 3), (4, 2), (5, 2)), least=6)
DT = 0.2


def _laws(count: int) -> list[np.ndarray]:
    rng = np.random.default_rng(1)
    drift = [np.stack([rng.uniform(0.5, 2.0, count), rng.uniform(0.5, 5.0, count)]) for _ in range(3)]
    swing = np.stack([rng.uniform(0.1, 0.3, count), rng.uniform(0.1, 0.6, count), rng.uniform(0.05, 0.4, count)])
    return [drift[0], drift[1], swing, drift[2]]


def _drift(sd, tau, z):
    made = [sd * z[0]]
    for x in z[1:]:
        made.append(np.exp(-DT / tau) * made[-1] + sd * np.sqrt(1.0 - np.exp(-2.0 * DT / tau)) * x)
    return np.array(made)


def _oscillator(sd, frequency, zeta, z):
    omega = 2.0 * np.pi * frequency
    step = expm(DT * omega * np.array([[0.0, 1.0], [-1.0, -2.0 * zeta]]))
    root = np.linalg.cholesky(np.eye(2) - step @ step.T)
    state, made = z[0], [z[0, 0]]
    for x in z[1:]:
        state = step @ state + root @ x
        made.append(state[0])
    return sd * np.array(made)


def test_every_landing_and_process_is_that_of_a_loop():
    laws, z = _laws(3), np.random.default_rng(2).standard_normal((40, LATENT.size, 3))
    made = latent_rows(LATENT, laws, DT, z, 9)
    assert made.shape == (40, 9, 3) and LATENT.size == 8
    for b in range(3):
        of = [law[:, b] for law in laws]
        wanted = np.zeros((40, 9))
        wanted[:, 0] = _drift(*of[0], z[:, 0, b])
        wanted[:, 2] = _drift(*of[0], z[:, 1, b]) + _drift(*of[1], z[:, 2, b])
        wanted[:, 4] = _drift(*of[3], z[:, 3, b]) + _oscillator(*of[2], z[:, 4:6, b])
        wanted[:, 5] = _oscillator(*of[2], z[:, 6:8, b])
        np.testing.assert_allclose(made[:, :, b], wanted, atol=1e-6)


def test_at_least_as_many_rows_as_the_model_says():
    assert latent_rows(LATENT, _laws(1), DT, np.zeros((3, 8, 1)), 2).shape == (3, 6, 1)
    nothing = latent_rows(Latent((), (), 0), [], DT, np.zeros((3, 0, 2)), 4)
    assert nothing.shape == (3, 4, 2) and not nothing.any()


@pytest.mark.parametrize("kind", ["drift", "oscillator"])
def test_they_are_stationary_with_the_correlation_of_their_law(kind):
    sd, frequency, zeta, tau, many = 2.0, 0.3, 0.2, 1.5, 20_000
    latent = Latent((kind,), ((0, 0),))
    law = np.array([[sd], [tau]] if kind == "drift" else [[sd], [frequency], [zeta]]) * np.ones(many)
    z = np.random.default_rng(3).standard_normal((9, latent.size, many))
    made = latent_rows(latent, [law], DT, z, 1)[:, 0]
    np.testing.assert_allclose(made.std(axis=1), sd, rtol=0.02)
    lag = DT * np.arange(9)
    omega, damped = 2.0 * np.pi * frequency, 2.0 * np.pi * frequency * np.sqrt(1.0 - zeta**2)
    wanted = np.exp(-lag / tau)
    if kind == "oscillator":  # of the position of an oscillator driven by white noise
        wanted = np.exp(-zeta * omega * lag) * (np.cos(damped * lag) + zeta * omega / damped * np.sin(damped * lag))
    np.testing.assert_allclose((made[0] * made).mean(axis=1) / sd**2, wanted, atol=0.03)


def test_the_winds_of_a_campaign_take_the_place_of_those_of_the_posterior():
    left = without_wind(LATENT)
    assert left.processes == ((4, 3), (4, 2), (5, 2)) and left.kinds == LATENT.kinds and left.least == 6
    laws, z = _laws(2), np.random.default_rng(4).standard_normal((20, 8, 2))
    whole, rest = latent_rows(LATENT, laws, DT, z, 6), latent_rows(left, laws, DT, z[:, 3:], 6)
    np.testing.assert_allclose(rest[:, 3:], whole[:, 3:])
    assert not rest[:, :3].any() and whole[:, [0, 2]].all()
