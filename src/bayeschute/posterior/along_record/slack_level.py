"""The objective at a level of slack: iterates of the fit, their merit, and steps that lower it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.likelihood.joint import FlightData, Lifted, Linear, NoiseParameters, linearise
from bayeschute.likelihood.kalman import Gains
from bayeschute.likelihood.priors import Prior, precision, standard, working
from bayeschute.posterior.along_record.linear_problem import Solved, closed, led, shortened, solve, terms

Array = NDArray[np.float64]
LEVELS = (3.0, 1.0, 0.3)  # times a path's slack, one after the other
_PRICE = 3.0  # of a defect of the last level's slack, in log density; more than the process noise of the states ask for
_SHARES, _CLOSING = (1.0, 0.5, 0.2, 0.05), 5  # of steps; most that close the defects of one
_NONE = np.zeros(0)  # no step of parameters
_MOST_ON_PATH = 6  # steps of the parameters before a path moves: where they begin far off the first is not the last


class Near(NamedTuple):
    """Stopping criteria of a fit: gain of the last step in log density, its length, and the remaining defects.

    Attributes:
        gain: In log density.
        step: Of a parameter, in standard errors.
        defect: Of the last level's slack; less is as good as none, even in a flight that strays from there.
        fall: Of the marginal log density below the greatest on the way, at which the fit returns there.
    """

    gain: float
    step: float
    defect: float = 1e-3
    fall: float = np.inf


NEAR = Near(0.2, 0.3)


class Relaxed(NamedTuple):
    """The linear problems at an iterate, solved for fixed parameters.

    Attributes:
        ends: Flights at their solutions.
        filters: Filters of the linearised flights.
        gain: By which the merit would fall on the way, were the problems linear.
    """

    ends: list[Lifted]
    filters: list[Gains]
    gain: float


class Point(NamedTuple):
    """An iterate of the fit: its linearised flights, and its cost.

    Attributes:
        theta: Parameters, working coordinates (P,).
        flights: Start, process noise and trajectory of every flight.
        along: The flights linearised along them.
        merit: What steps lower: the cost, and the squares or the price of the defects; infinite where not finite.
        cost: Minus the log density, defects aside, up to constants.
        defect: The largest, over the slack of the last level.
    """

    theta: Array
    flights: tuple[Lifted, ...]
    along: tuple[Linear, ...]
    merit: float
    cost: float
    defect: float


@dataclass(frozen=True)
class Level:
    """Objective at a level of slack; 0: the equations of motion hold, and defects are penalised.

    Attributes:
        records: Flights.
        hyper: Noise parameters.
        priors: Of the parameters.
        level: Of slack.
        by_theta: Whether derivatives by the parameters are wanted.
    """

    records: Sequence[FlightData]
    hyper: NoiseParameters
    priors: Sequence[Prior]
    level: float
    by_theta: bool = True

    def slack(self, flight: FlightData, at: Lifted, level: float | None = None) -> Array:
        """Standard deviations of a flight's defects (X,) at a level, this one where None; in units of the states."""
        if flight.path is None:  # as of a record that tells states to a hundredth of their size
            own = 1e-2 * np.sqrt(np.mean(np.asarray(at.path) ** 2, axis=0)) + 1e-9
        else:
            own = np.asarray(flight.path.slack)
        return (self.level if level is None else level) * own

    def _freedom(self, flight: FlightData, at: Lifted) -> Array | None:
        return self.slack(flight, at) if self.level else None

    def point(self, theta: Array, flights: Sequence[Lifted]) -> Point:
        """A point; its merit is infinite where a step or an output is not finite."""
        cost = merit = 0.5 * float(np.sum(standard(self.priors, theta) ** 2)) if self.priors else 0.0
        made, defect, unit = [], 0.0, self.level or LEVELS[-1]
        for flight, at in zip(self.records, flights, strict=True):
            made.append(linearise(flight, theta, at.latent_path(flight), self.by_theta))
            part = terms(flight, self.hyper, self.slack(flight, at, unit), at, made[-1])
            cost += part.data
            merit += part.data + (part.squares if self.level else _PRICE * part.sizes)
            defect = max(defect, part.largest * unit / LEVELS[-1])
        merit = merit if np.isfinite(merit) else np.inf
        return Point(theta, tuple(flights), tuple(made), merit, cost, defect)

    def solved(self, here: Point) -> tuple[list[Solved], Array, Array]:
        """The flights' linear problems, and Gauss-Newton matrix (P, P) and gradient (P,) of the parameters."""
        matrix, found = precision(self.priors), list[Solved]()
        gradient = matrix @ (here.theta - working(self.priors)[0])
        for flight, at, made in zip(self.records, here.flights, here.along, strict=True):
            found.append(solve(flight, self.hyper, self._freedom(flight, at), made)[0])
            gram, own = np.asarray(found[-1].gram), made.parameters
            matrix[np.ix_(own, own)] += gram[1:, 1:]
            gradient[own] -= gram[1:, 0]
        return found, matrix, gradient

    def relaxed(self, here: Point) -> Relaxed:
        """Trajectory, start and process noise that minimise the linear problem for fixed parameters."""
        trio, ends, filters = zip(self.records, here.flights, here.along, strict=True), list[Lifted](), list[Gains]()
        least = 0.5 * float(np.sum(standard(self.priors, here.theta) ** 2)) if self.priors else 0.0
        for flight, at, made in trio:
            solved, filtered = solve(flight, self.hyper, self._freedom(flight, at), made.without_theta())
            ends.append(led(flight, self.hyper, at, solved, _NONE))
            filters.append(filtered)
            least += 0.5 * float(solved.gram[0, 0])
        return Relaxed(ends, filters, here.merit - least)

    def on_the_path(self, here: Point) -> Point:
        """The parameters of least defects along the present path: equation error by Gauss-Newton, priors included."""
        for _ in range(_MOST_ON_PATH):
            matrix = precision(self.priors)
            gradient = matrix @ (here.theta - working(self.priors)[0])
            for flight, at, made in zip(self.records, here.flights, here.along, strict=True):
                slack = self.slack(flight, at, self.level or LEVELS[-1])
                by_theta = np.concatenate([made.steps.first_theta[None], made.steps.by_theta]) / slack[:, None]
                matrix[np.ix_(made.parameters, made.parameters)] += np.einsum("txp,txq->pq", by_theta, by_theta)
                gradient[made.parameters] += np.einsum("txp,tx->p", by_theta, np.asarray(made.defects) / slack)
            if not (np.isfinite(matrix).all() and np.isfinite(gradient).all()):
                break
            try:
                step = np.linalg.solve(matrix, gradient)
            except np.linalg.LinAlgError:  # one step diverges: beside its sensitivities no other has digits left
                break
            there = self.point(here.theta - step, here.flights)
            if not there.merit < here.merit:
                break
            gain, here = here.merit - there.merit, there
            if gain < NEAR.gain:
                break
        return here

    def closed(self, here: Point) -> Point:
        """The iterate without the defects of the linear problem, for fixed parameters."""
        trio = zip(self.records, here.flights, here.along, strict=True)
        ends = [closed(flight, self.hyper, at, made) for flight, at, made in trio]
        return stepped(self, here, ends, np.zeros_like(here.theta), 1.0)

    def moved(self, here: Point, solved: Sequence[Solved], step: Array) -> list[Lifted]:
        """Flights at the end of a step of the parameters."""
        trio = zip(self.records, here.flights, solved, strict=True)
        return [led(f, self.hyper, at, one, step) for f, at, one in trio]


class Step(NamedTuple):
    """Where a step leads, and the share of it that was taken."""

    point: Point
    share: float


def stepped(level: Level, here: Point, ends: Sequence[Lifted], step: Array, share: float) -> Point:
    """Where a share of a step leads.

    Args:
        level: Objective.
        here: Where it begins.
        ends: Flights at the end of the whole step.
        step: Of the parameters (P,).
        share: Of the step.
    """
    trio, theta = zip(level.records, here.flights, ends, strict=True), here.theta
    return level.point(theta + share * step, [shortened(f, a, b, share, theta, step) for f, a, b in trio])


def stepped_and_closed(level: Level, here: Point, ends: Sequence[Lifted], step: Array, share: float) -> Point:
    """A share of a step; where the path obeys the equations of motion, with its defects closed if they make it dear.

    Products of the parameters' change with that of the path make defects that the linear problem does not know, and
    their price would hold every step back (Maratos 1978).
    """
    point = stepped(level, here, ends, step, share)
    if level.level == 0.0 and here.merit < point.merit < np.inf:
        point = _closed(level, point, here.merit)
    return point


def _closed(level: Level, here: Point, bound: float) -> Point:
    """An iterate whose defects are closed for fixed parameters, until its merit is below a bound and decreases no more.

    Given up where it won't come below at the pace of the last step.
    """
    for left in range(_CLOSING, 0, -1):
        there = level.closed(here)
        if not there.merit < here.merit:
            break
        gain, here = here.merit - there.merit, there
        if gain < NEAR.gain or gain * (left - 1) < here.merit - bound:
            break
    return here


def lowered(level: Level, here: Point, there: Sequence[Lifted], step: Array) -> Step | None:
    """The whole step where it lowers the merit, else a share of it; None where no share does.

    Args:
        level: Objective.
        here: Where the step begins.
        there: Flights at its end.
        step: Of the parameters (P,).
    """
    for share in _SHARES:
        point = stepped_and_closed(level, here, there, step, share)
        if point.merit < here.merit:
            return Step(point, share)
    return None
