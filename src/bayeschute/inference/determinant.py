"""The log determinant of the marginal posterior: what start and disturbances add by how closely they are known.

It depends on the parameters through the linearisation, and every value of it takes one anew. It is very nearly linear
over the posterior, so a polynomial of second order stands for it there.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from bayeschute.inference.differences import beside
from bayeschute.inference.marginal import Marginal, Quadratic, course_at, shifted
from bayeschute.inference.target import filter_gains, linearise
from bayeschute.numerics import processors

Array = NDArray[np.float64]
_CROSSED = 3  # axes whose products with others the polynomial has
_gains = jax.jit(filter_gains)


def exact(marginal: Marginal, xi: Array) -> float:
    """Exact log determinant at one point (P,): every flight linearised anew there."""
    theta, shift = shifted(marginal, jnp.asarray(xi))
    total = 0.0
    for flight, along in zip(marginal.flights, marginal.along, strict=True):
        linear = linearise(flight, theta, course_at(along, shift))
        total += float(_gains(flight, marginal.hyper, linear).log_determinant)
    return total


def _changes(marginal: Marginal, points: Array) -> Array:
    """Exact log determinants (N,) at points (N, P), less the value at theta_0."""
    with ThreadPoolExecutor(processors()) as pool:
        values = list(pool.map(lambda xi: exact(marginal, xi), [0.0 * points[0], *points]))
    return np.array(values[1:]) - values[0]


def slope(marginal: Marginal, step: float = 0.2) -> Array:
    """Slope of the log determinant at theta_0 in standard coordinates (P,), by one-sided differences.

    Where a flight beside the optimum fails, the difference is taken to the other side.

    Raises:
        FloatingPointError: If flights fail to both sides, or at the optimum.
    """
    axes = np.eye(np.size(marginal.centre))
    found = _changes(marginal, step * axes) / step
    lost = ~np.isfinite(found)
    if lost.any():
        found[lost] = _changes(marginal, -step * axes[lost]) / -step
    if not np.isfinite(found).all():
        raise FloatingPointError("flights to both sides of the optimum fail: the log determinant has no slope there")
    return found


def around(marginal: Marginal, step: float = 1.0, crossed: int = _CROSSED) -> Quadratic:
    """The log determinant about theta_0, from exact values at plus and minus `step` along every axis.

    Along an axis on which a flight fails there, from values at a half, a quarter or an eighth of it. The `crossed` axes
    of greatest curvature get their products with all others too; a product at both corners of which a flight fails is
    left out (`error` tells what is missing).

    Raises:
        FloatingPointError: If a flight fails at an eighth of the step too.
    """
    count = np.size(marginal.centre)
    up, down, h = beside(lambda points: _changes(marginal, points)[:, None], count, step, "the log determinant")
    tilt, bent = ((up - down) / (2.0 * h))[:, 0], ((up + down) / h**2)[:, 0]
    curvature, first = np.diag(bent), np.argsort(-np.abs(bent))[:crossed]
    pairs = [(i, j) for n, i in enumerate(first) for j in range(count) if j not in first[: n + 1]]
    left = np.array(pairs, int).reshape(-1, 2)
    for side, sign in ((up, 1.0), (down, -1.0)):
        if not left.size:
            break
        i, j = left.T
        corners = sign * (np.diag(h[:, 0])[i] + np.diag(h[:, 0])[j])
        mixed = (_changes(marginal, corners) - side[i, 0] - side[j, 0]) / (h[i, 0] * h[j, 0])
        known = np.isfinite(mixed)
        curvature[i[known], j[known]] = curvature[j[known], i[known]] = mixed[known]
        left = left[~known]
    return Quadratic(tilt, curvature)


def error(marginal: Marginal, points: int, rng: np.random.Generator) -> float:
    """Root mean square error of the polynomial of the log determinant at standard normal points."""
    xi = rng.standard_normal((points, np.size(marginal.centre)))
    return float(np.sqrt(np.mean((_changes(marginal, xi) - np.asarray(marginal.determinant.at(xi.T))) ** 2)))
