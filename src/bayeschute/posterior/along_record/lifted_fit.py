"""Joint estimation of parameters and trajectory by lifted Newton with weak constraints (multiple shooting).

A simulation from prior means diverges from the record within a pendulum period, and a linearisation about it is useless
for finding the optimum. So the states of the flights are unknowns too, besides parameters, initial state and process
noise ("lifted" Newton, Albersmeyer & Diehl 2010; weak constraint, Bell 1994; multiple shooting with an interval per
sample, Bock 1983). They are initialised from the record and may violate the equations of motion by continuity defects,
whose allowed standard deviation (`slack`) is lowered level by level to zero. Along such a trajectory all steps are
linearised at once; one filter and smoother solves for trajectory, start and process noise as linear functions of the
parameters, and what remains is a damped least-squares problem in these.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.likelihood.joint import FlightData, Lifted, NoiseParameters, Unknowns
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior.along_record.conditional_mode import resting
from bayeschute.posterior.along_record.slack_level import LEVELS, NEAR, Level, Near, Point, Step, lowered, stepped
from bayeschute.posterior.quasi_newton import secant_step

Array = NDArray[np.float64]
_MOST, _MOST_HELD = 15, 40  # steps at a level, and where the path obeys the equations of motion
_FEW_DEFECTS, _SECANTS = 0.2, 6  # of the last level's slack, at which earlier slopes tell of the next step; how many
_NEARLY = 1.0  # gain in log density at which flights led here from elsewhere are near enough their conditional modes
_IDLE = 4  # steps that together gain next to nothing: however long the next would be, it leads nowhere
_FREE = 1e-2  # damping below which a step is as good as free
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-3, 1e-9, 1e8
_NEAR_LEVEL = Near(2.0, np.inf)  # end of a level with slack: what its optimum is does not matter


class Row(NamedTuple):
    """A step of the fit, for its log.

    Attributes:
        level: Slack over that of the flights' paths; 0: the path obeys the equations of motion.
        cost: Minus the log density along the path, defects aside.
        defect: Largest defect, over the slack of the last level.
        gain: By which the merit fell.
        step: Largest step of a parameter over its standard error.
        share: Of the step that was taken; 0: a return to an earlier place.
    """

    level: float
    cost: float
    defect: float
    gain: float
    step: float
    share: float

    def __str__(self) -> str:
        """The row as a line of the log."""
        return (
            f"slack {self.level:g}: cost {self.cost:.2f}, gain {self.gain:.3g}, defect {self.defect:.2g}, "
            f"step {self.step:.3f} standard errors{self._part}"
        )

    @property
    def _part(self) -> str:
        return (
            ", back to an earlier place" if self.share == 0.0 else f", {self.share:g} of the whole" * (self.share < 1.0)
        )


@dataclass(frozen=True)
class LiftedFit:
    """A fit along the record.

    Attributes:
        theta: Parameters (P,).
        flights: Start, process noise and trajectory of every flight.
        covariance: Of the parameters by the last linear problem (P, P).
        rows: The steps.
        converged: Whether the last level was done with, defects as good as none.
    """

    theta: Array
    flights: tuple[Lifted, ...]
    covariance: Array
    rows: tuple[Row, ...]
    converged: bool

    @property
    def unknowns(self) -> tuple[Unknowns, ...]:
        """Start and process noise of every flight."""
        return tuple(one.unknowns for one in self.flights)


def begin(flight: FlightData) -> Lifted:
    """A flight on the path that its record shows, undisturbed.

    Raises:
        ValueError: If the flight has no such path.
    """
    if flight.path is None:
        raise ValueError("a fit along the record wants a flight with the path of its record")
    error = np.zeros((flight.samples, flight.latent.rows))
    return Lifted(flight.still(), error, np.asarray(flight.path.states))


def _resettled(level: Level, here: Point) -> Point:
    """A place found under other noise parameters: its disturbances find theirs before parameters move."""
    there = stepped(level, here, level.relaxed(here).ends, np.zeros_like(here.theta), 1.0)
    return there if np.isfinite(there.merit) else here._replace(merit=np.inf)


class _Passed(NamedTuple):
    """A place that a fit has passed, the parameters' covariance there, and minus the marginal log density."""

    point: Point
    covariance: Array
    marginal: float

    def return_from(self, there: Point) -> Row:
        """The return from another place, for the log."""
        length = float(np.max(np.abs(there.theta - self.point.theta) / np.sqrt(np.diag(self.covariance))))
        return Row(0.0, self.point.cost, self.point.defect, there.merit - self.point.merit, length, 0.0)


def _descend(
    level: Level, here: Point, most: int, near: Near, say: Callable[[Row], None]
) -> tuple[Point, Array, list[Row], bool]:
    """Damped Gauss-Newton steps, shortened until the merit falls.

    Near the optimum of the cost the marginal density can be thousands of log units below that of places passed on the
    way: a flight whose disturbances grow by themselves follows any record. So it is watched, and where it has fallen by
    more than `near.fall` the place where it was greatest is returned to.

    Returns:
        Where they lead, the parameters' covariance there, the steps, and whether the last was short.
    """
    damping, rows, covariance = _FIRST_DAMPING, list[Row](), np.full((len(level.priors),) * 2, np.nan)
    greatest: _Passed | None = None
    bends: list[tuple[Array, Array]] = []
    last: tuple[Array, Array] | None = None
    while len(rows) < most:
        solved, matrix, gradient = level.solved(here)
        if not (np.isfinite(matrix).all() and np.isfinite(gradient).all()):
            return here, covariance, rows, False
        covariance = np.asarray(np.linalg.inv(matrix))
        if level.level == 0.0 and here.defect < near.defect:
            passed = _Passed(here, covariance, here.cost + sum(float(one.determinant) for one in solved))
            if greatest is None or passed.marginal < greatest.marginal:
                greatest = passed
            elif passed.marginal > greatest.marginal + near.fall:
                rows.append(greatest.return_from(here))
                say(rows[-1])
                return greatest.point, greatest.covariance, rows, True
        if level.level == 0.0 and here.defect < _FEW_DEFECTS:  # else the slope is that of another path
            if last is not None and not np.array_equal(here.theta, last[0]):
                bends = [*bends, (here.theta - last[0], gradient - last[1])][-_SECANTS:]
            last = here.theta, gradient
        else:
            bends, last = [], None
        found: Step | None = None
        while found is None and damping < _MOST_DAMPING:
            damped = matrix + damping * np.diag(np.diag(matrix))
            step = secant_step(gradient, np.asarray(np.linalg.inv(damped), np.float64), bends)
            found = lowered(level, here, level.moved(here, solved, step), step)
            if found is None:
                bends, last = [], None
                damping = max(10.0 * damping, _FIRST_DAMPING)
        if found is None:
            return here, covariance, rows, False
        before, here = here, found.point
        if found.share == 1.0:
            damping = max(damping / 10.0, _LEAST_DAMPING)
        length = float(np.max(np.abs(here.theta - before.theta) / np.sqrt(np.diag(covariance))))
        gain = before.merit - here.merit
        rows.append(Row(level.level, here.cost, here.defect, gain, length, found.share))
        say(rows[-1])
        # A step that damping made short says nothing of the optimum, nor does the part of one that was taken.
        whole = float(np.max(np.abs(step) / np.sqrt(np.diag(covariance)))) if damping < _FREE else np.inf
        idle = damping < _FREE and len(rows) >= _IDLE and sum(row.gain for row in rows[-_IDLE:]) < near.gain
        if gain < near.gain and (whole <= near.step or idle) and (level.level or here.defect < near.defect):
            return here, covariance, rows, True
    return here, covariance, rows, False


def descend(
    flights: Sequence[FlightData],
    hyper: NoiseParameters,
    priors: Sequence[Prior],
    theta: Array,
    at: Sequence[Lifted] | None = None,
    levels: Sequence[float] = (*LEVELS, 0.0),
    most: int = _MOST_HELD,
    near: Near = NEAR,
    progress: Callable[[Row], None] | None = None,
) -> LiftedFit:
    """Fit along the record, level by level.

    Args:
        flights: Records, with their paths.
        hyper: Noise parameters, fixed.
        priors: Priors of the parameters.
        theta: Where to begin (P,).
        at: Likewise, per flight; the record's path where None.
        levels: Slack over that of the paths, one after the other; 0: paths obey the equations of motion.
        most: Most steps where they do.
        near: When the last level is done with.
        progress: Called with every step.

    Returns:
        The fit; `converged` is that of the last level.
    """
    say, rows = progress or (lambda row: None), list[Row]()
    places = [begin(f) for f in flights] if at is None else list(at)
    covariance, converged = np.full((len(priors),) * 2, np.nan), False
    for number, level in enumerate(levels):
        problem = Level(flights, hyper, priors, level)
        here = problem.point(theta, places)
        if number == 0:
            here = problem.on_the_path(here) if at is None else _resettled(problem, here)
            if at is not None and np.isfinite(near.fall):  # what the cost falls by at rest hides what the density does
                here, _ = resting(problem, here, _NEARLY)
        last = level == levels[-1]
        bounds = near if last else _NEAR_LEVEL
        here, covariance, made, converged = _descend(problem, here, _MOST if level else most, bounds, say)
        theta, places = here.theta, list(here.flights)
        rows += made
    return LiftedFit(theta, tuple(places), covariance, tuple(rows), converged)
