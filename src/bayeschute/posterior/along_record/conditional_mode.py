"""Conditional modes of trajectory, start and process noise for fixed parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

from bayeschute.likelihood.disturbances import disturbances
from bayeschute.likelihood.joint import FlightData, Lifted, Linear, NoiseParameters
from bayeschute.likelihood.kalman import Gains
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior.along_record.linear_problem import Solved, led, shortened
from bayeschute.posterior.along_record.slack_level import Level, Point, Relaxed, lowered, stepped, stepped_and_closed

Array = NDArray[np.float64]
_RESTING, _MOST_RESTING = 0.01, 12  # gain in log density at which a conditional optimum is reached; most steps to it
_CLOSE, MOST_CLOSE = 1e-3, 20  # the same where paths enter to first order
_ANDERSON = 4  # earlier steps that tell of the next one to it


class ConditionalOptimum(NamedTuple):
    """Conditional mode of trajectory, start and process noise for given parameters, and the cost about it.

    Attributes:
        flights: Of every flight.
        gradient: Of the cost by theta (P,).
        matrix: Its Gauss-Newton matrix (P, P).
        cost: Minus the log density up to constants.
        defect: Largest that is left, over the slack of the last level.
        onward: The flights' linear problems there.
    """

    flights: tuple[Lifted, ...]
    gradient: Array
    matrix: Array
    cost: float
    defect: float
    onward: tuple[Solved, ...]

    @property
    def marginal(self) -> float:
        """Minus the marginal log density by Laplace's approximation, up to constants."""
        return self.cost + sum(float(one.determinant) for one in self.onward)


def conditional_optimum(
    flights: Sequence[FlightData], hyper: NoiseParameters, priors: Sequence[Prior], theta: Array, at: Sequence[Lifted]
) -> ConditionalOptimum | None:
    """Bring trajectories, start and process noise to their conditional mode for fixed parameters; None if not finite.

    Args:
        flights: Records.
        hyper: Noise parameters.
        priors: Priors of the parameters.
        theta: Parameters, working coordinates (P,).
        at: Where to begin.
    """
    level = Level(flights, hyper, priors, 0.0)
    here, _ = resting(level, level.point(theta, at))
    solved, matrix, gradient = level.solved(here)
    if not (np.isfinite(here.merit) and np.isfinite(matrix).all() and np.isfinite(gradient).all()):
        return None
    return ConditionalOptimum(here.flights, gradient, matrix, here.cost, here.defect, tuple(solved))


def brought(
    flights: Sequence[FlightData], hyper: NoiseParameters, theta: Array, at: Sequence[Lifted]
) -> list[tuple[Lifted, Linear]]:
    """Flights at their conditional modes for fixed parameters, linearised there; as `conditional_optimum`."""
    level = Level(flights, hyper, (), 0.0)
    here, _ = resting(level, level.point(theta, at), _CLOSE, MOST_CLOSE)
    return list(zip(here.flights, here.along, strict=True))


class LinearOptimum(NamedTuple):
    """A flight at the mode of the linear problem near its conditional mode, that problem, and its filter."""

    flight: Lifted
    linear: Linear
    gains: Gains


def approached(
    flights: Sequence[FlightData],
    hyper: NoiseParameters,
    theta: Array,
    at: Sequence[Lifted],
    most: int = MOST_CLOSE,
) -> list[LinearOptimum]:
    """Flights at their conditional modes for fixed parameters, with the linear problems there.

    Without derivatives by theta. The linear problem's own mode has the cost to third order in what is left of the way,
    but the correction of the mean (`likelihood.mean_correction`) is that about the path, and first order matters: on a
    flight whose path bends much, paths that lacked up to one unit of the cost had marginal log densities 1.1 too high
    on average, that at rest had its own, and the density seemed to rise from there to all sides. Paths that lack 0.01
    have densities that are the same as of those that lack 0.001 to the third decimal (set S).

    Args:
        flights: Records.
        hyper: Noise parameters.
        theta: Parameters, working coordinates (P,).
        at: Where to begin.
        most: Most steps.
    """
    level = Level(flights, hyper, (), 0.0, by_theta=False)
    here, relaxed = resting(level, level.point(theta, at), _RESTING, most)
    five = zip(flights, here.flights, here.along, relaxed.ends, relaxed.filters, strict=True)
    held = np.zeros_like(theta)
    return [
        LinearOptimum(shortened(f, at, end, 1.0, theta, held), made.without_theta(), one)
        for f, at, made, end, one in five
    ]


def resting(level: Level, here: Point, near: float = _RESTING, most: int = _MOST_RESTING) -> tuple[Point, Relaxed]:
    """Steps of trajectories, start and process noise for fixed parameters, until they would gain next to nothing.

    Gauss-Newton steps, accelerated by Anderson's method (1965): where residuals bend they are too long or too short
    along a few directions, which the change of the steps over earlier ones tells. Where canopies were not seen for a
    while plain steps go up to five times too far, and take 60 linearisations to where these take 7 to 14.

    Args:
        level: Objective.
        here: Where they begin.
        near: Gain in log density of the next step at which they end.
        most: Most steps.

    Returns:
        Where they lead, and the linear problems solved there.
    """
    held, tried = np.zeros_like(here.theta), list[tuple[Sequence[Lifted], Sequence[Lifted]]]()
    if not all(_consistent(f, level.hyper, at) for f, at in zip(level.records, here.flights, strict=True)):
        here = stepped(level, here, level.relaxed(here).ends, held, 1.0)  # what it cost before says nothing
    for left in range(most, -1, -1):
        relaxed = level.relaxed(here)
        if relaxed.gain < near or not left:
            break
        tried = [*tried[-_ANDERSON:], (here.flights, relaxed.ends)]
        several = len(tried) > 1 and _finite(relaxed.ends)
        there = stepped_and_closed(level, here, _accelerated(tried), held, 1.0) if several else here
        if not there.merit < here.merit:
            tried = tried[-1:]
            found = lowered(level, here, relaxed.ends, held)
            if found is None:
                break
            there = found.point
        here = there
    return here, relaxed


def _accelerated(tried: Sequence[tuple[Sequence[Lifted], Sequence[Lifted]]]) -> list[Lifted]:
    """Ends of the next step by Anderson's method, from the beginnings and ends of earlier ones, the last one last.

    The combination of ends whose steps together are shortest, in standard coordinates of start and process noise.
    """
    made = []
    for pairs in zip(*(zip(*one, strict=True) for one in tried), strict=True):
        steps = [np.concatenate([np.ravel(b - a) for a, b in zip(at[0], end[0], strict=True)]) for at, end in pairs]
        changes = np.diff(np.array(steps), axis=0)
        weights = np.linalg.lstsq(changes.T, steps[-1])[0]
        ends = [end for _, end in pairs]
        shares = np.append(weights, 1.0) - np.append(0.0, weights)
        made.append(jax.tree.map(lambda *ends, c=shares: np.tensordot(c, np.stack(ends), axes=1), *ends))
    return made


def _finite(ends: Sequence[Lifted]) -> bool:
    """Whether steps lead anywhere: where a flight diverges beyond all digits they don't."""
    return all(np.isfinite(part).all() for part in jax.tree.leaves(ends))


def _consistent(flight: FlightData, hyper: NoiseParameters, at: Lifted) -> bool:
    """Whether the disturbances belong to the process noise under these noise parameters, not to earlier ones."""
    apart = np.abs(at.error - disturbances(hyper.dynamics(flight), at.unknowns.process_noise))
    return bool(np.max(apart, initial=0.0) <= 1e-9 * (1.0 + np.max(np.abs(at.error), initial=0.0)))


def onward(
    flights: Sequence[FlightData], hyper: NoiseParameters, theta: Array, here: ConditionalOptimum, step: Array
) -> tuple[Lifted, ...]:
    """Flights after a step of the parameters (P,) from the conditional mode at theta (P,)."""
    ends = []
    for flight, at, solved in zip(flights, here.flights, here.onward, strict=True):
        ends.append(shortened(flight, at, led(flight, hyper, at, solved, step), 1.0, theta, step))
    return tuple(ends)
