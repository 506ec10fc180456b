"""The optimum against the closed form, and what it says when it fails."""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np
import pytest

from bayeschute.likelihood.joint import latent_path_of, linearise, states
from bayeschute.posterior import joint_mode as module
from bayeschute.posterior.joint_mode import conditional, fit, total_cost


@pytest.fixture(scope="module")
def found(descent):
    return fit(descent.flights, descent.hyper, descent.priors, descent.theta + 0.5)


@pytest.fixture(scope="module")
def exact(linear):
    return linear.matrices.posterior(linear.flight, linear.hyper, linear.priors)


def _straight(linear, **options):
    return fit([linear.flight], linear.hyper, linear.priors, np.zeros(2), tolerance=1e-6, **options)


def _dense(linear, theta, u):
    """Theta, start and disturbances in one vector, as the matrices have them."""
    return np.concatenate([theta, u.start, np.asarray(latent_path_of(linear.flight, linear.hyper, u).error).ravel()])


def test_linear_gaussian_problem_has_the_closed_form(linear, exact):
    best = _straight(linear)
    mean, covariance = exact
    se = np.sqrt(np.diag(covariance))
    assert best.converged and best.iterations <= 6
    np.testing.assert_allclose(_dense(linear, best.theta, best.unknowns[0]) / se, mean / se, atol=1e-5)
    np.testing.assert_allclose(best.covariance, covariance[:2, :2], rtol=1e-6)


def test_a_flight_may_fail_after_its_last_datum_where_only_its_opening_is_fitted(linear, monkeypatch):
    present = np.array(linear.flight.present)
    last = len(present) // 2
    present[last + 1 :] = False
    seen = replace(linear.flight, present=present)

    def fitted(**options):
        return fit([seen], linear.hyper, linear.priors, np.zeros(2), tolerance=1e-6, **options)

    whole = fitted()

    def failing(*given):
        """The step from the last datum, and all that comes after it, is lost."""
        made = linearise(*given)
        by_step = {n: np.array(getattr(made.steps, n)) for n in ("by_state", "by_theta", "by_now", "by_then")}
        by_out = {n: np.array(getattr(made.steps, n)) for n in ("out_state", "out_theta")}
        for rows, first in ((by_step, last), (by_out, last + 1)):
            for array in rows.values():
                array[first:] = np.nan
        return made._replace(steps=made.steps._replace(**by_step, **by_out))

    monkeypatch.setattr(module, "linearise", failing)
    found = fitted(first_part=True)
    np.testing.assert_allclose(found.theta, whole.theta, rtol=1e-9)
    np.testing.assert_allclose(found.covariance, whole.covariance, rtol=1e-9)
    np.testing.assert_allclose(found.unknowns[0].start, whole.unknowns[0].start, atol=1e-9)
    np.testing.assert_allclose(found.unknowns[0].process_noise, whole.unknowns[0].process_noise, atol=1e-9)
    with pytest.raises(FloatingPointError, match="starting point"):
        fitted()
    last -= 1
    with pytest.raises(FloatingPointError, match="starting point"):
        fitted(first_part=True)


def test_tilt_moves_the_optimum_by_the_covariance(linear, exact):
    mean, covariance = exact
    tilt = np.array([3.0, -2.0]) / np.sqrt(np.diag(covariance)[:2])
    best = _straight(linear, tilt=tilt)
    plain = total_cost([linear.flight], linear.hyper, linear.priors, best.theta, best.unknowns)
    se = np.sqrt(np.diag(covariance)[:2])
    np.testing.assert_allclose(best.theta / se, (mean[:2] - covariance[:2, :2] @ tilt) / se, atol=1e-5)
    assert np.abs((best.theta - mean[:2]) / se).max() > 1.0  # it is no small move
    np.testing.assert_allclose(best.covariance, covariance[:2, :2], rtol=1e-6)
    assert best.cost == pytest.approx(plain + tilt @ best.theta)
    # Start and disturbances follow theta along their conditional mean.
    follow = mean[2:] + covariance[2:, :2] @ np.linalg.solve(covariance[:2, :2], best.theta - mean[:2])
    np.testing.assert_allclose(_dense(linear, best.theta, best.unknowns[0])[2:], follow, atol=1e-5)


def test_unknowns_given_theta_are_the_conditional_mean(linear, exact):
    mean, covariance = exact
    driven = latent_path_of(linear.flight, linear.hyper, linear.u)
    given = conditional(linear.flight, linear.hyper, linearise(linear.flight, linear.theta, driven))
    gain = np.linalg.solve(covariance[:2, :2], covariance[:2, 2:]).T
    wanted = mean[2:] + gain @ (linear.theta - mean[:2])
    np.testing.assert_allclose(_dense(linear, linear.theta, given.optimum)[2:], wanted, atol=1e-9)
    for k in range(2):
        slope = jax.tree.map(lambda a, k=k: -np.asarray(a)[..., k], given.slope)
        np.testing.assert_allclose(_dense(linear, linear.theta, slope)[2:], gain[:, k], atol=1e-9)
    precision = np.linalg.inv(covariance[:2, :2])
    prior = np.diag([p.scale**-2 for p in linear.priors])
    np.testing.assert_allclose(given.matrix, precision - prior, rtol=1e-8)
    centre = np.array([p.centre for p in linear.priors])
    gradient = precision @ (linear.theta - mean[:2]) - prior @ (linear.theta - centre)
    np.testing.assert_allclose(given.gradient, gradient, rtol=1e-8)


def test_converges_from_an_offset_start(descent, found):
    assert found.converged and found.last_step < 0.01
    again = fit(descent.flights, descent.hyper, descent.priors, descent.theta - 0.5, found.unknowns)
    se = np.sqrt(found.covariance[0, 0])
    assert abs(again.theta[0] - found.theta[0]) < 0.05 * se
    assert abs(found.theta[0] - descent.theta[0]) < 4.0 * se


def test_the_cost_never_rises(descent, found):
    given = (descent.flights, descent.hyper, descent.priors)
    assert (np.diff(found.trace) <= 1e-9 * np.abs(found.trace[:-1])).all()
    start = total_cost(*given, descent.theta + 0.5, [f.still() for f in descent.flights])
    assert found.trace[0] < start and len(found.trace) == found.iterations > 1
    assert found.cost == found.trace[-1] == pytest.approx(total_cost(*given, found.theta, found.unknowns))


def test_the_optimum_is_stationary(descent, found):
    given = (descent.flights, descent.hyper, descent.priors)
    at = total_cost(*given, found.theta, found.unknowns)
    for shift in (-0.3, 0.3):
        moved = found.theta + shift * np.sqrt(found.covariance[0])
        assert total_cost(*given, moved, found.unknowns) > at
        pushed = [jax.tree.map(lambda a, s=shift: np.asarray(a) + 0.1 * s, u) for u in found.unknowns]
        assert total_cost(*given, found.theta, pushed) > at


def test_prior_is_counted_once(descent, found):
    given = (descent.flights, descent.hyper)
    prior = descent.priors[0]
    with_it, without = (
        total_cost(*given, p, found.theta, found.unknowns) for p in (descent.priors, [replace(prior, scale=1e9)])
    )
    assert with_it - without == pytest.approx(0.5 * ((found.theta[0] - prior.centre) / prior.scale) ** 2)


def test_converged_holds_for_start_and_disturbances_too(descent):
    """Parameters known beforehand don't move in the first step; the rest is far from its optimum then."""
    flight, tight = descent.flights[0], [replace(descent.priors[0], centre=descent.theta[0], scale=1e-3)]
    far = replace(
        flight,
        observed=np.where(flight.present, flight.observed + 4.0 * np.exp(-flight.dt * np.arange(101)[:, None]), 0.0),
    )
    loose, strict = (fit([far], descent.hyper, tight, descent.theta, tolerance=t) for t in (0.1, 1e-6))
    assert loose.converged and strict.converged
    assert loose.cost == pytest.approx(strict.cost, abs=0.1)
    assert loose.trace[0] - strict.cost > 0.5  # where one step ends


def test_an_early_stop_is_said(descent):
    best = fit(descent.flights, descent.hyper, descent.priors, descent.theta + 0.5, most=1)
    assert not best.converged and best.iterations == 1 and best.last_step > 0.01


def test_progress_is_told(descent, found):
    heard = []
    fit(
        descent.flights, descent.hyper, descent.priors, found.theta, found.unknowns,
        progress=lambda *told: heard.append(told),
    )  # fmt: skip
    assert heard and heard[-1][2] < 0.01 and [told[0] for told in heard] == list(range(1, len(heard) + 1))


def test_a_start_that_fails_is_refused(descent):
    spoiled = replace(descent.flights[0], observed=np.full_like(descent.flights[0].observed, np.inf))
    with pytest.raises(FloatingPointError, match="starting point"):
        fit([spoiled, descent.flights[1]], descent.hyper, descent.priors, descent.theta)


def test_a_step_into_failure_is_damped(descent):
    """A tilt towards drag at which the integration blows up: the first full step and its quarter fail."""
    tilt = np.array([-3e4])
    best = fit(descent.flights, descent.hyper, descent.priors, descent.theta, tilt=tilt)
    given = [
        conditional(f, descent.hyper, linearise(f, descent.theta, latent_path_of(f, descent.hyper, f.still())))
        for f in descent.flights
    ]
    full = -tilt / (sum(float(g.matrix[0, 0]) for g in given) + descent.priors[0].scale ** -2)
    still = [f.still() for f in descent.flights]
    for share in (1.0, 0.25):
        moved = descent.theta + share * full
        assert total_cost(descent.flights, descent.hyper, descent.priors, moved, still) == np.inf
    assert np.isfinite(best.trace).all() and (np.diff(best.trace) <= 0.0).all()
    assert (
        best.trace[-1]
        < total_cost(descent.flights, descent.hyper, descent.priors, descent.theta, still) + tilt @ descent.theta
    )
    assert not best.converged  # its optimum lies where nothing can be simulated, and that is said
    assert np.isfinite(best.theta).all() and np.isfinite(best.covariance).all()


def test_a_cost_that_is_not_finite_is_infinite(descent, found):
    given = (descent.flights, descent.hyper, descent.priors)
    assert total_cost(*given, np.array([150.0]), found.unknowns) == np.inf


def test_flights_of_an_optimum_are_on_the_paths_of_their_simulations(descent, found):
    for flight, at, u in zip(descent.flights, found.flights, found.unknowns, strict=True):
        driven = latent_path_of(flight, descent.hyper, u)
        np.testing.assert_array_equal(at.error, driven.error)
        np.testing.assert_array_equal(at.path, states(flight, found.theta, driven))
    for lin, flight, u in zip(found.linear(descent.flights), descent.flights, found.unknowns, strict=True):
        wanted = linearise(flight, found.theta, latent_path_of(flight, descent.hyper, u))
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-9), lin, wanted)
