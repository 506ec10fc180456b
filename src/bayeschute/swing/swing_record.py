"""Preparation of a swing's record for its fit: validation, averaging, dominant frequency, settling time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from bayeschute.core.errors import Fault, InputError

_SIGNIFICANT = 0.05  # probability below which a beginning counts as unsettled
_FINE = 8  # frequencies tried per resolution


class SwingRecord(NamedTuple):
    """Channels and the regressors they share.

    Attributes:
        data: (N, C), NaN where missing, in all channels alike.
        nuisance: (N, C, k).
    """

    data: Float[np.ndarray, "N C"]
    nuisance: Float[np.ndarray, "N C k"]


def read_swing(data: Float[np.ndarray, "T ..."], nuisance: Float[np.ndarray, "T C k"] | None, dt: float) -> SwingRecord:
    """Check a record and give it its shape; a sample that is missing in one channel is missing in all.

    Args:
        data: One column per direction.
        nuisance: Regressors, or None.
        dt: Sample interval [s].

    Returns:
        The record; missing ends are cut off.

    Raises:
        InputError: For wrong shapes, infinite values, no uniform interval or too few samples.
    """
    y = np.asarray(data, dtype=np.float64)
    y = y[:, None] if y.ndim == 1 else y
    faults = []
    if y.ndim != 2 or not 1 <= y.shape[1] <= 6:
        raise InputError(Fault("swing", f"data of shape {np.shape(data)}", "samples by up to six directions"))
    z = np.zeros((*y.shape, 0)) if nuisance is None else np.asarray(nuisance, dtype=np.float64)
    if z.shape[:2] != y.shape or z.ndim != 3:
        faults.append(Fault("swing, nuisance", f"shape {z.shape}", f"{y.shape[0]} x {y.shape[1]} x regressors"))
    if not (np.isfinite(dt) and dt > 0.0):
        faults.append(Fault("swing, dt", f"{dt}", "a positive interval [s]"))
    if np.isinf(y).any() or np.isinf(z).any():
        faults.append(Fault("swing", "infinite values", "finite ones, NaN where missing"))
    if faults:
        raise InputError(faults)
    seen = np.asarray(np.isfinite(y).all(axis=1) & np.isfinite(z).all(axis=(1, 2)))
    if seen.sum() < 20:
        raise InputError(Fault("swing", f"{int(seen.sum())} samples", "at least 20", "Take a longer record."))
    first, last = np.flatnonzero(seen)[[0, -1]]
    y, z = np.where(seen[:, None], y, np.nan), np.where(seen[:, None, None], z, 0.0)
    return SwingRecord(y[first : last + 1], z[first : last + 1])


def averaged(record: SwingRecord, every: int) -> SwingRecord:
    """Means over blocks of samples; a block with a gap is missing."""
    count = record.data.shape[0] // every

    def means(x: np.ndarray) -> np.ndarray:
        return np.asarray(x[: count * every].reshape(count, every, *x.shape[1:]).mean(axis=1))

    return SwingRecord(means(record.data), means(record.nuisance))


def trimmed(record: SwingRecord, samples: int) -> SwingRecord:
    """The record without its first samples, nor the gap that may follow."""
    rest = SwingRecord(record.data[samples:], record.nuisance[samples:])
    seen = np.flatnonzero(np.isfinite(rest.data[:, 0]))
    first = int(seen[0]) if seen.size else 0
    return SwingRecord(rest.data[first:], rest.nuisance[first:])


def strongest(record: SwingRecord, dt: float, low: float, high: float) -> float:
    """Frequency of greatest power, all channels together, by least squares (gaps do no harm).

    Offsets, trends and nuisances are removed first.

    Args:
        record: The record.
        dt: Sample interval [s].
        low: Lower end of the search [Hz].
        high: Upper end [Hz].

    Returns:
        [Hz].
    """
    N, C = record.data.shape
    every = max(int(0.25 / (high * dt)), 1)
    record, dt = averaged(record, every), every * dt
    N = record.data.shape[0]
    seen = np.isfinite(record.data[:, 0])
    t = (np.arange(N) * dt)[seen]
    lines = np.stack([np.ones_like(t), t - t.mean()], axis=1)
    own = np.kron(np.eye(C), lines)
    shared = np.concatenate([record.nuisance[seen, c] for c in range(C)])
    known = np.concatenate([own, shared], axis=1)
    y = np.concatenate([record.data[seen, c] for c in range(C)])
    rest = (y - known @ np.linalg.lstsq(known, y, rcond=None)[0]).reshape(C, -1)
    rest = rest * np.hanning(t.size + 2)[1:-1]  # or a great beginning would spread over all frequencies
    frequency = np.linspace(low, high, max(int(_FINE * (high - low) * N * dt), 16))
    wave = np.exp(-2j * np.pi * frequency[:, None] * t)
    power = np.sum(np.abs(wave @ rest.T) ** 2, axis=1)
    return float(frequency[np.argmax(power)])


def settled(innovations: Float[np.ndarray, "N C"], cycle: int) -> bool:
    """Whether a record's beginning is disturbed no more than the rest (F tests of its first and first two cycles).

    Args:
        innovations: One-step errors, NaN where missing.
        cycle: Samples per cycle.

    Returns:
        Whether neither test speaks against it at 5 %.
    """
    from scipy.stats import f

    for samples in (cycle, 2 * cycle):
        first, rest = innovations[:samples], innovations[samples:]
        few, many = int(np.isfinite(first).sum()), int(np.isfinite(rest).sum())
        if few < 2 or many < few:
            continue
        ratio = float(np.nanmean(first**2) / np.nanmean(rest**2))
        if f.sf(ratio, few, many) < _SIGNIFICANT:
            return False
    return True
