"""Draws of a linear flight's start, disturbances and states against dense Gaussians, where it is stable and where not."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.compiler.runge_kutta import Stepping
from bayeschute.likelihood import disturbances
from bayeschute.likelihood.joint import (
    LatentPath,
    NoiseParameters,
    as_seen,
    filter_gains,
    latent_path_of,
    linearise,
    states,
)
from bayeschute.likelihood.kalman import Seen, smooth_driven
from bayeschute.likelihood.noise import Noise
from bayeschute.likelihood.simulation_smoother import drawn, normals

GROWTH, PUSH, LONG = 1.3, 0.1, 200


def _made(flight, hyper, theta, driven):
    """A flight linearised along a course, its filter, and what it sees."""
    lin = linearise(flight, theta, driven)
    return lin, filter_gains(flight, hyper, lin), as_seen(lin).column(0)


def _wide(seen, count):
    return Seen(*(jnp.repeat(part, count, axis=2) for part in seen))


def _law(columns):
    """Mean and covariance of draws made of no number, then of each alone (N, 1 + K)."""
    root = columns[:, 1:] - columns[:, :1]
    return columns[:, 0], root @ root.T


@pytest.mark.parametrize("broken", [False, True])
def test_draws_have_the_dense_conditional_law_whatever_the_path(linear, each_number, broken):
    """Of start and process noise given parameters and data; and the states are those of a flight under these."""
    flight, hyper = linear.flight, linear.hyper
    driven = latent_path_of(flight, hyper, jax.tree.map(lambda a: 0.8 * a, linear.u))
    path = np.asarray(states(flight, linear.theta, driven))
    path = path + broken * np.random.default_rng(2).standard_normal(path.shape)
    _, made, seen = _made(flight, hyper, linear.theta, driven._replace(path=path))
    numbers = each_number(flight)
    count = numbers.start.shape[-1]
    got = drawn(flight, hyper, made, _wide(seen, count), numbers)
    y, zero, by = linear.matrices.model(flight)
    r, _, _ = linear.matrices.covariances(flight, hyper, linear.priors)
    each = jnp.eye(60 * 4).reshape(60, 4, -1)
    process_noise = np.asarray(disturbances.disturbances(hyper.dynamics(flight), each)).reshape(120, -1)
    by_z = np.concatenate([by[:, 2:4], by[:, 4:] @ process_noise], axis=1)
    gain = np.linalg.solve(r + by_z @ by_z.T, by_z).T
    mean, spread = _law(
        np.concatenate([got.unknowns.start, np.asarray(got.unknowns.process_noise).reshape(240, count)])
    )
    np.testing.assert_allclose(mean, gain @ (y - zero - by[:, :2] @ linear.theta), atol=1e-9)
    np.testing.assert_allclose(spread, np.eye(242) - gain @ by_z, atol=1e-9)
    theta = np.repeat(linear.theta[:, None], count, axis=1)
    flown = states(flight, theta, latent_path_of(flight, hyper, got.unknowns))
    np.testing.assert_allclose(path[..., None] + got.states, flown, atol=1e-9)


def test_draws_without_random_numbers_are_the_smoothed_flight(descent):
    flight, hyper = descent.flights[0], descent.hyper
    _, made, seen = _made(flight, hyper, descent.theta, latent_path_of(flight, hyper, descent.u[0]))
    still = jax.tree.map(np.zeros_like, normals(flight, 1, np.random.default_rng(0)))
    got, want = drawn(flight, hyper, made, seen, still), smooth_driven(made, seen)
    for ours, theirs in ((got.unknowns.start, want.start), (got.unknowns.process_noise, want.process_noise), (got.states, want.states)):  # fmt: skip
        np.testing.assert_allclose(ours, theirs, atol=1e-12 * np.abs(theirs).max())


def test_numbers_have_the_shapes_of_a_flight(linear):
    made = normals(linear.flight, 7, np.random.default_rng(0))
    assert [a.shape for a in made] == [(2, 7), (60, 4, 7), (60, 2, 7), (60, 2, 7)]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class GrowingFlight:
    """A linear flight that runs away from every path, by 22 powers of ten over the record."""

    drive: Any
    stepping: Stepping = field(default=Stepping(1), metadata={"static": True})

    def inputs(self):
        return self.drive

    def numbers(self, theta):
        return theta

    def initial(self, numbers, start):
        return start

    def advance(self, x, numbers, now, then, error_now, error_then):
        return GROWTH * x + PUSH * (error_now + error_then)

    def observe(self, x, numbers, now):
        return x


@pytest.fixture(scope="module")
def growing(descent):
    """Such a flight that its disturbances hold near a path, seen with gaps, and its noise parameters."""
    rng, nothing = np.random.default_rng(4), np.zeros((LONG, 1))
    hyper = NoiseParameters(Noise(*(np.array([x]) for x in (0.1, 0.1, 2.0))), (np.array([1.0, 0.4]),))
    path = 0.3 * np.sin(0.2 * np.arange(LONG))[:, None]
    present = rng.random((LONG, 1)) > 0.1
    present[50:54] = False
    observed = np.where(present, path + 0.1 * rng.standard_normal((LONG, 1)), 0.0)
    flight = replace(
        descent.flights[0], model=GrowingFlight(nothing[:, 0]), observed=observed, present=present, start_scale=np.array([0.5])
    )  # fmt: skip
    return flight, hyper, LatentPath(np.zeros(1), nothing, path)


def _held(flight, hyper, dense):
    """Mean and covariance of states and disturbances (2 T,) given the data, by the normal equations under constraints.

    States obey the equations of motion as constraints: no response over the record is asked for.
    """
    times, here = flight.dt * np.arange(LONG), flight.present[:, 0]
    noise = (np.asarray(a) for a in (hyper.noise.white, hyper.noise.correlated, hyper.noise.time_constant))
    seen = np.eye(2 * LONG)[:LONG][here]
    weighted = seen.T @ np.linalg.inv(dense.noise_covariance(times, flight.present, *noise))
    precision = weighted @ seen
    precision[0, 0] += flight.start_scale[0] ** -2
    precision[LONG:, LONG:] += np.linalg.inv(
        dense.disturbance_covariance(flight.latent, hyper.disturbance_parameters, times)
    )
    one, after = np.eye(LONG)[:-1], np.eye(LONG)[1:]
    obeyed = np.concatenate([after - GROWTH * one, -PUSH * (one + after)], axis=1)
    whole = np.block([[precision, obeyed.T], [obeyed, np.zeros((LONG - 1, LONG - 1))]])
    covariance = np.linalg.inv(whole)[: 2 * LONG, : 2 * LONG]
    return covariance @ weighted @ flight.observed[here, 0], covariance


def test_draws_of_an_unstable_flight_have_the_dense_conditional_law(growing, each_number, dense):
    flight, hyper, driven = growing
    _, made, seen = _made(flight, hyper, np.zeros(1), driven)
    numbers = each_number(flight)
    count = numbers.start.shape[-1]
    got = drawn(flight, hyper, made, _wide(seen, count), numbers)
    error = np.asarray(disturbances.disturbances(hyper.dynamics(flight), got.unknowns.process_noise))
    both = np.concatenate([driven.path[:, 0, None] + got.states[:, 0], error[:, 0]])
    (mean, spread), (wanted, law) = _law(both), _held(flight, hyper, dense)
    se = np.sqrt(np.diag(law))
    np.testing.assert_allclose((mean - wanted) / se, 0.0, atol=1e-6)
    np.testing.assert_allclose((spread - law) / np.outer(se, se), 0.0, atol=1e-6)


def test_draws_of_an_unstable_flight_stay_near_its_path(growing):
    """They are finite and centred on the smoother's means; the flight under their process noise, simulated, is not."""
    flight, hyper, driven = growing
    _, made, seen = _made(flight, hyper, np.zeros(1), driven)
    got, want = drawn(flight, hyper, made, _wide(seen, 500), normals(flight, 500, np.random.default_rng(1))), smooth_driven(made, seen)  # fmt: skip
    still = drawn(flight, hyper, made, seen, jax.tree.map(np.zeros_like, normals(flight, 1, np.random.default_rng(0))))
    np.testing.assert_allclose(still.states, want.states, atol=1e-9)
    np.testing.assert_allclose(still.unknowns.process_noise, want.process_noise, atol=1e-9)
    off = np.asarray(got.states) - np.asarray(want.states)
    assert np.isfinite(off).all() and np.abs(off).max() < 2.0
    assert np.abs(off.mean(axis=-1) / off.std(axis=-1)).max() < 5.0 / np.sqrt(500)
    simulated = states(flight, np.zeros((1, 500)), latent_path_of(flight, hyper, got.unknowns))
    assert np.abs(np.asarray(simulated)[-1]).max() > 1e3
    near = states(flight, np.zeros((1, 500)), latent_path_of(flight, hyper, got.unknowns))[:20]
    np.testing.assert_allclose(driven.path[:20, :, None] + got.states[:20], near, atol=1e-9)
