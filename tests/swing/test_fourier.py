"""Finite Fourier transforms against closed forms."""

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.swing import fourier
from bayeschute.swing.fourier import finite_transform, harmonics

DT, N = 0.1, 700
T = (N - 1) * DT
t = np.arange(N) * DT


def exact(lam: complex, frequency: np.ndarray) -> np.ndarray:
    """int_0^T exp((lam - i omega) t) dt."""
    s = lam - 2j * np.pi * frequency
    return (np.exp(s * T) - 1.0) / s


@pytest.mark.parametrize("lam", [-0.03 + 0.45j, 0.02 + 0.3j, -0.5 + 0.0j])
@pytest.mark.parametrize(
    "frequency", [harmonics(T, 0.01, 0.5), np.linspace(0.013, 1.7, 60), np.array([0.0, 0.07, 3.1])]
)
def test_damped_oscillations(lam, frequency):
    x = np.exp(lam * t)
    made = finite_transform(np.column_stack([x.real, x.imag]), DT, frequency)
    np.testing.assert_allclose(made @ [1.0, 1j], exact(lam, frequency), atol=3e-6 * np.abs(exact(lam, frequency)).max())


def test_error_is_of_fourth_order():
    lam, frequency = -0.05 + 2.0j, np.array([0.1, 0.3, 0.35])
    errors = []
    for every in (1, 2):
        coarse = np.exp(lam * t[: 2 * (N // 2) - 1 : every])
        span = (len(coarse) - 1) * DT * every
        s = lam - 2j * np.pi * frequency
        made = finite_transform(coarse.real, DT * every, frequency) + 1j * finite_transform(
            coarse.imag, DT * every, frequency
        )
        errors.append(np.abs(made - (np.exp(s * span) - 1.0) / s).max())
    assert 10.0 < errors[1] / errors[0] < 30.0


def test_cubics_are_exact():
    frequency = np.array([0.02, 0.4, 4.9])
    x = 1.0 - 0.3 * t + 0.02 * t**2 - 4e-4 * t**3
    nodes, weights = np.polynomial.legendre.leggauss(40)
    width = T / 70
    at = (np.arange(70)[:, None] * width + 0.5 * width * (1.0 + nodes)).ravel()
    y = 1.0 - 0.3 * at + 0.02 * at**2 - 4e-4 * at**3
    wanted = (np.exp(-2j * np.pi * frequency[:, None] * at) * y) @ np.tile(weights, 70) * width / 2.0
    np.testing.assert_allclose(finite_transform(x, DT, frequency), wanted, atol=1e-9)


def test_chirp_z_and_matrix_agree(monkeypatch):
    rng = np.random.default_rng(1)
    x, frequency = rng.standard_normal((N, 2)), np.linspace(0.05, 2.0, 90)
    plain = finite_transform(x, DT, frequency)
    monkeypatch.setattr(fourier, "_LARGEST_PRODUCT", 10)
    np.testing.assert_allclose(finite_transform(x, DT, frequency), plain, atol=1e-9)
    uneven = np.sort(rng.uniform(0.05, 2.0, 20))
    np.testing.assert_allclose(finite_transform(x, DT, uneven)[7], finite_transform(x, DT, uneven[7:8])[0], atol=1e-9)


def test_harmonics():
    np.testing.assert_allclose(harmonics(20.0, 0.0, 0.2), np.arange(1, 5) / 20.0)
    with pytest.raises(InputError, match="holds a multiple of 0.05 Hz"):
        harmonics(20.0, 0.11, 0.14)
    with pytest.raises(InputError, match="0 <= low < high"):
        harmonics(20.0, 0.2, 0.1)


@pytest.mark.parametrize(
    ("x", "dt", "frequency", "message"),
    [
        (np.r_[1.0, np.nan, 2.0, 3.0], 0.1, [0.1], "1 missing"),
        (np.ones(3), 0.1, [0.1], "at least 4"),
        (np.ones(9), 0.0, [0.1], "positive interval"),
        (np.ones(9), 0.1, [7.0], "half the sampling rate"),
    ],
)
def test_bad_input(x, dt, frequency, message):
    with pytest.raises(InputError, match=message):
        finite_transform(x, dt, np.array(frequency))
