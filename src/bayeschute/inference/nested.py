"""The joint posterior of parameters and noise parameters, every point linearised anew: a slow judge of the fast way.

The marginal posterior (`inference.marginal`) follows the conditional optimum linearly, takes the log determinant from a
polynomial, and adds the uncertainty of the noise parameters by a slope. Here none of that is done: at every point
(theta, eta) start and disturbances are optimised for these very values, and integrated out about their optimum with the
determinant that belongs there (nested Laplace approximation, Rue, Martino and Chopin 2009). The gap alone is taken from
the fit. Draws of the fast way are then importance weighted; the Pareto shape of the weights tells whether they can be
trusted (Vehtari et al. 2024).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from bayeschute.inference.evidence import HyperPrior, from_vector, to_vector
from bayeschute.inference.finding import Found
from bayeschute.inference.marginal import course_at
from bayeschute.inference.priors import Prior, working
from bayeschute.inference.statespace import innovations, response, smooth
from bayeschute.inference.target import (
    Course,
    FlightData,
    Hyper,
    Linear,
    Unknowns,
    course,
    filter_gains,
    linearise,
)

Array = NDArray[np.float64]
_MOST, _NEAR = 6, 1e-3  # most linearisations at a point; gain in log density [1] by the last one that counts as settled


class Point(NamedTuple):
    """Log density at a point.

    Attributes:
        value: Joint log density of theta and eta, up to one constant for all points; NaN where a simulation fails.
        unsettled: What the last linearisation still gained; a measure of its error.
    """

    value: float
    unsettled: float


class _Eliminated(NamedTuple):
    """Conditional optimum of start and shocks of a linearised flight, and minus the log density without them."""

    optimum: Unknowns
    value: jax.Array


@jax.jit
def _eliminate(flight: FlightData, hyper: Hyper, linear: Linear, gap: jax.Array) -> _Eliminated:
    start, error = jnp.asarray(linear.driven.start), jnp.asarray(linear.driven.error)
    none = jnp.zeros((linear.steps.out_theta.shape[2], 1))
    series = linear.residual[..., None] + response(linear.steps, start[:, None], error[..., None], none)
    made = filter_gains(flight, hyper, linear)
    unit, (first, shocks) = innovations(made, series - gap[..., None]), smooth(made, series)
    return _Eliminated(Unknowns(first[:, 0], shocks[..., 0]), 0.5 * jnp.sum(unit**2) + made.log_determinant)


@dataclass(frozen=True)
class Nested:
    """The joint posterior of parameters and noise parameters about a fit.

    Attributes:
        found: The fit; its courses are where optimisations of start and disturbances begin.
        priors: Priors of the parameters.
        prior: Priors of the noise parameters.
    """

    found: Found
    priors: Sequence[Prior]
    prior: HyperPrior

    def log_density(self, theta: Array, eta: Array) -> Point:
        """Joint log density of parameters theta (P,) and logarithms of the noise parameters eta (V,).

        Args:
            theta: Working coordinates.
            eta: In the order of `score.to_vector`.
        """
        centre, scale = working(self.priors)
        off = (eta - to_vector(self.prior.median)) / self.prior.log_sd
        value = -0.5 * float(np.sum(((theta - centre) / scale) ** 2) + off @ off)
        marginal, hyper, gained = self.found.marginal, from_vector(eta, self.prior.median), 0.0
        shift = jnp.asarray(theta - np.asarray(marginal.centre))
        for flight, along in zip(marginal.flights, marginal.along, strict=True):
            driven: Course = course_at(along, shift)
            before = np.inf
            for _ in range(_MOST):
                made = _eliminate(flight, hyper, linearise(flight, jnp.asarray(theta), driven), along.gap)
                now = float(made.value)
                if not np.isfinite(now):
                    return Point(np.nan, np.inf)
                driven, last, before = course(flight, hyper, made.optimum), abs(now - before), now
                if last < _NEAR:
                    break
            value, gained = value - now, gained + last
        return Point(value, gained)


class Drawn(NamedTuple):
    """Draws of the fast way, and the log density they were drawn with.

    Attributes:
        theta: Working coordinates (S, P).
        eta: Logarithms of the noise parameters (S, V).
        log_proposal: Up to a constant (S,).
    """

    theta: Array
    eta: Array
    log_proposal: Array


def draw(found: Found, xi: Array, log_density: Array, count: int, seed: int, held: bool = False) -> Drawn:
    """Joint draws of parameters and noise parameters as the fast way makes them.

    Args:
        found: The fit.
        xi: Draws of the sampler, noise parameters held (N, P).
        log_density: Their marginal log densities (N,).
        count: Draws to make of them, spread evenly.
        seed: Seed.
        held: Whether the noise parameters stay at the fit's.
    """
    pick = np.linspace(0, len(xi) - 1, count).astype(int)
    z = np.random.default_rng([seed, 12]).standard_normal((count, len(found.law_covariance)))
    z = 0.0 * z if held else z
    moved = z @ np.linalg.cholesky(found.law_covariance).T
    wide = xi[pick] + moved @ found.law_slope.T
    theta = np.asarray(found.marginal.centre) + wide @ np.asarray(found.marginal.scale).T
    return Drawn(theta, to_vector(found.hyper) + moved, log_density[pick] - 0.5 * np.sum(z**2, axis=1))
