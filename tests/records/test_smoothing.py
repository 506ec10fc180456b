"""Global Fourier smoothing on signals whose answer is known."""

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.records.smoothing import fourier_smooth, most_likely_cutoff, wiener_gain

DT = 0.1
T = np.arange(900) * DT


def pendulum():
    f, g = 2 * np.pi * 0.068, 2 * np.pi * 0.23
    value = 3 + 0.2 * T + 2 * np.sin(f * T + 0.3) + 0.1 * np.sin(g * T)
    first = 0.2 + 2 * f * np.cos(f * T + 0.3) + 0.1 * g * np.cos(g * T)
    second = -2 * f**2 * np.sin(f * T + 0.3) - 0.1 * g**2 * np.sin(g * T)
    return value, first, second


def test_sine_series_is_the_naive_sum():
    z = np.random.default_rng(0).standard_normal(60)
    s = fourier_smooth(z, DT, cutoff_hz=1.0)
    from bayeschute.records.differentiate import savitzky_golay

    a, b = savitzky_golay(z, 1.0, 9, 0)[[0, -1]]
    i = np.arange(60)
    g = z - (a + (b - a) * i / 59)
    k = np.arange(1, 59)
    basis = np.sin(np.pi * np.outer(i, k) / 59)
    coefficient = 2 / 59 * basis[1:-1].T @ g[1:-1]
    gain = 1 / (1 + (k / (2 * 59 * DT * 1.0)) ** 6)
    np.testing.assert_allclose(s.gain, gain)
    np.testing.assert_allclose(s.frequency, k / (2 * 59 * DT))
    np.testing.assert_allclose(s.values, a + (b - a) * i / 59 + basis @ (gain * coefficient), atol=1e-12)
    removed = (z - s.values)[1:-1]
    assert s.noise_sd == pytest.approx(np.sqrt(np.sum(removed**2) / np.sum((1 - gain) ** 2)))


@pytest.mark.parametrize("sd", [0.01, 0.1, 0.5])
def test_finds_the_noise_and_follows_the_signal(sd):
    value, first, second = pendulum()
    s = fourier_smooth(value + sd * np.random.default_rng(1).standard_normal(T.size), DT)
    inner = slice(10, -10)
    assert s.noise_sd == pytest.approx(sd, rel=0.08)
    assert np.std((s.values - value)[inner]) < 0.5 * sd
    assert np.std((s.first - first)[inner]) < sd * 1.0
    assert np.std((s.second - second)[inner]) < sd * 4.0
    assert s.snr == pytest.approx(np.std(value) / sd, rel=0.1)
    assert s.snr_with_mean > s.snr


def test_noise_variance_is_not_biased_low():
    """Divided by sum (1 - Phi)^2; divided by N it would be low by the share of the signal's band."""
    rng = np.random.default_rng(2)
    value = pendulum()[0]
    found = [fourier_smooth(value + 0.3 * rng.standard_normal(T.size), DT, 1.0).noise_sd ** 2 for _ in range(60)]
    assert np.mean(found) == pytest.approx(0.09, rel=0.02)


def test_cutoff_of_a_known_wiener_filter():
    rng = np.random.default_rng(3)
    k = np.arange(1, 901)
    found = [most_likely_cutoff(rng.standard_normal(900) * np.sqrt(1 + (40 / k) ** 6)) for _ in range(30)]
    assert np.median(found) == pytest.approx(40, rel=0.1)


def test_gain_is_half_at_the_cutoff():
    np.testing.assert_allclose(wiener_gain(np.array([10.0, 20.0]), 10.0), [0.5, 1 / 65])


def test_derivatives_are_those_of_the_smoothed_values():
    s = fourier_smooth(pendulum()[0], DT, 0.5)
    np.testing.assert_allclose(np.gradient(s.values, DT)[5:-5], s.first[5:-5], atol=2e-3)
    np.testing.assert_allclose(np.gradient(s.first, DT)[5:-5], s.second[5:-5], atol=1e-2)


def test_a_constant_has_no_noise():
    s = fourier_smooth(np.full(50, 7.0), DT)
    np.testing.assert_allclose(s.values, 7.0)
    assert s.noise_sd < 1e-12


@pytest.mark.parametrize(
    ("z", "dt", "cutoff", "word"),
    [
        (np.zeros(10), 0.1, None, "at least 20"),
        (np.where(np.arange(50) == 3, np.nan, 1.0), 0.1, None, "1 missing"),
        (np.zeros(50), -1.0, None, "positive interval"),
        (np.zeros(50), 0.1, 0.0, "positive frequency"),
    ],
)
def test_unfit_input_is_refused(z, dt, cutoff, word):
    with pytest.raises(InputError, match=word):
        fourier_smooth(z, dt, cutoff)
