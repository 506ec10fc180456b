"""Virtual swings of the dumbbell, and frequency and amplitude of a swing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayeschute.dynamics.parameters import Canopies
from bayeschute.likelihood.joint import NoiseParameters
from bayeschute.likelihood.noise import Noise
from bayeschute.likelihood.priors import Prior
from bayeschute.records.sensors import SensorNoise
from bayeschute.reduced.dumbbell import Dumbbell
from bayeschute.reduced.dumbbell_data import GUSTS, STILL, dumbbell_data
from bayeschute.reduced.planar import PlanarAero
from bayeschute.reduced.virtual_swing import SwingDrop, fly_swing, predict_swings, swing_of
from bayeschute.virtual.drop import Turbulence
from bayeschute.virtual.virtual_wind import WindProfile

BASE = Dumbbell(9936.0, 71.6, Canopies(981.0, 35.4, 9.75, 149.0, 3969.0))
AERO = PlanarAero(0.927, -0.329, 0.189, 0.1901, -0.988)
PRIORS = [Prior(n, getattr(AERO, n), 0.1, False, "1", "") for n in ("C_A0", "C_Nalphadot")]
THETA = np.array([[p.centre for p in PRIORS]])
DROP = SwingDrop(90.0, 0.1, 2000.0, 0.3)


@pytest.fixture(scope="module")
def still():
    return fly_swing(DROP, BASE, AERO, 1, substeps=2)


@pytest.mark.parametrize("offset", [0.0, 0.05])
def test_frequency_and_amplitude_of_a_known_swing(offset):
    time = np.arange(0.0, 60.0, 0.1)
    made = swing_of(time, offset + 0.37 * np.sin(2.0 * np.pi * 0.0698 * time + 0.4))
    assert made.frequency == pytest.approx(0.0698, rel=1e-4)
    assert made.amplitude == pytest.approx(0.37, rel=1e-3)


def test_what_does_not_swing_has_no_frequency():
    time = np.arange(0.0, 60.0, 0.1)
    for angle in (0.3 * np.exp(-0.1 * time), np.full(time.size, np.nan)):
        assert np.isnan(swing_of(time, angle)).all()


def test_a_swing_settles_into_the_published_limit_cycle():
    """CHECKCASES 14: 0.380 rad, 0.0698 Hz at the density there; here the air changes, and both a little."""
    _, truth = fly_swing(replace(DROP, duration=200.0, altitude=2900.0), BASE, AERO, 1, substeps=2)
    late = truth["time"].values > 120.0
    made = swing_of(truth["time"].values[late], truth["swing_angle"].values[late])
    assert made.amplitude == pytest.approx(0.380, abs=0.02)
    assert made.frequency == pytest.approx(0.0698, abs=0.0015)


def test_instruments_and_turbulence_are_the_only_differences(still):
    record, truth = still
    for name in ("swing_angle", "capsule_velocity", "wind", "density"):
        np.testing.assert_array_equal(record[name], truth[name])
    assert not truth["turbulence"].any() and "turbulence" not in record
    blowing = WindProfile((0.0, 1.0), (6.0, 6.0), (3.0, 3.0), (0.5, 0.5))
    windy = replace(
        DROP,
        wind=blowing,
        turbulence=Turbulence(0.6, 0.2, 5.0),
        sensors={"swing_angle": SensorNoise(0.01), "wind": SensorNoise(0.0, 0.3, 20.0)},
    )
    seen, flown = fly_swing(windy, BASE, AERO, 2, substeps=2)
    np.testing.assert_array_equal(seen["capsule_velocity"], flown["capsule_velocity"])
    assert np.std(seen["swing_angle"] - flown["swing_angle"]) == pytest.approx(0.01, rel=0.1)
    np.testing.assert_allclose(flown["wind"], [[6.0, 0.5]] * 901)
    assert 0.2 < np.std(flown["turbulence"][:, 0]) < 1.2
    assert np.std(seen["wind"] - flown["wind"]) > 0.1
    again, _ = fly_swing(windy, BASE, AERO, 2, substeps=2)
    np.testing.assert_array_equal(again["swing_angle"], seen["swing_angle"])


def test_steady_wind_carries_the_swing(still):
    blowing = WindProfile((0.0, 1.0), (6.0, 6.0), (0.0, 0.0))
    _, flown = fly_swing(replace(DROP, wind=blowing), BASE, AERO, 1, substeps=2)
    np.testing.assert_allclose(flown["swing_angle"], still[1]["swing_angle"], atol=1e-9)
    np.testing.assert_allclose(flown["capsule_velocity"] - still[1]["capsule_velocity"], [[6.0, 0.0]] * 901, atol=1e-8)


def test_predictions_are_the_flight_where_nothing_is_unknown(still):
    record, truth = still
    data = dumbbell_data(record, BASE, AERO, PRIORS, STILL)
    made = predict_swings(data, None, np.repeat(THETA, 3, axis=0) * [[1.0, 1.0], [1.0, 1.0], [1.0, -1.0]], 30.0, None)
    seen = truth["time"].values >= 30.0
    wanted = swing_of(truth["time"].values[seen], truth["swing_angle"].values[seen])
    np.testing.assert_allclose(made[0], wanted, rtol=2e-3)  # the start is read from the record's opening
    np.testing.assert_array_equal(made[0], made[1])
    assert not made[2, 1] > 0.5 * made[0, 1]  # damping turned round: it comes to rest


def test_unknown_wind_spreads_predictions(still):
    data = dumbbell_data(still[0], BASE, AERO, PRIORS, GUSTS)
    noise = Noise(np.array([0.01, 0.1]), np.array([0.01, 0.1]), np.ones(2))
    laws = NoiseParameters(noise, (np.array([0.6, 5.0]), np.array([0.3, 5.0])))
    made = predict_swings(data, laws, np.repeat(THETA, 3, axis=0), 30.0, np.random.default_rng(1))
    assert (np.ptp(made, axis=0) / made.mean(axis=0) > [1e-3, 1e-2]).all()
