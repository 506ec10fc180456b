"""The joint optimum with its noise parameters: ways along the record, turns of noise, and fits that end without one."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bayeschute.compiler.runge_kutta import CLASSICAL, EXTENDED, Stepping
from bayeschute.likelihood.joint import Lifted
from bayeschute.posterior import joint_mode, noise_evidence
from bayeschute.posterior.along_record import lifted_fit
from bayeschute.posterior.along_record.slack_level import LEVELS, NEAR
from bayeschute.posterior.fit import joint_fit
from bayeschute.posterior.joint_mode import Optimum
from bayeschute.posterior.noise_evidence import NoisePrior

OWN, LOUD = pytest.approx(1.0), pytest.approx(3.0)


def _ways(hyper, at=None):
    return [*([joint_fit._from_path(hyper, at)] if at else []), *joint_fit._from_record(hyper)]


def _row(defect, cost=12.0):
    return lifted_fit.Row(0.0, cost, defect, 1.0, 1.0, 1.0)


def test_a_fit_along_the_record_takes_the_flight_s_small_steps(monkeypatch, descent):
    """And where it led is a place of the flight as it was given."""
    at, seen = Lifted(descent.flights[0].still(), np.zeros((1, 1)), np.zeros((1, 1))), []

    def led(flights, hyper, priors, theta, places, levels, near=None, progress=None):
        seen.extend(flight.model.stepping for flight in flights)
        return lifted_fit.LiftedFit(theta, (at,), np.eye(1), (_row(1e-4),), True)

    monkeypatch.setattr(lifted_fit, "descend", led)
    long = Stepping(2, EXTENDED, classical=5)
    flights = [replace(f, model=replace(f.model, stepping=long)) for f in descent.flights]
    ways = _ways(descent.hyper, [at])
    joint_fit._along_record(flights, descent.priors, np.zeros(1), [ways], NEAR, print)
    assert seen == [Stepping(5, CLASSICAL, 5)] * len(flights) and flights[0].model.stepping == long


def test_what_is_fast_is_tried_first_then_what_gets_further(monkeypatch, descent):
    """The first that gets there is kept."""
    at, tried = Lifted(descent.flights[0].still(), np.zeros((1, 1)), np.zeros((1, 1))), []

    def late(flights, hyper, priors, theta, places, levels, near=None, progress=None):
        tried.append((places is not None, tuple(levels)))
        return lifted_fit.LiftedFit(theta, (at,), np.eye(1), (_row(1e-4 if len(tried) == 3 else 0.5),), True)

    monkeypatch.setattr(lifted_fit, "descend", late)
    ways = _ways(descent.hyper, [at])
    (made,) = joint_fit._along_record(descent.flights, descent.priors, np.zeros(1), [ways], NEAR, print)
    assert made.cost == 12.0 and made.converged
    small = tried[-1][1]
    assert tried == [(True, (0.0,)), (False, (*LEVELS, 0.0)), (False, small)]
    assert len(small) > len(LEVELS) + 1 and small[-1] == 0.0 and sorted(small, reverse=True) == list(small)


@pytest.mark.parametrize(
    ("fails", "evidence", "kept"),
    [
        ((), (5.0, 4.0), 1),  # minus the log evidence of the two second turns: from the path, anew
        ((), (4.0, 5.0), 0),
        (("path",), (4.0, 5.0), 1),
        (("anew",), (5.0, 4.0), 0),
    ],
)
def test_the_second_turn_goes_on_where_the_evidence_is_greater(monkeypatch, descent, fails, evidence, kept):
    """From the path of the first, whose noise is stronger than told, and from the record anew."""
    flights = [replace(f, path=SimpleNamespace()) for f in descent.flights]
    at, asked = [Lifted(f.still(), np.zeros((1, 1)), np.zeros((1, 1))) for f in flights], []

    def descended(flights, hyper, priors, theta, places, levels, near=None, progress=None):
        asked.append((float(np.asarray(hyper.noise.white)[0]) / 0.05, places is not None, float(theta[0])))
        second = len(asked) > 1 and not (len(asked) > 3 and places is not None)
        lost = second and ("path" if places is not None else "anew") in fails
        return lifted_fit.LiftedFit(
            np.full(1, float(len(asked))), tuple(at), np.eye(1), (_row(0.5 if lost else 1e-4),), True
        )

    def told(flights, linear, priors, prior):
        theta = linear[0]
        return lambda vector: (evidence[0] if theta == 2.0 else evidence[1], None)

    monkeypatch.setattr(lifted_fit, "descend", descended)
    monkeypatch.setattr(Optimum, "linear", lambda self, flights: [float(self.theta[0])])
    monkeypatch.setattr(noise_evidence, "function_of", told)
    _hold_noise(monkeypatch)
    joint_fit.joint_fit(flights, descent.priors, NoisePrior(descent.hyper))
    assert asked[0] == (LOUD, False, descent.priors[0].centre)
    assert asked[1] == (OWN, True, 1.0) and asked[2] == (OWN, False, 1.0)
    ends = [2.0, 3.0]
    assert asked[-1][1] and asked[-1][2] == ends[kept]


def _hold_noise(monkeypatch):
    """Noise parameters stay where they are."""
    monkeypatch.setattr(noise_evidence, "scales", lambda *_: None)
    monkeypatch.setattr(noise_evidence, "maximise", lambda evidence, hyper, *_: (hyper, 0.0))


def test_a_fit_with_nothing_left_to_try_tells_all_that_was_tried(monkeypatch, descent):
    flights = [replace(f, path=SimpleNamespace()) for f in descent.flights]
    at = tuple(Lifted(f.still(), np.zeros((1, 1)), np.zeros((1, 1))) for f in flights)
    defects = iter((1e-4, 0.3, 0.9, 0.8))

    def descended(flights, hyper, priors, theta, places, levels, near=None, progress=None):
        return lifted_fit.LiftedFit(theta, at, np.eye(1), (_row(next(defects)),), True)

    monkeypatch.setattr(lifted_fit, "descend", descended)
    monkeypatch.setattr(Optimum, "linear", lambda self, flights: [])
    _hold_noise(monkeypatch)
    with pytest.raises(joint_fit.NoFitError, match="no flight of the model follows the record") as told:
        joint_fit.joint_fit(flights, descent.priors, NoisePrior(descent.hyper))
    assert [words.split(":")[0] for words in told.value.tried] == [
        "from the path of the turn before", "from the path of the record", "from the path of the record, in smaller steps"
    ]  # fmt: skip
    assert told.value.best.rows[-1].defect == 0.3


def test_noise_grows_until_a_flight_follows_its_record(monkeypatch, descent):
    """Own noise, and three times as much, in usual and in smaller steps; then ten times as much."""
    flights = [replace(f, path=SimpleNamespace()) for f in descent.flights]
    at = tuple(Lifted(f.still(), np.zeros((1, 1)), np.zeros((1, 1))) for f in flights)
    asked = []

    def descended(flights, hyper, priors, theta, places, levels, near=None, progress=None):
        times = float(np.asarray(hyper.noise.white)[0]) / 0.05
        asked.append((times, places is None, len(levels)))
        led = times > 9.0 or places is not None
        return lifted_fit.LiftedFit(theta, at, np.eye(1), (_row(1e-4 if led else 0.5),), True)

    monkeypatch.setattr(lifted_fit, "descend", descended)
    monkeypatch.setattr(Optimum, "linear", lambda self, flights: [])
    monkeypatch.setattr(noise_evidence, "function_of", lambda *_: lambda vector: (1.0, None))
    _hold_noise(monkeypatch)
    joint_fit.joint_fit(flights, descent.priors, NoisePrior(descent.hyper))
    usual, small = len(LEVELS) + 1, len(joint_fit._SMALL_LEVELS)
    first = [(LOUD, True, usual), (OWN, True, usual), (LOUD, True, small), (pytest.approx(10.0), True, usual)]
    assert asked[:5] == [*first, (OWN, False, 1)]


def test_looser_noise_has_larger_standard_deviations_and_the_same_times(descent):
    made, hyper = joint_fit._looser(descent.hyper, 3.0), descent.hyper
    np.testing.assert_allclose(made.noise.white, 3.0 * hyper.noise.white)
    np.testing.assert_allclose(made.noise.correlated, 3.0 * hyper.noise.correlated)
    np.testing.assert_array_equal(made.noise.time_constant, hyper.noise.time_constant)
    np.testing.assert_allclose(made.disturbance_parameters[0], hyper.disturbance_parameters[0] * [3.0, 1.0])


def test_a_record_that_no_flight_follows_is_told(monkeypatch, descent):
    """Whatever was tried is listed, the best path is kept, and nothing goes on from there."""
    at = Lifted(descent.flights[0].still(), np.zeros((1, 1)), np.zeros((1, 1)))
    defects = iter((0.9, 0.5, 0.7))

    def stuck(flights, hyper, priors, theta, places, levels, near=None, progress=None):
        row = lifted_fit.Row(0.0, 12.0, next(defects), 1.0, 1.0, 1.0)
        return lifted_fit.LiftedFit(theta, (at,), np.eye(len(priors)), (row,), False)

    monkeypatch.setattr(lifted_fit, "descend", stuck)
    theta = np.zeros(len(descent.priors))
    with pytest.raises(joint_fit.NoFitError, match="no flight of the model follows the record") as told:
        joint_fit._along_record(descent.flights, descent.priors, theta, [_ways(descent.hyper, [at])], NEAR, print)
    assert len(told.value.tried) == 3 and "defect 0.5" in told.value.tried[1]
    assert told.value.best.rows[-1].defect == 0.5 and told.value.priors == tuple(descent.priors)


def test_a_fit_that_took_no_step_is_not_the_best(monkeypatch, descent):
    at, rows = Lifted(descent.flights[0].still(), np.zeros((1, 1)), np.zeros((1, 1))), iter((None, 0.9, None))

    def seldom(flights, hyper, priors, theta, places, levels, near=None, progress=None):
        defect = next(rows)
        made = () if defect is None else (lifted_fit.Row(0.0, 12.0, defect, 1.0, 1.0, 1.0),)
        return lifted_fit.LiftedFit(theta, (at,), np.eye(len(priors)), made, False)

    monkeypatch.setattr(lifted_fit, "descend", seldom)
    theta = np.zeros(len(descent.priors))
    with pytest.raises(joint_fit.NoFitError, match="break the equations of motion") as told:
        joint_fit._along_record(descent.flights, descent.priors, theta, [_ways(descent.hyper, [at])], NEAR, print)
    assert told.value.best.rows[-1].defect == 0.9


@pytest.mark.parametrize("path", [True, False])
def test_a_joint_optimum_goes_along_the_record_where_there_is_one(descent, monkeypatch, path, flown):
    """Else by single shooting; both from where they are told to."""
    at, told = [flown(f, descent.hyper, descent.theta, f.still()) for f in descent.flights], []
    flights = [replace(f, path=SimpleNamespace() if path else None) for f in descent.flights]

    def along(flights, hyper, priors, theta, places, levels, near, progress):
        told.append(("along", places))
        rows = (lifted_fit.Row(0.3, 9.0, 0.3, 1.0, 1.0, 1.0), lifted_fit.Row(0.0, 7.0, 1e-4, 0.1, 0.2, 1.0))
        return lifted_fit.LiftedFit(theta + 1.0, tuple(at), np.eye(1), rows, True)

    def shot(flights, hyper, priors, theta, unknowns, tolerance):
        told.append(("shot", unknowns))
        return Optimum(theta + 1.0, tuple(at), np.eye(1), 7.0, True, 2, 0.2, (7.0,))

    monkeypatch.setattr(lifted_fit, "descend", along)
    monkeypatch.setattr(joint_mode, "fit", shot)
    for begin in (None, at):
        made = joint_fit.joint(flights, descent.hyper, descent.priors, descent.theta, begin)
        assert (made.cost, made.converged, made.iterations, made.last_step, made.trace) == (7.0, True, 2, 0.2, (7.0,))
        np.testing.assert_allclose(made.theta, descent.theta + 1.0)
    assert [name for name, _ in told] == 2 * ["along" if path else "shot"] and told[0][1] is None
    assert told[1][1] is at if path else [u is x.unknowns for u, x in zip(told[1][1], at, strict=True)] == [True, True]


def test_the_joint_optimum_is_where_single_shooting_ends(descent, flown):
    want = joint_mode.fit(descent.flights, descent.hyper, descent.priors, descent.theta, tolerance=1e-4)
    at = [flown(f, descent.hyper, descent.theta, f.still()) for f in descent.flights]
    made = joint_fit.joint(descent.flights, descent.hyper, descent.priors, descent.theta + 0.3, at)
    assert abs(made.theta - want.theta)[0] < 0.02 * np.sqrt(want.covariance[0, 0]) and made.converged
