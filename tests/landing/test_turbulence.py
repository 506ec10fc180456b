"""Fields of gusts: the amplitude at every frequency, axis by axis, and the correlations of the spectra's own."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import gamma, kv

from bayeschute.landing.turbulence import KINDS, Turbulence, field, field_size, spectrum

STEP = 5.0


def test_a_field_is_a_sum_of_waves_each_with_the_power_of_its_band():
    """A cosine and a sine of one frequency have the variance 2 S dw together; constant and highest stand alone."""
    law, size = Turbulence("dryden", 2.0, 0.7, 80.0, 30.0), 32
    band = 2.0 * np.pi / (size * STEP)
    for axis, (sd, length) in enumerate(((2.0, 80.0), (2.0, 80.0), (0.7, 30.0))):
        for k in (0, 1, 9, 15, 16):
            z = np.zeros((3, size))
            z[axis, k] = 1.0
            made = field(law, z, STEP)
            power = sd**2 * spectrum("dryden", axis == 2, length, np.array([k * band]))[0] * band
            wave = np.cos(2.0 * np.pi * k * np.arange(size) / size) * np.sqrt((1.0 if k in (0, 16) else 2.0) * power)
            np.testing.assert_allclose(made[:, axis], wave, atol=1e-12)
            assert not np.delete(made, axis, axis=1).any()
        z = np.zeros((3, size))
        z[axis, size // 2 + 3] = 1.0
        power = sd**2 * spectrum("dryden", axis == 2, length, np.array([3 * band]))[0] * band
        wave = -np.sin(2.0 * np.pi * 3 * np.arange(size) / size) * np.sqrt(2.0 * power)
        np.testing.assert_allclose(field(law, z, STEP)[:, axis], wave, atol=1e-12)


def _correlation(kind: str, longitudinal: bool, length: float, apart: float) -> float:
    """Of the spectrum, by quadrature."""
    power = lambda w: spectrum(kind, longitudinal, length, np.array([w]))[0]  # noqa: E731
    return 2.0 * quad(power, 0.0, np.inf, weight="cos", wvar=apart)[0]


@pytest.mark.parametrize("longitudinal", [True, False])
@pytest.mark.parametrize("kind", KINDS)
def test_spectra_are_those_of_correlations_in_closed_form(kind, longitudinal):
    """Exponential; Dryden's (1 - r / 2 L) exp(-r / L) across; von Karman's by Bessel functions."""
    length = 40.0
    for r in (8.0, 40.0, 100.0):
        along = np.exp(-r / length)
        wanted = along if longitudinal or kind == "ou" else (1.0 - 0.5 * r / length) * along
        if kind == "von-karman":
            x = r / (1.339 * length)
            f = 2.0 ** (2.0 / 3.0) / gamma(1.0 / 3.0) * x ** (1.0 / 3.0)
            wanted = f * kv(1.0 / 3.0, x) if longitudinal else f * (kv(1.0 / 3.0, x) - 0.5 * x * kv(2.0 / 3.0, x))
        assert _correlation(kind, longitudinal, length, r) == pytest.approx(wanted, abs=1e-4)


def test_a_field_is_long_enough_that_its_period_is_not_seen():
    for law, span in (
        (Turbulence("ou", 1.0, 1.0, 500.0, 20.0), 900.0),
        (Turbulence("ou", 1.0, 1.0, 20.0, 500.0), 900.0),
    ):
        size = field_size(law, span, 2.0)
        assert size & (size - 1) == 0 and size / 2 < (900.0 + 3000.0) / 2.0 <= size
    assert field_size(Turbulence("ou", 1.0, 1.0, 0.1, 0.1), 1.0, 2.0) == 16
