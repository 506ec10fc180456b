"""The filter of a forced swing in colored noise, against dense covariance matrices."""

from dataclasses import replace

import numpy as np
import pytest
from tests.twins import damped_swing as twin

from bayeschute.swing.oscillator import free_response, transition, whiten

SWING = twin.Swing(frequency=0.9, damping_ratio=0.04, forcing=0.7, colored=0.3, tau=0.8, white=0.1, samples=40)
CASES = [
    SWING,
    replace(SWING, observed="angle"),
    replace(SWING, damping_ratio=-0.05),
    replace(SWING, forcing=1e-9, white=0.01),
    replace(SWING, damping_ratio=0.6, observed="angle"),
]


def row(swing):
    omega = 2.0 * np.pi * swing.frequency
    b = swing.damping_ratio * omega
    noise = np.log([swing.forcing, swing.colored, swing.tau, swing.white])
    return np.r_[0.5 * np.log(omega**2 - b**2), b, noise][None]


@pytest.mark.parametrize("swing", CASES)
@pytest.mark.parametrize("gaps", [False, True])
def test_dense_covariance(swing, gaps):
    columns = np.random.default_rng(0).standard_normal((1, swing.samples, 3))
    seen = np.ones(swing.samples, bool)
    if gaps:
        seen[[0, 3, 4, 5, 20]] = False
        columns[0, ~seen, 0] = np.nan
    made = whiten(columns, row(swing), swing.dt, swing.observed)
    dense = twin.covariance(swing)[np.ix_(seen, seen)]
    X = columns[0, seen]
    np.testing.assert_allclose(made.log_determinant[0], np.linalg.slogdet(dense)[1], rtol=2e-4, atol=2e-3)
    white = made.columns[0][seen]
    np.testing.assert_allclose(white.T @ white, X.T @ np.linalg.solve(dense, X), rtol=3e-3, atol=0.02)
    assert (made.columns[0][~seen] == 0.0).all()


def test_parameter_sets_do_not_mix():
    rows = np.concatenate([row(s) for s in CASES[:1] + CASES[2:3]])
    columns = np.random.default_rng(0).standard_normal((1, 40, 2))
    both = whiten(columns, rows, SWING.dt)
    for i in range(2):
        alone = whiten(columns, rows[i : i + 1], SWING.dt)
        np.testing.assert_allclose(both.columns[i], alone.columns[0], atol=1e-12)
        np.testing.assert_allclose(both.log_determinant[i], alone.log_determinant[0])


def test_innovations_of_what_the_model_makes_are_white():
    square, lagged = [], []
    for seed in range(40):
        data = twin.make(replace(SWING, amplitude=(0.0,), samples=60), np.random.default_rng(seed))
        e = whiten(data[None], row(SWING), SWING.dt).columns[0, :, 0]
        square.append(np.mean(e**2))
        lagged.append(np.mean(e[1:] * e[:-1]))
    assert abs(np.mean(square) - 1.0) < 0.12
    assert abs(np.mean(lagged)) < 0.08


def test_free_response_follows_the_equation_of_motion():
    dt, b, omega = 1e-3, 0.2, 5.0
    x = free_response(np.array([[np.log(omega), b, 0, 0, 0, 0]]), np.arange(2000) * dt)[0]
    rate, acceleration = np.gradient(x, dt, axis=0), np.gradient(np.gradient(x, dt, axis=0), dt, axis=0)
    left = acceleration + 2.0 * b * rate + (omega**2 + b**2) * x  # 6.3.1-22
    assert np.abs(left[2:-2]).max() < 1e-3 * omega**2


def test_steps_compose():
    psi = row(SWING)
    one, added = transition(psi, 0.1)
    two, together = transition(psi, 0.2)
    np.testing.assert_allclose(one[0] @ one[0], two[0], atol=1e-12)
    np.testing.assert_allclose(one[0] @ added[0] @ one[0].T + added[0], together[0], atol=1e-12)
