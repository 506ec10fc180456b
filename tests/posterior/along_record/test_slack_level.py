"""The objective at a level of slack: what it lowers, and where parameters go before a path moves."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.likelihood.joint import linearise
from bayeschute.likelihood.priors import standard
from bayeschute.posterior.along_record import slack_level
from bayeschute.posterior.along_record.lifted_fit import begin, descend
from bayeschute.posterior.along_record.linear_problem import terms
from bayeschute.posterior.along_record.slack_level import LEVELS


@pytest.mark.parametrize("off", [0.0, 3.0, 30.0])
def test_before_the_path_moves_parameters_fit_it_wherever_they_begin(drop, off):
    """Where the gradient of prior and squares of defects, by finite differences, vanishes."""
    centre, scale = (np.array([getattr(p, name) for p in drop.priors]) for name in ("centre", "scale"))
    level = slack_level.Level([drop.flight], drop.hyper, drop.priors, 3.0)
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
    level = slack_level.Level([drop.flight], drop.hyper, drop.priors, 3.0)
    fitted = level.on_the_path(level.point(np.array([p.centre for p in drop.priors]), [begin(drop.flight)]))
    assert np.max(np.abs(level.on_the_path(fitted).theta - fitted.theta)) < 1e-6


def test_a_step_that_diverges_leaves_the_parameters_where_they_are(drop):
    """Its sensitivities, 32 orders of magnitude above the others', leave these no digit: their squares are singular."""
    level = slack_level.Level([drop.flight], drop.hyper, drop.priors, 3.0)
    here = level.point(np.array([p.centre for p in drop.priors]), [begin(drop.flight)])
    (made,) = here.along
    by_theta = np.array(made.steps.by_theta)
    by_theta[-1] = 1e32
    lost = here._replace(along=(made._replace(steps=made.steps._replace(by_theta=by_theta)),))
    assert level.on_the_path(lost) is lost


@pytest.mark.parametrize("level", [*LEVELS, 0.0])
def test_what_a_level_lowers_is_what_it_says(drop, level):
    """Cost plus squares, or prices, of the defects, put together by hand at both ends of a level: it falls by its gains."""
    start = np.array([p.centre for p in drop.priors])

    def merit(theta, at):
        slack = (level or LEVELS[-1]) * drop.flight.path.slack
        told = terms(drop.flight, drop.hyper, slack, at, linearise(drop.flight, theta, at.latent_path(drop.flight)))
        held = float(told.squares) if level else slack_level._PRICE * float(told.sizes)
        return 0.5 * float(np.sum(standard(drop.priors, theta) ** 2)) + float(told.data) + held

    made = descend([drop.flight], drop.hyper, drop.priors, start, levels=(level,), most=6)
    gains = [row.gain for row in made.rows]
    problem = slack_level.Level([drop.flight], drop.hyper, drop.priors, level)
    first = problem.on_the_path(problem.point(start, [begin(drop.flight)]))
    fell = merit(first.theta, begin(drop.flight)) - merit(made.theta, made.flights[0])
    assert min(gains) > 0.0 and sum(gains) == pytest.approx(fell, rel=1e-9)
    (at,) = made.flights
    lin = linearise(drop.flight, made.theta, at.latent_path(drop.flight))
    sizes = terms(drop.flight, drop.hyper, LEVELS[-1] * drop.flight.path.slack, at, lin)
    assert made.rows[-1].defect == pytest.approx(float(sizes.largest), rel=1e-9)
