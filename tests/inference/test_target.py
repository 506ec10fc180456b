"""The joint density of data and unknowns against dense Gaussians, and its derivatives against differences."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.inference.map import conditional
from bayeschute.inference.statespace import innovations, response, smooth, smooth_driven
from bayeschute.inference.target import (
    Course,
    Unknowns,
    as_seen,
    cost,
    course,
    filter_gains,
    linearise,
    residuals,
    states,
)


@pytest.fixture(scope="module")
def line(linear):
    """The linear flight linearised beside its truth."""
    at = jax.tree.map(lambda a: 0.8 * a, linear.u)
    return linearise(linear.flight, linear.theta, course(linear.flight, linear.hyper, at)), at


@pytest.fixture(scope="module")
def bent(descent):
    """A descent linearised at its truth."""
    return linearise(descent.flights[0], descent.theta, course(descent.flights[0], descent.hyper, descent.u[0]))


def _dense(linear, u):
    """Unknowns as the matrices have them: start, then disturbances."""
    driven = course(linear.flight, linear.hyper, u)
    return np.concatenate([u.start, np.asarray(driven.error).ravel()])


def test_joint_density_is_the_dense_one(linear):
    """The cost is half the Mahalanobis square of the residuals and half the squares of the unknowns."""
    flight, u = linear.flight, linear.u
    y, zero, by = linear.matrices.model(flight)
    r, _, _ = linear.matrices.covariances(flight, linear.hyper, linear.priors)
    left = y - zero - by @ np.concatenate([linear.theta, _dense(linear, u)])
    wanted = 0.5 * (left @ np.linalg.solve(r, left) + np.sum(u.start**2) + np.sum(u.shocks**2))
    assert float(cost(flight, linear.hyper, linear.theta, u)) == pytest.approx(wanted, rel=1e-9)


def test_cost_keeps_batches(descent):
    flight, rng = descent.flights[0], np.random.default_rng(0)
    many = Unknowns(rng.standard_normal((1, 3)), rng.standard_normal((101, 1, 3)))
    theta = descent.theta[:, None] + np.array([[0.0, 0.1, -0.2]])
    made = cost(flight, descent.hyper, theta, many)
    assert made.shape == (3,)
    for b in range(3):
        one = cost(flight, descent.hyper, theta[:, b], Unknowns(many.start[:, b], many.shocks[..., b]))
        assert float(made[b]) == pytest.approx(float(one), rel=1e-12)


def test_course_scales_the_start_and_follows_the_processes(linear):
    flight, hyper = linear.flight, linear.hyper
    made = course(flight, hyper, Unknowns(jnp.ones(2), jnp.zeros((60, flight.latent.size))))
    np.testing.assert_allclose(made.start, flight.start_scale)
    np.testing.assert_array_equal(made.error, 0.0)
    batch = Unknowns(jnp.ones((2, 5)), jnp.ones((60, flight.latent.size, 5)))
    assert course(flight, hyper, batch).start.shape == (2, 5) and course(flight, hyper, batch).error.shape == (60, 2, 5)
    still = flight.still()
    assert float(jnp.sum(still.start**2) + jnp.sum(still.shocks**2)) == 0.0
    assert still.start.shape == (flight.starts,) and still.shocks.shape == (flight.samples, flight.latent.size)


def test_a_start_moves_the_first_state_by_its_scale(descent):
    flight = descent.flights[0]
    first = [
        np.asarray(states(flight, jnp.asarray(descent.theta), Course(jnp.array([2.0 * s]), jnp.zeros((101, 1)))))[0]
        for s in (0.0, 1.0)
    ]
    np.testing.assert_allclose(first[1] - first[0], [0.0, 2.0])


def _open_loop(lin):
    """Data about the undisturbed flight, and derivatives by theta: responses over the whole record (T, C, 1 + P)."""
    start, error, p = np.asarray(lin.driven.start), np.asarray(lin.driven.error), lin.steps.out_theta.shape[2]
    known = response(lin.steps, start[:, None], error[..., None], np.zeros((p, 1)))
    none = np.zeros((start.size, p)), np.zeros((*error.shape, p))
    return np.concatenate([lin.residual[..., None] + known, response(lin.steps, *none, np.eye(p))], axis=2)


def test_linearised_series_are_the_dense_ones(linear, line):
    """Data about the undisturbed flight, and derivatives by theta, wherever the flight was linearised."""
    y, zero, by = linear.matrices.model(linear.flight)
    stack, made = linear.matrices.dense.stack, _open_loop(line[0])
    here = linear.flight.present
    np.testing.assert_allclose(stack(made[..., 0], here), y - zero - by[:, :2] @ linear.theta, atol=1e-12)
    np.testing.assert_allclose(stack(made[..., 1:], here), by[:, :2], atol=1e-12)
    left = y - zero - by @ np.concatenate([linear.theta, _dense(linear, line[1])])
    np.testing.assert_allclose(stack(np.asarray(line[0].residual), here), left, atol=1e-12)
    assert (np.asarray(line[0].residual)[~here] == 0.0).all()


@pytest.mark.parametrize("which", ["line", "bent"])
def test_what_is_seen_step_by_step_tells_the_same_as_whole_responses(which, linear, descent, request):
    """Innovations, start and shocks: about the undisturbed flight, or of data and pushes about the disturbed one."""
    lin = request.getfixturevalue(which)
    lin = lin[0] if which == "line" else lin
    flight, hyper = (linear.flight, linear.hyper) if which == "line" else (descent.flights[0], descent.hyper)
    made, seen, whole = filter_gains(flight, hyper, lin), as_seen(lin), _open_loop(lin)
    assert seen.series.shape == whole.shape and seen.driven.shape == (*lin.steps.out_state.shape[::2], whole.shape[2])
    want = np.asarray(innovations(made, whole))
    close = {"rtol": 1e-9, "atol": 1e-9 * np.abs(want).max()}
    np.testing.assert_allclose(innovations(made, *seen), want, **close)
    got = smooth_driven(made, seen)
    for ours, theirs in zip(got[1:3], smooth(made, whole), strict=True):
        np.testing.assert_allclose(ours, theirs, **close)


def test_defects_drive_the_states_of_the_first_column_alone(line):
    steps, rng = line[0].steps, np.random.default_rng(5)
    plain, defects = as_seen(line[0]), rng.standard_normal(np.shape(as_seen(line[0]).driven)[:2])
    broken = as_seen(line[0], defects)
    np.testing.assert_allclose(broken.driven[..., 0] - plain.driven[..., 0], defects, atol=1e-14)
    np.testing.assert_array_equal(broken.driven[..., 1:], plain.driven[..., 1:])
    np.testing.assert_array_equal(broken.series, plain.series)
    np.testing.assert_array_equal(-plain.driven[0, :, 1:], steps.first_theta)


def test_response_of_the_linear_flight_is_the_dense_one(linear, line):
    size = 2 + 2 + 120
    eye = np.eye(size)
    scaled = linear.flight.start_scale[:, None] * eye[2:4]
    made = np.asarray(response(line[0].steps, scaled, eye[4:].reshape(60, 2, size), eye[:2]))
    _, _, by = linear.matrices.model(linear.flight)
    np.testing.assert_allclose(linear.matrices.dense.stack(made, linear.flight.present), by, atol=1e-12)


def test_filter_knows_the_dense_covariance(linear, line):
    _, _, by = linear.matrices.model(linear.flight)
    r, u, _ = linear.matrices.covariances(linear.flight, linear.hyper, linear.priors)
    wanted = 0.5 * np.linalg.slogdet(r + by[:, 2:] @ u @ by[:, 2:].T)[1]
    assert float(filter_gains(linear.flight, linear.hyper, line[0]).log_determinant) == pytest.approx(wanted, rel=1e-9)


def test_response_of_a_descent_against_differences(descent, bent):
    """Start, the parameter, and a disturbance at each of several samples, alone and together."""
    flight, h, rng = descent.flights[0], 1e-5, np.random.default_rng(0)
    start, theta, error = np.zeros((1, 8)), np.zeros((1, 8)), np.zeros((101, 1, 8))
    start[0, 0] = theta[0, 1] = 1.0
    for k, t in enumerate((0, 1, 40, 99, 100)):
        error[t, 0, 2 + k] = 1.0
    start[0, 7], theta[0, 7], error[..., 7] = rng.standard_normal(3)[0], 0.3, rng.standard_normal((101, 1))
    driven = course(flight, descent.hyper, descent.u[0])
    seen = []
    for sign in (1.0, -1.0):
        moved = Course(driven.start[:, None] + sign * h * start, driven.error[..., None] + sign * h * error)
        seen.append(np.asarray(residuals(flight, descent.theta[:, None] + sign * h * theta, moved)))
    wanted = (seen[1] - seen[0]) / (2.0 * h)  # residuals fall as outputs rise
    made = np.where(flight.present[..., None], response(bent.steps, start, error, theta), 0.0)
    np.testing.assert_allclose(made, wanted, atol=2e-8 * np.abs(wanted).max())
    assert (np.abs(wanted).max(axis=(0, 1)) > 1e-2).all()


def test_the_marginal_gradient_is_that_of_the_cost_at_the_conditional_optimum(descent):
    """The envelope theorem; and at that optimum the cost has no slope by the unknowns."""
    flight, hyper, u = descent.flights[0], descent.hyper, descent.u[0]
    for _ in range(6):
        given = conditional(flight, hyper, linearise(flight, descent.theta, course(flight, hyper, u)))
        u = given.optimum
    by_theta, by_u = jax.grad(cost, argnums=(2, 3))(flight, hyper, jnp.asarray(descent.theta), u)
    np.testing.assert_allclose(given.gradient, by_theta, rtol=1e-6)
    assert np.abs(by_theta).min() > 0.1
    for part in by_u:
        np.testing.assert_allclose(part, 0.0, atol=1e-6)


def test_residuals_of_the_truth_have_the_law_of_the_noise(descent):
    for flight, u in zip(descent.flights, descent.u, strict=True):
        s = cost(flight, descent.hyper, descent.theta, u)
        degrees = flight.present.sum() + u.start.size + u.shocks.size
        assert abs(2.0 * float(s) - degrees) < 4.0 * np.sqrt(2.0 * degrees)
