"""A prior that a model survives, and one whose failures lie where they were put."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bayeschute.dynamics.outcome import Outcome
from bayeschute.dynamics.parameters import Structure
from bayeschute.forecast.stress import lines, stress_flight, stress_test
from bayeschute.inference.latent import Latent
from bayeschute.inference.priors import Prior
from bayeschute.inference.target import FlightData

_spec = importlib.util.spec_from_file_location(
    "small_cluster", Path(__file__).parents[1] / "twins" / "small_cluster.py"
)
small = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(small)

PLAIN = Structure(("1",), ("e",), 2, "riser")
START = small.start(np.array([[0.3, 0.1], [0.0, 0.15], [-1.0, -1.0]]))
NAMES = ("axial[1]", "riser_damping")
SEEN = {"names": NAMES, "channels": ("canopy_position", "capsule_velocity")}
MODEL = small.flight(small.cluster((0.95,), (0.1,)), START, PLAIN, samples=31, substeps=4, **SEEN)
N = 40


PRIORS = (
    Prior("axial[1]", 0.95, 0.05, False, "1", "made up"),
    Prior("riser_damping", np.log(1.46e5), 0.1, True, "N s/m", "made up"),
)


def tried_with(log_sd, n=N):
    return stress_test(MODEL, (PRIORS[0], replace(PRIORS[1], scale=log_sd)), n, np.full(17, 1e-3), seed=2)


@pytest.fixture(scope="module")
def wide():
    return tried_with(1.5)


def test_a_sound_prior_is_survived():
    tried = tried_with(0.1)
    assert tried.ok.all() and tried.gradient.all() and tried.place() == {}
    shares = tried.shares()
    assert shares.pop("ok") == 1.0 and set(shares.values()) == {0.0}
    assert tried.step_error.shape == (N, 25)
    worst = tried.worst_step_error()
    assert 1e-9 < worst[2] < 1e-2 and (tried.worst_step_error(0.5) <= worst).all()


def test_failures_lie_at_the_parameter_that_makes_them(wide):
    """A riser damper beyond the reach of the steps, c (1/m_canopy + 2/m_capsule) dt > 2.8, makes flights fail."""
    limit = 2.785 / 0.025 / (1.0 / (149.1 + 1.1 * 3969.0) + 2.0 / 9463.0)
    too_stiff = 1.46e5 * np.exp(1.5 * wide.standard[:, 1]) > limit
    assert 3 <= too_stiff.sum() <= N - 3
    assert (wide.ok == ~too_stiff).mean() >= 0.9
    place = wide.place()
    mean, se = place["riser_damping"]
    assert mean > 3.0 * se
    mean, se = place["axial[1]"]
    assert abs(mean) < 2.5 * se


def test_outcomes_are_counted_and_timed(wide):
    shares = wide.shares()
    outcomes = [shares[kind.words] for kind in Outcome]
    assert sum(outcomes) == pytest.approx(1.0) and outcomes[0] == wide.ok.mean() < 1.0
    assert (wide.failed_at[wide.ok] == -1).all() and (wide.failed_at[~wide.ok] >= 0).all()
    assert wide.gradient[wide.ok].all() and not wide.gradient[~wide.ok].any()


def test_draws_don_t_depend_on_how_they_are_batched(wide):
    fewer = tried_with(1.5, 5)
    np.testing.assert_array_equal(fewer.outcome.shape, (5,))
    again = tried_with(1.5)
    np.testing.assert_array_equal(again.standard, wide.standard)
    np.testing.assert_array_equal(again.outcome, wide.outcome)


def test_a_record_ready_to_be_fitted_is_tried_with_its_own_scales():
    nothing = np.zeros((31, 9))
    data = FlightData(
        MODEL, nothing, nothing > 1.0, 0.1, np.full(17, 1e-3), (0,) * 6 + (1,) * 3, Latent(("drift",), ((2, 0),))
    )
    tried = stress_flight(data, PRIORS, N, seed=2)
    again = stress_test(MODEL, PRIORS, N, np.full(17, 1e-3), seed=2)
    np.testing.assert_array_equal(tried.start, again.start)
    np.testing.assert_array_equal(tried.step_error, again.step_error)


def test_words_name_what_fails(wide):
    told = "\n".join(lines(wide))
    assert f"{N} flights of prior draws\nok: {100 * wide.ok.mean():.1f} %" in told
    assert "failures at riser_damping: +" in told and "axial" not in told and "first failure at sample" in told
    none = wide._replace(outcome=np.zeros(N, int), gradient=np.ones(N, bool))
    assert len(lines(none)) == 3


def test_where_nothing_is_ok_no_error_is_told(wide):
    none = wide._replace(outcome=np.full(N, int(Outcome.DIVERGED)))
    assert np.isnan(none.worst_step_error()).all()
    assert none.shares()["derivatives that are not finite"] == 0.0
