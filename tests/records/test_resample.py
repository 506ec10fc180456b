"""A channel on a new clock: exact on lines and great circles, means of what is faster, gaps and breaks left open."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from bayeschute.records.resample import Channel, Grid, _slerp, default_max_gap, resample, same_sign

RNG = np.random.default_rng(0)


def channel(time, values, variable="altitude", breaks=()):
    values = np.asarray(values, float).reshape(len(time), -1)
    return Channel(variable, variable, None, np.asarray(time), values, np.isfinite(values).all(axis=1), breaks)


def grid(start, end, rate, max_gap=None):
    return Grid(start + np.arange(round((end - start) * rate) + 1) / rate, rate, max_gap)


@pytest.mark.parametrize(("native", "wanted"), [(0.01, 0.5), (0.3, 0.5), (0.4, 0.6), (2.0, 3.0)])
def test_the_default_gap(native, wanted):
    assert default_max_gap(native) == pytest.approx(wanted)


def test_signs_are_made_to_go_on_and_nothing_else():
    q = Rotation.from_rotvec(np.outer(np.linspace(0.0, 9.0, 80), [0.6, 0.0, 0.8])).as_quat()
    made = same_sign(q * RNG.choice([-1.0, 1.0], (80, 1)))
    np.testing.assert_array_equal(np.abs(made), np.abs(q))
    assert (np.sum(made[1:] * made[:-1], axis=1) > 0.0).all()
    assert same_sign(q[:0]).shape == (0, 4) and (same_sign(-q)[0] == -q[0]).all()


def test_between_two_attitudes_along_the_great_circle():
    ends = Rotation.random(2, random_state=1)
    a, b = same_sign(ends.as_quat()[:, [3, 0, 1, 2]])
    share = np.linspace(0.0, 1.0, 11)
    made = _slerp(np.tile(a, (11, 1)), np.tile(b, (11, 1)), share)
    wanted = Slerp([0.0, 1.0], ends)(share).as_quat()[:, [3, 0, 1, 2]]
    np.testing.assert_allclose(np.abs(np.sum(made * wanted, axis=1)), 1.0, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(made, axis=1), 1.0, rtol=1e-14)
    still = _slerp(np.tile(a, (3, 1)), np.tile(a, (3, 1)), np.array([0.0, 0.4, 1.0]))
    np.testing.assert_allclose(still, np.tile(a, (3, 1)), rtol=1e-14)


def test_a_line_stays_one_on_any_clock_between_its_ends():
    time = np.cumsum(RNG.uniform(0.05, 0.15, 100))
    x = np.stack([3.0 - 2.0 * time, 0.5 * time], axis=1)
    made = grid(time[0] - 0.5, time[-1] + 0.5, 9.0)
    found, _ = resample(channel(time, x, "wind"), made)
    inside = (made.time >= time[0]) & (made.time <= time[-1])
    np.testing.assert_array_equal(np.isfinite(found).all(axis=1), inside)
    np.testing.assert_allclose(found[inside], np.stack([3.0 - 2.0 * made.time, 0.5 * made.time], axis=1)[inside])


def test_its_own_clock_changes_nothing():
    time = 5.0 + 0.1 * np.arange(50)
    x = RNG.standard_normal((50, 3))
    x[[7, 8, 30]] = np.nan
    found, notes = resample(channel(time, x, "capsule_velocity"), grid(5.0, 9.9, 10.0, max_gap=0.0))
    np.testing.assert_array_equal(found, x)
    assert [(n.kind, n.count) for n in notes] == [("gap", 2), ("gap", 1)]
    np.testing.assert_allclose([(n.start, n.end) for n in notes], [(5.6, 5.9), (7.9, 8.1)])


@pytest.mark.parametrize(("max_gap", "bridged"), [(None, False), (0.8, False), (0.95, True), (5.0, True)])
def test_gaps_up_to_the_longest_are_bridged_and_told(max_gap, bridged):
    time = np.delete(0.1 * np.arange(60), np.arange(20, 28))  # 0.9 s between neighbours
    found, notes = resample(channel(time, 7.0 * time), grid(0.0, 5.9, 10.0, max_gap))
    assert np.isfinite(found[20:28]).all() == bridged and np.isfinite(np.delete(found, np.arange(20, 28))).all()
    (note,) = notes
    assert (note.kind, note.count) == ("interpolated" if bridged else "gap", 8)


def test_nothing_is_bridged_over_a_shift_of_level():
    time = 0.1 * np.arange(60)
    broken, notes = resample(channel(time, time, breaks=(3.05,)), grid(0.0, 5.9, 100.0))
    clock = grid(0.0, 5.9, 100.0).time
    np.testing.assert_array_equal(np.isnan(broken[:, 0]), (clock > 3.0 + 1e-6) & (clock < 3.1 - 1e-6))
    assert [n.kind for n in notes] == ["gap", "resampled"]


def test_a_faster_channel_is_averaged_over_the_new_interval():
    """The mean of t^2 over an interval h about t is t^2 + h^2/12."""
    time, h = 0.001 * np.arange(4001), 0.25
    made = grid(0.0, 4.0, 1.0 / h)
    found, (note,) = resample(channel(time, time**2), made)
    np.testing.assert_allclose(found[1:-1, 0], made.time[1:-1] ** 2 + h**2 / 12.0, atol=1e-6)
    np.testing.assert_allclose(found[[0, -1], 0], made.time[[0, -1]] ** 2, atol=1e-9)  # no whole interval: no mean
    assert note.kind == "resampled" and "mean over 0.25 s" in note.detail and note.times == ()


def test_not_quite_twice_as_fast_is_not_averaged():
    time = 0.1 * np.arange(100)
    x, made = RNG.standard_normal(100), grid(0.0, 9.5, 5.1)
    found, notes = resample(channel(time, x), made)
    np.testing.assert_allclose(found[:, 0], np.interp(made.time, time, x), atol=1e-12)
    assert notes == []


def test_the_samples_of_a_slower_channel_are_told():
    time = np.arange(0.0, 30.0, 1.0)
    _, (note,) = resample(channel(time, time), grid(4.0, 20.0, 10.0, max_gap=2.0))
    assert "no new information" in note.detail and note.count == 161
    assert note.times == tuple(time[4:21])


def test_ends_that_no_sample_covers_are_told():
    time = 0.1 * np.arange(100)
    found, notes = resample(channel(time, 0.0 * time), grid(-1.0, 11.9, 10.0))
    assert np.isfinite(found).sum() == 100
    assert [(n.kind, n.count) for n in notes] == [("gap", 10), ("gap", 20)]
    (empty,) = resample(channel(time, np.nan * time), grid(0.0, 1.0, 10.0))[1]
    assert (empty.kind, empty.count, empty.detail) == ("gap", 11, "no valid sample")
    one, _ = resample(channel(time[:1], [4.0]), grid(0.0, 1.0, 10.0))
    assert one[0, 0] == 4.0 and np.isnan(one[1:]).all()


def test_longitudes_go_the_short_way_round():
    time = np.arange(0.0, 4.0, 1.0)
    east = np.array([3.1, 3.14, -3.1, -3.06])
    found, _ = resample(channel(time, east, "longitude"), grid(0.0, 3.0, 2.0))
    wanted = np.interp(grid(0.0, 3.0, 2.0).time, time, np.unwrap(east))
    np.testing.assert_allclose(np.exp(1j * found[:, 0]), np.exp(1j * wanted))
    assert (np.abs(found) <= np.pi).all()


def test_attitudes_of_any_length_and_sign_come_out_as_unit_ones():
    time = 0.1 * np.arange(60)
    half = 0.5 * 0.9 * time[:, None]
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    q = np.hstack([np.cos(half), np.sin(half) * axis])
    mixed = q * RNG.choice([-1.0, 1.0], (60, 1)) * RNG.uniform(0.97, 1.03, (60, 1))
    made = grid(0.0, 5.8, 23.0)
    found, _ = resample(channel(time, mixed, "capsule_attitude"), made)
    now = 0.5 * 0.9 * made.time[:, None]
    wanted = np.hstack([np.cos(now), np.sin(now) * axis])
    np.testing.assert_allclose(np.sum(found * wanted, axis=1) ** 2, 1.0, atol=1e-12)
    assert (np.sum(found[1:] * found[:-1], axis=1) > 0.0).all()
