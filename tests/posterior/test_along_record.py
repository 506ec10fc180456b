"""The fit along the record against single shooting, dense matrices and the closed form, from paths that break the rules."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.twins import small_cluster as small

from bayeschute.compiler import compiled_model as kernel
from bayeschute.dynamics.parameters import Structure
from bayeschute.likelihood import joint
from bayeschute.likelihood.channels import cluster_data
from bayeschute.likelihood.disturbances import Latent
from bayeschute.likelihood.joint import Lifted, NoiseParameters, Unknowns, latent_path_of, linearise, states
from bayeschute.likelihood.noise import Noise
from bayeschute.likelihood.priors import Prior, standard
from bayeschute.likelihood.record_path import RecordPath
from bayeschute.posterior import along_record
from bayeschute.posterior import joint_mode as optimum
from bayeschute.posterior.along_record import begin, conditional_optimum, descend, led, onward, solve, terms
from bayeschute.records.sensors import SensorNoise
from bayeschute.virtual.drop import Turbulence, VirtualDrop, fly

TIGHT = along_record.Near(1e-4, 1e-3)  # gain and step at which a fit is compared to another


def _broken(flight, hyper, theta, u, seed=0, size=0.3):
    """The flight with the path of a simulation, broken at every sample, as what its record shows."""
    x = np.asarray(states(flight, jnp.asarray(theta), latent_path_of(flight, hyper, u)))
    path = x + size * np.random.default_rng(seed).standard_normal(x.shape)
    return replace(flight, path=RecordPath(path, np.full(x.shape[1], 0.1)))


@pytest.fixture(scope="module")
def broken(linear):
    return _broken(linear.flight, linear.hyper, linear.theta, linear.u)


@pytest.fixture(scope="module")
def drop():
    """A short drop of two canopies in gusts, seen well, and its parameters."""
    white = {"canopy_position": 0.1, "capsule_velocity": 0.05, "capsule_attitude": 0.002}
    structure = Structure(("1", "alpha^2"), ("e", "rate"), 2, "riser")
    model = small.cluster((0.95, -0.8), (-0.1, 0.3))
    flight = VirtualDrop(
        duration=8.0, dt=0.1, altitude=1500.0, swing=0.2, swing_azimuth=0.5, flyout=0.15,
        turbulence=Turbulence(0.3, 0.2, 2.0), sensors={name: SensorNoise(sd) for name, sd in white.items()},
    )  # fmt: skip
    record, _ = fly(flight, model, structure, 0, small.SUBSTEPS)
    names, truth, sd = ("axial[1]", "transverse[e]", "transverse[rate]"), (0.95, -0.1, 0.3), (0.1, 0.2, 0.2)
    off = np.array([-0.05, 0.1, -0.1])
    priors = [Prior(n, x + d, s, False, "1", "") for n, x, d, s in zip(names, truth, off, sd, strict=True)]
    gusts = Latent(("drift", "drift"), ((0, 0), (1, 0), (2, 1)))
    data = cluster_data(record, model, structure, priors, tuple(white), gusts)
    noise = Noise(np.array(list(white.values())), 0.3 * np.array(list(white.values())), np.full(3, 1.0))
    hyper = NoiseParameters(noise, (np.array([0.3, 2.0]), np.array([0.2, 2.0])))
    return SimpleNamespace(flight=data, priors=priors, hyper=hyper, theta=np.array(truth))


@pytest.fixture(scope="module")
def shot(drop):
    """The optimum of the drop by single shooting from the truth."""
    return optimum.fit([drop.flight], drop.hyper, drop.priors, drop.theta, tolerance=1e-3)


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

    disturbing = np.asarray(
        along_record.disturbances(law, jnp.eye(samples * size).reshape(samples, size, -1))
    )  # (T, A, T L)
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


def test_a_linear_flight_gets_to_its_closed_form(broken, linear):
    mean, covariance = linear.matrices.posterior(broken, linear.hyper, linear.priors)
    made = descend([broken], linear.hyper, linear.priors, np.array([3.0, -4.0]), near=TIGHT)
    se = np.sqrt(np.diag(covariance)[:2])
    assert made.converged and [row.level for row in made.rows if row.level == 0.0]
    np.testing.assert_allclose(made.theta / se, mean[:2] / se, atol=1e-4)
    np.testing.assert_allclose(made.covariance, covariance[:2, :2], rtol=1e-8)
    found = np.concatenate([made.unknowns[0].start, np.asarray(made.flights[0].error).ravel()])
    np.testing.assert_allclose(found, mean[2:], atol=1e-3)


def test_a_fit_that_begins_at_its_optimum_has_converged(broken, linear):
    made = descend([broken], linear.hyper, linear.priors, np.zeros(2), near=TIGHT)
    again = descend([broken], linear.hyper, linear.priors, made.theta, made.flights, (0.0,), near=TIGHT)
    assert again.converged and len(again.rows) < 4
    np.testing.assert_allclose(again.theta, made.theta, atol=1e-3 * np.sqrt(np.diag(made.covariance)).min())


def _same_optimum(drop, shot, made):
    """Whether a fit along the record ends where single shooting does, on a path that obeys."""
    assert made.converged and shot.converged
    away = np.abs(made.theta - shot.theta) / np.sqrt(np.diag(shot.covariance))
    assert away.max() < 0.02
    np.testing.assert_allclose(made.covariance, shot.covariance, rtol=0.02, atol=0.02 * np.abs(shot.covariance).max())
    total = optimum.total_cost([drop.flight], drop.hyper, drop.priors, made.theta, made.unknowns)
    assert total == pytest.approx(shot.cost, abs=0.02)
    (at,) = made.flights
    told = terms(
        drop.flight,
        drop.hyper,
        drop.flight.path.slack,
        at,
        linearise(drop.flight, made.theta, at.latent_path(drop.flight)),
    )
    assert float(told.largest) < 1e-2
    driven = latent_path_of(drop.flight, drop.hyper, at.unknowns)
    np.testing.assert_allclose(at.error, driven.error, atol=1e-9)
    off = np.abs(np.asarray(states(drop.flight, jnp.asarray(made.theta), driven)) - at.path)
    assert off.max() < 0.02


def test_along_the_record_a_drop_is_fitted_as_from_the_truth(drop, shot):
    told = []
    start = np.array([p.centre for p in drop.priors])
    made = descend([drop.flight], drop.hyper, drop.priors, start, near=TIGHT, progress=told.append)
    _same_optimum(drop, shot, made)
    assert tuple(told) == made.rows
    levels = [row.level for row in made.rows]
    assert sorted(levels, reverse=True) == levels and set(levels) == {*along_record.LEVELS, 0.0}
    assert all(row.gain > 0.0 and 0.0 < row.share <= 1.0 for row in made.rows)


@pytest.mark.parametrize("signs", [(1, 1, 1), (-1, 1, -1), (1, -1, -1)])
def test_where_a_fit_along_the_record_begins_does_not_matter(drop, shot, signs):
    """From parameters three standard deviations off, damping that feeds the swing among them."""
    start = np.array([p.centre + 3.0 * sign * p.scale for p, sign in zip(drop.priors, signs, strict=True)])
    assert np.abs((start - shot.theta) / np.sqrt(np.diag(shot.covariance))).min() > 5.0
    made = descend([drop.flight], drop.hyper, drop.priors, start, near=TIGHT)
    _same_optimum(drop, shot, made)


@pytest.mark.parametrize("off", [0.0, 3.0, 30.0])
def test_before_the_path_moves_parameters_fit_it_wherever_they_begin(drop, off):
    """Where the gradient of prior and squares of defects, by finite differences, vanishes."""
    centre, scale = (np.array([getattr(p, name) for p in drop.priors]) for name in ("centre", "scale"))
    level = along_record.Level([drop.flight], drop.hyper, drop.priors, 3.0)
    slack = 3.0 * np.asarray(drop.flight.path.slack)

    def misfit(theta):
        defects = np.asarray(linearise(drop.flight, theta, begin(drop.flight).latent_path(drop.flight)).defects)
        return np.concatenate([(theta - centre) / scale, np.ravel(defects / slack)])

    def slopes(theta):
        return np.stack([(misfit(theta + h) - misfit(theta - h)) / 2e-3 for h in 1e-3 * np.eye(len(centre))], axis=1)

    here = level.point(centre + off * scale, [begin(drop.flight)])
    found = level.on_the_path(here)
    left = np.linalg.lstsq(slopes(found.theta), misfit(found.theta))[0]
    np.testing.assert_allclose(left, 0.0, atol=0.01)
    assert np.abs(centre - found.theta).max() > 0.01
    assert found.merit < here.merit and np.array_equal(found.flights[0].path, here.flights[0].path)


def test_parameters_that_fit_the_path_already_stay(drop):
    level = along_record.Level([drop.flight], drop.hyper, drop.priors, 3.0)
    fitted = level.on_the_path(level.point(np.array([p.centre for p in drop.priors]), [begin(drop.flight)]))
    assert np.max(np.abs(level.on_the_path(fitted).theta - fitted.theta)) < 1e-6


def test_a_drop_whose_fit_begins_at_its_optimum_has_converged(drop, shot, flown):
    at = flown(drop.flight, drop.hyper, shot.theta, shot.unknowns[0])
    made = descend([drop.flight], drop.hyper, drop.priors, shot.theta, [at], (0.0,))
    _same_optimum(drop, shot, made)
    assert len(made.rows) <= 3


@pytest.mark.parametrize("level", [*along_record.LEVELS, 0.0])
def test_what_a_level_lowers_is_what_it_says(drop, level):
    """Cost plus squares, or prices, of the defects, put together by hand at both ends of a level: it falls by its gains."""
    start = np.array([p.centre for p in drop.priors])

    def merit(theta, at):
        slack = (level or along_record.LEVELS[-1]) * drop.flight.path.slack
        told = terms(drop.flight, drop.hyper, slack, at, linearise(drop.flight, theta, at.latent_path(drop.flight)))
        held = float(told.squares) if level else along_record._PRICE * float(told.sizes)
        return 0.5 * float(np.sum(standard(drop.priors, theta) ** 2)) + float(told.data) + held

    made = descend([drop.flight], drop.hyper, drop.priors, start, levels=(level,), most=6)
    gains = [row.gain for row in made.rows]
    problem = along_record.Level([drop.flight], drop.hyper, drop.priors, level)
    first = problem.on_the_path(problem.point(start, [begin(drop.flight)]))
    fell = merit(first.theta, begin(drop.flight)) - merit(made.theta, made.flights[0])
    assert min(gains) > 0.0 and sum(gains) == pytest.approx(fell, rel=1e-9)
    (at,) = made.flights
    lin = linearise(drop.flight, made.theta, at.latent_path(drop.flight))
    sizes = terms(drop.flight, drop.hyper, along_record.LEVELS[-1] * drop.flight.path.slack, at, lin)
    assert made.rows[-1].defect == pytest.approx(float(sizes.largest), rel=1e-9)


def test_a_fit_under_other_noise_parameters_goes_on_from_its_path(drop, shot):
    """Disturbances of the ones before are kept with the path; their process noise are found before parameters move."""
    louder = NoiseParameters(
        drop.hyper.noise, tuple(np.asarray(law) * [1.5, 1.0] for law in drop.hyper.disturbance_parameters)
    )
    before = descend([drop.flight], louder, drop.priors, drop.theta)
    made = descend([drop.flight], drop.hyper, drop.priors, before.theta, before.flights, (0.0,), near=TIGHT)
    _same_optimum(drop, shot, made)
    assert np.isfinite([row.gain for row in made.rows]).all() and min(row.gain for row in made.rows) > 0.0


def test_a_fit_returns_to_where_the_marginal_density_was_greatest(drop, monkeypatch):
    """A log determinant made to rise by 30 a step: minus the density rises faster than any cost falls."""
    start, steps = np.array([p.centre for p in drop.priors]), [0]
    usual = along_record.Level.solved

    def steeper(level, here):
        solved, *rest = usual(level, here)
        passed = level.level == 0.0 and here.defect < 1e-3
        steps[0] += passed
        return [one._replace(determinant=one.determinant + 30.0 * steps[0]) for one in solved], *rest

    held = descend([drop.flight], drop.hyper, drop.priors, start, near=TIGHT)
    monkeypatch.setattr(along_record.Level, "solved", steeper)
    near = TIGHT._replace(fall=10.0)
    made = descend([drop.flight], drop.hyper, drop.priors, start, near=near)
    *_, before, last = made.rows
    assert last.share == 0.0 and last.gain < 0.0 and made.converged and last.defect < 1e-3
    assert last.cost != before.cost and last.cost in [row.cost for row in made.rows[:-1]]
    (at,) = made.flights
    rest = terms(
        drop.flight,
        drop.hyper,
        drop.flight.path.slack,
        at,
        linearise(drop.flight, made.theta, at.latent_path(drop.flight)),
    )
    cost = 0.5 * float(np.sum(standard(drop.priors, made.theta) ** 2)) + float(rest.data)
    assert cost == pytest.approx(last.cost, rel=1e-9)  # parameters and path are those of the place that is told
    np.testing.assert_array_less(0.0, np.diag(made.covariance))
    steps[0] = 0
    free = descend([drop.flight], drop.hyper, drop.priors, start, near=TIGHT)
    assert all(row.share > 0.0 for row in free.rows) and free.rows[-1].cost == pytest.approx(held.rows[-1].cost)


def test_a_fit_whose_marginal_density_does_not_fall_ends_as_without_the_watch(drop, shot):
    start = np.array([p.centre for p in drop.priors])
    watched = descend([drop.flight], drop.hyper, drop.priors, start, near=TIGHT._replace(fall=10.0))
    assert watched.rows == descend([drop.flight], drop.hyper, drop.priors, start, near=TIGHT).rows
    again = descend(
        [drop.flight], drop.hyper, drop.priors, watched.theta, watched.flights, (0.0,), near=TIGHT._replace(fall=10.0)
    )
    _same_optimum(drop, shot, again)


def test_two_flights_share_their_parameters(broken, linear):
    """Two linear flights: the closed form of both together, each on a path of its own."""
    other, u = linear.simulate(replace(broken, path=None), linear.hyper, linear.theta, 8)
    other = _broken(other, linear.hyper, linear.theta, u, seed=5)
    made = descend([broken, other], linear.hyper, linear.priors, np.zeros(2), near=TIGHT)
    want = optimum.fit([broken, other], linear.hyper, linear.priors, np.zeros(2), tolerance=1e-6)
    se = np.sqrt(np.diag(want.covariance))
    np.testing.assert_allclose(made.theta / se, want.theta / se, atol=1e-3)
    np.testing.assert_allclose(made.covariance, want.covariance, rtol=1e-6)
    assert len(made.flights) == 2 and made.converged


def test_a_flight_without_a_path_is_refused(linear, descent):
    for flight in (linear.flight, descent.flights[0]):
        with pytest.raises(ValueError, match="path of its record"):
            begin(flight)
    with pytest.raises(ValueError, match="path of its record"):
        descend([linear.flight], linear.hyper, linear.priors, linear.theta)


def test_without_a_finite_linearisation_nothing_moves(broken, linear):
    lost = replace(broken, path=broken.path._replace(states=np.full_like(broken.path.states, np.nan)))
    made = descend([lost], linear.hyper, linear.priors, linear.theta)
    assert not made.converged and made.rows == ()
    np.testing.assert_array_equal(made.theta, linear.theta)


def test_jax_serves_where_there_is_no_machine_code(descent, monkeypatch):
    pytest.importorskip("llvmlite")
    flight, u = descent.flights[0], descent.u[0]
    flight = _broken(flight, descent.hyper, descent.theta, u, size=5.0)
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


def _largest(flight, theta, at, hyper):
    slack = along_record.LEVELS[-1] * flight.path.slack
    return float(terms(flight, hyper, slack, at, linearise(flight, theta, at.latent_path(flight))).largest)


def test_at_rest_a_linear_flight_is_at_its_dense_conditional_mean(broken, linear, flown):
    """And the slope by the parameters is that with everything else following, from a path that is no flight at all."""
    mean, covariance = linear.matrices.posterior(broken, linear.hyper, linear.priors)
    theta = np.array([1.5, 0.4])
    found = conditional_optimum([broken], linear.hyper, linear.priors, theta, [begin(broken)])
    gain = np.linalg.solve(covariance[:2, :2], covariance[:2, 2:]).T
    (at,) = found.flights
    got = np.concatenate([at.unknowns.start, np.asarray(at.error).ravel()])
    np.testing.assert_allclose(got, mean[2:] + gain @ (theta - mean[:2]), atol=1e-8)
    precision = np.linalg.inv(covariance[:2, :2])
    np.testing.assert_allclose(found.matrix, precision, rtol=1e-7)
    np.testing.assert_allclose(found.gradient, precision @ (theta - mean[:2]), rtol=1e-6)
    total = optimum.total_cost([broken], linear.hyper, linear.priors, theta, [at.unknowns])
    assert found.cost == pytest.approx(total, rel=1e-9) and found.defect < 1e-8
    # A step onward is exact, whatever its length.
    (there,) = onward([broken], linear.hyper, theta, found, mean[:2] - theta)
    got = np.concatenate([there.unknowns.start, np.asarray(there.error).ravel()])
    np.testing.assert_allclose(got, mean[2:], atol=1e-8)
    own = flown(broken, linear.hyper, mean[:2], there.unknowns)
    np.testing.assert_allclose(there.path, own.path, atol=1e-8)


def test_at_rest_a_descent_s_slope_is_that_of_its_least_cost(descent, flown):
    """Against central differences; brought to rest again nothing moves, and a step onward stays near it."""
    theta, given = descent.theta + 0.3, (descent.flights, descent.hyper, descent.priors)
    off = [flown(f, descent.hyper, theta, f.still()) for f in descent.flights]
    found = conditional_optimum(*given, theta, off)
    sd = 1.0 / np.sqrt(found.matrix[0, 0])
    h = 0.05 * sd

    def least(at):
        held = [replace(descent.priors[0], centre=at[0], scale=1e-7)]
        best = optimum.fit(descent.flights, descent.hyper, held, at, tolerance=1e-4)
        return best.cost + 0.5 * ((at[0] - descent.priors[0].centre) / descent.priors[0].scale) ** 2

    slope = (least(theta + h) - least(theta - h)) / (2.0 * h)
    assert found.gradient[0] == pytest.approx(slope, rel=0.02)
    assert found.cost == pytest.approx(least(theta), abs=0.06)
    again = conditional_optimum(*given, theta, found.flights)
    assert abs(again.cost - found.cost) < 0.05 and abs(again.gradient - found.gradient)[0] < 0.05 / sd
    step = np.array([0.5 * sd])
    ends, near = onward(*given[:2], theta, again, step), conditional_optimum(*given, theta + step, again.flights)
    for end, at in zip(ends, near.flights, strict=True):
        np.testing.assert_allclose(end.path, at.path, atol=0.05 * np.abs(at.path).max())
        np.testing.assert_allclose(end.unknowns.process_noise, at.unknowns.process_noise, atol=0.1)


def test_steps_that_go_too_far_or_not_far_enough_are_solved_after_as_many_as_directions():
    """Anderson's method on an affine map: exact, whatever the map's eigenvalues, once every direction was gone."""
    rng, rest, size = np.random.default_rng(0), np.array([0.7, -1.2, 0.4]), 3
    axes = np.linalg.qr(rng.standard_normal((size, size)))[0]
    overshoot = axes @ np.diag([5.0, 1.0, 0.2]) @ axes.T  # of the way to rest that a step takes

    def place(u):
        return Lifted(Unknowns(u[:1], u[1:, None]), 2.0 * u[1:, None], np.ones((2, 1)) * u[0])

    tried, u = [], np.zeros(size)
    for turn in range(size + 1):
        tried.append(([place(u)], [place(u + overshoot @ (rest - u))]))
        (found,) = along_record._accelerated(tried)
        wanted = place(u + overshoot @ (rest - u)) if turn == 0 else place(rest) if turn == size else None
        if wanted is not None:
            jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-9), found, wanted)
        u = np.append(found.unknowns.start, found.unknowns.process_noise)


def test_accelerated_steps_come_to_rest_where_plain_ones_do(drop, shot, monkeypatch):
    """Sooner or later: plain ones are given all the time they want."""
    theta = shot.theta + 1.5 * np.sqrt(np.diag(shot.covariance))
    given = [drop.flight], drop.hyper, drop.priors, theta, shot.flights
    found = conditional_optimum(*given)
    monkeypatch.setattr(along_record, "_accelerated", lambda tried: tried[-1][1])
    monkeypatch.setattr(along_record, "_RESTING", 1e-6)
    monkeypatch.setattr(along_record, "_MOST_RESTING", 100)
    plain = conditional_optimum(*given)
    assert found.cost == pytest.approx(plain.cost, abs=2.0 * 0.01) and found.defect < 1e-3
    assert found.marginal == pytest.approx(plain.marginal, abs=0.05)


def test_at_rest_a_drop_obeys(drop, shot):
    """Start, process noise and path from the record's path, parameters held at the optimum of single shooting."""
    rough = descend([drop.flight], drop.hyper, drop.priors, shot.theta, near=along_record.Near(1e4, np.inf, 0.5))
    found = conditional_optimum([drop.flight], drop.hyper, drop.priors, shot.theta, rough.flights)
    assert found.cost == pytest.approx(shot.cost, abs=0.1)
    sd = np.sqrt(np.diag(shot.covariance))
    assert np.abs(found.gradient * sd).max() < 0.2 and found.defect < 0.02
    (at,) = found.flights
    assert found.defect == pytest.approx(_largest(drop.flight, shot.theta, at, drop.hyper), rel=1e-6)
    assert np.abs(np.asarray(at.path) - shot.flights[0].path).max() < 0.05


def test_where_nothing_is_finite_nothing_rests(descent, flown):
    at = [flown(f, descent.hyper, descent.theta, f.still()) for f in descent.flights]
    assert conditional_optimum(descent.flights, descent.hyper, descent.priors, np.array([np.nan]), at) is None


def test_a_row_is_a_line_of_the_log():
    row = along_record.Row(0.3, 1234.5678, 0.0123, 0.5, 0.0456, 0.2)
    assert str(row) == "slack 0.3: cost 1234.57, gain 0.5, defect 0.012, step 0.046 standard errors, share 0.2"
