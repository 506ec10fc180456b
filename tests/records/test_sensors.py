"""Noise processes by their moments, and what of a flight they touch."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from bayeschute.records.record import make_record
from bayeschute.records.sensors import Dropouts, SensorNoise, missing, noisy, ornstein_uhlenbeck, record_of

DT = 0.1


def test_ornstein_uhlenbeck_is_stationary_with_its_time_constant():
    x = ornstein_uhlenbeck(2.0, 0.5, DT, (400, 4000), np.random.default_rng(0))
    sd = x.std(axis=1)
    np.testing.assert_allclose(sd, 2.0, rtol=0.06)
    assert sd[0] == pytest.approx(sd[200:].mean(), rel=0.05)
    for lag in (1, 5, 10):
        rho = np.mean(x[:-lag] * x[lag:]) / 4.0
        assert rho == pytest.approx(np.exp(-lag * DT / 0.5), abs=0.01)


def test_noisy_adds_both_parts():
    z = noisy(np.full((20000, 3), 7.0), SensorNoise(0.3, 0.4, 0.2), DT, np.random.default_rng(1))
    assert z.mean() == pytest.approx(7.0, abs=0.02)
    assert z.std() == pytest.approx(0.5, rel=0.02)
    np.testing.assert_array_equal(noisy(np.ones(5), SensorNoise(), DT, np.random.default_rng(1)), 1.0)


@pytest.mark.parametrize("share, mean_length", [(0.05, 0.5), (0.3, 1.0)])
def test_dropouts_have_their_share_and_length(share, mean_length):
    lost = missing(200_000, Dropouts(share, mean_length), DT, np.random.default_rng(2))
    assert lost.mean() == pytest.approx(share, rel=0.05)
    runs = np.diff(np.flatnonzero(np.diff(np.concatenate([[0], lost.astype(int), [0]]))))[::2]
    assert runs.mean() * DT == pytest.approx(mean_length, rel=0.05)
    assert not missing(50, Dropouts(), DT, np.random.default_rng(2)).any()


def truth(T=4000):
    q = np.tile([0.5, 0.5, 0.5, 0.5], (T, 1))
    still = np.zeros((T, 3))
    return make_record(
        time=np.arange(T) * DT, capsule_position=still, capsule_velocity=still, capsule_attitude=q, capsule_rate=still,
        capsule_specific_force=still, canopy_position=np.zeros((T, 2, 3)) + [0.0, 0.0, -70.0], wind=still,
        density=np.ones(T), altitude=np.ones(T),
    )  # fmt: skip


SENSORS = {
    "capsule_position": SensorNoise(0.5),
    "capsule_attitude": SensorNoise(0.01),
    "canopy_position": SensorNoise(0.2),
}


def test_a_record_keeps_what_no_sensor_touches_and_sees_canopies_from_the_capsule():
    flown = truth()
    before = flown.copy(deep=True)
    record = record_of(flown, SENSORS, Dropouts(0.2, 0.5), np.random.default_rng(3))
    xr.testing.assert_identical(flown, before)
    np.testing.assert_array_equal(record["wind"], flown["wind"])
    apart = (record["canopy_position"] - record["capsule_position"]).transpose("time", "canopy", "axis").values
    lost = np.isnan(apart)
    assert (lost.any(axis=2) == lost.all(axis=2)).all()
    assert (lost[:, 0, 0] != lost[:, 1, 0]).any()
    assert np.nanstd(apart - [0.0, 0.0, -70.0]) == pytest.approx(0.2, rel=0.05)
    assert float(record["capsule_position"].std()) == pytest.approx(0.5, rel=0.05)
    assert not record["capsule_attitude"].isnull().any()


def test_attitude_noise_turns_by_its_angle():
    record = record_of(truth(), SENSORS, Dropouts(), np.random.default_rng(4))
    q = record["capsule_attitude"].values
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0)
    turn = 2 * np.arccos(np.clip(q @ np.full(4, 0.5), -1, 1))
    assert np.sqrt(np.mean(turn**2)) == pytest.approx(0.01 * np.sqrt(3), rel=0.05)


def test_seeds_reproduce():
    one, two, three = (record_of(truth(50), SENSORS, Dropouts(0.2), np.random.default_rng(s)) for s in (5, 5, 6))
    xr.testing.assert_identical(one, two)
    assert not one.equals(three)


def test_the_zero_of_the_clock_does_not_matter():
    """Time constants of noise and lengths of dropouts are in seconds of the sample interval."""
    time, still = DT * np.arange(300), np.zeros((300, 3))
    made = [
        record_of(
            make_record(time=zero + time, capsule_position=still, canopy_position=np.zeros((300, 1, 3))),
            {"capsule_position": SensorNoise(0.1, 0.4, 3.0)}, Dropouts(0.2, 1.0), np.random.default_rng(5),
        )
        for zero in (0.0, 500.0)
    ]  # fmt: skip
    for name in ("capsule_position", "canopy_position"):
        np.testing.assert_allclose(made[1][name].values, made[0][name].values, atol=1e-9)
