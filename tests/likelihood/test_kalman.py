"""The filter, its smoother and the linear response against dense matrices, along steps that change with time."""

from __future__ import annotations

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.compiler.integrate import Steps
from bayeschute.likelihood import disturbances
from bayeschute.likelihood.disturbances import Latent
from bayeschute.likelihood.kalman import MeanCorrection, Seen, gains, innovations, response, smooth_driven
from bayeschute.likelihood.noise import Noise

T, X, D, A, P, C, DT = 30, 3, 2, 2, 2, 2, 0.2
WHICH = Latent(("drift", "oscillator"), ((0, 0), (1, 0), (1, 1)))
LAWS = (np.array([0.6, 1.5]), np.array([0.9, 0.35, 0.15]))
NOISE = Noise(np.array([0.2, 0.1]), np.array([0.3, 0.4]), np.array([0.9, 2.0]))
SCALE = np.array([0.5, 1.4])


def _run(steps, laws, noise, here, series):
    """Gains, innovations, expected start and process noise of flights that nothing drives."""
    made = gains(steps, SCALE, disturbances.dynamics(WHICH, laws, DT), noise, DT, here)
    got = smooth_driven(made, Seen(series, jnp.zeros((T, X, series.shape[2]))))
    return made, innovations(made, series), got.start, got.process_noise


@pytest.fixture(scope="module", params=["machine code", "JAX"])
def run(request):
    """By machine code, and as part of a compiled function, where JAX takes the passes."""
    return _run if request.param == "machine code" else jax.jit(_run)


def _steps(rng):
    """Random steps, stable on the whole."""
    turn = np.linalg.qr(rng.standard_normal((X, X)))[0]
    shapes = ((T - 1, X, P), (T - 1, X, A), (T - 1, X, A), (X, P), (X, D), (T, C, X), (T, C, P))
    by_state = 0.9 * turn + 0.1 * rng.standard_normal((T - 1, X, X))
    return Steps(by_state, *(0.5 * rng.standard_normal(shape) for shape in shapes))


def _by(steps):
    """Outputs (T, C, D + T A + P) by initial deviations, disturbances and parameters, one sample after the other."""
    eye = np.eye(D + T * A + P)
    start, error, theta = eye[:D], eye[D:-P].reshape(T, A, -1), eye[-P:]
    x, rows = steps.first_start @ start + steps.first_theta @ theta, []
    for t in range(T):
        if t:
            x = steps.by_state[t - 1] @ x + steps.by_theta[t - 1] @ theta
            x = x + steps.by_now[t - 1] @ error[t - 1] + steps.by_then[t - 1] @ error[t]
        rows.append(steps.out_state[t] @ x + steps.out_theta[t] @ theta)
    return np.array(rows)


@pytest.fixture(scope="module")
def case(dense, run):
    """A random system with gaps, data, and what dense matrices make of them."""
    rng = np.random.default_rng(0)
    steps, series = _steps(rng), rng.standard_normal((T, C, 3))
    here = rng.random((T, C)) > 0.2
    here[0, 1], here[10:14], here[-1, 0] = False, False, False
    times, by = DT * np.arange(T), _by(steps)
    stacked = dense.stack(by, here)
    start, error = stacked[:, :D] * SCALE, stacked[:, D:-P]
    noise = dense.noise_covariance(times, here, NOISE.white, NOISE.correlated, NOISE.time_constant)
    disturbed = dense.disturbance_covariance(WHICH, LAWS, times)
    total = start @ start.T + error @ disturbed @ error.T + noise
    each = jnp.eye(T * WHICH.size).reshape(T, WHICH.size, -1)
    by_shocks = np.asarray(disturbances.disturbances(disturbances.dynamics(WHICH, LAWS, DT), each)).reshape(T * A, -1)
    seen = dense.stack(series, here)
    made, unit, *expected = run(steps, LAWS, NOISE, here, series)
    names = ("steps", "series", "here", "by", "start", "error", "disturbed", "by_shocks", "total", "seen")
    values = (steps, series, here, by, start, error, disturbed, by_shocks, total, seen)
    return SimpleNamespace(**dict(zip(names, values, strict=True)), made=made, unit=np.asarray(unit), expected=expected)


def _log_density(case, column):
    """What the filter says of one series."""
    unit = case.unit[..., column]
    count = case.here.sum()
    return -0.5 * np.sum(unit**2) - float(case.made.log_determinant) - 0.5 * count * np.log(2.0 * np.pi)


def test_likelihood_is_the_dense_one(case, dense):
    for column in range(3):
        wanted = dense.gaussian_log_density(case.seen[:, column], case.total)
        assert _log_density(case, column) == pytest.approx(wanted, rel=1e-9)
    assert float(case.made.log_determinant) == pytest.approx(0.5 * np.linalg.slogdet(case.total)[1], rel=1e-9)


@pytest.mark.parametrize(
    ("white", "correlated", "tau", "law"),
    [(1e-6, 0.3, 1.0, LAWS), (0.3, 1e-6, 1e-3, LAWS), (0.1, 0.3, 1e4, (np.array([5.0, 1e4]), LAWS[1]))],
    ids=["hardly white", "hardly correlated", "hardly changing"],
)
def test_likelihood_at_the_edges(run, case, dense, white, correlated, tau, law):
    noise = Noise(np.full(2, white), np.full(2, correlated), np.full(2, tau))
    made, unit, *_ = run(case.steps, law, noise, case.here, case.series)
    times = DT * np.arange(T)
    r = dense.noise_covariance(times, case.here, noise.white, noise.correlated, noise.time_constant)
    disturbed = dense.disturbance_covariance(WHICH, law, times)
    total = case.start @ case.start.T + case.error @ disturbed @ case.error.T + r
    ours = -0.5 * np.sum(np.asarray(unit)[..., 0] ** 2) - float(made.log_determinant)
    wanted = dense.gaussian_log_density(case.seen[:, 0], total) + 0.5 * len(total) * np.log(2.0 * np.pi)
    assert ours == pytest.approx(wanted, rel=1e-8)


def test_likelihood_of_a_full_record(run, case, dense):
    here = np.ones((T, C), bool)
    made, unit, *_ = run(case.steps, LAWS, NOISE, here, case.series)
    by = dense.stack(case.by, here)
    r = dense.noise_covariance(DT * np.arange(T), here, NOISE.white, NOISE.correlated, NOISE.time_constant)
    start = by[:, :D] * SCALE
    total = start @ start.T + by[:, D:-P] @ case.disturbed @ by[:, D:-P].T + r
    wanted = dense.gaussian_log_density(dense.stack(case.series, here)[:, 1], total)
    ours = -0.5 * np.sum(np.asarray(unit)[..., 1] ** 2) - float(made.log_determinant) - T * C / 2 * np.log(2.0 * np.pi)
    assert ours == pytest.approx(wanted, rel=1e-9)


def test_innovations_of_columns_have_the_dense_products(run, case):
    """For any two columns, the innovations' product is that with the inverse covariance; later data change nothing."""
    flat = case.unit.reshape(-1, 3)
    np.testing.assert_allclose(flat.T @ flat, case.seen.T @ np.linalg.solve(case.total, case.seen), rtol=1e-9)
    later = case.series.copy()
    later[20:] += 7.0
    again = np.asarray(run(case.steps, LAWS, NOISE, case.here, later)[1])
    np.testing.assert_array_equal(again[:20], case.unit[:20])
    assert (again[20:] != case.unit[20:])[case.here[20:]].all()


@pytest.mark.parametrize("value", [1e6, np.nan])
def test_missing_data_are_ignored(run, case, value):
    spoiled = np.where(case.here[..., None], case.series, value)
    _, unit, *expected = run(case.steps, LAWS, NOISE, case.here, spoiled)
    np.testing.assert_array_equal(unit, case.unit)
    jax.tree.map(np.testing.assert_array_equal, expected, case.expected)
    assert (case.unit[~case.here] == 0.0).all()


def test_smoothed_start_and_shocks_are_the_dense_posterior_means(case):
    weighted = np.linalg.solve(case.total, case.seen)
    start, process_noise = (np.asarray(a) for a in case.expected)
    assert start.shape == (D, 3) and process_noise.shape == (T, WHICH.size, 3)
    np.testing.assert_allclose(start, case.start.T @ weighted, atol=1e-10)
    wanted = case.by_shocks.T @ case.error.T @ weighted
    np.testing.assert_allclose(process_noise.reshape(-1, 3), wanted, atol=1e-10)
    # The disturbances that they make, by kernels alone.
    np.testing.assert_allclose(
        case.by_shocks @ process_noise.reshape(-1, 3), case.disturbed @ case.error.T @ weighted, atol=1e-10
    )


def test_series_without_a_batch_axis(case):
    np.testing.assert_allclose(innovations(case.made, case.series[..., 2]), case.unit[..., 2], atol=1e-12)


def test_response_is_the_dense_one(case):
    rng = np.random.default_rng(1)
    start, error, theta = (rng.standard_normal((*n, 4)) for n in ((D,), (T, A), (P,)))
    columns = np.concatenate([start, error.reshape(T * A, 4), theta])
    np.testing.assert_allclose(response(case.steps, start, error, theta), case.by @ columns, atol=1e-11)


def test_nothing_seen_says_nothing(run, case):
    made, unit, start, process_noise = run(case.steps, LAWS, NOISE, np.zeros((T, C), bool), case.series)
    for a in (unit, start, process_noise):
        np.testing.assert_array_equal(a, 0.0)
    assert float(made.log_determinant) == 0.0


def test_innovations_whiten(run, case, dense):
    """As a map of the data they are a root of the inverse covariance, causal and with a positive diagonal."""
    count = int(case.here.sum())
    series = np.zeros((T, C, count))
    series[case.here] = np.eye(count)  # in order of time; `stack` orders by output
    root = np.asarray(run(case.steps, LAWS, NOISE, case.here, series)[1])[case.here]
    order = dense.stack(np.where(case.here, np.cumsum(case.here.ravel()).reshape(T, C) - 1, 0), case.here)
    np.testing.assert_allclose((root.T @ root)[np.ix_(order, order)], np.linalg.inv(case.total), atol=1e-9)
    np.testing.assert_allclose(np.triu(root, 1), 0.0, atol=1e-12)
    assert (np.diag(root) > 0.0).all()


def test_a_disturbance_that_drives_nothing_keeps_its_prior_mean(run, case):
    still = {name: np.where(np.arange(A) == 0, 0.0, getattr(case.steps, name)) for name in ("by_now", "by_then")}
    process_noise = np.asarray(run(case.steps._replace(**still), LAWS, NOISE, case.here, case.series)[3])
    np.testing.assert_allclose(process_noise[:, 0], 0.0, atol=1e-14)
    assert np.abs(process_noise[:, 1:]).max() > 0.1


def _along(steps, driven):
    """States (T, X, M) and outputs (T, C, M) that known pushes of the states (T, X, M) alone lead to."""
    x = [driven[0]]
    for a, push in zip(steps.by_state, driven[1:], strict=True):
        x.append(a @ x[-1] + push)
    return np.array(x), np.einsum("tcx,txm->tcm", steps.out_state, np.array(x))


@pytest.fixture(scope="module")
def driven(case):
    """Data of flights that are pushed at every step, what the filter makes of them, and their undisturbed paths."""
    pushes = np.random.default_rng(2).standard_normal((T, X, 3))
    path, outputs = _along(case.steps, pushes)
    return SimpleNamespace(seen=Seen(case.series + outputs, pushes), path=path)


def test_what_drives_the_states_is_taken_from_the_data(case, driven):
    """Innovations, start and process noise are those of the data less the response to it over the whole record."""
    got = smooth_driven(case.made, driven.seen)
    np.testing.assert_allclose(got.innovations.reshape(T, C, 3), case.unit, atol=1e-10)
    np.testing.assert_allclose(innovations(case.made, *driven.seen), case.unit, atol=1e-10)
    np.testing.assert_allclose(got.start, case.expected[0], atol=1e-10)
    np.testing.assert_allclose(got.process_noise, case.expected[1], atol=1e-10)
    assert np.abs(innovations(case.made, driven.seen.series) - case.unit).max() > 1.0


def test_expected_states_are_those_of_expected_start_and_shocks(case, driven):
    got = smooth_driven(case.made, driven.seen)
    process = disturbances.dynamics(WHICH, LAWS, DT)
    start, error = SCALE[:, None] * got.start, np.asarray(disturbances.disturbances(process, got.process_noise))
    own = case.steps._replace(out_state=np.tile(np.eye(X), (T, 1, 1)), out_theta=np.zeros((T, X, P)))
    disturbed = response(own, start, error, np.zeros((P, 3)))
    np.testing.assert_allclose(got.states, driven.path + disturbed, atol=1e-9)
    assert np.abs(disturbed).max() > 0.1


def test_expected_states_are_the_dense_posterior_means(case, driven, dense):
    """With noise of the states themselves: no start and process noise tell those."""
    slack, here = np.array([0.3, 0.1, 0.5]), case.here
    made = gains(case.steps, SCALE, disturbances.dynamics(WHICH, LAWS, DT), NOISE, DT, here, slack)
    got = smooth_driven(made, driven.seen)
    own = case.steps._replace(out_state=np.tile(np.eye(X), (T, 1, 1)), out_theta=np.zeros((T, X, P)))
    each = np.eye(D + T * A)
    states = response(own, each[:D], each[D:].reshape(T, A, -1), np.zeros((P, len(each))))
    states = np.asarray(states).reshape(T * X, -1)
    pushed = _along(case.steps, np.eye(T * X).reshape(T, X, -1))[0].reshape(T * X, -1)
    law = states[:, :D] * SCALE**2 @ states[:, :D].T + states[:, D:] @ case.disturbed @ states[:, D:].T
    law = law + pushed * np.tile(slack**2, T) @ pushed.T
    out = dense.stack(np.einsum("tcx,txm->tcm", case.steps.out_state, np.eye(T * X).reshape(T, X, -1)), here)
    noise = dense.noise_covariance(DT * np.arange(T), here, NOISE.white, NOISE.correlated, NOISE.time_constant)
    wanted = law @ out.T @ np.linalg.solve(out @ law @ out.T + noise, case.seen)
    np.testing.assert_allclose(got.states - driven.path, wanted.reshape(T, X, 3), atol=1e-9)


def test_seen_has_columns_and_a_gap_is_of_the_data_alone(driven):
    seen, rng = driven.seen, np.random.default_rng(4)
    gap = MeanCorrection(rng.standard_normal((T, C)), rng.standard_normal((T, X)))
    np.testing.assert_array_equal(seen.column(1).series[..., 0], seen.series[..., 1])
    np.testing.assert_array_equal(seen.column(1).inputs, seen.inputs[..., 1:2])
    less = Seen(*map(jnp.asarray, seen)).less(gap)
    np.testing.assert_allclose(less.series[..., 0], seen.series[..., 0] - gap.outputs)
    np.testing.assert_allclose(less.inputs[..., 0], seen.inputs[..., 0] + gap.inputs)
    for ours, theirs in zip(less, seen, strict=True):
        np.testing.assert_array_equal(ours[..., 1:], theirs[..., 1:])


def test_data_of_flights_that_lie_off_by_a_gap_tell_what_they_would_without(case, driven):
    """Outputs and ends of steps that are displaced, and data with the response to both."""
    rng = np.random.default_rng(7)
    gap = MeanCorrection(rng.standard_normal((T, C)), rng.standard_normal((T, X)))
    response_to_both = gap.outputs + _along(case.steps, gap.inputs[..., None])[1][..., 0]
    series = driven.seen.series.copy()
    series[..., 0] += response_to_both
    seen = Seen(jnp.asarray(series), jnp.asarray(driven.seen.inputs)).less(gap)
    np.testing.assert_allclose(innovations(case.made, *seen), case.unit, atol=1e-10)


def test_an_unstable_flight_is_followed_where_its_response_over_the_record_is_garbage():
    """A state that grows by e^60 from end to end, pushed at every sample and kept where it is by its disturbances."""
    samples, here, rng = 301, np.ones((301, 1), bool), np.random.default_rng(6)
    one, none = np.ones((samples, 1, 1)), np.zeros((samples, 1, 1))
    grown = np.exp(0.2) * one[1:]
    steps = Steps(grown, none[1:], none[1:], one[1:], none[0], one[0], one, none)
    noise = Noise(np.array([0.01]), np.array([1e-6]), np.array([1.0]))
    law = disturbances.dynamics(Latent(("drift",), ((0, 0),)), (np.array([2.0, 0.01]),), DT)
    made = gains(steps, np.array([1.0]), law, noise, DT, here)
    path, pushes = rng.standard_normal((2, samples, 1, 1))
    seen = Seen(path + 0.01 * rng.standard_normal(path.shape), pushes)
    got = smooth_driven(made, seen)
    np.testing.assert_allclose(got.states, path, atol=0.05)
    assert np.sqrt(np.mean(np.square(got.innovations))) == pytest.approx(1.0, abs=0.3)
    off = np.abs(innovations(made, seen.series - _along(steps, pushes)[1]) - got.innovations)
    assert off[:50].max() < 1e-6 and not off[-50:].max() < 1.0  # no digit is left of the data by then
