"""Smooth differentiation by local polynomials (Savitzky and Golay 1964; the five-point quadratic of SIDPAC's habit)."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d
from scipy.signal import savgol_coeffs

from bayeschute.core.errors import Fault, InputError

Array = NDArray[np.float64]


@cache
def _weights(window: int, order: int, degree: int) -> Array:
    """Weights (window, window): row i gives the derivative at point i of a window, unit spacing."""
    return np.stack([savgol_coeffs(window, degree, order, pos=i, use="dot") for i in range(window)])


def _check(samples: int, dt: float, window: int, order: int, degree: int) -> None:
    faults = []
    if not (np.isfinite(dt) and dt > 0.0):
        faults.append(Fault("differentiation, dt", f"{dt}", "a positive interval [s]"))
    if window < 3 or window % 2 == 0:
        faults.append(Fault("differentiation, window", f"{window}", "an odd number of points, at least 3"))
    if not 0 <= order <= degree < window:
        faults.append(Fault("differentiation", f"derivative {order}, degree {degree}", "derivative <= degree < window"))
    if samples < window:
        faults.append(Fault("differentiation", f"{samples} samples", f"at least {window}", "Take a longer record."))
    if faults:
        raise InputError(faults)


def savitzky_golay(x: NDArray, dt: float, window: int = 5, order: int = 1, degree: int = 2) -> Array:
    """Derivative of a local polynomial fitted to every window; one-sided at the ends.

    A window that touches a NaN gives NaN. By default a quadratic through five points: inside, the weights are
    (-2, -1, 0, 1, 2)/(10 dt), at the first two points (-54, 13, 40, 27, -26)/(70 dt) and (-34, 3, 20, 17, -6)/(70 dt),
    mirrored at the last two.

    Args:
        x: Samples at a uniform rate (T, ...), any unit.
        dt: Sample interval [s].
        window: Points of the window, odd.
        order: Order of the derivative; 0 smooths.
        degree: Degree of the polynomial.

    Returns:
        The derivative, same shape [unit of x / s^order].

    Raises:
        InputError: If the window, the degree or dt is unfit, or the record is shorter than the window.
    """
    x = np.asarray(x, dtype=float)
    _check(x.shape[0], dt, window, order, degree)
    # SciPy's savgol_filter fits the ends by a solver that refuses NaN; the weights themselves don't.
    half, weights = window // 2, _weights(window, order, degree) / dt**order
    out = np.asarray(correlate1d(x, weights[half], axis=0))
    out[:half] = np.tensordot(weights[:half], x[:window], axes=1)
    out[-half:] = np.tensordot(weights[half + 1 :], x[-window:], axes=1)
    return out
