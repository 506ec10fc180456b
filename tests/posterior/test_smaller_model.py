"""A library and a small model of its terms: each goes on where the other has led."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from tests.fitting import LinearFlight

from bayeschute.likelihood.priors import given_zero
from bayeschute.posterior import joint_mode
from bayeschute.posterior.along_record import conditional_mode
from bayeschute.posterior.fit import smaller_model
from bayeschute.posterior.fit.joint_fit import JointFit
from bayeschute.posterior.fit.smaller_model import Smaller, beside_smaller, carried_over
from bayeschute.posterior.noise_evidence import NoisePrior


def test_a_model_goes_on_where_another_one_led(descent, settled):
    prior, there = NoisePrior(descent.hyper), settled.optimum.theta + np.sqrt(np.diag(settled.optimum.covariance))
    made = carried_over(descent.flights, descent.priors, prior, settled, there, settled.optimum.flights)
    rest = conditional_mode.conditional_optimum(
        descent.flights, settled.hyper, descent.priors, there, settled.optimum.flights
    )
    np.testing.assert_array_equal(made.optimum.theta, there)
    np.testing.assert_allclose(made.optimum.covariance, scipy.linalg.inv(rest.matrix), rtol=1e-6)
    assert made.hyper is settled.hyper and made.optimum.cost == pytest.approx(rest.cost)
    assert made.optimum.cost > settled.optimum.cost and made.evidence > settled.evidence
    nowhere = there * np.nan
    assert carried_over(descent.flights, descent.priors, prior, settled, nowhere, settled.optimum.flights) is None


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class WithoutSecond(LinearFlight):
    """The linear flight whose second parameter is zero."""

    def numbers(self, theta):
        return jnp.concatenate([theta, jnp.zeros_like(theta)])


@pytest.fixture(scope="module")
def case(linear):
    """The linear flight of two parameters as library, the model without the second one, and fits of the library."""
    prior = NoisePrior(linear.hyper)
    less = replace(linear.flight, model=WithoutSecond(linear.flight.model.drive))
    small = Smaller([less], given_zero(linear.priors, ["two"]), np.array([True, False]))
    best = joint_mode.fit([linear.flight], linear.hyper, linear.priors, np.zeros(2), tolerance=1e-6)
    library = JointFit(best, linear.hyper, 0.0)
    off = carried_over([linear.flight], linear.priors, prior, library, best.theta + [0.0, 3.0], best.flights)
    return SimpleNamespace(
        prior=prior, small=small, best=library, off=off,
        beside=lambda library, small=small, say=None: beside_smaller(
            [linear.flight], linear.priors, prior, library, small, say
        ),
    )  # fmt: skip


def test_a_library_that_lies_below_its_small_model_goes_on_there(case, linear):
    heard = []
    made = case.beside(case.off, say=lambda share, words: heard.append((share, words)))
    wanted = joint_mode.fit(case.small.flights, linear.hyper, case.small.priors, np.zeros(1), tolerance=1e-6)
    assert made.optimum.theta[1] == 0.0  # its density has but one mode, the joint one: the determinant is constant
    assert abs(made.optimum.theta[0] - wanted.theta[0]) < 0.2 * np.sqrt(wanted.covariance[0, 0])
    rest = conditional_mode.conditional_optimum(
        [linear.flight], linear.hyper, linear.priors, made.optimum.theta, made.optimum.flights
    )
    assert made.optimum.cost == pytest.approx(rest.cost) and made.optimum.cost < case.off.optimum.cost
    gain = case.off.optimum.cost - made.optimum.cost
    assert heard[-1] == (1.0, f"fewest terms: log density {gain:+.1f} over the joint optimum's")
    assert [share for share, _ in heard] == sorted(share for share, _ in heard)


def test_a_library_that_lies_above_its_small_model_stays(case):
    heard = []
    assert case.beside(case.best, say=lambda share, words: heard.append(words)) is case.best
    assert heard[-1].startswith("fewest terms: log density -")


def test_a_small_model_that_begins_far_below_the_library_is_given_up_at_once(case, monkeypatch):
    heard = []
    monkeypatch.setattr(smaller_model, "marginal_mode", None)
    monkeypatch.setattr(smaller_model, "_FAR_BELOW", 0.0)
    assert case.beside(case.best, say=lambda share, words: heard.append(words)) is case.best
    assert heard[-1].startswith("fewest terms: log density -") and heard[-1].endswith("given up")


def test_a_library_with_nothing_to_leave_out_is_its_own_small_model(case, linear, monkeypatch):
    monkeypatch.setattr(smaller_model, "marginal_mode", None)
    whole = Smaller([linear.flight], linear.priors, np.array([True, True]))
    assert case.beside(case.off, whole) is case.off


def test_a_small_model_that_follows_no_record_is_told_and_left(case, monkeypatch):
    heard = []
    monkeypatch.setattr(conditional_mode, "conditional_optimum", lambda *_: None)
    assert case.beside(case.off, say=lambda share, words: heard.append(words)) is case.off
    assert heard[1:] == ["fewest terms: no flight follows the record from where the library led"]


def test_a_small_model_whose_steps_fail_is_told_and_left(case, monkeypatch):
    def lost(*_):
        raise FloatingPointError("a step towards the marginal mode lost the record")

    heard = []
    monkeypatch.setattr(smaller_model, "marginal_mode", lost)
    assert case.beside(case.off, say=lambda share, words: heard.append(words)) is case.off
    assert heard[1:] == ["fewest terms: a step towards the marginal mode lost the record"]
