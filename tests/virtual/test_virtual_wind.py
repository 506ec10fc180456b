"""Parts of a virtual drop's wind against a reading by eye, and the field of the profile against the profile."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.virtual.virtual_wind import Gust, ShearLayer, WindHistory, WindProfile

LAYER = ShearLayer(500.0, 40.0, (2.0, -4.0, 1.0))
PROFILE = WindProfile((0.0, 400.0, 510.0), (0.0, 8.0, 9.0), (3.0, -1.0, 2.0), layers=(LAYER,))


def test_a_layer_changes_the_wind_below_it_and_leaves_that_above():
    got = LAYER.at(np.array([0.0, 480.0, 490.0, 500.0, 520.0, 900.0]))
    share = np.array([1.0, 1.0, 0.75, 0.5, 0.0, 0.0])
    np.testing.assert_allclose(got, share[:, None] * np.array(LAYER.change), atol=1e-15)


@pytest.mark.parametrize("origin", [0.0, 120.0])
def test_the_field_of_a_profile_is_the_profile_at_every_altitude(origin):
    h = np.linspace(-100.0, 900.0, 701)
    got = PROFILE.field(origin).at(h - origin)[0].stack().T
    np.testing.assert_allclose(got, PROFILE.at(h), atol=1e-12)


def test_altitudes_of_any_shape():
    h = np.random.default_rng(0).uniform(0.0, 800.0, (5, 2))
    got = PROFILE.at(h)
    assert got.shape == (5, 2, 3)
    np.testing.assert_array_equal(got[:, 1], PROFILE.at(h[:, 1]))


def test_a_profile_of_one_altitude_is_the_same_everywhere():
    one = WindProfile((300.0,), (4.0,), (-2.0,), (0.5,))
    np.testing.assert_allclose(
        one.field().at(np.array([0.0, 300.0, 300.5, 900.0]))[0].stack().T, [[4.0, -2.0, 0.5]] * 4
    )


def test_a_history_is_linear_between_samples_and_held_beyond():
    history = WindHistory((0.0, 10.0, 20.0), ((1.0, 0.0, 0.0), (3.0, 2.0, 0.0), (3.0, 2.0, -1.0)))
    got = history.at(np.array([-1.0, 5.0, 15.0, 30.0]))
    np.testing.assert_allclose(got, [[1.0, 0.0, 0.0], [2.0, 1.0, 0.0], [3.0, 2.0, -0.5], [3.0, 2.0, -1.0]])


def test_a_gust_comes_and_goes_smoothly():
    gust = Gust(10.0, 4.0, (6.0, 0.0, -2.0))
    got = gust.at(np.array([0.0, 10.0, 11.0, 12.0, 13.0, 14.0, 50.0]))
    np.testing.assert_allclose(got[:, 0], [0.0, 0.0, 3.0, 6.0, 3.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(got[:, 2], -got[:, 0] / 3.0, atol=1e-12)
