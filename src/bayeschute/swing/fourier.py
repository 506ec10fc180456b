"""Finite Fourier transforms of sampled records at chosen frequencies (Klein and Morelli 2006, chapter 7).

``x~(f) = int_0^T x(t) exp(-2 pi i f t) dt`` of the cubic spline through the samples, exactly: piece by piece the
moments of ``s^k exp(-i omega s)`` times sums over the samples, by matrix product or, where that would be large, by
chirp-z transform. So the error is that of the spline, of fourth order in the sample interval, at any frequency.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

from bayeschute.core.errors import Fault, InputError

_LARGEST_PRODUCT = 4_000_000  # samples times frequencies up to which the transform is a matrix product
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)


def harmonics(duration: float, low: float, high: float) -> Float[np.ndarray, " M"]:
    """Multiples of 1/T inside a band, zero left out: transforms of white noise there are independent.

    Args:
        duration: Length of the record T [s].
        low: Lower end of the band [Hz].
        high: Upper end [Hz].

    Returns:
        Frequencies [Hz].

    Raises:
        InputError: If the band is empty or holds no harmonic.
    """
    if not (duration > 0.0 and 0.0 <= low < high):
        raise InputError(Fault("band", f"{low:g} to {high:g} Hz over {duration:g} s", "0 <= low < high, a length > 0"))
    first, last = max(int(np.ceil(low * duration - 1e-9)), 1), int(np.floor(high * duration + 1e-9))
    if last < first:
        wanted = f"a band that holds a multiple of {1.0 / duration:g} Hz"
        raise InputError(Fault("band", f"{low:g} to {high:g} Hz", wanted, "Widen the band or take a longer record."))
    return np.arange(first, last + 1) / duration


def _sums(c: np.ndarray, frequency: np.ndarray, dt: float) -> np.ndarray:
    """sum_i c_i exp(-2 pi i f i dt) over the first axis of c (N, K): (M, K)."""
    N, M = c.shape[0], frequency.size
    steps = np.diff(frequency)
    even = M > 2 and np.allclose(steps, steps.mean(), rtol=1e-9, atol=0.0)
    if N * M <= _LARGEST_PRODUCT or not even:
        angle = 2.0 * np.pi * dt * frequency
        rows = max(_LARGEST_PRODUCT // N, 1)
        index = np.arange(N)
        parts = [np.exp(-1j * angle[i : i + rows, None] * index) @ c for i in range(0, M, rows)]
        return np.concatenate(parts)
    from scipy.signal import czt

    turn = np.exp(2j * np.pi * frequency[0] * dt)
    return np.asarray(czt(c, M, np.exp(-2j * np.pi * steps.mean() * dt), turn, axis=0))


def finite_transform(
    x: Float[np.ndarray, "N ..."], dt: float, frequency: Float[np.ndarray, " M"]
) -> Complex[np.ndarray, "M ..."]:
    """Transform of a record over its length T = (N - 1) dt.

    Args:
        x: Samples at a uniform rate, time first, none missing.
        dt: Sample interval [s].
        frequency: Frequencies [Hz], below half the sampling rate.

    Returns:
        [unit of x times s].

    Raises:
        InputError: If samples are missing or fewer than four, or a frequency is beyond half the sampling rate.
    """
    from scipy.interpolate import CubicSpline

    x, frequency = np.asarray(x, dtype=np.float64), np.atleast_1d(np.asarray(frequency, dtype=np.float64))
    _check(x, dt, frequency)
    columns = x.reshape(x.shape[0], -1)
    pieces = CubicSpline(np.arange(x.shape[0]) * dt, columns).c  # (4, N - 1, K), highest power first
    s = 0.5 * dt * (1.0 + _NODES)
    wave = np.exp(-2j * np.pi * frequency[:, None] * s) * (0.5 * dt * _WEIGHTS)
    moments = wave @ s[:, None] ** np.arange(3, -1, -1)  # (M, 4)
    sums = _sums(np.moveaxis(pieces, 0, 1).reshape(x.shape[0] - 1, -1), frequency, dt)
    total = np.sum(moments[:, :, None] * sums.reshape(frequency.size, 4, -1), axis=1)
    return total.reshape(frequency.size, *x.shape[1:])


def _check(x: np.ndarray, dt: float, frequency: np.ndarray) -> None:
    faults = []
    if x.ndim < 1 or x.shape[0] < 4:
        faults.append(Fault("Fourier transform", f"shape {x.shape}", "at least 4 samples"))
    if not np.isfinite(x).all():
        got = f"{int((~np.isfinite(x)).sum())} missing or infinite samples"
        faults.append(Fault("Fourier transform", got, "a record without gaps", "Take a stretch without gaps."))
    if not (np.isfinite(dt) and dt > 0.0):
        faults.append(Fault("Fourier transform, dt", f"{dt}", "a positive interval [s]"))
    elif not (np.abs(frequency) <= 0.5 / dt * (1.0 + 1e-9)).all():
        got, wanted = f"{np.abs(frequency).max():g} Hz", f"at most {0.5 / dt:g} Hz, half the sampling rate"
        faults.append(Fault("Fourier transform, frequency", got, wanted))
    if faults:
        raise InputError(faults)
