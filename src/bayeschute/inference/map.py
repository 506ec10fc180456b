"""The most probable parameters, initial states and latent disturbances: damped Gauss-Newton with exact Jacobians.

Stops on the step measured in posterior standard errors, never on the cost: tens of standard errors can cost a few units
of log density (METHODS 5).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bayeschute.inference.priors import Prior, working
from bayeschute.inference.target import FlightData, Hyper, Linear, cost, linearise, normal_equations

Array = NDArray[np.float64]
_FREE = 1e-2  # damping below which a step counts as a Gauss-Newton step


@dataclass(frozen=True)
class Optimum:
    """A fitted point.

    Attributes:
        theta: Parameters in working coordinates (P,).
        u: Initial deviations and knots of every flight, (U_f,) each.
        precision: Gauss-Newton matrix over (theta, u_1, u_2, ...).
        cost: Minus the log density up to constants.
        converged: Whether the last step was below tolerance.
        iterations: Jacobian evaluations spent.
        last_step: Largest last step over its standard error.
        trace: Cost after every iteration.
    """

    theta: Array
    u: tuple[Array, ...]
    precision: Array
    cost: float
    converged: bool
    iterations: int
    last_step: float
    trace: tuple[float, ...]

    @property
    def covariance(self) -> Array:
        """Laplace covariance of theta, u integrated out (P, P)."""
        p = self.theta.size
        return scipy.linalg.cho_solve(scipy.linalg.cho_factor(self.precision), np.eye(len(self.precision))[:, :p])[:p]


def assemble(
    flights: Sequence[FlightData], hyper: Hyper, linear: Sequence[Linear], priors: Sequence[Prior], theta: Array
) -> tuple[Array, Array, float]:
    """Gauss-Newton matrix, gradient and cost over (theta, u_1, u_2, ...), the prior of theta included."""
    centre, scale = working(priors)
    p = theta.size
    size = p + sum(f.unknowns for f in flights)
    matrix, gradient = np.zeros((size, size)), np.zeros(size)
    z = (theta - centre) / scale
    matrix[:p, :p] = np.diag(1.0 / scale**2)
    gradient[:p], total, at = z / scale, 0.5 * float(z @ z), p
    for flight, lin in zip(flights, linear, strict=True):
        m, g, c = normal_equations(flight, hyper, lin)
        where = np.r_[0:p, at : at + flight.unknowns]
        matrix[np.ix_(where, where)] += np.asarray(m)
        gradient[where] += np.asarray(g)
        total, at = total + float(c), at + flight.unknowns
    return matrix, gradient, total


def total_cost(
    flights: Sequence[FlightData], hyper: Hyper, priors: Sequence[Prior], theta: Array, u: Sequence[Array]
) -> float:
    """Minus the log density up to constants; infinite where a simulation fails."""
    centre, scale = working(priors)
    value = 0.5 * float(np.sum(((theta - centre) / scale) ** 2))
    for flight, part in zip(flights, u, strict=True):
        value += float(cost(flight, hyper, theta, part))
    return value if np.isfinite(value) else np.inf


def _pieces(flights: Sequence[FlightData], vector: Array, p: int) -> tuple[Array, tuple[Array, ...]]:
    cuts = np.cumsum([p] + [f.unknowns for f in flights])
    return vector[:p], tuple(vector[a:b] for a, b in zip(cuts[:-1], cuts[1:], strict=True))


def fit(
    flights: Sequence[FlightData],
    hyper: Hyper,
    priors: Sequence[Prior],
    theta: Array,
    u: Sequence[Array],
    tolerance: float = 0.01,
    most: int = 40,
    progress: Callable[[int, float, float], None] | None = None,
) -> Optimum:
    """Find the optimum by Levenberg-Marquardt with a line search.

    Args:
        flights: Records to fit.
        hyper: Noise parameters, fixed here.
        priors: Priors of theta.
        theta: Where to start, working coordinates (P,).
        u: Where to start, per flight (U_f,).
        tolerance: Largest step over its standard error at which to stop.
        most: Most iterations.
        progress: Called with iteration, cost and step over standard error.

    Returns:
        The optimum; `converged` tells whether the tolerance was met.

    Raises:
        FloatingPointError: If the simulation at the start is not finite.
    """
    theta, parts = np.asarray(theta, float), [np.asarray(x, float) for x in u]
    damping, trace = 1e-4, []
    value = total_cost(flights, hyper, priors, theta, parts)
    if not np.isfinite(value):
        raise FloatingPointError("the simulation at the starting point of the fit is not finite")
    largest, iteration, matrix, held_back = np.inf, 0, np.empty((0, 0)), False
    while iteration < most:
        linear = [linearise(f, theta, x) for f, x in zip(flights, parts, strict=True)]
        matrix, gradient, value = assemble(flights, hyper, linear, priors, theta)
        iteration += 1
        se = np.sqrt(np.diag(scipy.linalg.inv(matrix)))
        accepted = False
        while not accepted and damping < 1e6:
            damped = matrix + damping * np.diag(np.diag(matrix))
            step = -scipy.linalg.cho_solve(scipy.linalg.cho_factor(damped), gradient)
            for shrink in (1.0, 0.5, 0.25):
                d_theta, d_u = _pieces(flights, shrink * step, theta.size)
                trial = (theta + d_theta, [a + b for a, b in zip(parts, d_u, strict=True)])
                new = total_cost(flights, hyper, priors, *trial)
                if new <= value + 1e-9 * abs(value):
                    accepted = True
                    break
            else:
                damping *= 10.0
        if not accepted:
            largest = np.inf
            break
        held_back = shrink < 1.0 or damping > _FREE  # a short step that damping made says nothing of the optimum
        largest = float(np.max(np.abs(shrink * step)[: theta.size] / se[: theta.size]))
        (theta, parts), damping = trial, max(damping / 10.0, 1e-9)
        trace.append(new)
        if progress is not None:
            progress(iteration, new, largest)
        if largest < tolerance and not held_back:
            break
    linear = [linearise(f, theta, x) for f, x in zip(flights, parts, strict=True)]
    matrix, _, value = assemble(flights, hyper, linear, priors, theta)
    return Optimum(
        theta, tuple(parts), matrix, value, largest < tolerance and not held_back, iteration, largest, tuple(trace)
    )
