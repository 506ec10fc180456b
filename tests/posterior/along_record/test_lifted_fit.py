"""The fit along the record against single shooting, dense matrices and the closed form, from paths that break the rules."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from tests.posterior.along_record.conftest import broken_path

from bayeschute.likelihood.joint import NoiseParameters, latent_path_of, linearise, states
from bayeschute.likelihood.priors import standard
from bayeschute.posterior import joint_mode as optimum
from bayeschute.posterior.along_record import lifted_fit, slack_level
from bayeschute.posterior.along_record.lifted_fit import begin, descend
from bayeschute.posterior.along_record.linear_problem import terms
from bayeschute.posterior.along_record.slack_level import LEVELS, Near

TIGHT = Near(1e-4, 1e-3)  # gain and step at which a fit is compared to another


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
    assert sorted(levels, reverse=True) == levels and set(levels) == {*LEVELS, 0.0}
    assert all(row.gain > 0.0 and 0.0 < row.share <= 1.0 for row in made.rows)


@pytest.mark.parametrize("signs", [(1, 1, 1), (-1, 1, -1), (1, -1, -1)])
def test_where_a_fit_along_the_record_begins_does_not_matter(drop, shot, signs):
    """From parameters three standard deviations off, damping that feeds the swing among them."""
    start = np.array([p.centre + 3.0 * sign * p.scale for p, sign in zip(drop.priors, signs, strict=True)])
    assert np.abs((start - shot.theta) / np.sqrt(np.diag(shot.covariance))).min() > 5.0
    made = descend([drop.flight], drop.hyper, drop.priors, start, near=TIGHT)
    _same_optimum(drop, shot, made)


def test_a_drop_whose_fit_begins_at_its_optimum_has_converged(drop, shot, flown):
    at = flown(drop.flight, drop.hyper, shot.theta, shot.unknowns[0])
    made = descend([drop.flight], drop.hyper, drop.priors, shot.theta, [at], (0.0,))
    _same_optimum(drop, shot, made)
    assert len(made.rows) <= 3


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
    usual = slack_level.Level.solved

    def steeper(level, here):
        solved, *rest = usual(level, here)
        passed = level.level == 0.0 and here.defect < 1e-3
        steps[0] += passed
        return [one._replace(determinant=one.determinant + 30.0 * steps[0]) for one in solved], *rest

    held = descend([drop.flight], drop.hyper, drop.priors, start, near=TIGHT)
    monkeypatch.setattr(slack_level.Level, "solved", steeper)
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
    other = broken_path(other, linear.hyper, linear.theta, u, seed=5)
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


def test_a_row_is_a_line_of_the_log():
    row = lifted_fit.Row(0.3, 1234.5678, 0.0123, 0.5, 0.0456, 0.2)
    whole = "slack 0.3: cost 1234.57, gain 0.5, defect 0.012, step 0.046 standard errors"
    assert str(row) == f"{whole}, 0.2 of the whole" and str(row._replace(share=1.0)) == whole
    assert str(row._replace(share=0.0)) == f"{whole}, back to an earlier place"
