"""Smooth differentiation by local polynomials (Savitzky and Golay 1964; the five-point quadratic of SIDPAC's habit)."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.errors import Fault, InputError

Array = NDArray[np.float64]


@cache
def _weights(window: int, order: int, degree: int) -> Array:
    """Weights (window, window): row i gives the derivative at point i of a window, unit spacing.

    Args:
        window: Points of the window.
        order: Order of the derivative, 0 for the smoothed value.
        degree: Degree of the polynomial.
    """
    place = np.arange(window) - (window - 1) / 2.0
    scale = max((window - 1) / 2.0, 1.0)
    powers = np.arange(degree + 1)
    basis = (place[:, None] / scale) ** powers
    factor = np.array([np.prod(np.arange(k, k - order, -1)) if k >= order else 0.0 for k in powers])
    derived = factor * (place[:, None] / scale) ** np.maximum(powers - order, 0) / scale**order
    return np.asarray(derived @ np.linalg.pinv(basis))


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

    A window that touches a NaN gives NaN.

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
    weights, half = _weights(window, order, degree), window // 2
    inner = x.shape[0] - window + 1
    out = np.empty_like(x)
    centre = np.zeros_like(x[:inner])
    for i in range(window):
        centre += weights[half, i] * x[i : i + inner]
    out[half : half + inner] = centre
    out[:half] = np.tensordot(weights[:half], x[:window], axes=1)
    out[half + inner :] = np.tensordot(weights[half + 1 :], x[-window:], axes=1)
    return out / dt**order


def derivative(x: NDArray, dt: float) -> Array:
    """First derivative by a quadratic through five points.

    Inside, the weights are (-2, -1, 0, 1, 2)/(10 dt); at the first two points (-54, 13, 40, 27, -26)/(70 dt) and
    (-34, 3, 20, 17, -6)/(70 dt), mirrored at the last two.

    Args:
        x: Samples at a uniform rate (T, ...), T >= 5.
        dt: Sample interval [s].

    Returns:
        dx/dt, same shape; NaN where the window touches a NaN.

    Raises:
        InputError: If there are fewer than five samples or dt is not positive.
    """
    return savitzky_golay(x, dt)
