"""The joint density of data and unknowns against dense Gaussians, and its derivatives against differences."""

from __future__ import annotations

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.compiler import compiled_model as kernel
from bayeschute.likelihood import joint
from bayeschute.likelihood.joint import (
    LatentPath,
    NoiseParameters,
    Unknowns,
    as_seen,
    cost,
    disturbed,
    filter_gains,
    jax_states,
    jax_stepped,
    latent_path_of,
    linearise,
    moved,
    residuals,
    states,
    stepped,
)
from bayeschute.likelihood.kalman import Seen, innovations, response, smooth_driven
from bayeschute.likelihood.noise import Noise
from bayeschute.posterior.joint_mode import conditional


@pytest.fixture(scope="module")
def line(linear):
    """The linear flight linearised beside its truth."""
    at = jax.tree.map(lambda a: 0.8 * a, linear.u)
    return linearise(linear.flight, linear.theta, latent_path_of(linear.flight, linear.hyper, at)), at


@pytest.fixture(scope="module")
def bent(descent):
    """A descent linearised at its truth."""
    return linearise(descent.flights[0], descent.theta, latent_path_of(descent.flights[0], descent.hyper, descent.u[0]))


def _dense(linear, u):
    """Unknowns as the matrices have them: start, then disturbances."""
    driven = latent_path_of(linear.flight, linear.hyper, u)
    return np.concatenate([u.start, np.asarray(driven.error).ravel()])


def test_joint_density_is_the_dense_one(linear):
    """The cost is half the Mahalanobis square of the residuals and half the squares of the unknowns."""
    flight, u = linear.flight, linear.u
    y, zero, by = linear.matrices.model(flight)
    r, _, _ = linear.matrices.covariances(flight, linear.hyper, linear.priors)
    left = y - zero - by @ np.concatenate([linear.theta, _dense(linear, u)])
    wanted = 0.5 * (left @ np.linalg.solve(r, left) + np.sum(u.start**2) + np.sum(u.process_noise**2))
    assert float(cost(flight, linear.hyper, linear.theta, u)) == pytest.approx(wanted, rel=1e-9)


def test_cost_keeps_batches(descent):
    flight, rng = descent.flights[0], np.random.default_rng(0)
    many = Unknowns(rng.standard_normal((1, 3)), rng.standard_normal((101, 1, 3)))
    theta = descent.theta[:, None] + np.array([[0.0, 0.1, -0.2]])
    made = cost(flight, descent.hyper, theta, many)
    assert made.shape == (3,)
    for b in range(3):
        one = cost(flight, descent.hyper, theta[:, b], Unknowns(many.start[:, b], many.process_noise[..., b]))
        assert float(made[b]) == pytest.approx(float(one), rel=1e-12)


def test_course_scales_the_start_and_follows_the_processes(linear):
    flight, hyper = linear.flight, linear.hyper
    made = latent_path_of(flight, hyper, Unknowns(jnp.ones(2), jnp.zeros((60, flight.latent.size))))
    np.testing.assert_allclose(made.start, flight.start_scale)
    np.testing.assert_array_equal(made.error, 0.0)
    batch = Unknowns(jnp.ones((2, 5)), jnp.ones((60, flight.latent.size, 5)))
    assert latent_path_of(flight, hyper, batch).start.shape == (2, 5) and latent_path_of(
        flight, hyper, batch
    ).error.shape == (60, 2, 5)
    still = flight.still()
    assert float(jnp.sum(still.start**2) + jnp.sum(still.process_noise**2)) == 0.0
    assert still.start.shape == (flight.starts,) and still.process_noise.shape == (flight.samples, flight.latent.size)


def test_a_start_moves_the_first_state_by_its_scale(descent):
    flight = descent.flights[0]
    first = [
        np.asarray(states(flight, jnp.asarray(descent.theta), LatentPath(jnp.array([2.0 * s]), jnp.zeros((101, 1)))))[0]
        for s in (0.0, 1.0)
    ]
    np.testing.assert_allclose(first[1] - first[0], [0.0, 2.0])


def _open_loop(lin):
    """Data about the undisturbed flight, and derivatives by theta: responses over the whole record (T, C, 1 + P)."""
    start, error, p = np.asarray(lin.latent_path.start), np.asarray(lin.latent_path.error), lin.steps.out_theta.shape[2]
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
    """Innovations, start and process noise: about the undisturbed flight, or of data and pushes about the disturbed one."""
    lin = request.getfixturevalue(which)
    lin = lin[0] if which == "line" else lin
    flight, hyper = (linear.flight, linear.hyper) if which == "line" else (descent.flights[0], descent.hyper)
    made, seen, whole = filter_gains(flight, hyper, lin), as_seen(lin), _open_loop(lin)
    assert seen.series.shape == whole.shape and seen.inputs.shape == (*lin.steps.out_state.shape[::2], whole.shape[2])
    want = np.asarray(innovations(made, whole))
    close = {"rtol": 1e-9, "atol": 1e-9 * np.abs(want).max()}
    np.testing.assert_allclose(innovations(made, *seen), want, **close)
    got = smooth_driven(made, seen)
    undriven = smooth_driven(made, Seen(jnp.asarray(whole), jnp.zeros_like(seen.inputs)))
    for ours, theirs in zip(got[1:3], undriven[1:3], strict=True):
        np.testing.assert_allclose(ours, theirs, **close)


def test_defects_drive_the_states_of_the_first_column_alone(line):
    steps, rng = line[0].steps, np.random.default_rng(5)
    plain, defects = as_seen(line[0]), rng.standard_normal(np.shape(line[0].defects))
    broken = as_seen(line[0]._replace(defects=line[0].defects + defects))
    np.testing.assert_allclose(broken.inputs[..., 0] - plain.inputs[..., 0], defects, atol=1e-14)
    np.testing.assert_array_equal(broken.inputs[..., 1:], plain.inputs[..., 1:])
    np.testing.assert_array_equal(broken.series, plain.series)
    np.testing.assert_array_equal(-plain.inputs[0, :, 1:], steps.first_theta)


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
    driven = latent_path_of(flight, descent.hyper, descent.u[0])
    seen = []
    for sign in (1.0, -1.0):
        moved = LatentPath(driven.start[:, None] + sign * h * start, driven.error[..., None] + sign * h * error)
        seen.append(np.asarray(residuals(flight, descent.theta[:, None] + sign * h * theta, moved)))
    wanted = (seen[1] - seen[0]) / (2.0 * h)  # residuals fall as outputs rise
    made = np.where(flight.present[..., None], response(bent.steps, start, error, theta), 0.0)
    np.testing.assert_allclose(made, wanted, atol=2e-8 * np.abs(wanted).max())
    assert (np.abs(wanted).max(axis=(0, 1)) > 1e-2).all()


def test_the_marginal_gradient_is_that_of_the_cost_at_the_conditional_optimum(descent):
    """The envelope theorem; and at that optimum the cost has no slope by the unknowns."""
    flight, hyper, u = descent.flights[0], descent.hyper, descent.u[0]
    for _ in range(6):
        given = conditional(flight, hyper, linearise(flight, descent.theta, latent_path_of(flight, hyper, u)))
        u = given.optimum
    by_theta, by_u = jax.grad(cost, argnums=(2, 3))(flight, hyper, jnp.asarray(descent.theta), u)
    np.testing.assert_allclose(given.gradient, by_theta, rtol=1e-6)
    assert np.abs(by_theta).min() > 0.1
    for part in by_u:
        np.testing.assert_allclose(part, 0.0, atol=1e-6)


def test_residuals_of_the_truth_have_the_law_of_the_noise(descent):
    for flight, u in zip(descent.flights, descent.u, strict=True):
        s = cost(flight, descent.hyper, descent.theta, u)
        degrees = flight.present.sum() + u.start.size + u.process_noise.size
        assert abs(2.0 * float(s) - degrees) < 4.0 * np.sqrt(2.0 * degrees)


@pytest.fixture(params=["linear", "descent"])
def flying(request, linear, descent, flown):
    """A flight, its noise parameters and parameters, on the path of its simulation."""
    case = (linear.flight, linear.hyper, linear.theta, linear.u)
    if request.param == "descent":
        case = (descent.flights[0], descent.hyper, descent.theta, descent.u[0])
    return *case[:3], flown(*case)


def test_on_its_own_simulation_a_flight_obeys(flying):
    flight, hyper, theta, at = flying
    driven = latent_path_of(flight, hyper, at.unknowns)
    np.testing.assert_array_equal(at.path, states(flight, jnp.asarray(theta), driven))
    np.testing.assert_array_equal(at.error, driven.error)
    along = at.latent_path(flight)
    np.testing.assert_allclose(along.start, driven.start)
    residual, defects = stepped(flight, jnp.asarray(theta), along)
    np.testing.assert_allclose(defects, 0.0, atol=1e-12 * np.abs(at.path).max())
    np.testing.assert_allclose(residual, residuals(flight, jnp.asarray(theta), driven), atol=1e-12)
    assert (np.asarray(residual)[~flight.present] == 0.0).all()


def test_along_its_own_simulation_a_flight_is_linearised_as_without_a_path(flying):
    flight, hyper, theta, at = flying
    along, alone = (
        linearise(flight, theta, one) for one in (at.latent_path(flight), latent_path_of(flight, hyper, at.unknowns))
    )
    np.testing.assert_allclose(alone.latent_path.path, at.path, atol=1e-12)
    np.testing.assert_allclose(alone.defects, 0.0, atol=1e-12 * np.abs(at.path).max())
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-11), along, alone)


def test_what_a_flight_is_linearised_along_is_the_path_that_is_stepped(flying):
    """Residuals and defects are those of `stepped`, whatever the path."""
    flight, _, theta, at = flying
    rng = np.random.default_rng(3)
    driven = at.latent_path(flight)._replace(path=at.path + 0.3 * rng.standard_normal(at.path.shape))
    made, (residual, defects) = linearise(flight, theta, driven), stepped(flight, jnp.asarray(theta), driven)
    np.testing.assert_allclose(made.residual, residual, atol=1e-12)
    np.testing.assert_allclose(made.defects, defects, atol=1e-12)
    assert np.abs(defects).min(axis=1).max() > 0.1
    np.testing.assert_array_equal(made.latent_path.path, driven.path)


def test_defects_are_by_how_much_the_first_state_and_all_steps_lead_beside_the_path(linear):
    """The linear flight's equations, one sample after the other."""
    flight, theta, drive, rng = linear.flight, linear.theta, linear.flight.model.drive, np.random.default_rng(4)
    start, error, path = (rng.standard_normal(n) for n in ((2,), (60, 2), (60, 2)))
    residual, defects = stepped(flight, jnp.asarray(theta), LatentPath(start, error, path))
    wanted, seen = [np.array([1.0, -0.5 + 0.3 * theta[0]]) + start - path[0]], []
    for t, x in enumerate(path):
        if t:
            known = [0.05 * drive[t - 1] * theta[1], 0.02 * (drive[t - 1] + drive[t]) + 0.05 * theta[0]]
            led = np.array([[0.95, 0.2], [-0.2, 0.9]]) @ path[t - 1] + 0.05 * (error[t - 1] + error[t]) + known
            wanted.append(led - x)
        seen.append([x[0] + 0.5 * x[1] + 0.2 * theta[1] * drive[t], x[1]])
    np.testing.assert_allclose(defects, wanted, atol=1e-12)
    np.testing.assert_allclose(residual, np.where(flight.present, flight.observed - seen, 0.0), atol=1e-12)


def test_steps_of_a_batch_are_those_of_each(flying):
    flight, _, theta, at = flying
    rng = np.random.default_rng(6)
    many = jax.tree.map(lambda a: a[..., None] + 0.1 * rng.standard_normal((*a.shape, 3)), at.latent_path(flight))
    wide = theta[:, None] + 0.1 * rng.standard_normal((theta.size, 3))
    whole = stepped(flight, wide, many)
    for ours, jax_made in zip(whole, jax_stepped(flight, wide, many), strict=True):
        np.testing.assert_allclose(ours, jax_made, atol=1e-11 * np.abs(at.path).max())
    for b in range(3):
        one = stepped(flight, jnp.asarray(wide[:, b]), jax.tree.map(lambda a, b=b: a[..., b], many))
        for ours, alone in zip(whole, one, strict=True):
            np.testing.assert_allclose(ours[..., b], alone, atol=1e-11 * np.abs(at.path).max())


def test_jax_serves_where_there_is_no_machine_code(descent, monkeypatch, flown):
    pytest.importorskip("llvmlite")
    flight, theta = descent.flights[0], jnp.asarray(descent.theta)
    at = flown(flight, descent.hyper, theta, descent.u[0])
    path = at.path + np.random.default_rng(7).standard_normal(at.path.shape)
    driven = at.latent_path(flight)._replace(path=path)
    assert kernel.reached(flight.model, theta, *driven) is not None

    def once():
        known = states(flight, theta, driven, driven.path[:20])
        return stepped(flight, theta, driven), linearise(flight, theta, driven), known

    ours = once()
    for name in ("reached", "along_path", "states"):
        monkeypatch.setattr(joint.kernel, name, lambda *given: None)
    close = lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)  # noqa: E731
    jax.tree.map(close, ours, once())


@pytest.mark.parametrize("known", [1, 17])
def test_a_simulation_goes_on_from_known_states(flying, known):
    flight, hyper, theta, at = flying
    driven = latent_path_of(flight, hyper, at.unknowns)
    for simulated in (states, jax_states):
        goes_on = simulated(flight, jnp.asarray(theta), driven, at.path[:known])
        np.testing.assert_allclose(goes_on, at.path, atol=1e-11 * np.abs(at.path).max())
    other = at.path[:known] + 0.1
    made = states(flight, jnp.asarray(theta), driven, other)
    np.testing.assert_array_equal(made[:known], other)
    _, defects = stepped(flight, jnp.asarray(theta), driven._replace(path=made))
    np.testing.assert_allclose(defects[known:], 0.0, atol=1e-12 * np.abs(at.path).max())
    assert np.abs(np.asarray(made) - at.path)[known:].max() > 0.05


def test_start_and_disturbances_move_states_linearly(linear, line):
    """What they add to the first state and to every step of the linear flight, alone and in a batch."""
    flight, theta, steps = linear.flight, jnp.asarray(linear.theta), line[0].steps
    rng = np.random.default_rng(8)
    start, error, path = (rng.standard_normal(n) for n in ((2, 3), (60, 2, 3), (60, 2)))
    _, still = stepped(flight, theta, LatentPath(np.zeros(2), np.zeros((60, 2)), path))
    made = np.asarray(disturbed(steps, LatentPath(start, error)))
    for b in range(3):
        _, defects = stepped(flight, theta, LatentPath(start[:, b], error[..., b], path))
        np.testing.assert_allclose(made[..., b], defects - still, atol=1e-12)
        np.testing.assert_allclose(disturbed(steps, LatentPath(start[:, b], error[..., b])), made[..., b], atol=1e-14)


def test_records_without_their_models_are_of_one_kind_and_cost_the_same(linear, descent):
    """So what needs no model is compiled once."""

    def kind(flight):
        return jax.tree.structure(flight)

    other = replace(linear.flight, model=descent.flights[0].model)
    assert kind(linear.flight) != kind(other) and kind(linear.flight.without_model()) == kind(other.without_model())
    residual = jnp.asarray(np.random.default_rng(3).standard_normal(np.shape(linear.flight.observed)))
    whole, bare = (
        joint._joint(flight, linear.hyper, residual, linear.flight.still())
        for flight in (linear.flight, linear.flight.without_model())
    )
    assert whole == bare > 0.0


def test_a_path_is_moved_by_its_change_or_as_its_model_retracts(linear):
    """A model that keeps something has the last word."""
    rng = np.random.default_rng(9)
    path, by = rng.standard_normal((2, 60, 2, 3))
    theta = jnp.zeros((2, 3))
    np.testing.assert_array_equal(moved(linear.flight, path, by, theta, theta), path + by)

    @jax.tree_util.register_dataclass
    @dataclass(frozen=True)
    class Kept(type(linear.flight.model)):
        def retract(self, x, step, theta, change):
            return jnp.stack([x[:, 0] + step[:, 0], x[:, 1] + change[0]], axis=1)

    kept = moved(replace(linear.flight, model=Kept(linear.flight.model.drive)), path, by, theta, theta)
    np.testing.assert_array_equal(kept[:, 1], path[:, 1])
    np.testing.assert_array_equal(kept[:, 0], path[:, 0] + by[:, 0])


def test_a_lifted_flight_s_course_has_the_start_in_its_own_units(linear, flown):
    flight, at = linear.flight, flown(linear.flight, linear.hyper, linear.theta, linear.u)
    wide = jax.tree.map(lambda a: jnp.stack([a, 2.0 * a], axis=-1), at)
    made = wide.latent_path(flight, 1)
    np.testing.assert_allclose(made.start[:, 0], flight.start_scale * at.unknowns.start)
    np.testing.assert_allclose(made.start[:, 1], 2.0 * made.start[:, 0])
    np.testing.assert_array_equal(made.path, wide.path)
    np.testing.assert_array_equal(made.error, wide.error)


def test_standard_deviations_change_and_nothing_else_does():
    """A drift has a time constant, an oscillator a frequency and a damping ratio besides."""
    one, other = (
        NoiseParameters(
            Noise(f * np.array([0.1, 0.2]), f * np.array([0.3, 0.4]), np.array([2.0, 5.0])),
            (f * np.array([0.5, 12.0]), np.array([f * 0.02, 0.2, 0.1])),
        )
        for f in (1.0, 3.0)
    )
    made = one.with_deviations(lambda sd, more: sd + 2.0 * more, other)
    np.testing.assert_allclose(made.noise.white, [0.7, 1.4])
    np.testing.assert_allclose(made.noise.correlated, [2.1, 2.8])
    np.testing.assert_array_equal(made.noise.time_constant, one.noise.time_constant)
    np.testing.assert_allclose(made.disturbance_parameters[0], [3.5, 12.0])
    np.testing.assert_allclose(made.disturbance_parameters[1], [0.14, 0.2, 0.1])
    np.testing.assert_allclose(one.with_deviations(lambda sd: 2.0 * sd).noise.white, [0.2, 0.4])
