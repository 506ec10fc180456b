"""Structured quasi-Newton: Gauss-Newton steps corrected by secants of the gradient.

The Gauss-Newton matrix contains neither the curvature of the model nor terms of the density that are no squares. Where
these are large its steps converge slowly, monotonically or oscillating, and a few secants correct that: the structured
quasi-Newton idea of Dennis, Gay & Welsch (1981), with the recursion of L-BFGS (Nocedal 1980).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

Array = NDArray[np.float64]
_FLATTEST, _REACH = 0.2, 2.0  # least share of Gauss-Newton's curvature that is accepted; longest step of that kind


def length(step: Array, covariance: Array) -> float:
    """Length of a step of the parameters in posterior standard deviations."""
    return float(np.linalg.norm(scipy.linalg.solve_triangular(np.linalg.cholesky(covariance), step, lower=True)))


def secant_step(slope: Array, covariance: Array, bends: Sequence[tuple[Array, Array]]) -> Array:
    """A Gauss-Newton step, corrected by the gradient changes of earlier steps (L-BFGS; Nocedal 1980).

    Where it changed by less than `_FLATTEST` of what Gauss-Newton expects, that share is taken (Powell 1978), and a
    step made longer so is no longer than `_REACH` standard deviations.

    Args:
        slope: Gradient of the objective (P,).
        covariance: Inverse of the Gauss-Newton matrix (P, P).
        bends: Steps made, and changes of the slope over them.
    """
    factor, pairs = scipy.linalg.cho_factor(covariance), []
    for step, change in bends:
        stiff = scipy.linalg.cho_solve(factor, step)
        expected, told = float(step @ stiff), float(step @ change)
        share = 1.0 if told >= _FLATTEST * expected else (1.0 - _FLATTEST) * expected / (expected - told)
        pairs.append((step, share * change + (1.0 - share) * stiff))
    left, weights = slope, []
    for step, change in reversed(pairs):
        weights.append(float(step @ left) / float(step @ change))
        left = left - weights[-1] * change
    made = -covariance @ left
    for (step, change), weight in zip(pairs, reversed(weights), strict=True):
        made = made - step * (weight + float(change @ made) / float(step @ change))
    longest = max(_REACH, length(covariance @ slope, covariance))
    return np.asarray(made * min(1.0, longest / max(length(made, covariance), longest)))
