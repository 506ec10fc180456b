"""The extended filter against dense matrices, and two formulations on one record of an unstable pendulum."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.dynamics.parameters import Canopies
from bayeschute.likelihood import extended_kalman
from bayeschute.likelihood.disturbances import Latent
from bayeschute.likelihood.joint import FlightData, NoiseParameters
from bayeschute.likelihood.noise import Noise
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior import joint_mode as optimum
from bayeschute.reduced.dumbbell import Dumbbell, DumbbellFlight, DumbbellInputs
from bayeschute.reduced.planar import PlanarAero

GUSTS = Latent(("drift",), ((0, 0), (1, 0)))
NAMES = ("C_A0", "alpha_0", "C_Nalpha", "C_Nalphadot")
TRUTH = np.array([0.927, 0.189, 0.1901, -0.988])


@pytest.fixture(scope="module")
def swinging(linear):
    """90 s of a dumbbell with the report's coefficients under gusts, at 5 Hz."""
    samples, dt = 451, 0.2
    canopies = Canopies(*(float(x) for x in (980.0, 35.3, 10.0, 130.0, 10000.0)))
    body = Dumbbell(9500.0, 88.0, canopies)
    aero = PlanarAero(0.927, -0.329, 0.189, 0.1901, -0.988)
    record = DumbbellInputs(np.zeros((samples, 2)), np.full(samples, 1.05))
    start = np.array([0.0, 0.0, 0.0, 10.0, 0.3, 0.0])
    model = DumbbellFlight(body, aero, start, record, dt, NAMES, ("swing_angle", "air_velocity"))
    nothing = np.zeros((samples, 3))
    scale = np.array([0.02, 0.02, 0.5, 0.5])
    empty = FlightData(model, nothing, nothing == 0.0, dt, scale, (0, 1, 1), GUSTS)
    noise = Noise(np.array([0.003, 0.06]), np.array([0.004, 0.1]), np.array([2.0, 2.0]))
    hyper = NoiseParameters(noise, (np.array([0.4, 5.0]),))
    flight, u = linear.simulate(empty, hyper, TRUTH, 5)
    priors = [Prior(n, c, s, False, "1", "") for n, c, s in zip(NAMES, 1.1 * TRUTH, (0.3, 0.1, 0.1, 1.0), strict=True)]
    return SimpleNamespace(flight=flight, u=u, hyper=hyper, priors=priors)


def test_a_linear_flights_filter_is_exact(linear):
    for theta in (linear.theta, np.zeros(2)):
        wanted = linear.matrices.given_theta(linear.flight, linear.hyper, theta)
        got = float(extended_kalman.log_density(linear.flight, linear.hyper, jnp.asarray(theta)))
        np.testing.assert_allclose(got, wanted, rtol=1e-9)


def test_what_is_missing_adds_nothing(linear):
    made = extended_kalman.extended_filter(linear.flight, linear.hyper, jnp.asarray(linear.theta))
    assert (np.asarray(made.innovations)[~linear.flight.present] == 0.0).all()
    assert (np.asarray(made.terms)[10:14] == 0.0).all()  # a gap in all outputs
    spoiled = replace(linear.flight, observed=np.where(linear.flight.present, linear.flight.observed, 1e6))
    again = extended_kalman.extended_filter(spoiled, linear.hyper, jnp.asarray(linear.theta))
    np.testing.assert_array_equal(made.terms, again.terms)


def test_a_linear_flights_estimate_is_that_of_dense_matrices(linear):
    mean, covariance = linear.matrices.posterior(linear.flight, linear.hyper, linear.priors)
    made = extended_kalman.fit([linear.flight], linear.hyper, linear.priors, linear.theta)
    sd = np.sqrt(np.diag(covariance)[:2])
    assert made.converged
    np.testing.assert_allclose((made.theta - mean[:2]) / sd, 0.0, atol=1e-3)
    np.testing.assert_allclose(made.covariance / np.outer(sd, sd), covariance[:2, :2] / np.outer(sd, sd), atol=1e-3)


def test_innovations_of_a_swinging_flight_are_standard(swinging):
    made = extended_kalman.extended_filter(swinging.flight, swinging.hyper, jnp.asarray(TRUTH))
    unit = np.asarray(made.innovations)[swinging.flight.present]
    assert abs(unit.std() - 1.0) < 0.1 and abs(unit.mean()) < 0.1
    lag = np.asarray(made.innovations)[:, 0]
    assert abs(np.corrcoef(lag[:-1], lag[1:])[0, 1]) < 0.15


@pytest.mark.slow
def test_two_formulations_agree_within_their_intervals(swinging):
    """Latent wind and filter error, from the same start 10 % off."""
    start = np.array([p.centre for p in swinging.priors])
    single = optimum.fit([swinging.flight], swinging.hyper, swinging.priors, start)
    filtered = extended_kalman.fit([swinging.flight], swinging.hyper, swinging.priors, start)
    assert single.converged and filtered.converged
    sd, other = np.sqrt(np.diag(single.covariance)), np.sqrt(np.diag(filtered.covariance))
    assert (np.abs(filtered.theta - single.theta) < 1.645 * sd).all(), ((filtered.theta - single.theta) / sd, sd)
    assert ((other / sd > 0.6) & (other / sd < 1.6)).all(), other / sd
    assert (np.abs(filtered.theta - TRUTH) < 3.5 * other).all()
