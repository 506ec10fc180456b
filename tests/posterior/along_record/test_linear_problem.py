"""The linear problem along a path against single shooting, dense matrices and the closed form."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.posterior.along_record.conftest import broken_path

from bayeschute.compiler import compiled_model as kernel
from bayeschute.likelihood import joint
from bayeschute.likelihood.disturbances import disturbances
from bayeschute.likelihood.joint import Lifted, Unknowns, latent_path_of, linearise, states
from bayeschute.posterior import joint_mode as optimum
from bayeschute.posterior.along_record.lifted_fit import begin
from bayeschute.posterior.along_record.linear_problem import led, solve, terms


def _solved(flight, hyper, theta, at, slack):
    made = linearise(flight, theta, at.latent_path(flight))
    return made, solve(flight, hyper, np.asarray(slack), made)[0]


@pytest.mark.parametrize("which", ["linear", "descent", "drop"])
def test_along_its_own_simulation_a_flight_is_linearised_as_by_shooting(which, request, flown):
    case = request.getfixturevalue(which)
    flight = case.flights[0] if which == "descent" else case.flight
    rng = np.random.default_rng(1)
    process_noise = 0.3 * rng.standard_normal((flight.samples, flight.latent.size))
    u = Unknowns(0.5 * rng.standard_normal(flight.starts), process_noise)
    theta = np.asarray(case.theta)
    at = flown(flight, case.hyper, theta, u)
    made, got = _solved(flight, case.hyper, theta, at, np.zeros(at.path.shape[1]))
    shooting = linearise(flight, theta, latent_path_of(flight, case.hyper, u))
    want = optimum.conditional(flight, case.hyper, shooting)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-9), made, shooting)
    gram = np.asarray(got.gram)
    np.testing.assert_allclose(gram[1:, 1:], want.matrix, rtol=1e-6)
    np.testing.assert_allclose(-gram[1:, 0], want.gradient, rtol=1e-6, atol=1e-6 * np.abs(want.gradient).max())
    for name in ("start", "process_noise"):
        whole = np.asarray(getattr(got, name))
        whole = whole[:, : flight.latent.size] if name == "process_noise" else whole
        np.testing.assert_allclose(whole[..., 0], getattr(want.optimum, name), atol=1e-6)
        np.testing.assert_allclose(whole[..., 1:], getattr(want.slope, name), rtol=1e-5, atol=1e-5)
    told = terms(flight, case.hyper, np.ones(at.path.shape[1]), at, made)
    assert float(told.data) == pytest.approx(float(optimum.cost(flight, case.hyper, theta, u)), rel=1e-9)
    assert float(told.largest) < 1e-8


def test_a_step_of_nothing_lands_on_the_smoothed_flight_whatever_the_path(broken, linear):
    """Path, start and process noise given the parameters, from a path that is anything but a flight."""
    at = begin(broken)
    made, got = _solved(broken, linear.hyper, linear.theta, at, np.zeros(2))
    assert float(terms(broken, linear.hyper, np.ones(2), at, made).largest) > 0.5
    there = led(broken, linear.hyper, at, got, np.zeros(2))
    shooting = linearise(broken, linear.theta, latent_path_of(broken, linear.hyper, broken.still()))
    want = optimum.conditional(broken, linear.hyper, shooting).optimum
    np.testing.assert_allclose(there.unknowns.start, want.start, atol=1e-9)
    np.testing.assert_allclose(there.unknowns.process_noise, want.process_noise, atol=1e-9)
    driven = latent_path_of(broken, linear.hyper, want)
    np.testing.assert_allclose(there.error, driven.error, atol=1e-9)
    np.testing.assert_allclose(there.path, states(broken, jnp.asarray(linear.theta), driven), atol=1e-9)


def test_one_whole_step_solves_a_linear_problem(broken, linear):
    mean, covariance = linear.matrices.posterior(broken, linear.hyper, linear.priors)
    theta, at = np.array([3.0, -4.0]), begin(broken)
    made, got = _solved(broken, linear.hyper, theta, at, np.zeros(2))
    gram, prior = np.asarray(got.gram), np.diag([p.scale**-2 for p in linear.priors])
    step = np.linalg.solve(gram[1:, 1:] + prior, gram[1:, 0] - prior @ (theta - [p.centre for p in linear.priors]))
    np.testing.assert_allclose(theta + step, mean[:2], atol=1e-8)
    np.testing.assert_allclose(np.linalg.inv(gram[1:, 1:] + prior), covariance[:2, :2], rtol=1e-8)
    there = led(broken, linear.hyper, at, got, step)
    found = np.concatenate([there.unknowns.start, np.asarray(there.error).ravel()])
    np.testing.assert_allclose(found, mean[2:], atol=1e-8)
    driven = latent_path_of(broken, linear.hyper, there.unknowns)
    np.testing.assert_allclose(there.path, states(broken, jnp.asarray(theta + step), driven), atol=1e-8)


def _naive(flight, theta, start, error, pushes):
    """States and outputs (T, 2) of the linear flight, pushed at every sample, one after the other."""
    drive, x, rows = flight.model.drive, None, []
    for t, now in enumerate(drive):
        if t:
            e, then = 0.5 * (error[t - 1] + error[t]), drive[t - 1]
            known = np.array([0.05 * then * theta[1], 0.02 * (then + now) + 0.05 * theta[0]])
            x = np.array([[0.95, 0.2], [-0.2, 0.9]]) @ x + 0.1 * e + known + pushes[t]
        else:
            x = np.array([1.0, -0.5 + 0.3 * theta[0]]) + flight.start_scale * start + pushes[0]
        rows.append(np.concatenate([x, [x[0] + 0.5 * x[1] + 0.2 * theta[1] * now, x[1]]]))
    states_and_outputs = np.array(rows)
    return states_and_outputs[:, :2], states_and_outputs[:, 2:]


def test_slack_is_white_noise_of_the_states(broken, linear, dense):
    """Against dense matrices: start, process noise and pushes given the parameters, and what these are told."""
    theta, slack = np.array([0.2, 0.3]), np.array([0.07, 0.2])
    samples, law = broken.samples, linear.hyper.dynamics(broken)
    size = broken.latent.size
    made, got = _solved(broken, linear.hyper, theta, begin(broken), slack)
    there = led(broken, linear.hyper, begin(broken), got, np.zeros(2))

    disturbing = np.asarray(disturbances(law, jnp.eye(samples * size).reshape(samples, size, -1)))  # (T, A, T L)
    count = 2 + samples * size + 2 * samples

    def unstacked(z):
        process_noise = z[2 : 2 + samples * size]
        return z[:2], disturbing @ process_noise, slack * z[2 + samples * size :].reshape(samples, 2)

    def seen(z, theta):
        return dense.stack(_naive(broken, theta, *unstacked(z))[1], broken.present)

    zero = seen(np.zeros(count), theta)
    by = np.stack([seen(z, theta) - zero for z in np.eye(count)], axis=1)
    by_theta = np.stack([seen(np.zeros(count), theta + d) - zero for d in np.eye(2)], axis=1)
    noise = jax.tree.map(np.asarray, linear.hyper.outputs(broken))
    times = broken.dt * np.arange(samples)
    covariance = dense.noise_covariance(times, broken.present, noise.white, noise.correlated, noise.time_constant)
    total = by @ by.T + covariance
    left = dense.stack(broken.observed, broken.present) - zero
    columns = np.concatenate([left[:, None], by_theta], axis=1)
    np.testing.assert_allclose(got.gram, columns.T @ np.linalg.solve(total, columns), rtol=1e-7)
    z = by.T @ np.linalg.solve(total, left)
    start, error, pushes = unstacked(z)
    np.testing.assert_allclose(there.unknowns.start, start, atol=1e-9)
    np.testing.assert_allclose(np.ravel(there.unknowns.process_noise), z[2 : 2 + samples * size], atol=1e-9)
    np.testing.assert_allclose(there.error, error, atol=1e-9)
    np.testing.assert_allclose(there.path, _naive(broken, theta, start, error, pushes)[0], atol=1e-9)
    assert np.abs(pushes).max() > 0.5 * slack.min()  # the path needs them
    defects = terms(broken, linear.hyper, slack, there, linearise(broken, theta, there.latent_path(broken)))
    np.testing.assert_allclose(float(defects.squares), 0.5 * np.sum(z[2 + samples * size :] ** 2), rtol=1e-7)
    assert float(defects.sizes) == pytest.approx(np.abs(z[2 + samples * size :]).sum(), rel=1e-7)
    assert float(defects.largest) == pytest.approx(np.abs(z[2 + samples * size :]).max(), rel=1e-7)


def test_jax_serves_where_there_is_no_machine_code(descent, monkeypatch):
    pytest.importorskip("llvmlite")
    flight, u = descent.flights[0], descent.u[0]
    flight = broken_path(flight, descent.hyper, descent.theta, u, size=5.0)
    at, slack, step = begin(flight)._replace(unknowns=u), flight.path.slack, np.array([0.1])
    assert kernel.along_path(flight.model, descent.theta, at.unknowns.start, at.error, at.path) is not None

    def once():
        made, solved = _solved(flight, descent.hyper, descent.theta, at, slack)
        return made, solved, led(flight, descent.hyper, at, solved, step)

    ours = once()
    monkeypatch.setattr(joint.kernel, "along_path", lambda *given: None)
    theirs = once()
    close = lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-7, atol=1e-8 * np.abs(b).max())  # noqa: E731
    jax.tree.map(close, ours, theirs)
    assert isinstance(theirs[2], Lifted) and np.abs(np.asarray(theirs[2].path) - at.path).max() > 0.1
