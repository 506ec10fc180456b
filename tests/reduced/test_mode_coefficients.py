"""Coefficients that modes tell: made-up series with known answers, and the report's own numbers."""

import numpy as np
import pytest
from tests.twins import damped_swing as twin
from tests.twins.cluster_modes import flyout_period

from bayeschute.core.errors import InputError
from bayeschute.reduced.cluster_mode_laws import Canopy
from bayeschute.reduced.mode_coefficients import (
    breathing_peak,
    flyout_coefficients,
    maypole_coefficients,
    mean_draws,
    pendulum_coefficients,
    unwrapped,
)
from bayeschute.reduced.pendulum import Pendulum, decay_rate, natural_frequency, pivot_distance
from bayeschute.swing.modal import fit_swing

DT, N = 0.1, 900
t = np.arange(N) * DT
FOOT, SLUG, POUND = 0.3048, 14.5939, 4.44822
CANOPY = Canopy(307.0 * SLUG, 328.0 * POUND, 235.0 * FOOT)
LOAD = 12169.4 * POUND  # of the report's cluster at 33 ft/s


def noise(size, seed, tau=2.0):
    rng, out = np.random.default_rng(seed), np.zeros(N)
    phi = np.exp(-DT / tau)
    for i in range(1, N):
        out[i] = phi * out[i - 1] + np.sqrt(1.0 - phi**2) * rng.standard_normal()
    return size * out


def test_flyout():
    slope = 1.1
    period = flyout_period(CANOPY, LOAD, slope, np.cos(0.2))
    angle = 0.2 + 0.06 * np.exp(-0.01 * t) * np.sin(2.0 * np.pi * t / period) + noise(0.004, 0)
    made = flyout_coefficients(angle, LOAD * (1.0 + noise(0.05, 1)), DT, CANOPY, band=(0.03, 0.2))
    found = made.intervals["normal_slope"]
    assert abs(found.mean - slope) < 3.0 * found.sd < 0.15
    assert abs(made.intervals["period"].mean - period) < 3.0 * made.intervals["period"].sd < 0.5
    assert made.swing is not None and made.draws["normal_slope"].shape == made.draws["period"].shape


def test_maypole_of_the_report():
    """R 50 ft, 35 s, 32 ft/s: C_N = 0.0483 by 6.3.2-22 (printed 0.0485)."""
    load = LOAD * (32.0 / 32.9866) ** 2
    turn = 2.0 * np.pi / 35.0 * t + noise(0.05, 2)
    azimuth = np.mod(turn + np.pi, 2.0 * np.pi) - np.pi
    azimuth[100:160] = np.nan
    made = maypole_coefficients(azimuth, 50.0 * FOOT + noise(0.3, 3), load + 0.0 * t, DT, CANOPY)
    found = made.intervals["normal"]
    assert found.low < 0.0483 < found.high
    assert found.sd < 0.0015
    assert made.intervals["period"].mean == pytest.approx(35.0, rel=0.01)
    back = maypole_coefficients(-azimuth, 50.0 * FOOT + noise(0.3, 3), load + 0.0 * t, DT, CANOPY)
    assert back.intervals["normal"].mean == pytest.approx(found.mean, rel=0.01)
    with pytest.raises(InputError, match="less than the lines'"):
        maypole_coefficients(azimuth, 100.0 + 0.0 * t, load + 0.0 * t, DT, CANOPY)


def test_pendulum():
    system = Pendulum(22562.0 * POUND, 656.0 * POUND, 614.0 * SLUG, 235.0 * FOOT, 9.80665, 0.927)
    slope, damping = 0.19, 0.3
    omega, b = natural_frequency(system, slope), decay_rate(system, damping)
    swing = twin.Swing(
        frequency=omega / (2.0 * np.pi), damping_ratio=b / omega, amplitude=(0.2, 0.1), forcing=0.002, colored=0.004,
        tau=2.0, white=0.002, samples=N, dt=DT, observed="angle",
    )  # fmt: skip
    data = twin.make(swing, np.random.default_rng(1), kicks=1)
    made = pendulum_coefficients(fit_swing(data, DT, observed="angle", settle=False), system)
    truth = {"normal_slope": slope, "damping": damping, "pivot": pivot_distance(system, slope)}
    for name, value in truth.items():
        assert abs(made.intervals[name].mean - value) < 3.0 * made.intervals[name].sd
    assert made.intervals["normal_slope"].sd < 0.05 and made.intervals["damping"].sd < 0.2


def test_breathing_beside_a_swing():
    breathing = twin.Swing(
        frequency=0.23, damping_ratio=0.03, amplitude=(1.0,), forcing=0.3, colored=0.5, tau=1.0, white=0.2,
        samples=N, dt=DT, observed="angle",
    )  # fmt: skip
    swing = 0.3 * np.sin(2.0 * np.pi * 0.1 * t)  # loads the risers at 0.2 Hz
    data = twin.make(breathing, np.random.default_rng(6), kicks=1)[:, 0] + 40.0 * swing**2 + 100.0 - 0.05 * t
    data[200:204] = np.nan
    made, peak = breathing_peak(data, DT, (0.15, 0.6), nuisance=np.stack([swing**2, np.gradient(swing**2, DT)], axis=1))
    found = made.intervals["frequency"]
    assert abs(found.mean - 0.23) < 3.0 * found.sd < 0.03
    assert peak.low - 0.01 < 0.23 < peak.high + 0.01 and peak.chance < 0.01
    _, without = breathing_peak(data, DT, (0.15, 0.6))
    assert abs(without.frequency - 0.2) < 0.01  # the swing's line, where nobody takes it out


def test_mean_draws_know_of_correlation():
    z, widths = [], []
    for seed in range(60):
        draws = mean_draws(5.0 + noise(1.0, seed), np.random.default_rng(0))
        z.append((draws.mean() - 5.0) / draws.std())
        widths.append(draws.std())
    assert 0.7 < np.std(z) < 1.5
    assert np.mean(widths) > 3.0 / np.sqrt(N)
    with pytest.raises(InputError, match="at least 10"):
        mean_draws(np.r_[np.ones(5), np.full(50, np.nan)], np.random.default_rng(0))


def test_unwrapped():
    angle = np.linspace(0.0, 20.0, 80)
    wrapped = np.angle(np.exp(1j * angle))
    wrapped[5] = np.nan
    made = unwrapped(wrapped)
    np.testing.assert_allclose(np.delete(made, 5), np.delete(angle, 5))
    assert np.isnan(made[5])
