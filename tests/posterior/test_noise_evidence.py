"""The evidence against dense marginal likelihoods; noise parameters recovered."""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np
import pytest
from scipy.special import digamma

from bayeschute.likelihood.joint import NoiseParameters, latent_path_of, linearise
from bayeschute.likelihood.kalman import MeanCorrection
from bayeschute.likelihood.noise import Noise
from bayeschute.posterior import noise_evidence
from bayeschute.posterior.noise_evidence import NoisePrior

LOG_SD = 0.7


def _linearised(flight, hyper, theta, u):
    return linearise(flight, theta, latent_path_of(flight, hyper, u))


@pytest.fixture(scope="module")
def objective(linear):
    """Minus the log evidence and log prior, and its gradient, linearised at any theta."""

    def at(theta):
        lin = _linearised(linear.flight, linear.hyper, theta, linear.u)
        return noise_evidence.function_of([linear.flight], [lin], linear.priors, NoisePrior(linear.hyper, LOG_SD))

    return at


@pytest.fixture(scope="module")
def points(linear):
    middle = noise_evidence.to_vector(linear.hyper)
    return [middle, middle + 0.4 * np.random.default_rng(0).standard_normal(middle.size)]


def _dense(linear, vector, middle):
    """Log evidence and log prior by dense matrices, and the posterior of theta."""
    hyper = jax.tree.map(np.asarray, noise_evidence.from_vector(vector, linear.hyper))
    mean, covariance = linear.matrices.posterior(linear.flight, hyper, linear.priors)
    value = linear.matrices.evidence(linear.flight, hyper, linear.priors)
    return value - 0.5 * np.sum(((vector - middle) / LOG_SD) ** 2), mean[:2], covariance[:2, :2]


def test_vectors_are_invertible(linear):
    vector = noise_evidence.to_vector(linear.hyper)
    there = noise_evidence.from_vector(vector, jax.tree.map(lambda a: 2.0 * a, linear.hyper))
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-12), there, linear.hyper)
    np.testing.assert_allclose(
        np.exp(vector[-5:]), np.concatenate(linear.hyper.disturbance_parameters)
    )  # `noise_parameter_draws` relies on it
    np.testing.assert_allclose(np.exp(vector[:2]), linear.hyper.noise.white)


def test_differences_are_those_of_dense_marginal_likelihoods(linear, objective, points):
    """Held at one theta, the evidence misses the square of its distance from the posterior mean, and nothing else."""
    for theta in (linear.theta, np.array([0.2, 0.3])):
        ours, wanted = [], []
        for vector in points:
            value, mean, covariance = _dense(linear, vector, points[0])
            ours.append(objective(theta)(vector)[0])
            wanted.append(0.5 * (theta - mean) @ np.linalg.solve(covariance, theta - mean) - value)
        assert ours[1] - ours[0] == pytest.approx(wanted[1] - wanted[0], abs=1e-7)
        assert abs(wanted[1] - wanted[0]) > 1.0


def test_slope_at_an_optimum_is_the_dense_one(linear, objective, points):
    """What is left out vanishes with its slope where theta is the posterior mean."""
    at, step = points[1], 1e-4
    theta = _dense(linear, at, points[0])[1]

    def minus(vector):
        hyper = jax.tree.map(np.asarray, noise_evidence.from_vector(vector, linear.hyper))
        prior = 0.5 * np.sum(((vector - points[0]) / LOG_SD) ** 2)
        return prior - linear.matrices.evidence(linear.flight, hyper, linear.priors)

    wanted = [(minus(at + step * e) - minus(at - step * e)) / (2.0 * step) for e in np.eye(at.size)]
    np.testing.assert_allclose(objective(theta)(at)[1], wanted, rtol=1e-4, atol=1e-4)


def test_gradient_by_differences(linear, objective, points):
    value, at, step = objective(linear.theta), points[1], 1e-5
    wanted = [(value(at + step * e)[0] - value(at - step * e)[0]) / (2.0 * step) for e in np.eye(at.size)]
    np.testing.assert_allclose(value(at)[1], wanted, rtol=1e-5, atol=1e-5)


def test_several_flights_add_up(descent):
    prior = NoisePrior(descent.hyper, LOG_SD)
    lin = [_linearised(f, descent.hyper, descent.theta, u) for f, u in zip(descent.flights, descent.u, strict=True)]
    vector = noise_evidence.to_vector(descent.hyper) + 0.2
    far = [replace(descent.priors[0], scale=1e-6)]  # theta known: no shared term

    def value(which):
        flights = [descent.flights[i] for i in which]
        return noise_evidence.function_of(flights, [lin[i] for i in which], far, prior)(vector)[0]

    # The prior of the noise parameters and of theta are counted once.
    counted = 0.5 * np.sum((0.2 / LOG_SD) ** 2 * np.ones(vector.size)) - np.log(1e-6)
    assert value([0, 1]) - counted == pytest.approx(value([0]) + value([1]) - 2.0 * counted, rel=1e-6)


def test_maximise_recovers_the_noise(descent):
    flights, u = zip(
        *(descent.simulate(descent.flights[0], descent.hyper, descent.theta, s, gaps=0.05) for s in (11, 12)),
        strict=True,
    )
    off = NoiseParameters(Noise(np.array([0.15]), np.array([0.04]), np.array([4.0])), (np.array([1.0, 6.0]),))
    lin = [_linearised(f, descent.hyper, descent.theta, x) for f, x in zip(flights, u, strict=True)]
    prior = NoisePrior(off, 1.0)
    evidence = noise_evidence.function_of(flights, lin, descent.priors, prior)
    best, value = noise_evidence.maximise(evidence, off, prior)
    made, true = noise_evidence.to_vector(best), noise_evidence.to_vector(descent.hyper)
    # 190 samples tell white noise and the wind error; drift of the sensor, beside that of the wind, they don't.
    se = np.sqrt(
        np.diag(noise_evidence.noise_parameter_covariance(evidence, best, prior, np.zeros((1, 5)), np.zeros((1, 1))))
    )
    assert (np.abs(made - true) < 3.0 * se).all()
    assert (se[[0, 3, 4]] < [0.2, 0.3, 0.6]).all() and (np.abs(made - true)[[0, 3, 4]] < [0.35, 0.5, 1.0]).all()
    again, _ = noise_evidence.maximise(evidence, descent.hyper, prior)
    np.testing.assert_allclose(noise_evidence.to_vector(again), made, atol=0.15)
    assert value == pytest.approx(evidence(made)[0]) and value < evidence(true)[0]
    assert np.abs(evidence(made)[1]).max() < 0.1


def test_a_drift_lasts_no_longer_than_it_may(descent):
    """Drifts that last twenty times as long as the median says, sought with and without the limit."""
    flight, u = descent.simulate(descent.flights[0], descent.hyper, descent.theta, 11)
    lin = [_linearised(flight, descent.hyper, descent.theta, u)]
    (law,) = descent.hyper.disturbance_parameters
    brief = replace(descent.hyper, disturbance_parameters=(np.array([law[0], law[1] / 20.0]),))
    free, held = NoisePrior(brief, 1.0), NoisePrior(brief, 1.0, longest=((0, 0.075 * law[1]),))
    (low, high), (least, most) = free.limits(), held.limits()
    np.testing.assert_array_equal(low, least)
    assert most[-1] == pytest.approx(np.log(0.075 * law[1])) and (most[:-1] == high[:-1]).all()
    evidence = noise_evidence.function_of([flight], lin, descent.priors, free)
    found = [noise_evidence.maximise(evidence, brief, prior)[0].disturbance_parameters[0] for prior in (free, held)]
    assert found[0][1] > 3.0 * law[1] / 20.0 and found[1][1] == pytest.approx(0.075 * law[1])


def test_maximise_recovers_an_oscillator(linear):
    truth = NoiseParameters(linear.hyper.noise, (np.array([0.2, 2.5]), np.array([0.9, 0.35, 0.1])))
    drawn = [linear.simulate(linear.flight, truth, linear.theta, seed) for seed in (21, 22, 23)]
    flights, lin = [f for f, _ in drawn], [_linearised(f, truth, linear.theta, u) for f, u in drawn]
    off = NoiseParameters(linear.hyper.noise, (np.array([0.4, 2.5]), np.array([0.5, 0.6, 0.3])))
    prior = NoisePrior(off, 0.7)
    best, _ = noise_evidence.maximise(noise_evidence.function_of(flights, lin, linear.priors, prior), off, prior)
    sd, frequency, zeta = best.disturbance_parameters[1]
    assert frequency == pytest.approx(0.35, rel=0.1)  # 36 s, a dozen periods
    assert sd == pytest.approx(0.9, rel=0.4) and 0.03 < zeta < 0.3


def test_law_covariance_is_the_inverse_curvature_and_never_wider_than_the_prior(linear):
    lin = [_linearised(linear.flight, linear.hyper, linear.theta, linear.u)]
    prior = NoisePrior(linear.hyper, LOG_SD)
    evidence = noise_evidence.function_of([linear.flight], lin, linear.priors, prior)
    best = noise_evidence.maximise(evidence, linear.hyper, prior)[0]
    made = noise_evidence.noise_parameter_covariance(evidence, best, prior, np.zeros((2, 11)), np.zeros((2, 2)))
    assert made.shape == (11, 11)
    np.testing.assert_allclose(made, made.T, atol=1e-12)
    values, vectors = np.linalg.eigh(made)
    assert values.min() > 0.0 and values.max() <= LOG_SD**2 + 1e-12
    at, h = noise_evidence.to_vector(best), 0.05
    middle, told = evidence(at)[0], values < 0.8 * LOG_SD**2
    assert told.sum() >= 4
    for value, way in zip(values[told], vectors.T[told], strict=True):
        curvature = (evidence(at + h * way)[0] - 2.0 * middle + evidence(at - h * way)[0]) / h**2
        assert value == pytest.approx(1.0 / curvature, rel=0.05)
    # Parameters that follow the noise parameters take their part off the curvature.
    follow = 0.5 * np.outer([1.0, 0.0], vectors[:, 0]) / np.sqrt(values[0])
    freed = noise_evidence.noise_parameter_covariance(evidence, best, prior, follow, np.zeros((2, 2)))
    assert vectors[:, 0] @ freed @ vectors[:, 0] == pytest.approx(values[0] / 0.75, rel=1e-6)


def test_law_a_parameter_that_follows_noise_parameters_is_no_less_certain_than_by_its_prior(monkeypatch):
    """A Gaussian: the exact covariance where its curvature is right, and the prior's bound where rounding has spoiled it."""
    rng = np.random.default_rng(7)
    prior_sd = np.array([0.4, 5.0])
    data = rng.standard_normal((6, 5))
    data[:, 0] *= 10.0  # the data tell the first parameter for held noise parameters, and else its sum with those
    data[:, 2:] += 3.0 * data[:, :1]
    joint = data.T @ data + np.diag([*prior_sd**-2.0, *np.full(3, LOG_SD**-2.0)])
    scale = np.linalg.inv(np.linalg.cholesky(joint[:2, :2])).T
    slope = -scale.T @ joint[:2, 2:]
    before = scale.T @ np.diag(prior_sd**-2.0) @ scale
    monkeypatch.setattr(noise_evidence, "to_vector", lambda hyper: hyper)
    prior = NoisePrior(None, LOG_SD)

    def spread(curvature):
        evidence, _ = _quadratic(curvature)
        made = noise_evidence.noise_parameter_covariance(evidence, np.zeros(3), prior, slope, before)
        return made, np.sqrt(np.diag(scale @ (np.eye(2) + slope @ made @ slope.T) @ scale.T))

    made, sd = spread(joint[2:, 2:])
    np.testing.assert_allclose(made, np.linalg.inv(joint)[2:, 2:], rtol=1e-6)
    np.testing.assert_allclose(sd, np.sqrt(np.diag(np.linalg.inv(joint))[:2]), rtol=1e-6)
    _, spoiled = spread(slope.T @ slope)
    assert sd[0] < spoiled[0] <= prior_sd[0] * (1.0 + 1e-9)
    free = slope @ (LOG_SD**2 * np.eye(3)) @ slope.T  # what the prior of the noise parameters alone allows
    assert np.sqrt((scale @ (np.eye(2) + free) @ scale.T)[0, 0]) > 1.1 * prior_sd[0]


def _quadratic(curvature):
    """Minus a Gaussian log evidence about zero, and a list that gets a row for each time it is asked."""
    asked = []

    def evidence(x):
        asked.append(x)
        return 0.5 * float(x @ curvature @ x), curvature @ x

    return evidence, asked


def test_law_scales_are_the_widths_of_a_gaussian_along_the_axes_and_no_wider_than_the_prior(monkeypatch):
    curvature = np.array([[4e4, 30.0, 0.0], [30.0, 4.0, 1e-3], [0.0, 1e-3, 1e-4]])
    monkeypatch.setattr(noise_evidence, "to_vector", lambda hyper: hyper)
    evidence, _ = _quadratic(curvature)
    made = noise_evidence.scales(evidence, np.array([0.1, -0.2, 0.3]), NoisePrior(None, LOG_SD))
    np.testing.assert_allclose(made, [0.005, 0.5, LOG_SD], rtol=1e-6)


def test_noise_parameters_known_unequally_well_are_found_in_few_steps():
    """As a record knows a sensor's noise by thousands of samples and a correlation time by a few."""
    rng = np.random.default_rng(4)
    size, mixed = np.logspace(4.5, 0.0, 20), np.linalg.qr(np.eye(20) + 0.01 * rng.standard_normal((20, 20)))[0]
    evidence, asked = _quadratic(mixed @ np.diag(size) @ mixed.T)
    none = np.zeros(0)
    prior, start = (
        NoiseParameters(Noise(np.exp(x), none, none), ()) for x in (np.zeros(20), rng.uniform(0.5, 1.0, 20))
    )
    prior = NoisePrior(prior, 2.0)
    _, value = noise_evidence.maximise(evidence, start, prior)
    assert value < 0.01
    assert len(asked) < 21 + 50
    _, far = noise_evidence.maximise(evidence, start, prior, most=40, scale=np.ones(20))
    assert far > 10.0 * value


def test_an_evidence_that_is_not_finite_is_refused(linear):
    lin = _linearised(linear.flight, linear.hyper, linear.theta, linear.u)
    spoiled = lin._replace(residual=np.full_like(lin.residual, np.nan))
    prior = NoisePrior(linear.hyper)
    with pytest.raises(FloatingPointError, match="not finite"):
        noise_evidence.maximise(
            noise_evidence.function_of([linear.flight], [spoiled], linear.priors, prior), linear.hyper, prior
        )


def test_a_gap_shifts_what_the_linear_model_sees(linear):
    """Outputs by themselves, and by the response to what it adds to every step."""
    lin, prior = [_linearised(linear.flight, linear.hyper, linear.theta, linear.u)], NoisePrior(linear.hyper, LOG_SD)
    at, pushes = noise_evidence.to_vector(linear.hyper), 0.05 * np.random.default_rng(6).standard_normal((60, 2))
    gap, states = MeanCorrection(np.full(np.shape(linear.flight.observed), 0.1), pushes), [pushes[0]]
    for push in pushes[1:]:
        states.append(np.array([[0.95, 0.2], [-0.2, 0.9]]) @ states[-1] + push)
    response = np.array(states) @ np.array([[1.0, 0.0], [0.5, 1.0]])
    moved = replace(linear.flight, observed=np.asarray(linear.flight.observed) - gap.outputs - response)
    other = [_linearised(moved, linear.hyper, linear.theta, linear.u)]
    ours = noise_evidence.function_of([linear.flight], lin, linear.priors, prior, [gap])(at)
    wanted = noise_evidence.function_of([moved], other, linear.priors, prior)(at)
    assert ours[0] == pytest.approx(wanted[0], rel=1e-12)
    np.testing.assert_allclose(ours[1], wanted[1], rtol=1e-9)


def test_the_mean_of_skewed_noise_parameters(monkeypatch):
    """Logarithms of two standard deviations that some numbers tell: known in closed form, in turned axes."""
    n, turn = np.array([6.0, 40.0]), np.array([[0.8, -0.6], [0.6, 0.8]])
    at = np.array([0.3, -1.0])

    def evidence(x):
        """About the mode `at`: n eta + n/2 exp(-2 eta) along every axis."""
        eta = turn.T @ (x - at)
        return float(n @ eta + 0.5 * n @ np.exp(-2.0 * eta)), turn @ (n - n * np.exp(-2.0 * eta))

    monkeypatch.setattr(noise_evidence, "to_vector", lambda hyper: hyper)
    covariance = turn @ np.diag(1.0 / (2.0 * n)) @ turn.T
    moved = turn.T @ noise_evidence.mean_less_mode(evidence, at, covariance)
    np.testing.assert_allclose(moved, 0.5 * (np.log(n / 2.0) - digamma(n / 2.0)), rtol=0.15)
    # A Gaussian has none; axes that are known well are left alone; and nothing moves by more than its width.
    gaussian = noise_evidence.mean_less_mode(lambda x: (0.0, np.linalg.solve(covariance, x - at)), at, covariance)
    np.testing.assert_allclose(gaussian, 0.0, atol=1e-12)
    moved = turn.T @ noise_evidence.mean_less_mode(
        lambda x: (0.0, turn @ (turn.T @ (x - at)) ** 2 * 1e3), at, turn @ np.diag([0.04, 0.0025]) @ turn.T
    )
    np.testing.assert_allclose(moved, [-0.2, 0.0], atol=1e-12)


def test_axes_at_whose_ends_the_evidence_is_not_finite_are_left_out(monkeypatch):
    def evidence(x):
        """Skewed along both axes; not finite to one side of the second."""
        return (1e300, np.zeros(2)) if x[1] < -0.1 else (0.0, x + 0.5 * x**2)

    monkeypatch.setattr(noise_evidence, "to_vector", lambda hyper: hyper)
    moved = noise_evidence.mean_less_mode(evidence, np.zeros(2), np.diag([0.09, 0.16]))
    np.testing.assert_allclose(moved, [-0.5 * 0.09 * 0.09, 0.0], atol=1e-12)


def test_an_oscillator_stays_one_near_its_frequency():
    """Far from a light oscillation near its frequency a process is another one; others are as free as before."""
    noise = Noise(*(np.array([0.1, 0.3, 2.0]) for _ in range(3)))
    processes = (np.array([0.5, 5.0]), np.array([0.02, 0.25, 0.1]), np.array([0.3, 20.0]))
    median = NoiseParameters(noise, processes)
    middle, (low, high) = noise_evidence.to_vector(median), NoisePrior(median, 0.7).limits()
    wide = np.full(len(middle), 5.0 * 0.7)
    oscillator = slice(9 + 2, 9 + 5)
    expected = wide.copy()
    expected[oscillator] = [3.5, np.log(2.0), np.log(3.0)]
    np.testing.assert_allclose(high - middle, expected, rtol=1e-12)
    expected[oscillator] = [3.5, np.log(2.0), 3.5]
    np.testing.assert_allclose(middle - low, expected, rtol=1e-12)
    damped = replace(median, disturbance_parameters=(np.array([0.02, 0.25, 0.4]),))
    assert np.exp(NoisePrior(damped).limits()[1][-1]) == pytest.approx(0.8)


def test_no_oscillator_is_sought_as_a_slow_force(linear):
    """An evidence that falls towards a heavily damped oscillation ends at the limit."""
    median = replace(linear.hyper, disturbance_parameters=(np.array([0.02, 0.25, 0.1]),))
    size = len(noise_evidence.to_vector(median))

    def evidence(vector):
        return -float(vector[-1]), -np.eye(size)[-1]

    best, _ = noise_evidence.maximise(evidence, median, NoisePrior(median), scale=np.ones(size))
    np.testing.assert_allclose(best.disturbance_parameters[0], [0.02, 0.25, 0.3], rtol=1e-6)
