"""Channels on one clock, and the statistics of the laws, against sums and matrices written out."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bayeschute.records.plausibility.evidence import (
    Evidence,
    boxcar,
    conjugate,
    continuous,
    evidence_of,
    on_clock,
    slope,
    smoothed,
    spread,
    turned,
    typical,
)
from bayeschute.records.record import make_record

RNG = np.random.default_rng(0)


def test_means_over_windows_are_those_of_a_loop():
    x = RNG.standard_normal((30, 2, 3))
    x[11, 1, 2] = np.nan
    made = boxcar(x, 4)
    assert made.shape == (26, 2, 3)
    for i in range(26):
        window = x[i : i + 5]
        wanted = (0.5 * window[0] + window[1:4].sum(axis=0) + 0.5 * window[4]) / 4.0
        np.testing.assert_allclose(made[i], wanted, atol=1e-12)
    assert np.isnan(made).sum() == 5 and np.isnan(made[7:12, 1, 2]).all()


def test_slopes_go_with_the_means_of_rates():
    """A displacement over a window is the integral of the velocity: exact where that is linear."""
    t = 0.1 * np.arange(50)
    place, moving = 3.0 - 2.0 * t + 0.7 * t**2, -2.0 + 1.4 * t
    np.testing.assert_allclose(slope(place, 8, 0.1), boxcar(moving, 8), rtol=1e-12)


def test_smoothing_wants_half_of_the_samples():
    x = np.full(40, 3.0)
    x[10:20] = np.nan
    made = smoothed(x, 8)
    seen = boxcar(np.isfinite(x).astype(float), 8)
    np.testing.assert_array_equal(np.isfinite(made), seen >= 0.5)
    np.testing.assert_allclose(made[np.isfinite(made)], 3.0)
    assert np.isnan(made).any() and np.isfinite(boxcar(x, 8)).sum() < np.isfinite(made).sum()


def test_spread_is_of_the_smaller_nine_tenths():
    x = RNG.standard_normal((50, 2))
    size = np.sort(np.abs(x.ravel()))[:90]
    assert spread(x) == pytest.approx(np.sqrt(np.mean(size**2)))
    wild = x.copy()
    wild[np.unravel_index(np.argsort(np.abs(x), axis=None)[-9:], x.shape)] = 1e9
    wild = np.vstack([wild, [[np.nan, np.inf]]])
    assert spread(-wild) == spread(x)
    assert spread(np.array([-4.0])) == 4.0 and np.isnan(spread(np.array([np.nan])))
    assert typical(np.array([np.nan, 5.0, -1.0, 2.0, np.inf])) == 2.0 and np.isnan(typical(np.array([])))


def test_turns_are_those_of_matrices_whatever_the_norm():
    turn = Rotation.random(20, random_state=1)
    q = turn.as_quat()[:, [3, 0, 1, 2]] * RNG.uniform(0.5, 2.0, (20, 1))
    v = RNG.standard_normal((20, 3))
    np.testing.assert_allclose(turned(q, v), turn.apply(v), atol=1e-12)
    np.testing.assert_allclose(turned(q, v[0]), turn.apply(v[0]), atol=1e-12)
    np.testing.assert_allclose(turned(conjugate(q), turned(q, v)), v, atol=1e-12)


def test_signs_go_on_over_gaps():
    t = np.linspace(0.0, 9.0, 60)[:, None]
    q = 1.1 * np.hstack([np.cos(t), np.sin(t), 0.0 * t, 0.0 * t])
    mixed = q * RNG.choice([-1.0, 1.0], (60, 1))
    mixed[20:22] = np.nan
    made = continuous(mixed)
    assert np.flatnonzero(np.isnan(made).any(axis=1)).tolist() == [20, 21]
    seen = np.isfinite(made).all(axis=1)
    np.testing.assert_allclose(made[seen], np.sign(mixed[0] @ q[0]) * q[seen])


def test_lines_on_another_clock():
    time = np.cumsum(RNG.uniform(0.9, 1.1, 60))
    grid = np.arange(0.0, 65.0, 0.9)
    x = np.stack([2.0 * time, 5.0 - time], axis=1)
    made = on_clock(time, x, grid)
    inside = (grid >= time[0]) & (grid <= time[-1])
    np.testing.assert_array_equal(np.isfinite(made).all(axis=1), inside)
    np.testing.assert_allclose(made[inside], np.stack([2.0 * grid, 5.0 - grid], axis=1)[inside])


def test_gaps_of_three_intervals_are_bridged_and_longer_ones_not():
    time = np.arange(0.0, 50.0)
    for lost, bridged in ((2, True), (3, False)):
        x = 3.0 * time[:, None, None] * np.ones((50, 2, 1))
        x[20 : 20 + lost, 1] = np.nan
        made = on_clock(time, x, time)
        np.testing.assert_allclose(made[:, 0, 0], 3.0 * time)
        gone = np.isnan(made[:, 1, 0])
        assert gone[20 : 20 + lost].all() == (not bridged) and gone[:20].sum() == 0 and gone[24:].sum() == 0
    few = np.where(time < 2.0, 1.0, np.nan)
    assert np.isnan(on_clock(time, few, time)).all()


def test_faster_channels_are_averaged():
    """The mean of t^2 over h about t is t^2 + h^2/12; noise falls with the number of samples."""
    time, grid = 0.01 * np.arange(2001), np.arange(0.0, 20.0, 0.5)
    made = on_clock(time, time**2, grid)
    np.testing.assert_allclose(made[1:-1], grid[1:-1] ** 2 + 0.25 / 12.0, atol=1e-4)
    noise = on_clock(time, RNG.standard_normal(2001), grid)
    assert noise.std() == pytest.approx(1.0 / np.sqrt(50.0), rel=0.35)


@pytest.mark.parametrize(("seconds", "wanted"), [(2.0, 20), (0.01, 2), (30.0, 40)])
def test_spans_in_samples_at_most_a_tenth_of_all(seconds, wanted):
    assert Evidence(time=0.1 * np.arange(400)).samples(seconds) == wanted


def test_a_record_as_its_laws_see_it():
    time = np.arange(0.0, 100.0, 0.1)
    down = 10.0 * time - 2000.0
    position = np.stack([0.0 * time, 3.0 * time, down], axis=1)
    position[np.arange(1000) % 2 == 1] = np.nan  # the clock is that of the slowest of its own
    canopies = np.stack([position + [0.0, 5.0, -60.0], position + [0.0, -5.0, -80.0]], axis=1)
    record = make_record(time=time, capsule_position=position, canopy_position=canopies, density=1.0 + 0.0 * time,
                         temperature=np.full(1000, np.nan))  # fmt: skip

    def profile(height):
        return np.stack([0.01 * height, 0.0 * height, 0.0 * height], axis=1)

    made = evidence_of(record, None, (20.0, 60.0), profile)
    np.testing.assert_allclose(made.time, np.arange(20.0, 60.1, 0.2), atol=1e-9)
    assert made.step == pytest.approx(0.2) and made.temperature is None and made.velocity is None
    np.testing.assert_allclose(made.height(), 2000.0 - 10.0 * made.time, atol=1e-9)
    np.testing.assert_allclose(made.profile[:, 0], 0.01 * (2000.0 - 10.0 * made.time), atol=1e-9)
    np.testing.assert_allclose(made.shear[:, 0], 0.7, atol=1e-9)
    assert evidence_of(record, None, (20.0, 60.0)).profile is None
    record["canopy_position"][:300] = np.nan
    unseen = evidence_of(record, None, (20.0, 60.0), profile)
    np.testing.assert_allclose(unseen.shear[:, 0], np.where(unseen.time < 29.9, 0.0, 0.7), atol=1e-9)
    flat = Evidence(time=time, altitude=7.0 + 0.0 * time, position=position)
    assert flat.height()[0] == 7.0 and Evidence(time=time).height() is None
