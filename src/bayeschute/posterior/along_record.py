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

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from bayeschute.core.vectors import Component
from bayeschute.likelihood.disturbances import disturbances
from bayeschute.likelihood.joint import (
    FlightData,
    Lifted,
    Linear,
    NoiseParameters,
    Unknowns,
    as_seen,
    filter_gains,
    linearise,
    moved,
)
from bayeschute.likelihood.kalman import Gains, Seen, Smoothed, smooth_driven
from bayeschute.likelihood.noise import whiten
from bayeschute.likelihood.priors import Prior, precision, standard, working
from bayeschute.posterior.quasi_newton import secant_step

Array = NDArray[np.float64]
LEVELS = (3.0, 1.0, 0.3)  # times a path's slack, one after the other
_MOST, _MOST_HELD = 15, 40  # steps at a level, and where the path obeys the equations of motion
_FEW_DEFECTS, _SECANTS = 0.2, 6  # of that slack, at which earlier slopes tell of the next step; how many do
_PRICE = 3.0  # of a defect of the last level's slack, in log density; more than the process noise of the states ask for
_SHARES, _CLOSING = (1.0, 0.5, 0.2, 0.05), 5  # of steps; most that close the defects of one
_NONE = np.zeros(0)  # no step of parameters
_RESTING, _MOST_RESTING = 0.01, 12  # gain in log density at which a conditional optimum is reached; most steps to it
NEARLY = 1.0  # likewise where the linear problem about it is asked for its optimum: that is off by a hundredth
_MOST_ON_PATH = 6  # steps of the parameters before a path moves: where they begin far off the first is not the last
_ANDERSON = 4  # earlier steps that tell of the next one to it
_IDLE = 4  # steps that together gain next to nothing: however long the next would be, it leads nowhere
_FREE = 1e-2  # damping below which a step is as good as free
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-3, 1e-9, 1e8


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
_NEAR_LEVEL = Near(2.0, np.inf)  # end of a level with slack: what its optimum is does not matter


class Terms(NamedTuple):
    """Contribution of a flight to the merit function of a fit, and the size of its defects.

    Attributes:
        data: Half the sum of squares of innovations, start and process noise.
        squares: Half the squares of the defects over the slack.
        sizes: Sum of their sizes.
        largest: The largest of them.
    """

    data: jax.Array
    squares: jax.Array
    sizes: jax.Array
    largest: jax.Array


class Solved(NamedTuple):
    """The linear problem of a flight along a path, solved for all but the parameters.

    Attributes:
        gram: Products of the innovations of data and of the derivatives by parameters (1 + P, 1 + P).
        start: Standard start, and its derivatives by the parameters, sign turned (D, 1 + P).
        process_noise: Likewise of the process noise of the latent processes (T, L, 1 + P).
        states: Likewise of how far the path moves (T, X, 1 + P).
        determinant: Log determinant of the innovations.
    """

    gram: Component
    start: Component
    process_noise: Component
    states: Component
    determinant: Component


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
            f"step {self.step:.3f} standard errors, share {self.share:g}"
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
    error = jnp.zeros((flight.samples, flight.latent.rows))
    return Lifted(flight.still(), error, jnp.asarray(flight.path.states))


@jax.jit
def terms(flight: FlightData, hyper: NoiseParameters, slack: Component, at: Lifted, made: Linear) -> Terms:
    """Contribution of a flight to the merit function."""
    unit = whiten(hyper.outputs(flight), flight.dt, jnp.asarray(flight.present), made.residual)
    defect = made.defects / slack
    data = 0.5 * (jnp.sum(unit**2) + jnp.sum(at.unknowns.start**2) + jnp.sum(at.unknowns.process_noise**2))
    sizes = jnp.abs(defect)
    return Terms(data, 0.5 * jnp.sum(defect**2), jnp.sum(sizes), jnp.max(sizes))


def solve(flight: FlightData, hyper: NoiseParameters, slack: Component | None, made: Linear) -> tuple[Solved, Gains]:
    """Solve the linear problem of a flight for trajectory, start and process noise.

    Args:
        flight: The record.
        hyper: Noise parameters.
        slack: Standard deviations of the states' defects (X,); None: none are left.
        made: The flight linearised along a path.

    Returns:
        The solution, and the filter, which is as large as the linearised flight.
    """
    filtered = filter_gains(flight, hyper, made, slack)
    got = smooth_driven(filtered, as_seen(made))
    process_noise = got.process_noise[:, : flight.latent.size]
    flat = np.reshape(got.innovations, (-1, got.innovations.shape[2]))
    return Solved(flat.T @ flat, got.start, process_noise, got.states, filtered.log_determinant), filtered


@jax.jit
def led(flight: FlightData, hyper: NoiseParameters, at: Lifted, solved: Solved, step: jax.Array) -> Lifted:
    """Start, process noise and trajectory after a step of the parameters (P,) in the linear problem."""
    start, process_noise, away = (
        a[..., 0] - a[..., 1:] @ step for a in (solved.start, solved.process_noise, solved.states)
    )
    return Lifted(Unknowns(start, process_noise), disturbances(hyper.dynamics(flight), process_noise), at.path + away)


def closed(flight: FlightData, hyper: NoiseParameters, at: Lifted, made: Linear) -> Lifted:
    """A trajectory whose defects are closed in the linear problem, by the most probable change of the unknowns.

    The data are not used: repeated, it removes the defects as Newton's method does.

    Args:
        flight: The record.
        hyper: Noise parameters; the disturbances must be those of the process noise under them.
        at: The path.
        made: The flight linearised along it.
    """
    filtered = filter_gains(flight, hyper, made)
    got = smooth_driven(filtered, Seen(np.zeros((*np.shape(made.residual), 1)), made.defects[..., None]))
    return _beside(flight, hyper, at, got)


@jax.jit
def _beside(flight: FlightData, hyper: NoiseParameters, at: Lifted, got: Smoothed) -> Lifted:
    """Start, process noise and trajectory after a change that was smoothed."""
    process_noise = at.unknowns.process_noise + got.process_noise[..., 0]
    unknowns = Unknowns(at.unknowns.start + got.start[:, 0], process_noise)
    return Lifted(unknowns, disturbances(hyper.dynamics(flight), process_noise), at.path + got.states[..., 0])


@jax.jit
def shortened(flight: FlightData, at: Lifted, there: Lifted, share: float, theta: jax.Array, step: jax.Array) -> Lifted:
    """A fraction of a linear step of flight and parameters (P,)."""
    there = jax.tree.map(lambda a, b: a + share * (b - a), at, there)
    return there._replace(path=moved(flight, at.path, there.path - at.path, theta, share * step))


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
            cost += float(part.data)
            merit += float(part.data) + (float(part.squares) if self.level else _PRICE * float(part.sizes))
            defect = max(defect, float(part.largest) * unit / LEVELS[-1])
        merit = merit if np.isfinite(merit) else np.inf
        return Point(theta, tuple(flights), tuple(made), merit, cost, defect)

    def solved(self, here: Point) -> tuple[list[Solved], Array, Array]:
        """The flights' linear problems, and Gauss-Newton matrix (P, P) and gradient (P,) of the parameters."""
        matrix, found = precision(self.priors), list[Solved]()
        gradient = matrix @ (here.theta - working(self.priors)[0])
        for flight, at, made in zip(self.records, here.flights, here.along, strict=True):
            found.append(solve(flight, self.hyper, self._freedom(flight, at), made)[0])
            gram = np.asarray(found[-1].gram)
            matrix, gradient = matrix + gram[1:, 1:], gradient - gram[1:, 0]
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
                matrix = matrix + np.einsum("txp,txq->pq", by_theta, by_theta)
                gradient = gradient + np.einsum("txp,tx->p", by_theta, np.asarray(made.defects) / slack)
            if not (np.isfinite(matrix).all() and np.isfinite(gradient).all()):
                break
            there = self.point(here.theta - np.linalg.solve(matrix, gradient), here.flights)
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
    here, _ = resting(level, level.point(theta, at))
    return list(zip(here.flights, here.along, strict=True))


class LinearOptimum(NamedTuple):
    """A flight at the mode of the linear problem near its conditional mode, that problem, and its filter."""

    flight: Lifted
    linear: Linear
    gains: Gains


def approached(
    flights: Sequence[FlightData], hyper: NoiseParameters, theta: Array, at: Sequence[Lifted]
) -> list[LinearOptimum]:
    """Flights near their conditional modes for fixed parameters, where the linear problem's mode is as good as theirs.

    Half as many linearisations as `brought`. Minus the log density at that mode, half the squares of innovations of the
    linear problem and the log determinant, is off by a hundredth at most.
    """
    level = Level(flights, hyper, (), 0.0, by_theta=False)
    here, relaxed = resting(level, level.point(theta, at), NEARLY)
    five = zip(flights, here.flights, here.along, relaxed.ends, relaxed.filters, strict=True)
    held = np.zeros_like(theta)
    return [
        LinearOptimum(shortened(f, at, end, 1.0, theta, held), made.without_theta(), one)
        for f, at, made, end, one in five
    ]


def _resettled(level: Level, here: Point) -> Point:
    """A place found under other noise parameters: its disturbances find theirs before parameters move."""
    there = stepped(level, here, level.relaxed(here).ends, np.zeros_like(here.theta), 1.0)
    return there if np.isfinite(there.merit) else here._replace(merit=np.inf)


def resting(level: Level, here: Point, near: float = _RESTING) -> tuple[Point, Relaxed]:
    """Steps of trajectories, start and process noise for fixed parameters, until they would gain next to nothing.

    Gauss-Newton steps, accelerated by Anderson's method (1965): where residuals bend they are too long or too short
    along a few directions, which the change of the steps over earlier ones tells. Where canopies were not seen for a
    while plain steps go up to five times too far, and take 60 linearisations to where these take 7 to 14.

    Args:
        level: Objective.
        here: Where they begin.
        near: Gain in log density of the next step at which they end.

    Returns:
        Where they lead, and the linear problems solved there.
    """
    held, tried = np.zeros_like(here.theta), list[tuple[Sequence[Lifted], Sequence[Lifted]]]()
    if not all(_consistent(f, level.hyper, at) for f, at in zip(level.records, here.flights, strict=True)):
        here = stepped(level, here, level.relaxed(here).ends, held, 1.0)  # what it cost before says nothing
    for left in range(_MOST_RESTING, -1, -1):
        relaxed = level.relaxed(here)
        if relaxed.gain < near or not left:
            break
        tried = [*tried[-_ANDERSON:], (here.flights, relaxed.ends)]
        there = stepped_and_closed(level, here, _accelerated(tried), held, 1.0) if len(tried) > 1 else here
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


@jax.jit
def _apart(flight: FlightData, hyper: NoiseParameters, at: Lifted) -> jax.Array:
    return jnp.max(jnp.abs(at.error - disturbances(hyper.dynamics(flight), at.unknowns.process_noise)), initial=0.0)


def _consistent(flight: FlightData, hyper: NoiseParameters, at: Lifted) -> bool:
    """Whether the disturbances belong to the process noise under these noise parameters, not to earlier ones."""
    return bool(_apart(flight, hyper, at) <= 1e-9 * (1.0 + np.max(np.abs(at.error), initial=0.0)))


def onward(
    flights: Sequence[FlightData], hyper: NoiseParameters, theta: Array, here: ConditionalOptimum, step: Array
) -> tuple[Lifted, ...]:
    """Flights after a step of the parameters (P,) from the conditional mode at theta (P,)."""
    ends = []
    for flight, at, solved in zip(flights, here.flights, here.onward, strict=True):
        ends.append(shortened(flight, at, led(flight, hyper, at, solved, step), 1.0, theta, step))
    return tuple(ends)


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
                here, _ = resting(problem, here, NEARLY)
        last = level == levels[-1]
        bounds = near if last else _NEAR_LEVEL
        here, covariance, made, converged = _descend(problem, here, _MOST if level else most, bounds, say)
        theta, places = here.theta, list(here.flights)
        rows += made
    return LiftedFit(theta, tuple(places), covariance, tuple(rows), converged)
