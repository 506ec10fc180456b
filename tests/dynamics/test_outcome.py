"""Flights that are judged: each outcome, when it began, and the error due to steps against much finer ones."""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np
import pytest
from tests.twins import small_cluster as small

from bayeschute.compiler.integrate import trajectory_compiled
from bayeschute.compiler.runge_kutta import Stepping
from bayeschute.dynamics.descent import DensityProfile, DescentFlight, DescentInputs
from bayeschute.dynamics.outcome import Outcome, judge, simulate
from bayeschute.dynamics.parameters import Structure

DIRECTION = np.array([[0.3, 0.1], [0.0, 0.15], [-1.0, -1.0]])
SAMPLES = 31
NAMES = ("axial[1]", "riser_damping")
PLAIN = Structure(("1",), ("e",), 2, "riser")
MODEL = small.cluster((0.95,), (0.1,))


def flight(substeps=4):
    return small.flight(MODEL, small.start(DIRECTION), PLAIN, samples=SAMPLES, substeps=substeps, names=NAMES)


def go(one, theta):
    theta = np.asarray(theta, float)
    tail = theta.shape[1:]
    return simulate(one, theta, np.zeros((17, *tail)), np.zeros((SAMPLES, 3, *tail)))


GOOD, STIFF = (0.95, np.log(1.46e5)), (0.95, np.log(6e5))


@pytest.fixture(scope="module")
def batch():
    """A sound flight and one whose riser damper is too stiff for its steps."""
    return go(flight(), np.array([GOOD, STIFF]).T)


def test_a_sound_flight_is_ok_and_a_stiff_one_is_not(batch):
    assert Outcome(int(batch.outcome[0])) is Outcome.OK and int(batch.failed_at[0]) == -1
    assert Outcome(int(batch.outcome[1])) is Outcome.UNRESOLVED  # it shakes, but neither leaves nor hangs slack
    assert 0 < int(batch.failed_at[1]) < SAMPLES
    assert np.isfinite(batch.states).all()


def test_the_error_of_steps_is_that_against_steps_ten_times_as_fine(batch):
    true = trajectory_compiled(flight(substeps=40), np.array(GOOD), np.zeros(17), np.zeros((SAMPLES, 3)))
    error = np.abs(np.asarray(batch.states[:, :, 0] - true)).max(axis=0)
    told = np.asarray(batch.step_error[:, 0])
    large = error > 1e-10
    assert large.sum() > 12
    np.testing.assert_allclose(told[large], error[large], rtol=0.25)


judged = jax.jit(judge)


def spoilt(states, change):
    made = np.array(states[:, :, 0])
    change(made)
    outcome, at = judged(flight(), np.array(GOOD), made)
    return Outcome(int(outcome)), int(at)


def near(states, samples):
    """The canopies at half a riser's length from the capsule."""
    for axis in range(3):
        for i in range(2):
            row = 13 + 2 * axis + i
            states[samples, row] = 0.5 * (states[samples, row] + states[samples, axis])


def test_a_slack_riser_counts_where_it_stays_slack(batch):
    assert spoilt(batch.states, lambda s: near(s, slice(5, 15))) == (Outcome.OK, -1)  # 1 s of it
    assert spoilt(batch.states, lambda s: near(s, slice(5, 16))) == (Outcome.SLACK, 15)

    def twice(s):
        near(s, slice(5, 13))
        near(s, slice(14, 22))

    assert spoilt(batch.states, twice) == (Outcome.OK, -1)


def test_what_is_not_finite_too_fast_or_torn_has_diverged(batch):
    def nan(s):
        s[7:, 3] = np.nan

    def fast(s):
        s[9, 5] = 400.0

    def torn(s):
        s[11:, 17] -= 60.0

    assert spoilt(batch.states, nan) == (Outcome.DIVERGED, 7)
    assert spoilt(batch.states, fast) == (Outcome.DIVERGED, 9)
    assert spoilt(batch.states, torn) == (Outcome.DIVERGED, 11)


def test_the_worst_outcome_counts(batch):
    def both(s):
        near(s, slice(5, 20))
        s[18:, 3] = np.inf

    assert spoilt(batch.states, both) == (Outcome.DIVERGED, 18)


@pytest.mark.parametrize(("damping", "outcome"), [(0.3, Outcome.OK), (-0.3, Outcome.OK), (-2.0, Outcome.ILL_POSED)])
def test_airflow_rates_that_outweigh_a_canopy_are_ill_posed(batch, damping, outcome):
    """Apparent mass rho S l C_rate/4 against 149 kg and 1.1 kg/m^3 in 3969 m^3: they balance at about -0.47."""
    structure = Structure(("1",), ("rate",), 2, "airflow")
    one = replace(flight(), base=small.cluster((0.95,), (damping,)), structure=structure)
    states = np.asarray(batch.states[:3, :, 0])
    one = replace(one, record=small.flight(small.cluster(), small.start(DIRECTION), samples=3).record)
    found, at = judged(one, np.array(GOOD), states)
    assert (Outcome(int(found)), int(at)) == (outcome, -1 if outcome is Outcome.OK else 0)


def test_the_edge_of_ill_posedness_is_where_the_apparent_mass_equals_the_canopy_s(batch):
    mass = 149.1 + 1.1 * 3969.0
    edge = -4.0 * mass / (1.1 * 981.8 * 35.36)
    for factor, outcome in ((0.999, Outcome.OK), (1.001, Outcome.ILL_POSED)):
        structure = Structure(("1",), ("rate",), 2, "airflow")
        one = small.flight(small.cluster((0.95,), (edge * factor,)), small.start(DIRECTION), structure, samples=3)
        found, _ = judged(replace(one, names=NAMES), np.array(GOOD), np.asarray(batch.states[:3, :, 0]))
        assert Outcome(int(found)) is outcome


def test_any_other_model_is_judged_by_its_numbers():
    air = DensityProfile(0.0, 1000.0, np.log(np.array([1.2, 1.1, 1.0])))
    model = DescentFlight(air, DescentInputs(np.zeros(51)), 1500.0, 5.0, 0.5)
    flown = simulate(model, np.log([0.1]), np.zeros(1), np.zeros((51, 1)))
    assert Outcome(int(flown.outcome)) is Outcome.OK
    true = trajectory_compiled(replace(model, stepping=Stepping(40)), np.log([0.1]), np.zeros(1), np.zeros((51, 1)))
    error = np.abs(np.asarray(flown.states - true)).max(axis=0)
    np.testing.assert_allclose(flown.step_error, error, rtol=0.3)
    wild = np.array(flown.states)
    wild[3, 1] = 1e8
    outcome, at = judged(model, np.log([0.1]), wild)
    assert (Outcome(int(outcome)), int(at)) == (Outcome.DIVERGED, 3)


def test_outcomes_have_words():
    assert len({kind.words for kind in Outcome}) == len(Outcome)
