"""Where walkers begin."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.posterior.sampling import ensemble
from bayeschute.posterior.sampling.protocol import Counted


def begun(most, walkers=4000, parameters=3):
    counted = Counted(lambda x: np.where(np.abs(x).max(axis=0) <= most, -0.5 * np.sum(x**2, axis=0), np.nan))
    return ensemble._begun(counted, walkers, parameters, np.random.default_rng(5)), counted


def test_walkers_begin_wider_than_the_prior_about_its_mean():
    state, counted = begun(np.inf)
    assert state.coords.std() == pytest.approx(1.2, abs=0.03) and counted.evaluations == 4000
    assert np.abs(state.coords.mean(axis=0)).max() < 4 * 1.2 / np.sqrt(4000)


def test_only_walkers_that_do_not_fly_are_put_nearer_and_values_stay_with_their_places():
    (free, _), (state, counted) = begun(np.inf), begun(1.0)
    far = np.abs(free.coords).max(axis=1) > 1.0
    assert far.any() and counted.failed >= far.sum()
    np.testing.assert_array_equal(state.coords[~far], free.coords[~far])
    halvings = np.ceil(np.log2(np.abs(free.coords[far]).max(axis=1)))[:, None]
    np.testing.assert_allclose(state.coords[far], free.coords[far] / 2.0**halvings)
    np.testing.assert_allclose(state.log_prob, -0.5 * np.sum(state.coords**2, axis=1))


def test_walkers_that_fly_nowhere_are_left_after_ten_halvings():
    state, counted = begun(-1.0, walkers=3)
    assert np.isneginf(state.log_prob).all() and counted.evaluations == 3 * 11


def test_four_walkers_for_each_parameter_where_nobody_says_how_many():
    sizes = []

    def density(x):
        sizes.append(x.shape[1])
        return -0.5 * np.sum(x**2, axis=0)

    made = ensemble.sample(density, 3, 1, 20, 0, most_steps=400)
    assert sizes[0] == 12 and made.xi.shape == (1, 20, 3)
