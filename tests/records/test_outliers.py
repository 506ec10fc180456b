"""What outliers are: limits from both sides, and that neither datum, trend, sense nor direction of time matters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayeschute.records.outliers import SMOOTH, _excess, _moving_median, _rates, _runs, find_faulty
from bayeschute.records.resample import Channel

DT = 0.1
T = DT * np.arange(400)


def channel(values, variable="altitude", time=T):
    values = np.asarray(values, float).reshape(time.size, -1)
    return Channel(variable, variable, None, time, values, np.isfinite(values).all(axis=1))


def dropped(made):
    found, repairs = find_faulty(made)
    return np.flatnonzero(made.valid & ~found.valid), [r.kind for r in repairs]


def test_runs_are_those_of_a_loop():
    rng = np.random.default_rng(0)
    for share in (0.0, 0.3, 0.9, 1.0):
        mask = rng.random(50) < share
        wanted = [i for i in range(50) if mask[i] and (i == 0 or not mask[i - 1])]
        ends = [i for i in range(50) if mask[i] and (i == 49 or not mask[i + 1])]
        assert _runs(mask) == list(zip(wanted, ends, strict=True))


def test_moving_medians_are_those_of_a_loop():
    x = np.random.default_rng(1).standard_normal(40)
    x[[3, 17, 18, 19, 20, 21]] = np.nan
    wanted = [np.nanmedian(x[max(i - 2, 0) : i + 3]) if np.isfinite(x[max(i - 2, 0) : i + 3]).any() else np.nan for i in range(40)]  # fmt: skip
    np.testing.assert_array_equal(_moving_median(x, 2), wanted)


def test_rates_before_and_after_a_bend():
    """Of two lines: steps that n samples precede (follow) know the slope before (after) the bend alone."""
    t = np.cumsum(np.random.default_rng(2).uniform(0.05, 0.15, 60))
    x = np.where(t < t[30], 3.0 * (t - t[30]), -2.0 * (t - t[30]))
    before, after = _rates(x, t, 7)
    assert before.shape == after.shape == (59,)
    np.testing.assert_allclose(before[:30], 3.0, rtol=1e-9)
    np.testing.assert_allclose(after[30:], -2.0, rtol=1e-9)
    np.testing.assert_allclose(before[38:], -2.0, rtol=1e-9)
    np.testing.assert_allclose(after[:22], 3.0, rtol=1e-9)


@pytest.mark.parametrize("size", [-7.0, 4.0])
def test_what_no_side_foretells_of_a_step_is_its_excess(size):
    x = 5.0 - 3.0 * T
    x[200:] += size
    beyond, sd = _excess(x, T)
    np.testing.assert_allclose(beyond[199], size, rtol=1e-9)
    np.testing.assert_allclose(np.delete(beyond, 199), 0.0, atol=1e-9)
    np.testing.assert_allclose(sd, 0.0, atol=1e-9)


def test_the_expected_deviation_of_a_step_is_that_of_its_noise():
    """Of white steps: sqrt(1 + 1/7) times their own, and more over a gap, of the rate that foretells it."""
    rng = np.random.default_rng(3)
    x = np.cumsum(0.7 * rng.standard_normal(4000))
    t = DT * np.arange(4000)
    _, sd = _excess(x, t)
    assert np.median(sd) == pytest.approx(0.7 * np.sqrt(1.0 + 1.0 / 49.0), rel=0.1)
    keep = np.delete(np.arange(4000), np.arange(2000, 2050))
    _, wide = _excess(x[keep], t[keep])
    assert wide[1999] / np.median(wide) == pytest.approx(np.hypot(1.0, 51.0 / 20.0), rel=0.2)


@pytest.mark.parametrize("variable", sorted(SMOOTH))
def test_a_lone_step_beyond_what_a_body_can_do_is_a_spike(variable):
    """Without noise the limit is the step that the table states, and from both sides of zero."""
    level = {"pressure": 9e4, "temperature": 280.0, "density": 1.0}.get(variable, 0.1)
    line = level + 1e-3 * SMOOTH[variable].step * np.arange(400)
    for sign in (-1.0, 1.0):
        for share, wanted in ((0.95, []), (1.05, [150])):
            x = line.copy()
            x[150] += sign * share * SMOOTH[variable].step
            assert dropped(channel(x, variable))[0].tolist() == wanted, (variable, share)


@pytest.mark.parametrize("gap", [5.0, 29.0, 31.0])
@pytest.mark.parametrize("variable", sorted(SMOOTH))
def test_over_a_gap_a_step_may_be_longer_by_the_seconds(variable, gap):
    """Up to half a minute; longer gaps are not judged."""
    time, scale = np.concatenate([T, T[-1] + gap + T]), SMOOTH[variable]
    level = {"pressure": 9e4, "temperature": 280.0, "density": 1.0}.get(variable, 0.1)
    limit = scale.step + scale.rate * (gap - DT)
    for share, found in ((0.98, 0), (1.02, gap < 30.0)):
        x = level + 1e-3 * scale.step * time + np.where(np.arange(800) < 400, 0.0, share * limit)
        assert dropped(channel(x, variable, time))[1] == ["level_shift"] * found, share


def test_a_shift_in_several_steps_is_one():
    x = 0.01 * T + np.interp(np.arange(400), [199, 200, 201, 202], [0.0, 8.0, 19.0, 28.0])
    found, (repair,) = find_faulty(channel(x))
    assert (repair.kind, repair.start, repair.end, repair.count) == ("level_shift", T[199], T[202], 4)
    assert 25.0 < float(repair.detail.split()[3]) < 28.0  # what neither side's rate foretells, and that knows of steps
    assert np.flatnonzero(~found.valid).tolist() == [199, 200, 201, 202]


@pytest.fixture(scope="module")
def wild():
    rng = np.random.default_rng(4)
    x = np.cumsum(rng.standard_normal((400, 3)) * 0.05, axis=0) + 0.2 * rng.standard_normal((400, 3))
    x[[60, 61, 140, 330], [0, 0, 2, 1]] += [9.0, 9.0, -12.0, 30.0]
    x[250:, 1] += 11.0
    return x


def test_datum_trend_and_sense_do_not_matter(wild):
    base = find_faulty(channel(wild, "capsule_position"))[0]
    assert np.flatnonzero(~base.valid).tolist() == [60, 61, 140, 249, 250, 330]
    assert base.breaks == pytest.approx((0.5 * (T[249] + T[250]),))
    turn = np.roll(np.eye(3), 1, axis=0)
    moved = (wild + [1e3, -400.0, 7.0] + np.outer(T, [2.0, -30.0, 11.0]), -wild, wild @ turn)
    for other in moved:
        np.testing.assert_array_equal(find_faulty(channel(other, "capsule_position"))[0].valid, base.valid)


def test_the_direction_of_time_does_not_matter(wild):
    base = find_faulty(channel(wild, "capsule_position"))[0].valid
    back = find_faulty(channel(wild[::-1], "capsule_position"))[0].valid
    np.testing.assert_array_equal(back[::-1], base)


def test_samples_that_were_not_valid_say_nothing(wild):
    made = channel(wild, "capsule_position")
    holed = replace(made, valid=made.valid & (np.arange(400) != 100), values=np.where(np.arange(400)[:, None] == 100, 1e6, wild))  # fmt: skip
    found = find_faulty(holed)[0]
    assert not found.valid[100]
    np.testing.assert_array_equal(np.delete(found.valid, 100), np.delete(find_faulty(made)[0].valid, 100))


@pytest.mark.parametrize(("count", "goes"), [(1, True), (2, True), (3, False)])
def test_of_a_rough_channel_only_one_or_two_samples_go(count, goes):
    x = 9.8 + 0.1 * np.random.default_rng(5).standard_normal((400, 3))
    x[200 : 200 + count, 1] -= 300.0
    gone, kinds = dropped(channel(x, "capsule_specific_force"))
    assert gone.tolist() == (list(range(200, 200 + count)) if goes else [])
    assert kinds == ["spike"] * goes


def test_the_floor_of_a_rough_channel():
    x = 1e-3 * np.random.default_rng(6).standard_normal((400, 3))
    for size, wanted in ((1.9, []), (2.1, [77])):
        y = x.copy()
        y[77, 2] = size
        assert dropped(channel(y, "capsule_rate"))[0].tolist() == wanted


@pytest.mark.parametrize("repeats", [7, 8])
def test_a_rough_channel_that_repeats_itself_is_stuck(repeats):
    x = np.random.default_rng(7).standard_normal((400, 3))
    x[101 : 101 + repeats] = x[100]
    gone, kinds = dropped(channel(0.1 * x, "capsule_rate"))
    assert gone.tolist() == (list(range(101, 109)) if repeats == 8 else []) and kinds == ["stuck"] * (repeats == 8)


def test_crossing_the_date_line_is_no_step():
    east = np.mod(np.pi - 2e-6 + 1e-8 * np.arange(400) + np.pi, 2.0 * np.pi) - np.pi
    assert np.ptp(east) > 6.0 and find_faulty(channel(east, "longitude"))[1] == []


def test_a_short_channel_is_left_alone():
    x = np.zeros(13)
    x[6] = 1e3
    assert find_faulty(channel(x, "altitude", T[:13]))[1] == []
