"""What the uncertainty of the noise parameters adds to that of the parameters.

Parameters are drawn with the noise parameters held. With ``xi`` the parameters' standard coordinates and ``eta`` the
logarithms of the noise parameters, minus the log of their joint density is about
``1/2 |xi|^2 + xi' C (eta - eta_0) + ..``: given eta, xi is normal about ``-C (eta - eta_0)`` with unit covariance. So a
draw for held noise parameters, moved by that slope times a draw of eta, is one of the joint posterior (the correction
of empirical Bayes intervals of Kass and Steffey 1989, section 2).
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from bayeschute.inference.marginal import Marginal, beside, course_at, shifted
from bayeschute.inference.score import conditional_score, to_vector
from bayeschute.inference.target import as_series, linearise
from bayeschute.numerics import processors

Array = NDArray[np.float64]
_seen = jax.jit(lambda linear: as_series(linear)[..., 0])


def law_slope(marginal: Marginal, step: float = 0.5) -> Array:
    """Derivatives ``-C`` of the parameters' conditional mode by the noise parameters, in standard coordinates.

    C is the change along every axis of the gradient by eta of ``1/2 |innovations|^2 + log det``, the flights linearised
    anew along the conditional courses there: so the change of the log determinant is in it.

    Args:
        marginal: The posterior for held noise parameters.
        step: How far to either side to go along every axis; less far where a flight fails there.

    Returns:
        (P, V), noise parameters in the order of `score.to_vector`.

    Raises:
        FloatingPointError: If flights fail along an axis, however short a way is gone.
    """
    at = jnp.asarray(to_vector(marginal.hyper))
    like = jax.tree.map(lambda a: jnp.asarray(a, float), marginal.hyper)

    def gradient(xi: Array) -> Array:
        theta, shift = shifted(marginal, jnp.asarray(xi))
        total: Array = np.zeros(at.size)
        for flight, along in zip(marginal.flights, marginal.along, strict=True):
            linear = linearise(flight, theta, course_at(along, shift))
            total = total + np.asarray(conditional_score(at, like, flight, linear, _seen(linear) - along.gap))
        return total

    with ThreadPoolExecutor(processors()) as pool:
        up, down, h = beside(
            lambda points: np.array(list(pool.map(gradient, points))), np.size(marginal.centre), step, "the gradient"
        )
    return np.asarray((down - up) / (2.0 * h))


def widened(xi: Array, slope: Array, covariance: Array, seed: int) -> Array:
    """Draws for held noise parameters made draws of the joint posterior, each with noise parameters of its own.

    Args:
        xi: Standard coordinates (..., P).
        slope: From `law_slope` (P, V).
        covariance: Of the logarithms of the noise parameters (V, V).
        seed: Seed.
    """
    z = np.random.default_rng([seed, 8]).standard_normal((*xi.shape[:-1], len(covariance)))
    return np.asarray(xi + z @ np.linalg.cholesky(covariance).T @ slope.T)


def added(scale: Array, slope: Array, covariance: Array) -> Array:
    """What uncertain noise parameters add to the parameters' covariance (P, P); `scale` as in `Marginal`."""
    moved = np.asarray(scale) @ slope
    return np.asarray(moved @ covariance @ moved.T)
