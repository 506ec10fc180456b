"""Biases of velocities: exact where nothing is noisy, honest where it is."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.records.back_driving import SHORTEST, remove_velocity_bias, velocity_bias
from bayeschute.records.record import make_record, repairs
from bayeschute.records.sensors import SensorNoise, noisy

DT, SAMPLES, RATE = 0.1, 601, 0.43
TIME = DT * np.arange(SAMPLES)
BIAS = np.array([0.3, 0.0, -0.15])
SWING = np.array([3.0, 1.0, 0.2])
SPEEDS, PLACES = SensorNoise(0.1, 0.05, 1.0), SensorNoise(0.3, 0.2, 2.0)


def motion():
    """Position and velocity (T, 3) of a swing about a steady descent."""
    s, c = np.sin(RATE * TIME)[:, None], np.cos(RATE * TIME)[:, None]
    fall = np.array([0.0, 0.0, 10.0])
    return -SWING * s / RATE**2 + fall * TIME[:, None], -SWING * c / RATE + fall


def seen(seed, bias=BIAS, velocity=SPEEDS, position=PLACES, copies=1):
    """Records (T, copies, 3) of position and velocity."""
    rng = np.random.default_rng(seed)
    p, v = (np.repeat(a[:, None], copies, axis=1) for a in motion())
    return noisy(p, position, DT, rng), noisy(v + bias, velocity, DT, rng)


def test_a_bias_without_noise_is_found_exactly():
    rng = np.random.default_rng(1)
    v = rng.normal(size=(SAMPLES, 3))
    p = np.concatenate([np.zeros((1, 3)), np.cumsum(0.5 * DT * (v[1:] + v[:-1]), axis=0)])
    holes = p.copy()
    holes[200:260] = np.nan
    for positions in (p, holes):
        told = velocity_bias(v + BIAS, positions + 7.0, DT)
        np.testing.assert_allclose(told.bias, BIAS, atol=1e-9)
        np.testing.assert_allclose(told.drift, BIAS * TIME[-1], atol=1e-7)
        assert (told.se < 1e-8).all()


@pytest.mark.parametrize(
    ("velocity", "position", "least"),
    [
        (SensorNoise(0.1, 0.05, 1.0), SensorNoise(0.3, 0.2, 2.0), 0.75),
        (SensorNoise(0.0, 0.1, 6.0), SensorNoise(0.3), 0.75),
        (SensorNoise(0.02), SensorNoise(0.5, 0.5, 5.0), 0.4),  # it might be the velocity's: errors are told too large
    ],
)
def test_biases_come_back_within_their_standard_errors(velocity, position, least):
    """Over 40 records of 3 axes; z scores of a normal law have a root mean square of 1 +- 0.065."""
    p, v = seen(3, velocity=velocity, position=position, copies=40)
    told = velocity_bias(v, p, DT)
    z = (told.bias - BIAS) / told.se
    assert least < np.sqrt(np.mean(z**2)) < 1.25
    assert np.mean(np.abs(z) < 1.645) > 0.82
    assert np.abs(np.mean(z)) < 3.0 / np.sqrt(z.size)
    assert told.se.mean() < 1.3 / least * (told.bias - BIAS).std()
    assert told.found()[:, 1].mean() <= 0.05


def test_a_standard_error_of_white_noise_alone_would_be_too_small():
    """The error of the mean velocity over its white noise: what remembers counts more."""
    noise = SensorNoise(0.0, 0.1, 6.0)
    p, v = seen(3, velocity=noise, position=SensorNoise(0.05), copies=20)
    told = velocity_bias(v, p, DT)
    assert (told.bias - BIAS).std() > 5.0 * noise.correlated / np.sqrt(SAMPLES)
    assert told.se.mean() > 5.0 * noise.correlated / np.sqrt(SAMPLES)


def record(seed, bias=BIAS):
    p, v = (a[:, 0] for a in seen(seed, bias))
    return make_record(time=TIME, capsule_position=p, capsule_velocity=v)


def test_what_is_found_is_removed_and_told():
    before = record(5)
    after, told = remove_velocity_bias(before)
    np.testing.assert_array_equal(told.found(), [True, False, True])
    change = (before["capsule_velocity"] - after["capsule_velocity"]).values
    np.testing.assert_allclose(change, np.broadcast_to(np.where(told.found(), told.bias, 0.0), change.shape))
    (note,) = repairs(after)
    assert note.kind == "bias" and note.variable == "capsule_velocity" and note.count == SAMPLES
    assert f"north {told.bias[0]:+.3g}" in note.detail and note.detail.count("removed") == 2
    again = velocity_bias(after["capsule_velocity"].values, after["capsule_position"].values, DT)
    np.testing.assert_allclose(again.bias[[0, 2]], 0.0, atol=1e-9)
    np.testing.assert_allclose(again.bias[1], told.bias[1], atol=1e-9)
    assert "units" in after["capsule_velocity"].attrs and repairs(before) == ()


def test_no_bias_leaves_the_record_as_it_was():
    before = record(6, bias=0.0)
    after, told = remove_velocity_bias(before)
    assert not told.found().any()
    np.testing.assert_array_equal(before["capsule_velocity"], after["capsule_velocity"])
    assert [note.kind for note in repairs(after)] == ["derived"]


def test_bad_input_is_named():
    p, v = motion()
    with pytest.raises(InputError, match="shape"):
        velocity_bias(v[:, :2], p, DT)
    few = np.full_like(v, np.nan)
    few[: SHORTEST - 1] = 1.0
    with pytest.raises(InputError, match=f"{SHORTEST - 1} positions .*at least {SHORTEST}"):
        velocity_bias(few, p, DT)
    with pytest.raises(InputError, match="without capsule_velocity"):
        remove_velocity_bias(make_record(time=TIME, capsule_position=p))
    with pytest.raises(InputError, match="uniform"):
        remove_velocity_bias(make_record(time=TIME**1.01, capsule_position=p, capsule_velocity=v))
