"""Mode of the marginal posterior by quasi-Newton steps from the joint mode."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bayeschute.likelihood.joint import FlightData, Lifted, NoiseParameters
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior.along_record import conditional_mode
from bayeschute.posterior.beyond_linear import linear_errors
from bayeschute.posterior.fit.continuation import Progress
from bayeschute.posterior.fit.joint_fit import JointFit
from bayeschute.posterior.joint_mode import Optimum
from bayeschute.posterior.marginal import Marginal, marginalise, mean_correction_slope
from bayeschute.posterior.quasi_newton import length, secant_step

Array = NDArray[np.float64]
_MODE_STEPS, _NEAR = 16, 0.2  # most steps to the marginal mode; length of the last, in standard deviations
_HALVINGS = 10  # of a step to the mode at most
_TRUSTED = 1.0  # standard deviations up to which the last step of a search that did not end is gone all the same
_RISE = 5.0  # of minus the marginal log density over a step, beyond which half of it is tried
_HOPED = 2.0  # times the rise that a step promises, beyond which none is expected
_TELLING = 0.5  # standard deviations a step must be long for its change of the slope to count (see `marginal_mode`)
_SAME_SLOPE = 0.5  # standard deviations within which the slope of what linear models lack is taken for linear


class _LinearErrors(NamedTuple):
    """What the linear models about a point lack (`linear_errors.LinearErrors`), by theta.

    Attributes:
        theta: The point (P,).
        slope: (P,).
        information: (P, P).
    """

    theta: Array
    slope: Array
    information: Array

    @classmethod
    def at(cls, made: Marginal) -> _LinearErrors:
        """At the centre of a posterior."""
        errors, inverse = linear_errors.linear_errors(made), np.linalg.inv(np.asarray(made.scale))
        return cls(np.asarray(made.centre), inverse.T @ errors.slope, inverse.T @ errors.information @ inverse)

    def slope_at(self, theta: Array) -> Array:
        """The slope near the point (P,), as its information has it: secants of it must see the same curvature."""
        return self.slope + self.information @ (theta - self.theta)


class _Placed(NamedTuple):
    """A point at rest on the way to the marginal mode, what the mean correction adds to the slope, and the step on."""

    theta: Array
    conditional: conditional_mode.ConditionalOptimum
    correction: Array
    step: Array

    def onward(self, flights: Sequence[FlightData], hyper: NoiseParameters) -> tuple[Array, tuple[Lifted, ...]]:
        """Parameters and flights at the end of the step."""
        return self.theta + self.step, conditional_mode.onward(flights, hyper, self.theta, self.conditional, self.step)

    def rise(self, theta: Array, conditional: conditional_mode.ConditionalOptimum) -> float:
        """By how much minus the marginal log density is greater at another point, the mean correction linear."""
        return conditional.marginal - self.conditional.marginal + float(self.correction @ (theta - self.theta))


def marginal_mode(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    settled: JointFit,
    progress: Progress | None = None,
    most: int = _MODE_STEPS,
    near: float = _NEAR,
    least: float = -np.inf,
) -> Optimum:
    """Mode of the marginal posterior, from the joint mode: minimises cost, log determinant and mean correction.

    The mode is often five and more standard errors away. In between, the marginal density may be nearly flat, which the
    Gauss-Newton matrix of the cost doesn't show: it contains neither the curvature of the determinant nor that of the
    residuals, and its steps become short long before the mode. So steps are corrected by the change of the gradient
    over earlier ones (`quasi_newton`), and the gradient is taken at the conditional mode of start and disturbances.
    That over a short step is left out: conditional modes are at rest within 0.01 of the log density, so that gradients
    are known to 0.14 standard deviations, and curvatures from steps of a few tenths are noise. A remaining distance
    below 0.2 standard deviations is left to the sampler, which is exact.

    Args:
        flights: Records.
        priors: Priors of the parameters.
        settled: Where to begin, and the noise parameters.
        progress: Progress callback: share done and words.
        most: Most steps.
        near: Length of the last step, in standard deviations.
        least: Log density that is of use: the search ends where steps promise to stay far below.

    Returns:
        The mode, start and process noise at their best for it; `converged` is false where steps did not become short.
    """
    say = progress or (lambda share, words: None)
    begun, hyper, distance = settled.optimum, settled.hyper, np.inf
    theta, places, covariance = begun.theta, begun.flights, begun.covariance
    bends: list[tuple[Array, Array]] = []
    last: tuple[Array, Array] | None = None
    linear: _LinearErrors | None = None
    before: _Placed | None = None
    turn = halvings = 0
    while turn < most:
        conditional = conditional_mode.conditional_optimum(flights, hyper, priors, theta, places)
        try:
            if conditional is None:
                raise FloatingPointError(
                    "a step of the flights at the conditional optimum, or its derivative, is not finite"
                )
            if before is not None and halvings < _HALVINGS and before.rise(theta, conditional) > _RISE:
                raise FloatingPointError("a step towards the marginal mode lost the record")
            covariance = scipy.linalg.inv(conditional.matrix)
            best = replace(begun, theta=theta, flights=conditional.flights, covariance=covariance)
            made = marginalise(flights, hyper, priors, best)
            if linear is None or length(theta - linear.theta, covariance) > _SAME_SLOPE:
                linear = _LinearErrors.at(made)
        except FloatingPointError:
            if before is None or halvings == _HALVINGS:
                raise
            halvings, before = halvings + 1, before._replace(step=0.5 * before.step)
            theta, places = before.onward(flights, hyper)
            continue
        turn, halvings = turn + 1, 0
        covariance = scipy.linalg.inv(conditional.matrix + linear.information)
        correction = mean_correction_slope(made)
        slope = conditional.gradient + linear.slope_at(theta) + correction
        if last is not None and length(theta - last[0], covariance) > _TELLING:
            bends.append((theta - last[0], slope - last[1]))
        step, last = secant_step(slope, covariance, bends), (theta, slope)
        distance = length(step, covariance)
        density = f"cost {conditional.cost:.2f}, log density {-conditional.marginal:.2f}"
        say((turn - 1) / most, f"marginal mode: {density}, step {distance:.3f} standard deviations")
        before = _Placed(theta, conditional, correction, step)
        theta, places = before.onward(flights, hyper)
        if distance < near or -conditional.marginal + _HOPED * 0.5 * distance**2 < least:
            break
    if before is not None and distance > _TRUSTED:  # where that step leads nobody has looked
        theta, places = before.theta, before.conditional.flights
    converged = begun.converged and distance < near
    return replace(begun, theta=theta, flights=places, covariance=covariance, converged=converged)
