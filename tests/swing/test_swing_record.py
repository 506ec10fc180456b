"""Reading, averaging, the first guess of the frequency, and settling."""

import numpy as np
import pytest

from bayeschute.swing.swing_record import averaged, read_swing, settled, strongest, trimmed

t = np.arange(400) * 0.05


def record(x, nuisance=None):
    return read_swing(x, nuisance, 0.05)


def test_missing_ends_are_cut_and_a_gap_is_one_in_every_channel():
    x = np.ones((30, 2))
    x[:3], x[-2:], x[10, 1] = np.nan, np.nan, np.nan
    made = record(x)
    assert made.data.shape == (25, 2)
    assert np.isnan(made.data[7]).all() and np.isfinite(made.data[8]).all()
    assert trimmed(made, 7).data.shape == (17, 2)  # the gap goes, too


def test_blocks_with_a_gap_are_missing():
    x = np.arange(40.0)
    x[5] = np.nan
    np.testing.assert_array_equal(averaged(record(x), 4).data[:3, 0], [1.5, np.nan, 9.5])


@pytest.mark.parametrize("frequency", [0.4, 1.0, 2.3])
def test_strongest_frequency_in_spite_of_drift_gaps_and_nuisance(frequency):
    rng = np.random.default_rng(0)
    chirp = np.cos(2.0 * np.pi * (0.2 * t + 0.08 * t**2))
    x = np.cos(2.0 * np.pi * frequency * t) + 0.5 * t + 3.0 * chirp + 0.2 * rng.standard_normal(t.size)
    x[120:150] = np.nan
    made = strongest(record(x, chirp[:, None, None]), 0.05, 0.15, 3.0)
    assert made == pytest.approx(frequency, abs=0.02)


def test_power_of_all_channels_counts():
    x = np.stack([np.cos(6.0 * t) + 0.9 * np.cos(9.0 * t), 0.9 * np.sin(9.0 * t)], axis=1)
    assert strongest(record(x), 0.05, 0.3, 3.0) == pytest.approx(9.0 / (2.0 * np.pi), abs=0.02)


def test_settled():
    rng = np.random.default_rng(2)
    refused = 0
    for _ in range(200):
        refused += not settled(rng.standard_normal((90, 2)), 6)
    assert 0.02 < refused / 200 < 0.15  # two tests at 5 %, not independent
    loud = rng.standard_normal((90, 2))
    loud[:6] *= 3.0
    assert not settled(loud, 6)
    late = rng.standard_normal((90, 2))
    late[6:12] *= 3.0
    assert not settled(late, 6)
