"""Multitaper spectra and peaks: known levels, honest limits, honest chances."""

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.swing.spectrum import Spectrum, multitaper, spectral_peak

DT, N = 0.1, 600


def test_power_integrates_to_the_variance():
    x = np.random.default_rng(0).standard_normal(N) * 3.0 + 50.0
    made = multitaper(x, DT)
    assert np.trapezoid(made.power, made.frequency) == pytest.approx(np.var(x), rel=0.05)


def test_limits_cover_the_level_of_white_noise():
    inside = []
    for seed in range(60):
        made = multitaper(np.random.default_rng(seed).standard_normal(N), DT)
        inner = slice(50, -50)
        inside.append(np.mean((made.low[inner] < 2.0 * DT) & (2.0 * DT < made.high[inner])))
    assert 0.87 < np.mean(inside) < 0.93


def test_peak_of_a_line():
    t = np.arange(N) * DT
    x = np.sin(2.0 * np.pi * 0.233 * t) + 0.5 * np.random.default_rng(1).standard_normal(N)
    peak = spectral_peak(multitaper(x, DT), 0.1, 0.8)
    assert peak.frequency == pytest.approx(0.233, abs=0.01)
    assert peak.low < 0.233 < peak.high
    assert peak.chance < 1e-6 and peak.ratio > 10.0


def test_jackknife_covers_a_forced_mode():
    inside = 0
    for seed in range(60):
        rng, x = np.random.default_rng(seed), np.zeros(N + 300)
        b, w = 0.15, 2.0 * np.pi * 0.3
        for i in range(2, x.size):
            x[i] = 2.0 * np.exp(-b * DT) * np.cos(w * DT) * x[i - 1] - np.exp(-2.0 * b * DT) * x[i - 2]
            x[i] += rng.standard_normal()
        peak = spectral_peak(multitaper(x[300:], DT), 0.1, 0.8)
        inside += peak.low < 0.3 < peak.high
    assert inside >= 48


def test_noise_has_no_peak():
    chances = [
        spectral_peak(multitaper(np.random.default_rng(seed).standard_normal(N), DT), 0.1, 1.0).chance
        for seed in range(150)
    ]
    assert np.mean(np.array(chances) < 0.1) < 0.17
    assert np.mean(np.array(chances) < 0.5) > 0.15  # and the chance means something


@pytest.mark.parametrize(("wide", "tapers"), [(2, 3), (4, 2)])
def test_chance_is_that_of_the_highest_of_cells_over_a_ground_of_the_others(wide, tapers):
    """Simulated: a cell's mean of chi-squares over that of the band's other bandwidths."""
    half, step = 0.1, 0.02
    frequency = step * np.arange(80)
    each = np.ones((tapers, 80))
    each[:, (20 + 5 * wide)] = 5.0  # the middle of the band
    spectrum = Spectrum(frequency, each.mean(axis=0), each[0], each[0], half, each)
    peak = spectral_peak(spectrum, 0.4 - 1e-9, 0.4 + 2.0 * half * wide + 1e-9)
    rng = np.random.default_rng(3)
    cell, others = (rng.chisquare(2 * tapers * n, 400_000) / (2 * tapers * n) for n in (1, wide - 1))
    alone = np.mean(cell / others > peak.ratio)
    cells = 2.0 * half * wide / (8 * step)
    assert peak.chance == pytest.approx(1.0 - (1.0 - alone) ** cells, rel=0.04)


def test_bad_input():
    with pytest.raises(InputError, match="1 missing"):
        multitaper(np.r_[np.nan, np.ones(30)], DT)
    with pytest.raises(InputError, match="time_bandwidth"):
        multitaper(np.ones(30), DT, 20.0)
    with pytest.raises(InputError, match="a band of at least"):
        spectral_peak(multitaper(np.random.default_rng(0).standard_normal(N), DT), 0.2, 0.21)
