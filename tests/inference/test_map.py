"""The optimum against the closed form, and what it says when it fails."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayeschute.inference.map import fit, total_cost


@pytest.fixture(scope="module")
def found(descent):
    start = [np.zeros(f.unknowns) for f in descent.flights]
    return fit(descent.flights, descent.hyper, descent.priors, descent.theta + 0.5, start)


def test_linear_gaussian_problem_has_the_closed_form(linear):
    best = fit(
        [linear.flight], linear.hyper, linear.priors, np.zeros(2), [np.zeros(linear.flight.unknowns)], tolerance=1e-6
    )
    mean, covariance = linear.matrices.posterior(linear.flight, linear.hyper, linear.priors)
    se = np.sqrt(np.diag(covariance))
    assert best.converged and best.iterations <= 6
    np.testing.assert_allclose(np.concatenate([best.theta, best.u[0]]) / se, mean / se, atol=1e-5)
    np.testing.assert_allclose(best.covariance, covariance[:2, :2], rtol=1e-6)
    np.testing.assert_allclose(np.linalg.inv(best.precision), covariance, atol=1e-7 * np.abs(covariance).max())


def test_converges_from_an_offset_start(descent, found):
    assert found.converged and found.last_step < 0.01
    again = fit(descent.flights, descent.hyper, descent.priors, descent.theta - 0.5, found.u)
    se = np.sqrt(found.covariance[0, 0])
    assert abs(again.theta[0] - found.theta[0]) < 0.05 * se
    assert abs(found.theta[0] - descent.theta[0]) < 4.0 * se


def test_the_cost_never_rises(descent, found):
    assert (np.diff(found.trace) <= 1e-9 * np.abs(found.trace[:-1])).all()
    start = total_cost(descent.flights, descent.hyper, descent.priors, descent.theta + 0.5, [np.zeros(12)] * 2)
    assert found.trace[0] < start
    assert found.cost == pytest.approx(total_cost(descent.flights, descent.hyper, descent.priors, found.theta, found.u))


def test_the_optimum_is_stationary(descent, found):
    at = total_cost(descent.flights, descent.hyper, descent.priors, found.theta, found.u)
    for shift in (-0.3, 0.3):
        moved = found.theta + shift * np.sqrt(found.covariance[0])
        assert total_cost(descent.flights, descent.hyper, descent.priors, moved, found.u) > at


def test_an_early_stop_is_said(descent):
    best = fit(descent.flights, descent.hyper, descent.priors, descent.theta + 0.5, [np.zeros(12)] * 2, most=1)
    assert not best.converged and best.iterations == 1 and best.last_step > 0.01


def test_progress_is_told(descent, found):
    heard = []
    fit(descent.flights, descent.hyper, descent.priors, found.theta, found.u, progress=lambda *told: heard.append(told))
    assert heard and heard[-1][2] < 0.01


def test_a_start_that_fails_is_refused(descent):
    spoiled = [
        replace(descent.flights[0], observed=np.full_like(descent.flights[0].observed, np.inf)),
        descent.flights[1],
    ]
    with pytest.raises(FloatingPointError, match="starting point"):
        fit(spoiled, descent.hyper, descent.priors, descent.theta, [np.zeros(12)] * 2)
