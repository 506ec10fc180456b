"""Global Fourier smoothing: sine series of a record, a Wiener filter, and the noise that it removes (report 6.3.6).

The line through smoothed end points is removed and the rest reflected oddly, so that its sine coefficients fall as
``k^-3`` whatever the signal; white noise has a constant floor. Signal over noise at number k is then ``(k_c/k)^3``, and
the cut-off ``k_c`` is the one parameter: by maximum likelihood of the coefficients (no search for peaks), or by hand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.errors import Fault, InputError
from bayeschute.records.differentiate import savitzky_golay

Array = NDArray[np.float64]

_FALL = 3  # the signal's coefficients fall as k^-3
_END_WINDOW = 9  # points of the quadratics that give the smoothed end points
SHORTEST = 20  # samples


@dataclass(frozen=True)
class Smoothed:
    """A smoothed record.

    Attributes:
        values: Smoothed samples (T,), unit of the input.
        first: Their first derivative (T,) [unit/s].
        second: Their second derivative (T,) [unit/s^2]; it rings at the ends, leave out about 1 s.
        noise_sd: Standard deviation of the white noise removed.
        cutoff: Frequency at which signal and noise are modelled as equal [Hz].
        gain: Wiener filter Phi of every sine coefficient (T - 2,).
        frequency: Frequencies of the coefficients (T - 2,) [Hz].
        snr: rms(smoothed - its mean)/noise_sd.
        snr_with_mean: rms(smoothed)/noise_sd.
    """

    values: Array
    first: Array
    second: Array
    noise_sd: float
    cutoff: float
    gain: Array
    frequency: Array
    snr: float
    snr_with_mean: float


def wiener_gain(number: Array, cutoff_number: float) -> Array:
    """Wiener filter s^2/(s^2 + n^2) with s/n = (k_c/k)^3."""
    return np.asarray(1.0 / (1.0 + (number / cutoff_number) ** (2 * _FALL)))


def most_likely_cutoff(b: Array) -> float:
    """Cut-off number k_c that makes sine coefficients likeliest.

    Coefficient k is taken as normal with variance n^2 (1 + (k_c/k)^6); n is profiled out (Whittle likelihood).

    Args:
        b: Sine coefficients 1..K (K,).

    Returns:
        k_c, between 0.1 and 10 K.
    """
    number = np.arange(1, b.size + 1, dtype=float)
    power = b**2 + np.finfo(float).tiny

    def cost(log_cutoff: Array) -> Array:
        ratio = 1.0 + np.exp(2 * _FALL * (log_cutoff[:, None] - np.log(number)))
        return np.asarray(np.log(ratio).mean(axis=1) + np.log((power / ratio).mean(axis=1)))

    low, high = np.log(0.1), np.log(10.0 * b.size)
    for _ in range(4):  # a grid refined around its best point: the cost may have several dips
        grid = np.linspace(low, high, 61)
        best = int(np.argmin(cost(grid)))
        low, high = grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)]
    return float(np.exp(grid[best]))


def fourier_smooth(z: NDArray, dt: float, cutoff_hz: float | None = None) -> Smoothed:
    """Separate a smooth signal from white noise over a whole record.

    Args:
        z: Samples at a uniform rate (T,), T >= 20, none missing.
        dt: Sample interval [s].
        cutoff_hz: Cut-off frequency [Hz]; by maximum likelihood where none is given.

    Returns:
        Signal, derivatives, noise and signal-to-noise ratios.

    Raises:
        InputError: If samples are missing or too few, or the cut-off is not positive.
    """
    from scipy.fft import dct, dst

    z = np.asarray(z, dtype=float)
    _check(z, dt, cutoff_hz)
    last = z.size - 1
    ends = savitzky_golay(z, 1.0, _END_WINDOW, 0, 2)[[0, -1]]
    slope = (ends[1] - ends[0]) / (last * dt)
    line = ends[0] + slope * dt * np.arange(z.size)
    # SciPy's DST-I of the inner points is 2 sum g_i sin(k pi i/(N-1)).
    b = dst((z - line)[1:-1], type=1) / last
    number = np.arange(1, b.size + 1, dtype=float)
    if cutoff_hz is None:
        cutoff_number = most_likely_cutoff(b)
    else:
        cutoff_number = cutoff_hz * 2.0 * last * dt
    gain = wiener_gain(number, cutoff_number)
    omega = np.pi * number / (last * dt)
    kept = gain * b

    def sines(c: Array) -> Array:
        return np.concatenate([[0.0], dst(c, type=1) / 2.0, [0.0]])

    def cosines(c: Array) -> Array:
        return np.asarray(dct(np.concatenate([[0.0], c, [0.0]]), type=1) / 2.0)

    values = line + sines(kept)
    removed = (z - values)[1:-1]
    freedom = float(np.sum((1.0 - gain) ** 2))
    noise_sd = float(np.sqrt(np.sum(removed**2) / max(freedom, np.finfo(float).tiny)))

    def ratio(signal: Array) -> float:
        return float(np.sqrt(np.mean(signal**2)) / noise_sd) if noise_sd > 0.0 else float("inf")

    return Smoothed(
        values=values,
        first=slope + cosines(kept * omega),
        second=-sines(kept * omega**2),
        noise_sd=noise_sd,
        cutoff=cutoff_number / (2.0 * last * dt),
        gain=gain,
        frequency=number / (2.0 * last * dt),
        snr=ratio(values - values.mean()),
        snr_with_mean=ratio(values),
    )


def _check(z: Array, dt: float, cutoff_hz: float | None) -> None:
    faults = []
    if z.ndim != 1 or z.size < SHORTEST:
        faults.append(Fault("Fourier smoothing", f"shape {z.shape}", f"one dimension of at least {SHORTEST} samples"))
    if not np.isfinite(z).all():
        got = f"{int((~np.isfinite(z)).sum())} missing or infinite samples"
        faults.append(Fault("Fourier smoothing", got, "a record without gaps", "Take a stretch without gaps."))
    if not (np.isfinite(dt) and dt > 0.0):
        faults.append(Fault("Fourier smoothing, dt", f"{dt}", "a positive interval [s]"))
    if cutoff_hz is not None and not (np.isfinite(cutoff_hz) and cutoff_hz > 0.0):
        faults.append(Fault("Fourier smoothing, cut-off", f"{cutoff_hz}", "a positive frequency [Hz]"))
    if faults:
        raise InputError(faults)
