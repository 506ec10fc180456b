"""Swings with known frequency, damping and amplitude, in colored noise and gusts."""

from dataclasses import replace

import numpy as np
import pytest
from tests.twins import damped_swing as twin

from bayeschute.core.errors import InputError
from bayeschute.swing.modal import amplitude_effect, compare_halves, fit_swing, interval

GUSTY = twin.Swing(forcing=0.09, colored=0.1, tau=1.5, white=0.005)
BAND = (0.5, 1.6)


def fit(swing, record, **options):
    data = twin.make(swing, np.random.default_rng(record))
    return fit_swing(data, swing.dt, observed=swing.observed, band=BAND, settle=False, **options)


def coverage(swing, records, **options):
    frequency = damping = 0
    for record in records:
        made = fit(swing, record, **options)
        frequency += made.frequency.low <= swing.damped_frequency <= made.frequency.high
        damping += made.damping_ratio.low <= swing.damping_ratio <= made.damping_ratio.high
    return frequency / len(records), damping / len(records)


def test_intervals_cover_a_gusty_swing():
    """Of 20 intervals that cover 88 % fewer than 14 hold the truth once in 300 times; the benchmark counts more."""
    assert min(coverage(GUSTY, range(100, 120))) >= 14 / 20


def test_as_if_free_intervals_are_too_narrow():
    """The reason for the forcing: without it the same records' intervals miss."""
    frequency, _ = coverage(GUSTY, range(100, 110), forcing=False)
    assert frequency <= 0.7


def test_intervals_cover_a_free_decay():
    assert min(coverage(twin.Swing(), range(12), forcing=False)) >= 8 / 12


def test_a_growing_swing():
    made = fit(replace(GUSTY, damping_ratio=-0.03, amplitude=(0.2, 0.1), forcing=0.03), 3)
    assert made.damping_ratio.low < -0.03 < made.damping_ratio.high < 0.0


def test_amplitude_is_that_of_the_angle():
    """A rate of 1 rad/s at 1 Hz is an angle of 1/(2 pi); averaging of dense samples is made up for."""
    swing = twin.Swing(amplitude=(1.0,), colored=0.02, white=0.002, samples=600, dt=1.0 / 40.0)
    made = fit(swing, 0)
    assert made.problem.dt == pytest.approx(6.0 / 40.0)
    assert made.amplitude.mean == pytest.approx(1.0 / (2.0 * np.pi), rel=0.03)
    angle = fit(replace(swing, observed="angle"), 0)
    assert angle.amplitude.mean == pytest.approx(1.0, rel=0.03)
    assert angle.size == pytest.approx(
        np.std(twin.make(replace(swing, observed="angle"), np.random.default_rng(0))), rel=0.1
    )


def test_a_plane_swing_in_two_channels_is_one_swing():
    t = np.arange(120) / 6.0
    wave = np.exp(-0.1 * t) * np.cos(6.0 * t)
    noise = 0.01 * np.random.default_rng(0).standard_normal((120, 2))
    made = fit_swing(wave[:, None] * [0.6, 0.8] + noise, 1.0 / 6.0, observed="angle", band=BAND)
    assert made.amplitude.mean == pytest.approx(1.0, rel=0.03)
    assert made.decay_rate.mean == pytest.approx(0.1, abs=0.01)
    assert made.frequency.mean == pytest.approx(6.0 / (2.0 * np.pi), rel=2e-3)
    assert made.period.mean == pytest.approx(2.0 * np.pi / 6.0, rel=2e-3)


def test_gaps_do_little_harm():
    data = twin.make(GUSTY, np.random.default_rng(5))
    whole = fit_swing(data, GUSTY.dt, band=BAND, settle=False)
    data[[7, 8, 30, 31, 32, 33, 70]] = np.nan
    holes = fit_swing(data, GUSTY.dt, band=BAND, settle=False)
    assert abs(holes.frequency.mean - whole.frequency.mean) < whole.frequency.sd
    assert np.isnan(holes.innovations[7]).all()


def test_nuisances_are_told_apart():
    t = np.arange(GUSTY.samples) * GUSTY.dt
    chirp = np.stack([np.cos(0.3 * t**2), np.sin(0.3 * t**2)], axis=1)  # sweeps through the swing's frequency
    data = twin.make(GUSTY, np.random.default_rng(5))
    plain = fit_swing(data, GUSTY.dt, band=BAND, settle=False)
    freed = fit_swing(data + 2.0 * chirp, GUSTY.dt, nuisance=chirp[:, :, None], band=BAND, settle=False)
    assert abs(freed.frequency.mean - plain.frequency.mean) < plain.frequency.sd
    assert freed.frequency.sd < 1.3 * plain.frequency.sd


def test_a_violent_beginning_is_left_out():
    data = twin.make(replace(GUSTY, samples=140), np.random.default_rng(8))
    data[:14] += 3.0 * np.random.default_rng(9).standard_normal((14, 2))
    made = fit_swing(data, GUSTY.dt, band=BAND)
    assert 1.5 <= made.start <= 5.0
    assert made.time[0] == pytest.approx(made.start)
    kept = fit_swing(data, GUSTY.dt, band=BAND, settle=False)
    assert kept.start == 0.0 and kept.frequency.sd > made.frequency.sd


def test_the_same_seed_gives_the_same_numbers():
    first, again, other = fit(GUSTY, 1), fit(GUSTY, 1), fit(GUSTY, 1, seed=1)
    assert first.frequency == again.frequency != other.frequency
    assert abs(first.frequency.mean - other.frequency.mean) < 0.2 * first.frequency.sd


def test_the_band_ends_below_the_sampling_rate():
    """Six samples per cycle and a band far beyond them: no alias is taken for the swing."""
    data = twin.make(GUSTY, np.random.default_rng(5))
    made = fit_swing(data, GUSTY.dt, band=(0.3, 40.0), settle=False)
    assert abs(made.frequency.mean - GUSTY.damped_frequency) < 4.0 * made.frequency.sd


def test_halves():
    t = np.arange(180) / 6.0
    noise = 0.05 * np.random.default_rng(1).standard_normal(180)
    for rise, changed in ((0.0, False), (0.02, True)):
        made = fit_swing(np.cos(6.0 * t + rise * t**2) + noise, 1.0 / 6.0, observed="angle", band=BAND, settle=False)
        halves = compare_halves(made)
        change = halves.frequency_change
        assert (abs(change.mean / change.sd) > 2.5) == changed
        if changed:  # frequency rises by rise/pi Hz per second, and the halves are 15 s apart
            assert change.low < 0.02 / np.pi * 15.0 < change.high


def test_amplitude_effect_is_that_of_the_pendulum():
    from scipy.special import ellipk

    for a in (0.05, 0.2, 0.4):
        exact = np.pi / (2.0 * ellipk(np.sin(a / 2.0) ** 2)) - 1.0
        assert amplitude_effect(a)[0] == pytest.approx(exact, abs=0.01 * a**2)
    relative, turn = amplitude_effect(0.2, 0.2)
    assert relative + turn == pytest.approx(1.0 / np.sqrt(np.cos(0.2)) - 1.0, abs=3e-4)  # conical


def test_interval():
    made = interval(np.arange(101.0))
    assert made == pytest.approx((50.0, np.std(np.arange(101.0)), 5.0, 95.0))


@pytest.mark.parametrize(
    ("data", "options", "message"),
    [
        (np.zeros(100), {}, "a constant record"),
        (np.ones((100, 7)), {}, "up to six directions"),
        (np.full(100, np.nan), {}, "0 samples"),
        (np.r_[np.sin(np.arange(99.0)), np.inf], {}, "infinite values"),
        (np.sin(np.arange(100.0)), {"band": (0.5, 0.2)}, "0 < low < high"),
        (np.sin(0.02 * np.arange(100.0)), {"band": (0.002, 0.02)}, "cycles of"),
        (np.sin(np.arange(100.0)), {"nuisance": np.ones((3, 1, 1))}, "x regressors"),
    ],
)
def test_bad_input(data, options, message):
    with pytest.raises(InputError, match=message):
        fit_swing(data, 1.0, **options)
