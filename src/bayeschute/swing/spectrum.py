"""Spectrum of a record by prolate tapers, with limits, and the peak of a band (Thomson 1982).

K orthogonal tapers give K nearly independent spectra of one record. Their mean has chi-square limits; how its peak
moves when one of them is left out gives the peak's uncertainty (jackknife; Thomson and Chave 1991). The peak of a
forced, damped mode can also be fitted by `bayeschute.swing.modal.fit_swing`, which is sharper where its model
holds.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from bayeschute.core.errors import Fault, InputError

_PADDING = 8  # frequencies per 1/T


class Spectrum(NamedTuple):
    """One-sided power spectral density.

    Attributes:
        frequency: (M,) [Hz], from zero.
        power: (M,) [unit^2/Hz].
        low: Lower limit of the 90 % interval of each ordinate.
        high: Upper limit.
        half_width: Half of the bandwidth over which each ordinate averages [Hz].
        eigenspectra: By taper (K, M).
    """

    frequency: Float[np.ndarray, " M"]
    power: Float[np.ndarray, " M"]
    low: Float[np.ndarray, " M"]
    high: Float[np.ndarray, " M"]
    half_width: float
    eigenspectra: Float[np.ndarray, "K M"]


class Peak(NamedTuple):
    """The greatest power of a band.

    Attributes:
        frequency: [Hz].
        se: Its standard error by the jackknife [Hz].
        low: Lower limit of the 90 % interval.
        high: Upper limit.
        ratio: Power over the mean of the band's other ordinates, by their median.
        chance: Probability that noise of an even spectrum has so high a peak somewhere in the band.
    """

    frequency: float
    se: float
    low: float
    high: float
    ratio: float
    chance: float


def multitaper(x: Float[np.ndarray, " N"], dt: float, time_bandwidth: float = 2.5) -> Spectrum:
    """Mean of the spectra of the first 2 NW - 1 discrete prolate tapers; the record's mean is removed.

    Args:
        x: Samples at a uniform rate, none missing.
        dt: Sample interval [s].
        time_bandwidth: NW, half the bandwidth times the length of the record.

    Returns:
        The spectrum.

    Raises:
        InputError: If samples are missing or fewer than 20, or `time_bandwidth` is below 1.5.
    """
    from scipy.signal.windows import dpss
    from scipy.stats import chi2

    x = np.asarray(x, dtype=np.float64)
    if x.ndim != 1 or x.size < 20 or not np.isfinite(x).all():
        got = f"shape {x.shape}, {int((~np.isfinite(x)).sum())} missing"
        raise InputError(Fault("spectrum", got, "one series of at least 20 samples without gaps"))
    if not 1.5 <= time_bandwidth <= x.size / 4.0:
        raise InputError(Fault("spectrum, time_bandwidth", f"{time_bandwidth:g}", f"1.5 to {x.size / 4.0:g}"))
    count = int(2.0 * time_bandwidth) - 1
    tapers = dpss(x.size, time_bandwidth, count)
    made = np.fft.rfft(tapers * (x - x.mean()), _PADDING * x.size, axis=1)
    each = 2.0 * dt * np.abs(made) ** 2
    power = each.mean(axis=0)
    freedom = 2.0 * count
    return Spectrum(
        np.fft.rfftfreq(_PADDING * x.size, dt),
        power,
        power * freedom / chi2.ppf(0.95, freedom),
        power * freedom / chi2.ppf(0.05, freedom),
        time_bandwidth / (x.size * dt),
        each,
    )


def _top(frequency: np.ndarray, power: np.ndarray) -> float:
    """Place of the greatest ordinate, by the parabola through the logarithms of it and its neighbours."""
    i = int(np.argmax(power))
    if not 0 < i < power.size - 1:
        return float(frequency[i])
    a, b, c = np.log(power[i - 1 : i + 2])
    bend = a - 2.0 * b + c
    return float(frequency[i] + (0.5 * (a - c) / bend if bend < 0.0 else 0.0) * (frequency[1] - frequency[0]))


def spectral_peak(spectrum: Spectrum, low: float, high: float) -> Peak:
    """The peak of a band, its uncertainty and whether it is one.

    Args:
        spectrum: Of the record.
        low: Lower end of the band [Hz].
        high: Upper end [Hz].

    Returns:
        The peak.

    Raises:
        InputError: If the band is narrower than two bandwidths of the spectrum.
    """
    from scipy.stats import chi2, f, t

    here = (spectrum.frequency >= low) & (spectrum.frequency <= high)
    if not high - low >= 4.0 * spectrum.half_width or not here.any():
        got, wanted = (
            f"{low:g} to {high:g} Hz",
            f"a band of at least {4.0 * spectrum.half_width:g} Hz inside the spectrum",
        )
        raise InputError(Fault("spectral peak", got, wanted, "Take a longer record."))
    frequency, each = spectrum.frequency[here], spectrum.eigenspectra[:, here]
    power, count = each.mean(axis=0), len(each)
    top = _top(frequency, power)
    without = np.array([_top(frequency, np.delete(each, k, axis=0).mean(axis=0)) for k in range(count)])
    se = float(np.sqrt((count - 1) / count * np.sum((without - without.mean()) ** 2)))
    beside = np.abs(frequency - top) > spectrum.half_width
    ground = float(np.median(power[beside]) * 2 * count / chi2.ppf(0.5, 2 * count))
    ratio = float(power.max()) / ground if ground > 0.0 else np.inf
    # Peaks are searched among as many cells as a raw spectrum would have; the ground is the mean of fewer.
    wide = (high - low) / (2.0 * spectrum.half_width)
    alone = float(f.sf(ratio, 2 * count, max(2.0 * count * (wide - 1.0), 2.0)))
    cells = (high - low) / (_PADDING * (frequency[1] - frequency[0]))
    reach = float(t.ppf(0.95, count - 1)) * se
    return Peak(top, se, top - reach, top + reach, ratio, float(-np.expm1(cells * np.log1p(-min(alone, 1.0 - 1e-16)))))
