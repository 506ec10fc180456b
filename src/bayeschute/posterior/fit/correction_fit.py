"""Corrections of the marginal posterior compared with Laplace's approximation over the posterior, and fitted to it.

`polynomials.corrected` expands what the linear models lack about the mode, from places one standard deviation away. The
posterior of P parameters has its mass at root P standard deviations: where the density is no quadratic polynomial, or
where its values are known to a tenth only, what is read from differences near the mode is wrong there, by several units
of the log density on some flights. So the density is compared with Laplace's approximation at standard normal points.

What counts is not the error itself but what it does to means and standard deviations: the same points weighed by either
density tell (`implied`). Points are added until that is known well enough, and small. If the corrections can be
improved they are, by Bayesian linear regression (MacKay 1992): the expansion about the mode is what is expected, and
how far it may be left, and how exact the values are, is what makes the points most probable. Its errors are those of
leaving out one point after the other. Where they are so large that the most points ever used would not do, and more
points don't make them smaller, no more are tried: some flights bend too much for any quadratic polynomial.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.posterior.beyond_linear import comparison
from bayeschute.posterior.beyond_linear.comparison import Compared
from bayeschute.posterior.felt_axes import apart, groups, together
from bayeschute.posterior.marginal import Marginal, Quadratic

Array = NDArray[np.float64]
_FIRST, _BATCH, _MOST = 8, 2, 24  # points at first, and of each batch; of each batch, and of all, per parameter
MOST_SHIFT = 0.2
"""Change of a mean, in standard deviations, or relative of one of these, by the density's error, that will do."""
_KNOWN = 0.05  # standard error of what the density's error implies that will do [standard deviations]
_FINITE = 0.75  # least share of the points at which flights must not fail, nor the linear models
_BETTER = 0.9  # of the error without a fit, or of an earlier one, below which a fit is taken to be better
_STILL = 2  # batches without a better fit after which more are in vain
_SLOPE = 0.3  # prior standard deviation of the slope's change
_BENDS = (0.003, 0.01, 0.03, 0.06, 0.1, 0.2, 0.4)  # of the curvatures' change, one of
_ERRORS = (0.02, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6)  # standard deviation of a value about the polynomial, one of
_CONSTANT = 10.0  # of the constant, which the density does not depend on


class Fitted(NamedTuple):
    """A posterior whose corrections were compared with Laplace's approximation, and fitted to it where that helps.

    Attributes:
        marginal: The posterior.
        error: Standard deviation of the error of its log density over the posterior, where the linear models tell of
            it; NaN where they don't, or flights fail, at many of the points.
        shift: What it does: see `implied`; NaN likewise.
        before: The same without a fit.
        points: At how many they were compared.
    """

    marginal: Marginal
    error: float
    shift: float
    before: float
    points: int


class Change(NamedTuple):
    """What is to be added to a quadratic polynomial, and its errors.

    Attributes:
        polynomial: The change.
        errors: What each point lacks of the fit to all the others (N,).
    """

    polynomial: Quadratic
    errors: Array


def fitted(
    marginal: Marginal, rng: np.random.Generator, progress: Callable[[float, str], None] | None = None
) -> Fitted:
    """Compare the corrections with Laplace's approximation over the posterior, and fit them where that helps.

    Args:
        marginal: From `polynomials.corrected`.
        rng: Source of the points.
        progress: Called with a share done and words.
    """
    parts, off = groups(marginal), list[float]()
    parameters, size = np.size(marginal.centre), max(len(group.axes) for group in parts)
    points, seen = np.zeros((0, parameters)), Compared.none(len(parts))
    while True:
        xi = rng.standard_normal((max(_FIRST, _BATCH * size) if len(points) else _FIRST, parameters))
        points, seen = np.vstack([points, xi]), seen.and_at(comparison.compared(marginal, xi))
        use = seen.known & seen.in_range
        if use.mean() < _FINITE:
            return Fitted(marginal, np.nan, np.nan, np.nan, len(points))
        made, errors, own = marginal, seen.errors[use], seen.own
        if len(points) > _FIRST:
            better = changes(marginal, points[use], seen.missing[:, use])
            if np.std(better.errors) < _BETTER * np.std(errors):
                bend = Quadratic(*(a + b for a, b in zip(marginal.bend, better.polynomial, strict=True)))
                made, errors = replace(marginal, bend=bend), better.errors
                own = own + np.asarray(better.polynomial.at(points.T))
                own[use] = seen.laplace[use] - errors
        known = seen.known
        before, shift = (implied(points[known], one[known], seen.laplace[known]) for one in (seen.own, own))
        error = float(np.std(errors))
        if progress is not None:
            words = (
                f"log density over the posterior, {len(points)} points: off by {error:.2g}, "
                f"which shifts means by {shift:.2g} standard deviations"
            )
            progress(min(len(points) / (_MOST * size), 1.0), words)
        good = error / np.sqrt(use.sum()) < _KNOWN and shift < MOST_SHIFT
        off.append(error)
        if good or len(points) >= _MOST * size or _in_vain(off, _MOST * size):
            return Fitted(made, error, shift, before, len(points))


def _in_vain(off: Sequence[float], most: int) -> bool:
    """Whether so many points won't do: errors with more and more points are too large for that, and fall no more."""
    return len(off) > _STILL + 1 and off[-1] > _KNOWN * most**0.5 and off[-1] > _BETTER * off[-1 - _STILL]


def implied(points: Array, own: Array, right: Array) -> float:
    """Largest difference that a density's error makes: see `shifted`.

    Args:
        points: Standard normal points (N, P).
        own: Minus the log density there, up to a constant (N,).
        right: What that should be (N,).
    """
    inside = 0.5 * np.sum(points**2, axis=1)
    return shifted(points, inside - own, inside - right)


def shifted(points: Array, own: Array, right: Array) -> float:
    """Largest difference of two densities: of a mean, in standard deviations, or relative of one of these.

    Both are integrated by importance weights of the same points, so that the chance of these cancels where the
    densities agree. Weights of each are bounded by root N times their mean (Ionides 2008). A place that one of them
    holds to be impossible counts for as much as the other holds to be there. Infinite where the right one holds all
    points but one to be impossible: then nothing can be told.

    Args:
        points: (N, P).
        own: Log weights by one density, up to a constant (N,).
        right: By the one that is right (N,).
    """
    (mean, sd), (right_mean, right_sd) = _moments(points, own), _moments(points, right)
    if not right_sd.all():
        return np.inf
    return float(max(np.max(np.abs(mean - right_mean) / right_sd), np.max(np.abs(sd / right_sd - 1.0))))


def _moments(points: Array, log_weights: Array) -> tuple[Array, Array]:
    """Means and standard deviations (P,) of weighted points, the weights bounded."""
    weights = np.exp(log_weights - np.max(log_weights))
    weights = np.minimum(weights, np.sqrt(len(weights)) * np.mean(weights))
    weights /= np.sum(weights)
    mean = weights @ points
    return mean, np.sqrt(weights @ (points - mean) ** 2)


def changes(marginal: Marginal, points: Array, missing: Array) -> Change:
    """What is to be added to the corrections, by what each group of flights lacks as a function of its coordinates.

    Args:
        marginal: The posterior.
        points: Standard coordinates (N, P).
        missing: What groups lack, up to constants (G, N).
    """
    parts = groups(marginal)
    before = apart(marginal.correction, parts)
    made = [change(*three) for three in zip(before, (points[:, group.axes] for group in parts), missing, strict=True)]
    polynomial = together([one.polynomial for one in made], parts, points.shape[1])
    return Change(polynomial, np.sum([one.errors for one in made], axis=0))


def change(expected: Quadratic, points: Array, missing: Array) -> Change:
    """What is to be added to a quadratic polynomial, by Bayesian linear regression.

    A share of its curvature along the axes and one of that between them may be taken back, where differences near the
    mode say nothing of the density at large; and every coefficient may change by itself.

    Args:
        expected: The polynomial.
        points: Standard coordinates (N, P).
        missing: What it lacks there, up to a constant (N,).
    """
    size = points.shape[1]
    i, j = np.triu_indices(size)
    curvature = np.asarray(expected.curvature)
    own = np.diag(np.diag(curvature))
    shares = np.stack([0.5 * np.einsum("ni,ij,nj->n", points, part, points) for part in (own, curvature - own)])
    squares = np.where(i == j, np.sqrt(0.5), 1.0)[:, None] * (points.T[i] * points.T[j])
    columns = np.vstack([np.ones(len(points)), shares, points.T, squares])
    best, found, errors = -np.inf, np.zeros(len(columns)), np.zeros(len(points))
    for bend, error in product(_BENDS, _ERRORS):
        spread = np.repeat([_CONSTANT, 1.0, _SLOPE, bend], [1, 2, size, len(i)])
        wide = spread[:, None] * columns
        inverse = np.linalg.inv(np.linalg.cholesky(wide.T @ wide + error**2 * np.eye(len(points))))
        unit = inverse @ missing
        evidence = -0.5 * float(unit @ unit) + float(np.log(np.diag(inverse)).sum())
        if evidence > best:
            weights = inverse.T @ unit
            best, found = evidence, spread * (wide @ weights)
            errors = weights / np.sum(inverse**2, axis=0)  # of leave-one-out predictions (Rasmussen and Williams 2006)
    bent = np.zeros((size, size))
    bent[i, j] = np.where(i == j, np.sqrt(0.5), 1.0) * found[3 + size :]
    polynomial = Quadratic(found[3 : 3 + size], bent + bent.T + found[1] * own + found[2] * (curvature - own))
    return Change(polynomial, errors)
