"""Joint posterior mode of parameters, initial state and disturbances: Gauss-Newton with a Kalman smoother.

A flight linearised along its trajectory is a linear state-space model, so one pass of a Kalman filter and smoother
gives the conditional mode of start and disturbances as a linear function of the parameters; what remains is a
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

from bayeschute.core.vectors import Component
from bayeschute.likelihood.joint import (
    FlightData,
    Lifted,
    Linear,
    NoiseParameters,
    Unknowns,
    as_seen,
    cost,
    filter_gains,
    latent_path_of,
    linearise,
    states,
)
from bayeschute.likelihood.kalman import Gains, smooth_driven
from bayeschute.likelihood.priors import Prior, precision, standard, working

Array = NDArray[np.float64]
_FREE = 1e-2  # damping below which a step counts as a Gauss-Newton step
_SHRINK = (1.0, 0.5, 0.25)
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-4, 1e-9, 1e6


@dataclass(frozen=True)
class Optimum:
    """A fitted point.

    Attributes:
        theta: Parameters in working coordinates (P,).
        flights: Start, process noise and trajectory of every flight.
        covariance: Laplace covariance of theta, start and process noise integrated out (P, P).
        cost: Minus the joint log density up to constants.
        converged: Whether the last step was below tolerance.
        iterations: Linearisations spent.
        last_step: Largest last step over its standard error.
        trace: Cost after every iteration.
    """

    theta: Array
    flights: tuple[Lifted, ...]
    covariance: Array
    cost: float
    converged: bool
    iterations: int
    last_step: float
    trace: tuple[float, ...]

    @property
    def unknowns(self) -> tuple[Unknowns, ...]:
        """Start and process noise of every flight."""
        return tuple(one.unknowns for one in self.flights)

    def linear(self, flights: Sequence[FlightData]) -> list[Linear]:
        """The flights linearised along their paths."""
        return [linearise(f, self.theta, at.latent_path(f)) for f, at in zip(flights, self.flights, strict=True)]


class Conditional(NamedTuple):
    """Start and process noise given theta near a linearisation: ``optimum - slope (theta - theta_0)``, and the rest.

    Derivatives are by the K parameters that the flight has.

    Attributes:
        optimum: Conditional optimum at the linearisation.
        slope: Its derivatives by theta, last axis, sign turned.
        states: How far the path moves to that optimum, then its derivatives, sign turned (T, X, 1 + K).
        matrix: Gauss-Newton matrix of theta, start and process noise eliminated (K, K).
        gradient: Gradient of minus the log density by theta, likewise (K,).
        gains: The filter.
        parameters: Numbers of these parameters among all (K,).
    """

    optimum: Unknowns
    slope: Unknowns
    states: jax.Array
    matrix: Component
    gradient: Component
    gains: Gains
    parameters: Component

    def add_to(self, matrix: Array, gradient: Array) -> None:
        """Add the flight to the matrix (P, P) and the gradient (P,) of all parameters."""
        matrix[np.ix_(self.parameters, self.parameters)] += self.matrix
        gradient[self.parameters] += self.gradient


def conditional(data: FlightData, hyper: NoiseParameters, linear: Linear) -> Conditional:
    """Eliminate start and process noise of a linearised flight."""
    made = filter_gains(data, hyper, linear)
    got = smooth_driven(made, as_seen(linear))
    unit = got.innovations.reshape(-1, got.start.shape[1])
    return Conditional(
        Unknowns(got.start[:, 0], got.process_noise[..., 0]),
        Unknowns(got.start[:, 1:], got.process_noise[..., 1:]),
        got.states,
        unit[:, 1:].T @ unit[:, 1:],
        -unit[:, 1:].T @ unit[:, 0],
        made,
        linear.parameters,
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


def total_cost(
    flights: Sequence[FlightData],
    hyper: NoiseParameters,
    priors: Sequence[Prior],
    theta: Array,
    unknowns: Sequence[Unknowns],
) -> float:
    """Minus the log density up to constants; infinite where a simulation fails."""
    value = 0.5 * float(np.sum(standard(priors, np.asarray(theta)) ** 2))
    for flight, part in zip(flights, unknowns, strict=True):
        value += float(cost(flight, hyper, theta, part))
    return value if np.isfinite(value) else np.inf


class _Point(NamedTuple):
    """A point of the fit.

    Attributes:
        theta: Parameters (P,).
        unknowns: Of every flight.
        value: Cost, tilt in.
        given: Conditional optima of the flights linearised there.
        matrix: Of the least squares in theta, prior in (P, P).
        gradient: Likewise, tilt in (P,).
    """

    theta: Array
    unknowns: Sequence[Unknowns]
    value: float
    given: Sequence[Conditional]
    matrix: Array
    gradient: Array

    def towards(self, step: Array, share: float) -> tuple[Array, list[Unknowns]]:
        """Parameters a share of a step away, and unknowns a share of the way to their optimum at its end."""

        def moved(part: Unknowns, given: Conditional) -> Unknowns:
            own = step[given.parameters]
            there = jax.tree.map(lambda best, slope: best - slope @ own, given.optimum, given.slope)
            return jax.tree.map(lambda a, b: np.asarray(a + share * (b - a)), part, there)

        return self.theta + share * step, [moved(x, g) for x, g in zip(self.unknowns, self.given, strict=True)]


@dataclass(frozen=True)
class _Problem:
    """What is fitted: see `fit` for the attributes."""

    flights: Sequence[FlightData]
    hyper: NoiseParameters
    priors: Sequence[Prior]
    tilt: Array
    first_part: bool

    def point(self, theta: Array, unknowns: Sequence[Unknowns], below: float = np.inf) -> _Point | None:
        """A point of the fit; None where its cost or derivative is not finite, or the cost not below a bound.

        A flight may be finite where its derivative isn't, such as one lost in its last samples.
        """
        value = total_cost(self.flights, self.hyper, self.priors, theta, unknowns) + float(self.tilt @ theta)
        if not np.isfinite(value) or value > below:
            return None
        pairs = zip(self.flights, unknowns, strict=True)
        linear = [linearise(f, theta, latent_path_of(f, self.hyper, x)) for f, x in pairs]
        if self.first_part:
            linear = [_opening(f, one) for f, one in zip(self.flights, linear, strict=True)]
        given = [conditional(f, self.hyper, one) for f, one in zip(self.flights, linear, strict=True)]
        matrix = precision(self.priors)
        gradient = matrix @ (theta - working(self.priors)[0]) + self.tilt
        for one in given:
            one.add_to(matrix, gradient)
        finite = np.isfinite(matrix).all() and np.isfinite(gradient).all()
        return _Point(theta, unknowns, value, given, matrix, gradient) if finite else None


class _Step(NamedTuple):
    """Where a step leads, how parameters move, the damping it took, and whether that or a shortening held it back."""

    to: _Point
    move: Array
    damping: float
    held_back: bool


def _lower(problem: _Problem, here: _Point, damping: float) -> _Step | None:
    """A step that does not raise the cost, damped and shortened as much as that takes; None where nothing helps."""
    bound = here.value + 1e-9 * abs(here.value)
    while damping < _MOST_DAMPING:
        damped = here.matrix + damping * np.diag(np.diag(here.matrix))
        step = -scipy.linalg.cho_solve(scipy.linalg.cho_factor(damped), here.gradient)
        for share in _SHRINK:
            there = problem.point(*here.towards(step, share), bound)
            if there is not None:
                # A short step that damping made says nothing of the optimum.
                return _Step(there, share * step, damping, share < 1.0 or damping > _FREE)
        damping *= 10.0
    return None


def fit(
    flights: Sequence[FlightData],
    hyper: NoiseParameters,
    priors: Sequence[Prior],
    theta: Array,
    unknowns: Sequence[Unknowns] | None = None,
    tolerance: float = 0.01,
    most: int = 40,
    tilt: Array | None = None,
    progress: Callable[[int, float, float], None] | None = None,
    first_part: bool = False,
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
        first_part: Whether flights may fail after their last datum.

    Returns:
        The optimum; `converged` tells whether the tolerance was met.

    Raises:
        FloatingPointError: If the simulation at the start, or its derivative, is not finite.
    """
    tilt = np.zeros(len(priors)) if tilt is None else tilt
    problem = _Problem(flights, hyper, priors, tilt, first_part)
    here = problem.point(np.asarray(theta, float), [f.still() for f in flights] if unknowns is None else list(unknowns))
    if here is None:
        raise FloatingPointError("the simulation at the starting point of the fit, or its derivative, is not finite")
    damping, largest, converged, iteration = _FIRST_DAMPING, np.inf, False, 0
    trace: list[float] = []
    while iteration < most and not converged:
        iteration += 1
        made = _lower(problem, here, damping)
        if made is None:
            largest = np.inf
            break
        largest = float(np.max(np.abs(made.move) / np.sqrt(np.diag(scipy.linalg.inv(here.matrix)))))
        gained = here.value - made.to.value  # parameters that hardly move don't show what start and disturbances gain
        converged = largest < tolerance and gained < tolerance and not made.held_back
        here, damping = made.to, max(made.damping / 10.0, _LEAST_DAMPING)
        trace.append(here.value)
        if progress is not None:
            progress(iteration, here.value, largest)
    covariance = scipy.linalg.inv(here.matrix)
    ends = _flown(flights, hyper, here)
    return Optimum(here.theta, ends, covariance, here.value, converged, iteration, largest, tuple(trace))


def _flown(flights: Sequence[FlightData], hyper: NoiseParameters, here: _Point) -> tuple[Lifted, ...]:
    """The flights on the paths of their simulations, which are finite at every point of a fit until its last datum."""
    made = []
    for flight, unknowns in zip(flights, here.unknowns, strict=True):
        latent_path = latent_path_of(flight, hyper, unknowns)
        made.append(Lifted(unknowns, latent_path.error, states(flight, jnp.asarray(here.theta), latent_path)))
    return tuple(made)
