"""The objective at a level of slack: what it lowers, and where parameters go before a path moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayeschute.likelihood.joint import FlightData, linearise, stepped
from bayeschute.likelihood.priors import Prior, standard
from bayeschute.posterior import joint_mode as optimum
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


@pytest.fixture(scope="module")
def pair(drop):
    """The drop twice, each with an error of its own wind, and the priors of all parameters."""
    names = [p.name for p in drop.priors]
    error = Prior("wind_bias.north", 0.0, 0.5, False, "m/s", "")
    own = [("wind_bias.north", ""), ("", "wind_bias.north")]
    models = (replace(drop.flight.model, names=(*names, *both)) for both in own)
    return [replace(drop.flight, model=model) for model in models], [*drop.priors, error, error]


@pytest.mark.parametrize("level", [LEVELS[-1], 0.0])
def test_flights_with_errors_of_their_own_are_as_if_each_were_asked_for_all_of_them(pair, drop, level, monkeypatch):
    """Naive twin: every flight with derivatives by all parameters, those of the other's error being zero."""
    flights, priors = pair
    problem = slack_level.Level(flights, drop.hyper, priors, level)
    theta = np.array([*drop.theta, 0.3, -0.2])
    at = [begin(flight) for flight in flights]
    step = np.array([0.01, 0.02, -0.01, 0.1, 0.2])

    def told():
        here = problem.point(theta, at)
        solved, matrix, gradient = problem.solved(here)
        ends = problem.moved(here, solved, step)
        held = [optimum.conditional(f, drop.hyper, linear) for f, linear in zip(flights, here.along, strict=True)]
        whole, slope = np.zeros((5, 5)), np.zeros(5)
        for one in held:
            one.add_to(whole, slope)
        found = problem.on_the_path(here)
        sizes = [one.steps.by_theta.shape[-1] for one in here.along]
        return sizes, [matrix, gradient, *(end.path for end in ends), whole, slope, found.theta]

    def asked_for_all(data, theta):
        return data, theta, np.arange(len(theta))

    sizes, got = told()
    monkeypatch.setattr(FlightData, "own", asked_for_all)
    all_of, want = told()
    assert sizes == [4, 4] and all_of == [5, 5]
    for one, other in zip(got, want, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9 * np.max(np.abs(other)))


def test_an_error_of_the_other_flight_alone_moves_nothing_of_a_flight(pair, drop):
    flights, _ = pair
    theta, other = np.array([*drop.theta, 0.3, -0.2]), np.array([*drop.theta, 0.3, 4.0])
    at = begin(flights[0]).latent_path(flights[0])
    for one, same in zip(stepped(flights[0], theta, at), stepped(flights[0], other, at), strict=True):
        np.testing.assert_array_equal(one, same)
    assert np.max(np.abs(stepped(flights[1], theta, at)[1] - stepped(flights[1], other, at)[1])) > 1e-3
