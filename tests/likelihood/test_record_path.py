"""The path that a record shows against the states that made it, and what it does not hang on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.twins import small_cluster as small

from bayeschute.dynamics.parameters import STANDARD_GRAVITY, Structure
from bayeschute.likelihood.channels import cluster_data
from bayeschute.likelihood.disturbances import Latent
from bayeschute.likelihood.priors import Prior
from bayeschute.likelihood.record_path import record_path
from bayeschute.records.sensors import SensorNoise
from bayeschute.virtual.drop import VirtualDrop, fly

FEW = Structure(("1", "alpha^2"), ("e", "rate"), 2, "riser")
MODEL = small.cluster((0.95, -0.8), (-0.1, 0.3))
SWINGING = small.start([[0.35, 0.05], [0.1, -0.1], [-1.0, -1.0]])


@pytest.fixture(scope="module")
def flown():
    """States (T, X) of a swing, after the first seconds, in which the capsule turns into place."""
    return small.fly(small.flight(small.cluster(), SWINGING))[50:]


def _seen(states):
    """What a record without noise shows: velocity, attitude and the canopies from the capsule (T, n, 3)."""
    place = states[:, 13:19].reshape(-1, 3, 2).swapaxes(1, 2)
    return states[:, 3:6], states[:, 6:10], place - states[:, None, :3]


def _path(states, velocity, attitude, apart, dt=small.DT):
    return record_path(replace(SWINGING, position=states[0, :3]), MODEL, dt, velocity, attitude, apart)


@pytest.fixture(scope="module")
def made(flown):
    return _path(flown, *_seen(flown))


def _riser(states):
    """Unit vectors attach point -> canopy (T, 3, n) of states, the attach point on the body's x axis about."""
    w, x, y, z = states[:, 6:10].T
    b = small.CAPSULE.attach_b
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    arm = np.einsum("ijt,j->ti", turn, [b.x, b.y, b.z])
    riser = states[:, 13:19].reshape(-1, 3, 2) - (states[:, :3] + arm)[..., None]
    return riser, np.linalg.norm(riser, axis=1)


def test_the_path_of_a_record_without_noise_is_that_of_its_states(made, flown):
    """Up to what a second's smoothing takes off a swing, and off the capsule's wobble of a second, half a second from
    the ends.
    """
    inner, got = slice(5, -5), made.states
    assert got.shape == flown.shape
    off, size = np.abs(got - flown)[inner].max(axis=0), np.ptp(flown[inner], axis=0)
    assert off[3:6].max() < 0.01 and off[6:10].max() < 1e-3
    assert (off[10:13] < 0.2 * size[10:13]).all() and off[10:13].max() > 1e-3
    np.testing.assert_allclose(np.linalg.norm(got[:, 6:10], axis=1), 1.0, rtol=1e-12)
    assert off[13:19].max() < 0.05 and (off[19:] < 0.1 * size[19:]).all()
    (ours, length), (theirs, stretched) = _riser(got), _riser(flown)
    assert np.abs(ours / length[:, None] - theirs / stretched[:, None])[inner].max() < 1e-3
    assert size[3:5].max() > 5.0 and size[12] > 0.1  # there is a swing, and a wobble


def test_a_body_that_turns_steadily_has_its_rate():
    """About an axis of its own, at 0.2 rad/s: the axis is the body's, whatever the attitude."""
    rng, time = np.random.default_rng(2), small.DT * np.arange(60)
    axis, first = rng.standard_normal(3), rng.standard_normal(4)
    axis, first = axis / np.linalg.norm(axis), first / np.linalg.norm(first)
    half = 0.5 * 0.2 * time[:, None]
    turn, (w, v) = np.hstack([np.cos(half), np.sin(half) * axis]), (first[0], first[1:])
    attitude = np.column_stack(
        [w * turn[:, 0] - turn[:, 1:] @ v, w * turn[:, 1:] + turn[:, :1] * v + np.cross(v, turn[:, 1:])]
    )
    apart = np.tile([[5.0, 0.0, -70.0], [-5.0, 0.0, -70.0]], (60, 1, 1))
    made = record_path(SWINGING, MODEL, small.DT, np.zeros((60, 3)), attitude, apart).states
    np.testing.assert_allclose(made[5:-5, 10:13], np.tile(0.2 * axis, (50, 1)), atol=1e-3)
    np.testing.assert_allclose(made[5:-5, 6:10], attitude[5:-5], atol=1e-4)


def test_positions_are_the_integral_of_the_velocity(made, flown):
    np.testing.assert_allclose(made.states[0, :3], flown[0, :3], atol=1e-12)
    assert np.abs(made.states[:, :3] - flown[:, :3]).max() < 0.05


def test_risers_carry_their_share_of_the_weight(made):
    weight = small.CAPSULE.mass * STANDARD_GRAVITY / 2.0
    _, length = _riser(made.states)
    np.testing.assert_allclose(length, small.RISERS.length + weight / small.RISERS.stiffness, rtol=1e-12)


def test_signs_of_quaternions_do_not_matter(made, flown):
    velocity, attitude, apart = _seen(flown)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], size=(len(flown), 1))
    signs[0] = 1.0
    assert (signs < 0.0).sum() > 20
    again = _path(flown, velocity, signs * attitude, apart)
    np.testing.assert_allclose(again.states, made.states, atol=1e-12)
    turned = _path(flown, velocity, -signs * attitude, apart).states
    np.testing.assert_allclose(turned[:, 6:10], -made.states[:, 6:10], atol=1e-12)
    np.testing.assert_allclose(turned[:, 10:13], made.states[:, 10:13], atol=1e-12)


@pytest.mark.parametrize("dt", [0.1, 0.2])
def test_slack_is_of_an_acceleration_for_a_sample(flown, dt):
    step = round(dt / small.DT)
    states = flown[::step]
    slack = _path(states, *_seen(states), dt=dt).slack
    speed = 0.1 * STANDARD_GRAVITY * dt
    assert slack.shape == (25,) and (slack > 0.0).all()
    np.testing.assert_allclose(slack[[3, 4, 5, *range(19, 25)]], speed, rtol=1e-12)
    np.testing.assert_allclose(slack[[0, 1, 2, *range(13, 19)]], 0.05 * speed, rtol=1e-12)
    np.testing.assert_allclose(slack[6:10], 0.5 * dt * slack[10:13].mean(), rtol=1e-12)
    assert 5.0 < speed / slack[10] < 15.0  # over a lever of metres


@pytest.mark.parametrize("count", [3, 4, 7])
def test_a_short_record_has_a_path_too(flown, count):
    made = _path(flown[:count], *_seen(flown[:count]))
    assert made.states.shape == (count, 25) and np.isfinite(made.states).all()


def test_gaps_of_a_record_are_bridged():
    """A virtual record without noise, some of its samples missing: the path is that of the whole one."""
    white = {name: SensorNoise(1e-9) for name in ("canopy_position", "capsule_velocity", "capsule_attitude")}
    drop = VirtualDrop(duration=6.0, dt=0.1, altitude=1500.0, swing=0.2, swing_azimuth=0.5, sensors=white)
    record, _ = fly(drop, MODEL, FEW, 0)
    priors = [Prior("axial[1]", 0.95, 0.1, False, "1", "")]

    def path(record):
        given = record, MODEL, FEW, priors, tuple(white), Latent((), (), 3)
        return cluster_data(*given).path.states

    whole, broken = path(record), record.copy(deep=True)
    broken["canopy_position"][dict(time=slice(20, 23))] = np.nan
    broken["capsule_velocity"][dict(time=slice(40, 42))] = np.nan
    broken["capsule_attitude"][dict(time=slice(30, 33))] = np.nan
    got = path(broken)
    assert np.isfinite(got).all()
    off = np.abs(got - whole)
    assert 0.0 < off[:, 3:6].max() < 0.05 and 0.0 < off[:, 6:10].max() < 2e-3
    assert 0.0 < off[:, 13:19].max() < 0.1
