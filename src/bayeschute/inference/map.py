"""The most probable parameters, start and latent disturbances: Gauss-Newton with exact Jacobians, smoothed by a filter.

A flight linearised along its course is a linear state-space model, so one pass of a Kalman filter and smoother gives
the conditional optimum of start and disturbances as a linear function of the parameters; what is left is a
least-squares problem in the parameters, damped after Levenberg and Marquardt. Stops on the step measured in posterior
standard errors, never on the cost alone: tens of standard errors can cost a few units of log density (METHODS 5).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bayeschute.air.vector import Component
from bayeschute.inference.priors import Prior, working
from bayeschute.inference.statespace import innovations, smooth
from bayeschute.inference.target import (
    FlightData,
    Hyper,
    Linear,
    Unknowns,
    as_series,
    cost,
    course,
    filter_gains,
    linearise,
)

Array = NDArray[np.float64]
_FREE = 1e-2  # damping below which a step counts as a Gauss-Newton step
_SHRINK = (1.0, 0.5, 0.25)


@dataclass(frozen=True)
class Optimum:
    """A fitted point.

    Attributes:
        theta: Parameters in working coordinates (P,).
        unknowns: Start and shocks of every flight.
        covariance: Laplace covariance of theta, start and shocks integrated out (P, P).
        cost: Minus the joint log density up to constants.
        converged: Whether the last step was below tolerance.
        iterations: Linearisations spent.
        last_step: Largest last step over its standard error.
        trace: Cost after every iteration.
    """

    theta: Array
    unknowns: tuple[Unknowns, ...]
    covariance: Array
    cost: float
    converged: bool
    iterations: int
    last_step: float
    trace: tuple[float, ...]


class Conditional(NamedTuple):
    """Start and shocks given theta near a linearisation: ``optimum - slope (theta - theta_0)``, and what is left.

    Attributes:
        optimum: Conditional optimum at the linearisation.
        slope: Its derivatives by theta, last axis, sign turned.
        matrix: Gauss-Newton matrix of theta, start and shocks eliminated (P, P).
        gradient: Gradient of minus the log density by theta, likewise (P,).
    """

    optimum: Unknowns
    slope: Unknowns
    matrix: Component
    gradient: Component


@jax.jit
def conditional(data: FlightData, hyper: Hyper, linear: Linear) -> Conditional:
    """Eliminate start and shocks of a linearised flight."""
    made, series = filter_gains(data, hyper, linear), as_series(linear)
    unit = innovations(made, series).reshape(-1, series.shape[2])
    start, shocks = smooth(made, series)
    return Conditional(
        Unknowns(start[:, 0], shocks[..., 0]),
        Unknowns(start[:, 1:], shocks[..., 1:]),
        unit[:, 1:].T @ unit[:, 1:],
        -unit[:, 1:].T @ unit[:, 0],
    )


@jax.jit
def _opening(data: FlightData, linear: Linear) -> Linear:
    """A linearised flight that stands still where it fails after its last datum: nothing is told there."""
    steps, present = linear.steps, jnp.asarray(data.present).any(axis=1)
    after = jnp.arange(present.size) > jnp.max(jnp.where(present, jnp.arange(present.size), -1))

    def still(rows: jax.Array) -> jax.Array:
        """A step belongs to the sample that it leads to, an output to its own."""
        free = after[-rows.shape[0] :].reshape(-1, 1, 1)
        return jnp.where(free & ~jnp.isfinite(rows), 0.0, rows)

    by_step = ("by_state", "by_theta", "by_now", "by_then", "out_state", "out_theta")
    return linear._replace(steps=steps._replace(**{name: still(getattr(steps, name)) for name in by_step}))


class _Linearised(NamedTuple):
    """Conditional optima of all flights, and matrix and gradient of the least squares in theta, prior and tilt in."""

    given: list[Conditional]
    matrix: Array
    gradient: Array


def total_cost(
    flights: Sequence[FlightData], hyper: Hyper, priors: Sequence[Prior], theta: Array, unknowns: Sequence[Unknowns]
) -> float:
    """Minus the log density up to constants; infinite where a simulation fails."""
    centre, scale = working(priors)
    value = 0.5 * float(np.sum(((theta - centre) / scale) ** 2))
    for flight, part in zip(flights, unknowns, strict=True):
        value += float(cost(flight, hyper, theta, part))
    return value if np.isfinite(value) else np.inf


def _moved(unknowns: Unknowns, given: Conditional, step: Array, share: float) -> Unknowns:
    """Unknowns a share of the way to the conditional optimum at `step` from the linearisation."""
    there = jax.tree.map(lambda best, slope: best - slope @ step, given.optimum, given.slope)
    return jax.tree.map(lambda a, b: np.asarray(a + share * (b - a)), unknowns, there)


def fit(
    flights: Sequence[FlightData],
    hyper: Hyper,
    priors: Sequence[Prior],
    theta: Array,
    unknowns: Sequence[Unknowns] | None = None,
    tolerance: float = 0.01,
    most: int = 40,
    tilt: Array | None = None,
    progress: Callable[[int, float, float], None] | None = None,
    opening: bool = False,
) -> Optimum:
    """Find the optimum by Levenberg-Marquardt with a line search.

    Args:
        flights: Records to fit.
        hyper: Noise parameters, fixed here.
        priors: Priors of theta.
        theta: Where to start, working coordinates (P,).
        unknowns: Where to start, per flight; prior means where None.
        tolerance: Largest step over its standard error, and gain in log density, at which to stop.
        most: Most iterations.
        tilt: Slope of a term added to the cost (P,).
        progress: Called with iteration, cost and step over standard error.
        opening: Whether flights may fail after their last datum.

    Returns:
        The optimum; `converged` tells whether the tolerance was met.

    Raises:
        FloatingPointError: If the simulation at the start, or its derivative, is not finite.
    """
    centre, scale = working(priors)
    theta, tilt = np.asarray(theta, float), np.zeros(len(priors)) if tilt is None else tilt
    parts = list(unknowns) if unknowns is not None else [f.still() for f in flights]

    def value_at(theta: Array, parts: Sequence[Unknowns]) -> float:
        return total_cost(flights, hyper, priors, theta, parts) + float(tilt @ theta)

    def linearised(theta: Array, parts: Sequence[Unknowns]) -> _Linearised | None:
        pairs = zip(flights, parts, strict=True)
        linear = [linearise(f, theta, course(f, hyper, x)) for f, x in pairs]
        if opening:
            linear = [_opening(f, one) for f, one in zip(flights, linear, strict=True)]
        given = [conditional(f, hyper, one) for f, one in zip(flights, linear, strict=True)]
        matrix = np.diag(1.0 / scale**2) + sum(np.asarray(g.matrix) for g in given)
        gradient = (theta - centre) / scale**2 + tilt + sum(np.asarray(g.gradient) for g in given)
        return (
            _Linearised(given, matrix, gradient) if np.isfinite(matrix).all() and np.isfinite(gradient).all() else None
        )

    value, here = value_at(theta, parts), linearised(theta, parts)
    if not np.isfinite(value) or here is None:
        raise FloatingPointError("the simulation at the starting point of the fit, or its derivative, is not finite")
    damping, trace, largest, iteration, converged = 1e-4, [], np.inf, 0, False
    while iteration < most:
        given, matrix, gradient = here
        iteration += 1
        se, accepted = np.sqrt(np.diag(scipy.linalg.inv(matrix))), False
        while not accepted and damping < 1e6:
            damped = matrix + damping * np.diag(np.diag(matrix))
            step = -scipy.linalg.cho_solve(scipy.linalg.cho_factor(damped), gradient)
            for share in _SHRINK:
                moved = [_moved(x, g, step, share) for x, g in zip(parts, given, strict=True)]
                new = value_at(theta + share * step, moved)
                # A flight may be finite where its derivative isn't, such as one lost in its last samples.
                there = linearised(theta + share * step, moved) if new <= value + 1e-9 * abs(value) else None
                if there is not None:
                    accepted, here = True, there
                    break
            else:
                damping *= 10.0
        if not accepted:
            largest = np.inf
            break
        held_back = share < 1.0 or damping > _FREE  # a short step that damping made says nothing of the optimum
        largest = float(np.max(np.abs(share * step) / se))
        gained = value - new  # parameters that hardly move don't show what start and disturbances still gain
        theta, parts, value, damping = theta + share * step, moved, new, max(damping / 10.0, 1e-9)
        trace.append(new)
        if progress is not None:
            progress(iteration, new, largest)
        converged = largest < tolerance and gained < tolerance and not held_back
        if converged:
            break
    covariance = scipy.linalg.inv(here.matrix)
    return Optimum(theta, tuple(parts), covariance, value, converged, iteration, largest, tuple(trace))
