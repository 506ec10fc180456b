"""Simulation-based calibration on a short swing: its data are the model's own, its ranks answer to a broken sampler."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import jax
import numpy as np
import pytest

from bayeschute.aero.published import load_published
from bayeschute.calibration import simulation_based as sbc
from bayeschute.dynamics.parameters import Canopies
from bayeschute.likelihood.joint import NoiseParameters, residuals
from bayeschute.likelihood.noise import Noise
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior.fit.laplace_fit import find
from bayeschute.posterior.noise_evidence import NoisePrior, to_vector
from bayeschute.posterior.noise_uncertainty import joint_covariance
from bayeschute.reduced.dumbbell import Dumbbell
from bayeschute.reduced.dumbbell_data import GUSTS, dumbbell_data
from bayeschute.reduced.published_models import planar_aero
from bayeschute.reduced.virtual_swing import SwingDrop, fly_swing

TABLE = load_published("table-7.1-2")
AERO, TRUTH = planar_aero(TABLE), TABLE.estimates()
BASE = Dumbbell(9936.0, 71.6, Canopies(981.0, 35.4, 9.75, 149.0, 3969.0))
HYPER = NoiseParameters(
    Noise(np.array([2e-3, 0.06]), np.array([3e-3, 0.1]), np.array([2.0, 2.0])),
    (np.array([0.5, 5.0]), np.array([0.3, 5.0])),
)
NAMES = ("C_A0", "C_Aalpha")


@pytest.fixture(scope="module")
def template():
    record, _ = fly_swing(SwingDrop(12.0, 0.1, 1800.0, 0.3), BASE, AERO, 1, substeps=2)
    priors = tuple(Prior(n, TRUTH[n], 0.05, False, "1", "test") for n in NAMES)
    flight = dumbbell_data(record, BASE, AERO, priors, GUSTS)
    return sbc.Template(
        flight, priors, NoisePrior(HYPER, 0.3), lambda data, x: sbc.swing_quantities(x[:, 4], x[:, 3], float(data.dt))
    )


@pytest.fixture(scope="module")
def row(template):
    return sbc.ranked(3, template, levels=19, chains=2, draws=60)


def test_a_draw_is_the_models_own_and_the_seeds_alone(template):
    one, again, other = (sbc.draw(template, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.flight.observed, again.flight.observed)
    assert np.abs(one.theta - other.theta).max() > 0.0
    left = np.asarray(residuals(one.flight, one.theta, one.latent_path))
    # What is left at the truth is the noise alone: of each channel, the drawn white and correlated part together.
    noise = jax.tree.map(np.asarray, one.hyper.noise)
    sd = np.hypot(noise.white, noise.correlated)[[0, 1, 1]]
    assert ((left.std(axis=0) < 2.0 * sd) & (left.std(axis=0) > 0.3 * sd)).all()


def test_truths_come_from_the_priors(template):
    drawn = [sbc.draw(template, seed) for seed in range(40)]
    z = np.array([(d.theta - [TRUTH[n] for n in NAMES]) / 0.05 for d in drawn])
    assert (np.abs(z.mean(axis=0)) < 4.0 / np.sqrt(40)).all() and (np.abs(z.std(axis=0) - 1.0) < 0.5).all()
    law = np.array([(to_vector(d.hyper) - to_vector(HYPER)) / 0.3 for d in drawn])
    assert (np.abs(law.mean(axis=0)) < 4.0 / np.sqrt(40)).all() and (np.abs(law.std(axis=0) - 1.0) < 0.5).all()


def test_a_record_of_zeros_limits_no_draw(template):
    """Attitude is told against the recorded one."""
    flight = template.flight
    blank = replace(flight, observed=np.asarray(flight.observed) * np.array([0.0, 1.0, 1.0]))
    drawn = sbc.draw(replace(template, flight=blank), 1)
    np.testing.assert_array_equal(drawn.flight.observed, sbc.draw(template, 1).flight.observed)


def test_a_prior_that_does_not_fly_is_said(template):
    with pytest.raises(FloatingPointError, match="did not fly"):
        sbc.draw(replace(template, most_swing=1e-9), 1)


def test_a_row_ranks_parameters_and_derived_quantities(row):
    derived = {"swing amplitude", "swing frequency", "mean descent rate", "descent rate at the end"}
    assert set(row["ranks"]) == {*NAMES, *derived}
    assert all(0 <= r <= 19 for r in row["ranks"].values())
    assert row["ok"] and row["redrawn"] >= 0


def test_a_fit_that_has_not_converged_is_a_failure_before_it_is_drawn_from(template, monkeypatch):
    monkeypatch.setattr(sbc, "find", lambda *_: SimpleNamespace(optimum=SimpleNamespace(converged=False)))
    with pytest.raises(FloatingPointError, match="did not converge"):
        sbc.ranked(3, template)


def test_spoiled_draws_shift_ranks(template, row):
    low, high = (sbc.ranked(3, template, levels=19, chains=2, draws=60, shift=s)["spoiled"] for s in (-9.0, 9.0))
    assert all(low[name] >= row["ranks"][name] >= high[name] for name in NAMES)
    assert low["C_A0"] - high["C_A0"] > 9


def test_ranks_at_one_end_fail_and_even_ones_pass():
    even = [{"ranks": {"a": i % 20, "b": (7 * i) % 20}} for i in range(100)]
    assert all(t.passed for t in sbc.tested(even, 19).values())
    ends = [{"ranks": {"a": i % 20, "b": min(19, i % 20 + 6)}} for i in range(100)]
    found = sbc.tested(ends, 19)
    assert found["a"].passed and not found["b"].passed
    spoiled = [row | {"spoiled": {"a": 19}} for row in even]
    assert not sbc.tested(spoiled, 19, which="spoiled")["a"].passed


@pytest.fixture(scope="module")
def believed(template):
    return sbc.believe(template, 1, chains=2, draws=60)


def test_truths_come_from_a_posterior(template, believed):
    """Far narrower than the priors, about the fit's mean; noise parameters with their own spread, and what they do to theta."""
    centre, scale = np.asarray(believed.found.marginal.centre), np.asarray(believed.found.marginal.scale)
    drawn = [sbc.draw(template, seed, believed) for seed in range(60)]
    xi = np.array([np.linalg.solve(scale, d.theta - centre) for d in drawn])
    law = np.array([to_vector(d.hyper) - to_vector(believed.found.hyper) for d in drawn])
    effect, covariance = believed.found.noise_effect, believed.found.noise_parameter_covariance
    whole = np.diag(joint_covariance(np.diag(believed.xi.std(axis=0)), effect, covariance))
    assert (np.abs(xi.mean(axis=0) - believed.xi.mean(axis=0)) < 4.0 * np.sqrt(whole / 60)).all()
    np.testing.assert_allclose(xi.std(axis=0), np.sqrt(whole), rtol=0.4)
    np.testing.assert_allclose(law.std(axis=0), np.sqrt(np.diag(covariance)), rtol=0.4)
    pairs = zip(xi, law, strict=True)  # each is one of the draws for held noise parameters, carried along with its own
    assert max(np.abs(effect.carried(believed.xi, off) - one).sum(axis=1).min() for one, off in pairs) < 1e-9


def test_record_and_replicate_are_fitted_together(template, believed, monkeypatch):
    seen = []
    monkeypatch.setattr(sbc, "find", lambda flights, *rest: seen.append(flights) or find(flights, *rest))
    made = sbc.ranked(3, template, levels=19, chains=2, draws=60, believed=believed)
    assert seen[0][0] is template.flight and len(seen[0]) == 2
    np.testing.assert_array_equal(seen[0][1].observed, sbc.draw(template, 3, believed).flight.observed)
    assert all(0 <= r <= 19 for r in made["ranks"].values()) and len(made["ranks"]) == 6


def test_swing_quantities_of_a_sine():
    t = np.arange(0.0, 60.0, 0.1)
    angle = (0.1 + 0.3 * np.sin(2.0 * np.pi * 0.1 * t))[:, None]
    made = sbc.swing_quantities(angle, np.linspace(9.0, 11.0, t.size)[:, None], 0.1)
    assert made["swing amplitude"][0] == pytest.approx(0.3, rel=5e-3)
    assert made["swing frequency"][0] == pytest.approx(0.1, rel=5e-3)
    assert made["mean descent rate"][0] == pytest.approx(10.0)
    assert made["descent rate at the end"][0] == pytest.approx(11.0)
