"""Score tests of possible errors: least squares where all is linear, a standard normal law where nothing is wrong."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np
import pytest
from tests.fitting import BentFlight

from bayeschute.likelihood.disturbances import Latent
from bayeschute.likelihood.joint import NoiseParameters
from bayeschute.likelihood.noise import Noise
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior.assess.alternatives import Alternative, Score, scores
from bayeschute.posterior.joint_mode import fit
from bayeschute.posterior.marginal import marginalise

OFF = np.array([1.0, 0.0])  # a constant error of the first output


def shifted(flight, of_data=True):
    return Alternative("the first output", "m", lambda x: replace(flight, observed=flight.observed - x * OFF), of_data)


@pytest.fixture(scope="module")
def least_squares(linear):
    """The estimate of a constant error of the first output beside both parameters, by dense matrices."""
    y, zero, by = linear.matrices.model(linear.flight)
    r, u, prior = linear.matrices.covariances(linear.flight, linear.hyper, linear.priors)
    error = linear.matrices.dense.stack(np.tile(OFF, (len(linear.flight.observed), 1)), linear.flight.present)
    columns = np.column_stack([by[:, :2], error])
    weight = np.linalg.inv(r + by[:, 2:] @ u @ by[:, 2:].T)
    before = np.zeros((3, 3))
    before[:2, :2] = np.linalg.inv(prior)
    covariance = np.linalg.inv(columns.T @ weight @ columns + before)
    centre = np.array([p.centre for p in linear.priors] + [0.0])
    mean = covariance @ (columns.T @ weight @ (y - zero) + before @ centre)
    return mean[2], np.sqrt(covariance[2, 2])


@pytest.mark.parametrize("of_data", [True, False])
def test_where_all_is_linear_one_step_is_the_estimate_of_least_squares(linear, straight, least_squares, of_data):
    """Whether only the data are corrected, or the flight is brought to its mode with the error."""
    (found,) = scores(straight, 0, [shifted(linear.flight, of_data)])
    assert (found.estimate, found.se) == pytest.approx(least_squares, rel=1e-4)
    assert (found.what, found.unit) == ("the first output", "m")


def test_what_an_error_moves_is_by_how_much_the_parameters_would_differ(linear, straight):
    (found,) = scores(straight, 0, [shifted(linear.flight)])
    corrected = shifted(linear.flight).changed(found.estimate)
    with_it = fit([corrected], linear.hyper, linear.priors, np.zeros(2), tolerance=1e-8)
    moved = np.abs(with_it.theta - np.asarray(straight.centre)) / np.sqrt(np.diag(with_it.covariance))
    assert found.moves == pytest.approx(moved.max(), rel=1e-3) and found.moves > 0.01


def test_an_error_that_was_made_is_found_and_its_p_value_says_so(linear):
    wrong = shifted(linear.flight).changed(-3.0)
    best = fit([wrong], linear.hyper, linear.priors, np.zeros(2), tolerance=1e-8)
    (found,) = scores(marginalise([wrong], linear.hyper, linear.priors, best), 0, [shifted(wrong)])
    assert abs(found.estimate - 3.0) < 4.0 * found.se and found.p < 1e-4


@pytest.mark.parametrize(("z", "p"), [(0.0, 1.0), (1.959964, 0.05), (-2.575829, 0.01)])
def test_the_p_value_is_of_both_sides(z, p):
    assert Score("an error", "m", 3.0 * z, 3.0, 0.0).p == pytest.approx(p, rel=1e-5)


def test_what_changes_nothing_or_can_not_be_flown_is_left_out(linear, straight):
    same = Alternative("nothing", "", lambda x: linear.flight)
    broken = replace(linear.flight, model=replace(linear.flight.model, drive=np.nan * linear.flight.model.drive))
    lost = Alternative("lost", "", lambda x: broken)
    assert [one.what for one in scores(straight, 0, [same, shifted(linear.flight), lost])] == ["the first output"]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Gusty(BentFlight):
    """A flight in gusts that an instrument shows larger than they are; how much so changes covariances alone."""

    gain: Any = 1.0

    def advance(self, x, numbers, now, then, error_now, error_then):
        return 0.8 * x + 0.5 * numbers + 0.5 * self.gain * (error_now + error_then)


def test_without_an_error_scores_are_standard_normal_also_where_covariances_depend_on_it(linear):
    """The squares alone would be off by their mean: gusts that are larger make every innovation smaller."""
    priors = [Prior("drive", 1.0, 1.0, False, "1", "test")]
    hyper = NoiseParameters(Noise(*(np.array([x]) for x in (0.2, 0.2, 2.0))), (np.array([0.5, 3.0]),))
    gusts = Latent(("drift",), ((0, 0),))
    nothing = np.zeros((80, 1))
    empty = replace(
        linear.flight, model=Gusty(nothing[:, 0]), observed=nothing, present=nothing == 0.0, dt=0.5,
        start_scale=np.array([0.2]), channel=(0,), latent=gusts,
    )  # fmt: skip
    z = []
    for seed in range(40):
        flight, _ = linear.simulate(empty, hyper, np.array([1.0]), seed)
        made = marginalise([flight], hyper, priors, fit([flight], hyper, priors, np.array([1.0]), tolerance=1e-6))
        louder = Alternative("gusts", "1", lambda x, f=flight: replace(f, model=replace(f.model, gain=1.0 + x)))
        (found,) = scores(made, 0, [louder])
        z.append(found.estimate / found.se)
    told = np.array(z)
    assert abs(told.mean()) < 4.0 / np.sqrt(len(told))
    assert 0.6 < told.std() < 1.4  # 1.5 by the information in means alone
