"""Constant errors of a record are each flight's own, and of an unseen flight as likely as before any fit."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.likelihood.priors import Prior, correlated, covariance
from bayeschute.study.assembly import flight_parameters

PRIORS = (
    Prior("axial[1]", 0.9, 0.1, False, "1", "x"),
    Prior("wind_bias.north", 0.0, 2.0, False, "m/s", "x"),
    Prior("riser_length", 70.0, 0.3, False, "m", "x"),
)


def names(priors):
    return [p.name for p in priors]


def test_every_flight_has_its_own_and_all_share_the_rest():
    made = flight_parameters.each(PRIORS, ["one", "two"])
    assert names(made) == ["axial[1]", "wind_bias.north@one", "wind_bias.north@two", "riser_length"]
    assert flight_parameters.in_flight(made, "one") == ("axial[1]", "wind_bias.north", "", "riser_length")
    assert flight_parameters.in_flight(made, "two") == ("axial[1]", "", "wind_bias.north", "riser_length")
    assert flight_parameters.biases(made) == ("wind_bias.north",)
    assert flight_parameters.each(made, ["one", "two"]) == made  # as a search of terms has stored them


def test_a_flight_goes_without_what_it_does_not_take_from_the_fit():
    assert flight_parameters.in_flight(PRIORS, "one", ("riser_length",)) == ("axial[1]", "wind_bias.north", "")
    without = flight_parameters.biases(PRIORS)
    assert flight_parameters.in_flight(PRIORS, "one", without) == ("axial[1]", "", "riser_length")


def test_of_an_unseen_flight_they_are_as_before_the_fit_and_alone():
    scale = np.array([0.02, 0.1, 0.2])
    joint = scale[:, None] * np.array([[1.0, 0.8, 0.3], [0.8, 1.0, 0.2], [0.3, 0.2, 1.0]]) * scale
    after = correlated(PRIORS, np.array([0.85, 1.5, 70.4]), joint)
    made = flight_parameters.of_unseen(PRIORS, after)
    assert [(p.centre, p.scale) for p in made] == [(0.85, 0.02), (0.0, 2.0), (70.4, 0.2)]
    want = joint.copy()
    want[1], want[:, 1] = 0.0, 0.0
    want[1, 1] = 4.0
    np.testing.assert_allclose(covariance(made), want, rtol=1e-12, atol=1e-15)


def test_draws_for_an_unseen_flight_have_the_prior_s_law_in_them():
    theta = np.tile([0.85, 1.5, 70.4], (4000, 1))
    made = flight_parameters.drawn_for_unseen(PRIORS, theta, np.random.default_rng(0))
    assert made[:, 1].mean() == pytest.approx(0.0, abs=0.15) and made[:, 1].std() == pytest.approx(2.0, rel=0.05)
    np.testing.assert_array_equal(made[:, [0, 2]], theta[:, [0, 2]])
    assert (theta[:, 1] == 1.5).all()
