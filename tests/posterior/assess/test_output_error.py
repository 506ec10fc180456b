"""Output error on the linear flight: bounds against dense matrices, and against what replicates scatter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.likelihood.disturbances import Latent
from bayeschute.likelihood.joint import FlightData, NoiseParameters
from bayeschute.likelihood.noise import Noise
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior import joint_mode as optimum
from bayeschute.posterior.assess import output_error
from bayeschute.posterior.assess.output_error import bounds, gaussian_draws, table

NONE = Latent((), (), 2)
SAMPLES, DT = 400, 0.2
WIDE = [Prior("one", 0.5, 50.0, False, "1", ""), Prior("two", 0.0, 50.0, False, "1", "")]
THETA = np.array([0.7, -0.4])
WHITE = NoiseParameters(Noise(np.array([0.2, 0.3]), np.full(2, 1e-6), np.ones(2)), ())


@pytest.fixture(scope="module")
def empty(linear):
    """The linear flight, longer and without disturbances."""
    model = replace(linear.flight.model, drive=np.sin(0.4 * np.arange(SAMPLES)))
    nothing = np.zeros((SAMPLES, 2))
    return FlightData(model, nothing, nothing == 0.0, DT, np.array([0.5, 0.4]), (1, 0), NONE)


def fitted(flight):
    return optimum.fit([flight], WHITE, WIDE, THETA)


def dense_design(linear, flight):
    """Residual at zero, Jacobian by (theta, standard start) of the present data, output after output; and their sd."""
    y, zero, by = linear.matrices.model(flight)
    sd = np.concatenate([np.full(int(flight.present[:, i].sum()), WHITE.noise.white[c]) for i, c in enumerate((1, 0))])
    return y - zero, by[:, :4], sd


def test_the_optimum_and_raw_bound_are_weighted_least_squares(linear, empty):
    flight, _ = linear.simulate(empty, WHITE, THETA, 1)
    found = bounds([flight], WHITE, WIDE, best := fitted(flight))
    y, by, sd = dense_design(linear, flight)
    precision = np.diag([1 / 50.0**2, 1 / 50.0**2, 1.0, 1.0])
    matrix = (by / sd[:, None] ** 2).T @ by + precision
    mean = np.linalg.solve(matrix, (by / sd[:, None] ** 2).T @ y + precision @ [0.5, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(best.theta, mean[:2], atol=1e-8)
    np.testing.assert_allclose(found.theta, best.theta)
    np.testing.assert_allclose(found.raw, np.linalg.inv(matrix)[:2, :2], rtol=1e-8)
    np.testing.assert_allclose(best.covariance, found.raw, rtol=1e-6)


def test_corrected_bound_is_the_sandwich_of_dense_matrices(linear, empty):
    """With the parameters fixed by hand the middle is S' R^-1 V R^-1 S, V from the tapered autocovariance."""
    colored = NoiseParameters(Noise(np.full(2, 1e-6), np.array([0.2, 0.3]), np.array([1.0, 2.0])), ())
    flight, _ = linear.simulate(empty, colored, THETA, 2, gaps=0.0)
    flight = replace(flight, present=np.ones_like(flight.present))
    best = fitted(flight)
    made = bounds([flight], WHITE, WIDE, best)
    y, by, sd = dense_design(linear, flight)
    point = np.concatenate([best.theta, best.unknowns[0].start])
    e = ((y - by @ point) / sd).reshape(2, SAMPLES)
    lags = SAMPLES // 10
    u = np.arange(1, lags + 1) / (lags + 1)
    window = np.concatenate([[1.0], np.where(u <= 0.5, 1 - 6 * u**2 + 6 * u**3, 2 * (1 - u) ** 3)])
    v = np.zeros((2 * SAMPLES, 2 * SAMPLES))
    for i in range(2):
        for j in range(2):
            for t in range(SAMPLES):
                for s in range(max(0, t - lags), min(SAMPLES, t + lags + 1)):
                    k = s - t
                    both = e[i, : SAMPLES - k] @ e[j, k:] if k >= 0 else e[i, -k:] @ e[j, : SAMPLES + k]
                    v[i * SAMPLES + t, j * SAMPLES + s] = window[abs(k)] * both / SAMPLES
    x = by / sd[:, None]
    precision = np.diag([1 / 50.0**2, 1 / 50.0**2, 1.0, 1.0])
    inverse = np.linalg.inv(x.T @ x + precision)
    wanted = (inverse @ (x.T @ v @ x + precision) @ inverse)[:2, :2]
    ratio = np.sqrt(np.diag(made.corrected) / np.diag(wanted))
    # the product puts back what fitting took out of the residuals, which the plain formula does not
    assert ((ratio > 0.97) & (ratio < 1.25)).all(), ratio
    assert made.memory[0] > 3.0


def test_corrected_errors_are_those_of_replicates_and_raw_ones_are_not(linear, empty):
    colored = NoiseParameters(Noise(np.full(2, 1e-6), np.array([0.2, 0.3]), np.array([1.5, 1.5])), ())
    z = []
    for seed in range(40):
        flight, _ = linear.simulate(empty, colored, THETA, 100 + seed)
        made = bounds([flight], WHITE, WIDE, fitted(flight))
        z.append([(made.theta - THETA) / np.sqrt(np.diag(c)) for c in (made.raw, made.corrected)])
    raw, corrected = np.sqrt(np.mean(np.square(z), axis=0))
    assert (corrected > 0.7).all() and (corrected < 1.35).all(), corrected
    assert (raw > 1.6 * corrected).any(), (raw, corrected)


def test_white_residuals_leave_the_bound_alone(linear, empty):
    ratios = []
    for seed in range(8):
        flight, _ = linear.simulate(empty, WHITE, THETA, 200 + seed)
        made = bounds([flight], WHITE, WIDE, fitted(flight))
        ratios.append(np.sqrt(np.diag(made.corrected) / np.diag(made.raw)))
    np.testing.assert_allclose(np.mean(ratios, axis=0), 1.0, atol=0.15)


def test_sensitivities_that_grow_beyond_half_of_the_digits_leave_bounds(linear, empty, monkeypatch):
    """As those of a record that diverges do: of other parameters that mix the same two, the same bounds."""
    flight, _ = linear.simulate(empty, WHITE, THETA, 5)
    free = [replace(p, scale=1e14) for p in WIDE]
    best, mixed = fitted(flight), np.eye(4)
    turns = [np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]) for a in (0.6, 0.3)]
    mixed[:2, :2] = turns[0] @ np.diag([1e11, 1.0]) @ turns[1]
    plain = bounds([flight], WHITE, free, best)
    seen = output_error._sensitivities
    monkeypatch.setattr(output_error, "_sensitivities", lambda *given: seen(*given) @ mixed)
    made, back = bounds([flight], WHITE, free, best), np.linalg.inv(mixed[:2, :2])
    sd = np.sqrt(np.diag(made.raw))
    for found, wanted in ((made.raw, plain.raw), (made.corrected, plain.corrected)):
        np.testing.assert_allclose(found / np.outer(sd, sd), back @ wanted @ back.T / np.outer(sd, sd), atol=2e-3)
    drawn = gaussian_draws(made, made.theta, np.diag(sd), 4, 5000, np.random.default_rng(0))
    want = np.sqrt(np.diag(made.corrected)) / sd
    np.testing.assert_allclose(drawn.xi.reshape(-1, 2).std(axis=0), want, rtol=0.05)


def test_a_prior_that_knows_everything_is_the_answer(linear, empty):
    flight, _ = linear.simulate(empty, WHITE, THETA, 5)
    sure = [replace(p, centre=c, scale=1e-7) for p, c in zip(WIDE, THETA, strict=True)]
    best = optimum.fit([flight], WHITE, sure, THETA)
    made = bounds([flight], WHITE, sure, best)
    np.testing.assert_allclose(np.sqrt(np.diag(made.corrected)), 1e-7, rtol=1e-3)


def test_two_flights_are_better_than_one(linear, empty):
    flights = [linear.simulate(empty, WHITE, THETA, seed)[0] for seed in (6, 7)]
    best = optimum.fit(flights, WHITE, WIDE, THETA)
    both = bounds(flights, WHITE, WIDE, best)
    one = bounds(flights[:1], WHITE, WIDE, fitted(flights[0]))
    np.testing.assert_allclose(np.diag(both.raw) / np.diag(one.raw), 0.5, atol=0.1)
    assert len(both.memory) == 2


def test_latent_disturbances_are_refused(linear):
    best = optimum.fit([linear.flight], linear.hyper, linear.priors, linear.theta)
    with pytest.raises(InputError, match="latent disturbances"):
        bounds([linear.flight], linear.hyper, linear.priors, best)


def test_the_table_is_in_the_parameters_units(linear, empty):
    flight, _ = linear.simulate(empty, WHITE, THETA, 8)
    made = bounds([flight], WHITE, WIDE, fitted(flight))
    rows = table(made, [replace(WIDE[0], logarithmic=True, unit="kg"), WIDE[1]])
    assert [r.parameter for r in rows] == ["one", "two"] and rows[0].unit == "kg"
    np.testing.assert_allclose(rows[0].estimate, np.exp(made.theta[0]))
    np.testing.assert_allclose(rows[0].raw_sd, np.exp(made.theta[0]) * np.sqrt(made.raw[0, 0]))
    np.testing.assert_allclose(rows[1].corrected_sd, np.sqrt(made.corrected[1, 1]))


def test_standard_errors_below_the_rounding_of_an_estimate_are_not_known(linear, empty):
    flight, _ = linear.simulate(empty, WHITE, THETA, 8)
    made = bounds([flight], WHITE, WIDE, fitted(flight))
    tiny = np.diag([1e-14 / np.sqrt(made.raw[0, 0]), 1.0])
    one, two = table(made._replace(raw_factor=tiny @ made.raw_factor), WIDE)
    assert np.isnan(one.raw_sd) and one.estimate == made.theta[0]
    np.testing.assert_allclose([one.corrected_sd, two.raw_sd], np.sqrt([made.corrected[0, 0], made.raw[1, 1]]))


def test_draws_have_the_corrected_moments(linear, empty):
    flight, _ = linear.simulate(empty, WHITE, THETA, 9)
    made = bounds([flight], WHITE, WIDE, fitted(flight))
    centre, scale = made.theta + 0.01, np.linalg.cholesky(made.raw)
    drawn = gaussian_draws(made, centre, scale, 4, 5000, np.random.default_rng(0))
    theta = (centre + drawn.xi @ scale.T).reshape(-1, 2)
    sd = np.sqrt(np.diag(made.corrected))
    np.testing.assert_allclose((theta.mean(axis=0) - made.theta) / sd, 0.0, atol=0.03)
    np.testing.assert_allclose(np.cov(theta.T) / np.outer(sd, sd), made.corrected / np.outer(sd, sd), atol=0.05)
    assert drawn.log_density.shape == (4, 5000) and drawn.evaluations == 0
