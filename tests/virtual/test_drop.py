"""Virtual drops: reproducible, flown in the wind of their own altitude, with disturbances of known statistics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import periodogram
from tests.twins import small_cluster as small

from bayeschute.atmosphere.standard import standard_density
from bayeschute.records.sensors import Dropouts, SensorNoise
from bayeschute.virtual import drop
from bayeschute.virtual.drop import (
    Breathing,
    Turbulence,
    VirtualDrop,
    WindProfile,
    breathing_history,
    fly,
    start_of,
)

# Samples, interval and steps are those of the shared flight: one compilation.
DROP = VirtualDrop(
    duration=(small.SAMPLES - 1) * small.DT,
    dt=small.DT,
    altitude=2000.0,
    swing=0.1,
    flyout=0.2,
    wind=WindProfile((1700.0, 1900.0, 2000.0), (0.0, 4.0, 9.0), (1.0, -3.0, 2.0)),
    turbulence=Turbulence(0.5, 0.2, 2.0),
    breathing=Breathing(0.05),
    sensors={"capsule_velocity": SensorNoise(0.1, 0.05, 1.0), "canopy_position": SensorNoise(0.2)},
    dropouts=Dropouts(0.05, 0.5),
)
MODEL = small.cluster(transverse=(-0.1, 0.0, 2.6, 0.4, 0.3))


def go(drop=DROP, seed=3, model=MODEL):
    return fly(drop, model, small.TWO, seed, small.SUBSTEPS)


@pytest.fixture(scope="module")
def flown():
    return go()


def raw(dataset):
    return {name: variable.values.tobytes() for name, variable in dataset.variables.items()}


def test_the_same_seed_gives_the_same_bytes_and_another_gives_others(flown):
    again, other = go(), go(seed=4)
    for a, b, c in zip(flown, again, other, strict=True):
        assert raw(a) == raw(b)
        assert raw(a)["capsule_velocity"] != raw(c)["capsule_velocity"]


def test_wind_and_density_belong_to_the_altitude_flown(flown):
    _, truth = flown
    altitude = -truth["capsule_position"].sel(axis="down").values
    np.testing.assert_allclose(truth["altitude"], altitude)
    # The last repetition changed no altitude by more than a centimetre; the steepest wind gradient is 0.05 1/s.
    np.testing.assert_allclose(truth["wind"], DROP.wind.at(altitude), atol=0.01 * 0.05)
    np.testing.assert_allclose(truth["density"], standard_density(altitude), rtol=2e-6)
    assert 100.0 < altitude[0] - altitude[-1] < 400.0


def test_truth_and_record_tell_the_same_flight(flown):
    record, truth = flown
    error = (record["capsule_velocity"] - truth["capsule_velocity"]).values
    assert error.std() == pytest.approx(np.hypot(0.1, 0.05), rel=0.2)
    np.testing.assert_array_equal(record["wind"], truth["wind"])
    assert "turbulence" not in record and "swing_angle" not in record
    v = truth["capsule_velocity"].values
    rate = np.gradient(truth["capsule_position"].values, small.DT, axis=0)
    np.testing.assert_allclose(rate[5:-5], v[5:-5], atol=0.05)
    np.testing.assert_allclose(truth["descent_rate"], v[:, 2])
    # Specific force is acceleration less gravity, in body axes.
    q = truth["capsule_attitude"].values
    felt = np.linalg.norm(truth["capsule_specific_force"].values, axis=1)
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-5)
    lifted = np.gradient(v, small.DT, axis=0) - [0.0, 0.0, 9.80665]
    np.testing.assert_allclose(felt[5:-5], np.linalg.norm(lifted, axis=1)[5:-5], atol=0.5)


def test_canopy_velocities_are_recorded_on_request_and_change_nothing_of_the_flight(flown):
    record, truth = flown
    assert "canopy_velocity" not in record and "canopy_velocity" not in truth
    noise = SensorNoise(0.05, 0.1, 1.0)
    seen, true = go(replace(DROP, sensors={**DROP.sensors, "canopy_velocity": noise}))
    assert {name: values for name, values in raw(true).items() if name != "canopy_velocity"} == raw(truth)
    assert (
        seen["canopy_velocity"].dims == ("time", "canopy", "axis") and seen["canopy_velocity"].attrs["units"] == "m/s"
    )
    error = (seen["canopy_velocity"] - true["canopy_velocity"]).values
    assert error.std() == pytest.approx(np.hypot(0.05, 0.1), rel=0.2)
    rate = np.gradient(true["canopy_position"].values, small.DT, axis=0)
    np.testing.assert_allclose(rate[5:-5], true["canopy_velocity"].values[5:-5], atol=0.1)


def test_the_start_leans_swings_and_flies_out_as_told():
    drop = replace(DROP, swing=0.3, swing_azimuth=0.5, flyout=0.2, swing_rate=0.1)
    start = start_of(drop, MODEL, 2)
    mean = start.direction.mean(axis=1)
    assert np.arctan2(np.hypot(mean[0], mean[1]), -mean[2]) == pytest.approx(0.3)
    assert np.arctan2(mean[1], mean[0]) == pytest.approx(0.5)
    assert np.arccos(start.direction[:, 0] @ start.direction[:, 1]) == pytest.approx(0.4)
    np.testing.assert_allclose(np.sum(start.direction * start.turning, axis=0), 0.0, atol=1e-15)
    w, x, y, z = start.attitude
    body_x = [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)]
    np.testing.assert_allclose(body_x, mean / np.linalg.norm(mean), atol=1e-12)


def test_breathing_is_stationary_and_peaks_at_its_frequency():
    breathing = Breathing(0.05, 0.23, 0.05)
    factor = breathing_history(breathing, 0.1, 4000, 200, np.random.default_rng(0))
    assert factor.shape == (4000, 200)
    sd = factor.std(axis=1)
    np.testing.assert_allclose([sd[0], sd[10], sd.mean()], 0.05, rtol=0.12)
    assert sd.mean() == pytest.approx(0.05, rel=0.02)
    frequency, power = periodogram(factor - 1.0, 10.0, axis=0)
    assert frequency[power.mean(axis=1).argmax()] == pytest.approx(0.23, abs=0.01)


def test_no_breathing_is_exactly_none():
    np.testing.assert_array_equal(breathing_history(Breathing(), 0.1, 50, 2, np.random.default_rng(0)), 1.0)


def test_a_failed_flight_says_since_when(monkeypatch):
    whole = drop.flown

    def torn(*given):
        states = np.array(whole(*given))
        states[4:, 2] = np.nan
        return states

    monkeypatch.setattr(drop, "flown", torn)
    with pytest.raises(FloatingPointError, match=f"left the finite numbers at {4 * small.DT:.1f} s"):
        go()


def test_a_failed_flight_says_when():
    torn = replace(MODEL, risers=replace(small.RISERS, damping=1e9))
    with pytest.raises(FloatingPointError, match=r"left the finite numbers at \d+\.\d s"):
        go(model=torn)
