"""A fit along the record: parameters and path found together, held to the data before they are held to the model.

A simulation from prior means leaves the record within a pendulum period, and what is linearised about it says nothing
of the optimum. So the states of the flights are unknowns too, beside parameters, start and shocks ("lifted" Newton,
Albersmeyer & Diehl 2010; weak constraint, Bell 1994; multiple shooting with an interval per sample, Bock 1983). They
begin at what the record shows and may break the equations of motion by defects whose standard deviations are lowered
level by level, to none in the end. Along such a path all steps are linearised at once; one filter and smoother solves
for path, start and shocks as linear functions of the parameters, and what is left is a damped least-squares problem in
these.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from bayeschute.air.vector import Component
from bayeschute.dynamics import integrate
from bayeschute.dynamics.integrate import Reached, Steps
from bayeschute.dynamics.kernel import flight as kernel
from bayeschute.inference.latent import disturbances
from bayeschute.inference.noise import whiten
from bayeschute.inference.priors import Prior, precision, standard, working
from bayeschute.inference.quasi_newton import secant_step
from bayeschute.inference.statespace import gains, innovations, response, smooth
from bayeschute.inference.target import Course, FlightData, Hyper, Linear, Unknowns, course, states

Array = NDArray[np.float64]
LEVELS = (3.0, 1.0, 0.3)  # times a path's slack, one after the other
_MOST, _MOST_HELD = 15, 40  # steps at a level, and where the path obeys the equations of motion
_FEW_DEFECTS, _SECANTS = 0.2, 6  # of that slack, at which earlier slopes tell of the next step; how many do
_FIRM = 0.1  # times the prior standard deviations at levels with slack: it is the path that is sought there
_PRICE = 3.0  # of a defect of the last level's slack, in log density; more than the shocks of the states ask for
_SHARES, _RESTING = (1.0, 0.5, 0.2, 0.05), 4  # of steps; most that bring a path to rest
_FREE = 1e-2  # damping below which a step is as good as free
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-3, 1e-9, 1e8


class Near(NamedTuple):
    """When a fit is done with: largest gain of the last step in log density, its length, and what defects are left.

    Attributes:
        gain: In log density.
        step: Of a parameter, in standard errors.
        defect: Of the last level's slack; less is as good as none, even in a flight that strays from there.
    """

    gain: float
    step: float
    defect: float = 1e-3


NEAR = Near(0.2, 0.3)


class Lifted(NamedTuple):
    """A flight's unknowns along its record.

    Attributes:
        unknowns: Standard start and shocks.
        error: Disturbances of these shocks (T, A); before the first step under other noise parameters, those that the
            shocks had under the ones before.
        path: States (T, X).
    """

    unknowns: Unknowns
    error: Component
    path: Component


class Along(NamedTuple):
    """A flight linearised along a path.

    Attributes:
        residual: Data less outputs on the path, zero where no datum exists (T, C).
        reached: The first state, and where every step leads.
        steps: Derivatives of the steps and outputs.
    """

    residual: Component
    reached: Reached
    steps: Steps


class Terms(NamedTuple):
    """What a flight adds to the merit of a fit, and how large its defects are.

    Attributes:
        data: Half the squares of innovations, start and shocks.
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
        drift: How far the path moves by its defects and by what drives it now (T, X).
        gram: Products of the innovations of data and of the derivatives by parameters (1 + P, 1 + P).
        start: Standard start, and its derivatives by the parameters, sign turned (D, 1 + P).
        shocks: Likewise of the shocks of the latent processes and of the states (T, L + X, 1 + P).
    """

    drift: jax.Array
    gram: jax.Array
    start: jax.Array
    shocks: jax.Array


class Row(NamedTuple):
    """A step of the fit, for its log.

    Attributes:
        level: Slack over that of the flights' paths; 0: the path obeys the equations of motion.
        cost: Minus the log density along the path, defects aside.
        defect: Largest defect, over the slack of the last level.
        gain: By which the merit fell.
        step: Largest step of a parameter over its standard error.
        share: Of the step that was taken.
        held: Whether it was one of path and disturbances alone.
    """

    level: float
    cost: float
    defect: float
    gain: float
    step: float
    share: float
    held: bool = False

    def __str__(self) -> str:
        """The row as a line of the log."""
        what = "parameters held" if self.held else f"step {self.step:.3f} standard errors"
        return (
            f"slack {self.level:g}: cost {self.cost:.2f}, gain {self.gain:.3g}, defect {self.defect:.2g}, "
            f"{what}, share {self.share:g}"
        )


@dataclass(frozen=True)
class LiftedFit:
    """A fit along the record.

    Attributes:
        theta: Parameters (P,).
        flights: Start, shocks and path of every flight.
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
        """Start and shocks of every flight."""
        return tuple(one.unknowns for one in self.flights)


_along_by_jax = jax.jit(integrate.along_path)


def begin(flight: FlightData) -> Lifted:
    """A flight on the path that its record shows, undisturbed.

    Raises:
        ValueError: If the flight has no such path.
    """
    if flight.path is None:
        raise ValueError("a fit along the record wants a flight with the path of its record")
    error = jnp.zeros((flight.samples, flight.latent.rows))
    return Lifted(flight.still(), error, jnp.asarray(flight.path.states))


def flown(flight: FlightData, hyper: Hyper, theta: Array, unknowns: Unknowns) -> Lifted | None:
    """A flight on the path of its own simulation; None where that is not finite."""
    driven = course(flight, hyper, unknowns)
    path = states(flight, jnp.asarray(theta), driven)
    return Lifted(unknowns, driven.error, path) if bool(jnp.isfinite(path).all()) else None


def along(flight: FlightData, theta: Array, at: Lifted) -> Along:
    """A flight linearised along a path, by machine code where `kernel.flight` has it."""
    start = flight.start_scale * at.unknowns.start
    made = kernel.along_path(flight.model, theta, start, at.error, at.path)
    if made is None:
        made = _along_by_jax(flight.model, jnp.asarray(theta), start, at.error, at.path)
    y, reached, steps = made
    return Along(jnp.where(flight.present, flight.observed - y, 0.0), reached, steps)


def linear(flight: FlightData, at: Lifted, made: Along) -> Linear:
    """The linearised flight as `target.linearise` makes it, of a path without defects."""
    return Linear(made.residual, Course(flight.start_scale * at.unknowns.start, at.error), made.steps)


@jax.jit
def terms(flight: FlightData, hyper: Hyper, slack: Component, at: Lifted, made: Along) -> Terms:
    """What a flight adds to the merit."""
    unit = whiten(hyper.outputs(flight), flight.dt, jnp.asarray(flight.present), made.residual)
    first, rest = at.path[0] - made.reached.first, at.path[1:] - made.reached.steps
    defect = jnp.concatenate([first[None], rest]) / slack
    data = 0.5 * (jnp.sum(unit**2) + jnp.sum(at.unknowns.start**2) + jnp.sum(at.unknowns.shocks**2))
    sizes = jnp.abs(defect)
    return Terms(data, 0.5 * jnp.sum(defect**2), jnp.sum(sizes), jnp.max(sizes))


@jax.jit
def solve(flight: FlightData, hyper: Hyper, slack: Component, at: Lifted, made: Along) -> Solved:
    """Solve the linear problem of a flight for path, start and shocks.

    Args:
        flight: The record.
        hyper: Noise parameters.
        slack: Standard deviations of the states' defects (X,); zeros: none are left.
        at: The path.
        made: The flight linearised along it.
    """
    steps, error, start = made.steps, at.error, flight.start_scale * at.unknowns.start

    def carry(drift: jax.Array, row: tuple) -> tuple[jax.Array, jax.Array]:
        a, defect, c0, c1, e0, e1 = row
        drift = a @ drift + defect - c0 @ e0 - c1 @ e1
        return drift, drift

    first = made.reached.first - at.path[0] - steps.first_start @ start
    defects = made.reached.steps - at.path[1:]
    rows = (steps.by_state, defects, steps.by_now, steps.by_then, error[:-1], error[1:])
    drift = jnp.concatenate([first[None], jax.lax.scan(carry, first, rows)[1]])
    here, count = jnp.asarray(flight.present), steps.first_theta.shape[1]
    seen = jnp.where(here, made.residual - jnp.einsum("tcx,tx->tc", steps.out_state, drift), 0.0)
    none = jnp.zeros((start.size, count)), jnp.zeros((*error.shape, count))
    wide = jnp.where(here[..., None], response(steps, *none, jnp.eye(count)), 0.0)
    series = jnp.concatenate([seen[..., None], wide], axis=2)
    law, noise = hyper.dynamics(flight), hyper.outputs(flight)
    filtered = gains(steps, flight.start_scale, law, noise, flight.dt, here, slack)
    unit = innovations(filtered, series).reshape(-1, 1 + count)
    return Solved(drift, unit.T @ unit, *smooth(filtered, series))


@jax.jit
def moved(
    flight: FlightData, hyper: Hyper, slack: Component, at: Lifted, made: Along, solved: Solved, step: jax.Array
) -> Lifted:
    """Where a step of the parameters (P,) takes start, shocks and path in the linear problem."""
    steps, size = made.steps, flight.latent.size
    start = solved.start[:, 0] - solved.start[:, 1:] @ step
    shocks = solved.shocks[..., 0] - solved.shocks[..., 1:] @ step
    of_states = shocks[:, size:] * slack
    error = disturbances(hyper.dynamics(flight), shocks[:, :size])

    def carry(x: jax.Array, row: tuple) -> tuple[jax.Array, jax.Array]:
        a, b, c0, c1, e0, e1, w = row
        x = a @ x + b @ step + c0 @ e0 + c1 @ e1 + w
        return x, x

    first = steps.first_start @ (flight.start_scale * start) + steps.first_theta @ step + of_states[0]
    rows = (steps.by_state, steps.by_theta, steps.by_now, steps.by_then, error[:-1], error[1:], of_states[1:])
    away = jnp.concatenate([first[None], jax.lax.scan(carry, first, rows)[1]])
    return Lifted(Unknowns(start, shocks[:, :size]), error, at.path + solved.drift + away)


@jax.jit
def shortened(flight: FlightData, at: Lifted, there: Lifted, share: float) -> Lifted:
    """A share of the way to where a linear step leads; a model that can `retract` keeps what is stiff in it."""
    there = jax.tree.map(lambda a, b: a + share * (b - a), at, there)
    model: Any = flight.model
    if not hasattr(model, "retract"):
        return there
    return there._replace(path=model.retract(at.path, there.path - at.path))


class _Point(NamedTuple):
    """A point of the fit: its flights linearised, and what it costs."""

    theta: Array
    flights: tuple[Lifted, ...]
    along: tuple[Along, ...]
    merit: float
    cost: float
    defect: float


@dataclass(frozen=True)
class _Level:
    """What is minimised at a level of slack; 0: the path is to obey, and its defects have a price."""

    records: Sequence[FlightData]
    hyper: Hyper
    priors: Sequence[Prior]
    level: float
    careful: bool = False

    def slack(self, flight: FlightData, least: float = 0.0) -> Array:
        assert flight.path is not None
        return np.asarray(max(self.level, least) * flight.path.slack)

    def point(self, theta: Array, flights: Sequence[Lifted]) -> _Point:
        """A point; its merit is infinite where a step or an output is not finite."""
        cost = merit = 0.5 * float(np.sum(standard(self.priors, theta) ** 2))
        made, defect = [], 0.0
        for flight, at in zip(self.records, flights, strict=True):
            made.append(along(flight, theta, at))
            part = terms(flight, self.hyper, self.slack(flight, LEVELS[-1]), at, made[-1])
            cost += float(part.data)
            merit += float(part.data) + (float(part.squares) if self.level else _PRICE * float(part.sizes))
            defect = max(defect, float(part.largest) * max(self.level, LEVELS[-1]) / LEVELS[-1])
        merit = merit if np.isfinite(merit) else np.inf
        return _Point(theta, tuple(flights), tuple(made), merit, cost, defect)

    def solved(self, here: _Point) -> tuple[list[Solved], Array, Array]:
        """The flights' linear problems, and Gauss-Newton matrix and gradient of the parameters."""
        matrix, found = precision(self.priors), list[Solved]()
        gradient = matrix @ (here.theta - working(self.priors)[0])
        for flight, at, made in zip(self.records, here.flights, here.along, strict=True):
            found.append(solve(flight, self.hyper, self.slack(flight), at, made))
            gram = np.asarray(found[-1].gram)
            matrix, gradient = matrix + gram[1:, 1:], gradient - gram[1:, 0]
        return found, matrix, gradient

    def moved(self, here: _Point, solved: Sequence[Solved], step: Array) -> list[Lifted]:
        """Flights at the end of a step of the parameters."""
        rows = zip(self.records, here.flights, here.along, solved, strict=True)
        return [moved(f, self.hyper, self.slack(f), at, made, one, step) for f, at, made, one in rows]


class _Step(NamedTuple):
    """Where a step leads, the share of it that was taken, and whether the parameters were held."""

    point: _Point
    share: float
    held: bool


def _tried(level: _Level, here: _Point, ends: Sequence[Lifted], step: Array, share: float) -> _Point:
    trio = zip(level.records, here.flights, ends, strict=True)
    return level.point(here.theta + share * step, [shortened(f, a, b, share) for f, a, b in trio])


def _rested(level: _Level, here: _Point, solved: Sequence[Solved], most: int) -> tuple[_Point, float]:
    """Path, start and disturbances brought nearer to rest, parameters held, and the share of the last step."""
    held, share = np.zeros_like(here.theta), 0.0
    for _ in range(most):
        ends, found = level.moved(here, solved, held), None
        for shares in ((1.0, 0.5), (0.2,)):  # whole steps may lead from side to side
            points = {share: _tried(level, here, ends, held, share) for share in shares}
            share = min(points, key=lambda s: points[s].merit)
            if points[share].merit < here.merit:
                found = points[share]
                break
        if found is None:
            break
        gain, here = here.merit - found.merit, found
        if gain < NEAR.gain:
            break
        solved = level.solved(here)[0]
    return here, share


def _lower(level: _Level, here: _Point, solved: Sequence[Solved], step: Array) -> _Step | None:
    """A step that lowers the merit.

    The whole one where it does, else a share of it. A careful fit takes half a step where that does better than the
    whole; where the path breaks the equations of motion, one of path and disturbances alone; and where it obeys them,
    it judges a share of the step after path and disturbances have come to rest: products of the parameters' change with
    that of the path make defects that the linear problem does not know.
    """
    there = level.moved(here, solved, step)
    whole = _tried(level, here, there, step, 1.0)
    careful = level.careful and level.level == 0.0
    if whole.merit < here.merit:
        half = _tried(level, here, there, step, 0.5) if careful else whole
        return _Step(whole, 1.0, False) if whole.merit <= half.merit else _Step(half, 0.5, False)
    if careful and here.defect > _FEW_DEFECTS:
        rest, share = _rested(level, here, solved, _RESTING)
        if rest.merit < here.merit:
            return _Step(rest, share, True)
    for share in _SHARES:
        point = whole if share == 1.0 else _tried(level, here, there, step, share)
        if careful and np.isfinite(point.merit) and point.merit > here.merit:
            point = _rested(level, point, level.solved(point)[0], _RESTING)[0]
        if point.merit < here.merit:
            return _Step(point, share, False)
    return None


def _descend(
    level: _Level, here: _Point, most: int, near: Near, say: Callable[[Row], None]
) -> tuple[_Point, Array, list[Row], bool]:
    """Damped Gauss-Newton steps, shortened until the merit falls.

    Returns:
        Where they lead, the parameters' covariance there, the steps, and whether the last was short.
    """
    damping, rows, covariance = _FIRST_DAMPING, list[Row](), np.full((len(level.priors),) * 2, np.nan)
    bends: list[tuple[Array, Array]] = []
    last: tuple[Array, Array] | None = None
    while len(rows) < most:
        solved, matrix, gradient = level.solved(here)
        if not (np.isfinite(matrix).all() and np.isfinite(gradient).all()):
            return here, covariance, rows, False
        covariance = np.asarray(np.linalg.inv(matrix))
        if level.level == 0.0 and here.defect < _FEW_DEFECTS:  # else the slope is that of another path
            if last is not None and not np.array_equal(here.theta, last[0]):
                bends = [*bends, (here.theta - last[0], gradient - last[1])][-_SECANTS:]
            last = here.theta, gradient
        else:
            bends, last = [], None
        found: _Step | None = None
        while found is None and damping < _MOST_DAMPING:
            damped = matrix + damping * np.diag(np.diag(matrix))
            step = secant_step(gradient, np.asarray(np.linalg.inv(damped), np.float64), bends)
            found = _lower(level, here, solved, step)
            if found is None:
                bends, last = [], None
                damping = max(10.0 * damping, _FIRST_DAMPING)
        if found is None:
            return here, covariance, rows, False
        before, here = here, found.point
        if found.share == 1.0 and not found.held:
            damping = max(damping / 10.0, _LEAST_DAMPING)
        length = float(np.max(np.abs(here.theta - before.theta) / np.sqrt(np.diag(covariance))))
        gain = before.merit - here.merit
        rows.append(Row(level.level, here.cost, here.defect, gain, length, found.share, found.held))
        say(rows[-1])
        # A step that damping made short says nothing of the optimum, nor does the part of one that was taken.
        whole = float(np.max(np.abs(step) / np.sqrt(np.diag(covariance)))) if damping < _FREE else np.inf
        near_enough = gain < near.gain and whole <= near.step and not found.held
        if near_enough and (level.level or here.defect < near.defect):
            return here, covariance, rows, True
    return here, covariance, rows, False


def descend(
    flights: Sequence[FlightData],
    hyper: Hyper,
    priors: Sequence[Prior],
    theta: Array,
    at: Sequence[Lifted] | None = None,
    levels: Sequence[float] = (*LEVELS, 0.0),
    most: int = _MOST_HELD,
    near: Near = NEAR,
    progress: Callable[[Row], None] | None = None,
    careful: bool = False,
) -> LiftedFit:
    """Fit along the record, level by level.

    Args:
        flights: Records, with their paths.
        hyper: Noise parameters, held.
        priors: Priors of the parameters.
        theta: Where to begin (P,).
        at: Likewise, per flight; the record's path where None.
        levels: Slack over that of the paths, one after the other; 0: paths obey the equations of motion.
        most: Most steps where they do.
        near: When the last level is done with.
        progress: Called with every step.
        careful: Whether parameters keep near their priors at levels with slack, and the path is brought to rest before
            a step is judged: slower, and it does where a plain fit gets stuck.

    Returns:
        The fit; `converged` is that of the last level.
    """
    say, rows = progress or (lambda row: None), list[Row]()
    places = [begin(f) for f in flights] if at is None else list(at)
    covariance, converged = np.full((len(priors),) * 2, np.nan), False
    firm = [replace(p, scale=_FIRM * p.scale) for p in priors]
    for level in levels:
        problem = _Level(flights, hyper, firm if level and careful else priors, level, careful)
        here = problem.point(theta, places)
        if at is not None and level == levels[0]:
            # Its disturbances may be those of other noise parameters: their shocks come with the first step.
            here = here._replace(merit=np.inf)
        last = level == levels[-1]
        bounds = near if last else NEAR
        here, covariance, made, converged = _descend(problem, here, _MOST if level else most, bounds, say)
        theta, places = here.theta, list(here.flights)
        rows += made
    return LiftedFit(theta, tuple(places), covariance, tuple(rows), converged)
