"""At rest for fixed parameters: against the closed form, differences and single shooting."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import jax
import numpy as np
import pytest

from bayeschute.likelihood.joint import Lifted, Unknowns, as_seen, filter_gains, linearise
from bayeschute.likelihood.kalman import innovations
from bayeschute.posterior import joint_mode as optimum
from bayeschute.posterior.along_record import conditional_mode
from bayeschute.posterior.along_record.conditional_mode import approached, brought, conditional_optimum, onward, resting
from bayeschute.posterior.along_record.lifted_fit import begin, descend
from bayeschute.posterior.along_record.linear_problem import terms
from bayeschute.posterior.along_record.slack_level import LEVELS, Level, Near


def _largest(flight, theta, at, hyper):
    slack = LEVELS[-1] * flight.path.slack
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
        (found,) = conditional_mode._accelerated(tried)
        wanted = place(u + overshoot @ (rest - u)) if turn == 0 else place(rest) if turn == size else None
        if wanted is not None:
            jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-9), found, wanted)
        u = np.append(found.unknowns.start, found.unknowns.process_noise)


def test_accelerated_steps_come_to_rest_where_plain_ones_do(drop, shot, monkeypatch):
    """Sooner or later: plain ones are given all the time they want."""
    theta = shot.theta + 1.5 * np.sqrt(np.diag(shot.covariance))
    given = [drop.flight], drop.hyper, drop.priors, theta, shot.flights
    found = conditional_optimum(*given)
    monkeypatch.setattr(conditional_mode, "_accelerated", lambda tried: tried[-1][1])
    monkeypatch.setattr(conditional_mode, "resting", partial(resting, near=1e-6, most=100))
    plain = conditional_optimum(*given)
    assert found.cost == pytest.approx(plain.cost, abs=2.0 * 0.01) and found.defect < 1e-3
    assert found.marginal == pytest.approx(plain.marginal, abs=0.05)


def test_steps_that_lead_nowhere_end_the_search_where_it_is(drop, shot, monkeypatch):
    """The linear problem of a flight that diverges has no digits left, at once or after some steps."""
    theta, usual = shot.theta + 1.5 * np.sqrt(np.diag(shot.covariance)), Level.relaxed
    for turn in (1, 2, 3):
        asked = []

        def relaxed(level, here, turn=turn, asked=asked):
            asked.append(here)
            made = usual(level, here)
            lost = jax.tree.map(lambda a: np.full(np.shape(a), np.nan), made.ends)
            return made._replace(ends=lost, gain=10.0) if len(asked) == turn else made

        monkeypatch.setattr(Level, "relaxed", relaxed)
        rough = descend([drop.flight], drop.hyper, drop.priors, shot.theta, near=Near(1e4, np.inf, 0.5))
        asked.clear()
        found = conditional_optimum([drop.flight], drop.hyper, drop.priors, theta, rough.flights)
        assert len(asked) >= turn and np.isfinite(found.cost)


def test_at_rest_a_drop_obeys(drop, shot):
    """Start, process noise and path from the record's path, parameters held at the optimum of single shooting."""
    rough = descend([drop.flight], drop.hyper, drop.priors, shot.theta, near=Near(1e4, np.inf, 0.5))
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


@pytest.mark.parametrize("share", [-1.0, 0.5, 1.0])
def test_a_flight_is_at_rest_where_its_density_is_taken(drop, shot, monkeypatch, share):
    """Else the correction of the mean is that about another path. Squares and log determinant are those at rest."""
    gains, given = [], ([drop.flight], drop.hyper)
    relaxed = Level.relaxed

    def heard(level, here):
        made = relaxed(level, here)
        gains.append(made.gain)
        return made

    theta = shot.theta + share * np.sqrt(np.diag(shot.covariance))
    monkeypatch.setattr(Level, "relaxed", heard)
    (got,) = approached(*given, theta, shot.flights)
    assert gains[-1] < 0.01 < gains[0]
    ((_, linear),) = brought(*given, theta, shot.flights)
    want = filter_gains(drop.flight, drop.hyper, linear)
    assert float(got.gains.log_determinant) == pytest.approx(float(want.log_determinant), abs=0.05)
    there, here = (innovations(made, *as_seen(one)) for made, one in ((got.gains, got.linear), (want, linear)))
    assert 0.5 * np.sum(there[..., 0] ** 2) == pytest.approx(0.5 * np.sum(here[..., 0] ** 2), abs=0.02)
    assert got.linear.steps.by_theta.shape[-1] == 0
