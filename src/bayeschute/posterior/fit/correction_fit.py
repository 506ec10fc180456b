"""Corrections of the marginal posterior fitted over the posterior, where those taken near its mode don't hold.

`laplace.corrected` expands what the linear models lack about the mode, from places one standard deviation away. The
posterior of P parameters has its mass at root P standard deviations: where the density is no quadratic polynomial, or
where its values are known to a tenth only, what is read from differences near the mode is wrong there, by several units
of the log density on some flights. So the polynomials are compared with Laplace's approximation at standard normal
points. Where they fail, the points are added to what they are fitted to, by Bayesian linear regression (MacKay 1992):
the expansion about the mode is what is expected, and how far it may be left, and how exact the values are, is what
makes the points most probable. Every batch of points is a test of the fit to those before it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.posterior import laplace
from bayeschute.posterior.marginal import Marginal, Quadratic

Array = NDArray[np.float64]
GOOD = 0.15
"""Error of the log density at which the corrections are left as they are."""
_FIRST, _BATCH, _LEAST, _MOST = (
    8,
    2,
    8,
    16,
)  # points of a test at least; of all but the first, and of all, per parameter
_WORTH = 0.7  # of the error two batches before, at which more than the least are worth their time
_FINITE = 0.75  # least share of the points at which flights must not fail
_SLOPE = 0.3  # prior standard deviation of the slope's change
_BENDS = (0.003, 0.01, 0.03, 0.06, 0.1, 0.2, 0.4)  # of the curvatures' change, one of
_ERRORS = (0.02, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6)  # standard deviation of a value about the polynomial, one of
_CONSTANT = 10.0  # of the constant, which the density does not depend on


class Fitted(NamedTuple):
    """A posterior whose corrections were compared with Laplace's approximation, and fitted to it where they failed.

    Attributes:
        marginal: The posterior.
        error: Standard deviation of the error of its log density at points that it was not fitted to; NaN where flights
            fail at many of them.
        before: That of the corrections as they were.
        points: At how many they were fitted; zero where they were good.
    """

    marginal: Marginal
    error: float
    before: float
    points: int


def fitted(
    marginal: Marginal, rng: np.random.Generator, progress: Callable[[float, str], None] | None = None
) -> Fitted:
    """Compare the corrections with Laplace's approximation over the posterior, and fit them where they fail.

    Args:
        marginal: From `laplace.corrected`.
        rng: Source of the points.
        progress: Called with a share done and words.

    Returns:
        The posterior with the corrections of the last fit; the error is that of the fit before it at the last points.
    """
    size = np.size(marginal.centre)
    made, points, lacking, asked, errors = marginal, np.zeros((0, size)), np.zeros(0), 0, list[float]()
    while True:
        xi = rng.standard_normal((max(_FIRST, _BATCH * size) if asked else _FIRST, size))
        off = laplace.lacking(made, xi)
        known = np.isfinite(off)
        errors.append(float(np.std(off[known])) if known.mean() >= _FINITE else np.nan)
        asked += len(xi)
        if progress is not None:
            words = f"corrections over the posterior, {asked} points: off by {errors[-1]:.2g}"
            progress(min(asked / (_MOST * size), 1.0), words)
        if not errors[-1] > GOOD:
            break
        points = np.vstack([points, xi[known]])
        lacking = np.append(lacking, (off + np.asarray(_changed(marginal, made).at(xi.T)))[known])
        made = replace(marginal, bend=_sum(marginal.bend, change(marginal.correction, points, lacking)))
        slow = len(errors) > 2 and errors[-1] > _WORTH * errors[-3]
        if asked >= (_LEAST if slow else _MOST) * size:
            break
    return Fitted(made, errors[-1], errors[0], len(points))


def _sum(one: Quadratic, other: Quadratic) -> Quadratic:
    return Quadratic(*(np.asarray(a) + np.asarray(b) for a, b in zip(one, other, strict=True)))


def _changed(before: Marginal, after: Marginal) -> Quadratic:
    return Quadratic(*(np.asarray(b) - np.asarray(a) for a, b in zip(before.bend, after.bend, strict=True)))


def change(expected: Quadratic, points: Array, lacking: Array) -> Quadratic:
    """What is to be added to a quadratic polynomial, by Bayesian linear regression.

    A share of its curvature along the axes and one of that between them may be taken back, where differences near the
    mode say nothing of the density at large; and every coefficient may change by itself.

    Args:
        expected: The polynomial.
        points: Standard coordinates (N, P).
        lacking: What it lacks there, up to a constant (N,).
    """
    size = points.shape[1]
    i, j = np.triu_indices(size)
    curvature = np.asarray(expected.curvature)
    own = np.diag(np.diag(curvature))
    shares = np.stack([0.5 * np.einsum("ni,ij,nj->n", points, part, points) for part in (own, curvature - own)])
    squares = np.where(i == j, np.sqrt(0.5), 1.0)[:, None] * (points.T[i] * points.T[j])
    columns = np.vstack([np.ones(len(points)), shares, points.T, squares])
    best, found = -np.inf, np.zeros(len(columns))
    for bend, error in product(_BENDS, _ERRORS):
        spread = np.repeat([_CONSTANT, 1.0, _SLOPE, bend], [1, 2, size, len(i)])
        wide = spread[:, None] * columns
        root = np.linalg.cholesky(wide.T @ wide + error**2 * np.eye(len(points)))
        unit = np.linalg.solve(root, lacking)
        evidence = -0.5 * float(unit @ unit) - float(np.log(np.diag(root)).sum())
        if evidence > best:
            best, found = evidence, spread * (wide @ np.linalg.solve(root.T, unit))
    bent = np.zeros((size, size))
    bent[i, j] = np.where(i == j, np.sqrt(0.5), 1.0) * found[3 + size :]
    return Quadratic(found[3 : 3 + size], bent + bent.T + found[1] * own + found[2] * (curvature - own))
