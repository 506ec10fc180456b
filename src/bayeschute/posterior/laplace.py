"""Laplace's approximation of the marginal density at any point, and corrections of the linearised marginal with it.

`posterior.marginal` integrates start and disturbances out with derivatives taken at theta_0, at the cost of one
evaluation of every step. Here a flight is brought to its conditional mode at another theta and linearised there, which
costs hundreds of times as much: the sum of squared innovations and the log determinant are those at theta itself.
Because the residuals are noise and not small, the conditional mode is a curved function of theta where the derivatives
change with theta (residual-curvature term); without it the marginal density is too narrow, by a fifth and more for
parameters that determine the response to gusts. And the squares are weighed by covariances that change with theta: on
average the curvatures of this and of the log determinant add up to the Fisher information in the covariances
(`linear_errors`), and the second alone is negative. Both are evaluated on either side along every axis and at corners
between them, and two quadratic polynomials correct the linearised marginal: one for the squares, one for the log
determinant. A flight is looked at only where its own coordinates differ (`Marginal.felt`), so that of many flights with
constant errors of their own none is looked at along the axes of another's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from bayeschute.core.numerics import processors
from bayeschute.core.vectors import Component
from bayeschute.likelihood import mean_correction
from bayeschute.likelihood.joint import (
    FlightData,
    Lifted,
    Linear,
    NoiseParameters,
    as_seen,
    moved,
)
from bayeschute.likelihood.kalman import Gains, MeanCorrection, innovations
from bayeschute.posterior.along_record.conditional_mode import MOST_CLOSE, LinearOptimum, approached
from bayeschute.posterior.differences import beside
from bayeschute.posterior.felt_axes import apart, groups
from bayeschute.posterior.marginal import (
    Linearisation,
    Marginal,
    Quadratic,
    flight_half_squares,
    in_batches,
    in_range,
    place_at,
    prior_lines,
    prior_residuals,
    shifted,
)

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]
"""Called with the points that are done and wanted."""
FARTHEST = 3.0  # standard deviations that a step to the mode may be long
_FLATTEST = 0.2  # curvature of a Gaussian density in standard coordinates is one; the least that is left along an axis
_CORNER_STEPS = 2  # to the conditional mode at a corner
_SLOPE_STEPS = 0  # to that a little aside, for slopes (see `linear_errors`)
_JUMP = 1e4  # information by covariances along an axis, in standard coordinates, that no difference can mean
_LOOKS = 3  # most axes on which a curvature less than that is measured


class Laplace(NamedTuple):
    """The marginal log density at a point by Laplace's approximation there.

    Attributes:
        prior: Half the squares of theta under its prior.
        squares: Half the squares of innovations, by flight (F,).
        determinants: Log determinants, by flight (F,).
        flights: Conditional optima.
        means: The mean corrections there, by flight.
        roots: Factors of the innovations' covariances by sample (N, D, D), by flight.
    """

    prior: float
    squares: Array
    determinants: Array
    flights: tuple[Lifted, ...]
    means: tuple[MeanCorrection, ...]
    roots: tuple[Array, ...]

    def bare(self) -> Laplace:
        """Without flights, mean corrections and factors: the factors are many times as large as the record."""
        return self._replace(flights=(), means=(), roots=())

    @property
    def square(self) -> float:
        """Half the squares of innovations and of theta under its prior."""
        return self.prior + float(np.sum(self.squares))

    @property
    def determinant(self) -> float:
        """Log determinant of all flights."""
        return float(np.sum(self.determinants))


def _squares(made: Gains, linear: Linear, mean_correction: MeanCorrection) -> float:
    """Half the squares of innovations."""
    unit = innovations(made, *as_seen(linear).less(mean_correction))
    return 0.5 * float(np.sum(np.asarray(unit) ** 2))


def _mean_correction(
    flight: FlightData,
    hyper: NoiseParameters,
    along: Linearisation,
    theta: jax.Array,
    one: LinearOptimum,
) -> MeanCorrection:
    """The mean correction at another theta; its change is estimated from few pairs. Not finite where these fail."""
    try:
        few, _ = mean_correction.mean(flight, hyper, one.gains, theta, one.linear, rough=True)
    except FloatingPointError:
        return jax.tree.map(lambda a: np.full(np.shape(a), np.nan), along.mean_correction)
    return MeanCorrection(*(a + b - c for a, b, c in zip(along.mean_correction, few, along.rough, strict=True)))


def _place(flight: FlightData, along: Linearisation, shift: jax.Array) -> Lifted:
    """Where a flight's conditional optimum is by its slopes, which `corrected` takes from optima on either side."""
    followed = jax.tree.map(lambda a, b: np.asarray(a) + np.asarray(b), along.slope, along.aside)
    return place_at(flight, along._replace(slope=followed), shift)


def at(
    marginal: Marginal,
    xi: Array,
    most: int = MOST_CLOSE,
    here: Laplace | None = None,
) -> Laplace:
    """Laplace's approximation at standard coordinates (P,); not finite where a step fails.

    Args:
        marginal: The posterior.
        xi: Standard coordinates (P,).
        most: Most steps to the conditional mode there.
        here: At theta_0, for flights that the coordinates do not move; None: all are looked at.
    """
    theta, shift = shifted(marginal, xi)
    moved = range(len(marginal.flights)) if here is None else np.flatnonzero(marginal.felt @ (xi != 0.0))
    pairs = {int(k): (marginal.flights[k], marginal.along[k]) for k in moved}
    places = [_place(*pair, shift) for pair in pairs.values()]
    records = [flight for flight, _ in pairs.values()]
    found = approached(records, marginal.hyper, np.asarray(theta), places, most) if pairs else []
    means = [
        _mean_correction(flight, marginal.hyper, along, theta, one)
        for (flight, along), one in zip(pairs.values(), found, strict=True)
    ]
    return _told(marginal, np.asarray(theta), dict(zip(pairs, zip(found, means, strict=True), strict=True)), here)


def _told(
    marginal: Marginal, theta: Array, found: Mapping[int, tuple[LinearOptimum, MeanCorrection]], rest: Laplace | None
) -> Laplace:
    """Laplace's approximation at parameters (P,), of flights near their conditional modes and the mean corrections.

    Args:
        marginal: The posterior.
        theta: Parameters (P,).
        found: By number of the flight.
        rest: For all other flights.
    """
    away = np.linalg.solve(np.asarray(marginal.prior_factor), theta - np.asarray(marginal.prior_centre))
    none = [None] * len(marginal.flights)
    squares, determinants = (np.zeros(len(none)), np.zeros(len(none))) if rest is None else map(np.array, rest[1:3])
    flights, means, roots = (list[Any](part) for part in ((none,) * 3 if rest is None else rest[3:]))
    for k, (one, mean) in found.items():
        squares[k], determinants[k] = _squares(one.gains, one.linear, mean), float(one.gains.log_determinant)
        flights[k], means[k], roots[k] = one.flight, mean, np.asarray(one.gains.root)
    return Laplace(0.5 * float(away @ away), squares, determinants, tuple(flights), tuple(means), tuple(roots))


def at_corner(
    marginal: Marginal, here: Laplace, one: Laplace, other: Laplace, xi: Array, both: NDArray[np.bool_]
) -> Laplace:
    """Laplace's approximation at standard coordinates (P,) to which two steps lead, from that at their ends.

    Their changes of the conditional modes add up to a place so near the mode that two steps bring a flight there, and
    their changes of the mean correction, which off the mode is known to first order only, add up as well. On a flight
    in a limit cycle (set T) products of axes are within 0.03 of those with flights at rest to 1e-5 everywhere, as with
    flights brought to rest at corners; on other flights standard deviations are the same within 0.7 %.

    Args:
        marginal: The posterior.
        here: At theta_0.
        one: After the first step.
        other: After the second.
        xi: Standard coordinates (P,).
        both: Whether both steps move a flight (F,): of all others the changes add up.

    Returns:
        Without flights, mean corrections and factors: there are many corners.
    """
    theta, change = shifted(marginal, xi)
    numbers = np.flatnonzero(both).tolist()
    records = [marginal.flights[k] for k in numbers]
    four = ((marginal.flights[k], here.flights[k], one.flights[k], other.flights[k]) for k in numbers)
    places = [_beyond(flight, a, b, c, marginal.centre, change) for flight, a, b, c in four]
    found = approached(records, marginal.hyper, np.asarray(theta), places, _CORNER_STEPS)
    trio = ((here.means[k], one.means[k], other.means[k]) for k in numbers)
    means = [jax.tree.map(lambda a, b, c: b + c - a, *three) for three in trio]
    squares = one.squares + other.squares - here.squares
    rest = here._replace(squares=squares, determinants=one.determinants + other.determinants - here.determinants)
    made = _told(marginal, np.asarray(theta), dict(zip(numbers, zip(found, means, strict=True), strict=True)), rest)
    return made.bare()


def _at_each(
    at_one: Callable[..., Laplace], *given: Sequence[Any] | NDArray[Any], progress: Progress | None = None
) -> list[Laplace]:
    """Laplace's approximation at every point, in as many threads as there are processors."""
    made = list[Laplace]()
    with ThreadPoolExecutor(processors()) as pool:
        for one in pool.map(at_one, *given):
            made.append(one)
            if progress is not None:
                progress(len(made), len(given[0]))
    return made


def _more(here: Laplace, there: Sequence[Laplace]) -> Array:
    """Half the squares and log determinants (N, 2) less those at theta_0."""
    return np.array([[one.square - here.square, one.determinant - here.determinant] for one in there])


def _own(marginal: Marginal, points: Array, which: NDArray[np.bool_]) -> Array:
    """Half the squares of the linear models (N, F) at points (N, P), less those at theta_0: zero of all but `which`."""
    made = np.zeros(which.shape)
    for number, rows in enumerate(which.T):
        if rows.any():
            places = np.vstack([0.0 * points[:1], points[rows]])
            squares, _ = in_batches(partial(flight_half_squares, marginal, number), places.T)
            made[rows, number] = squares[1:] - squares[0]
    return made


def _beyond_linear(
    marginal: Marginal, here: Laplace, points: Array, there: Sequence[Laplace], which: NDArray[np.bool_]
) -> Array:
    """What squares are more than the linear models', and the log determinant, at points (N, P), less here (N, F, 2).

    Zero of all flights but `which` (N, F).
    """
    squares, determinants = ([getattr(one, name) for one in there] for name in ("squares", "determinants"))
    more = np.stack([np.array(squares) - here.squares, np.array(determinants) - here.determinants], axis=2)
    more[:, :, 0] -= _own(marginal, points, which)
    return np.where(which[:, :, None], more, 0.0)


class Expansion(NamedTuple):
    """Minus the log density about theta_0 as a quadratic polynomial, standard coordinates.

    Attributes:
        slope: (P,).
        curvature: (P, P).
    """

    slope: Array
    curvature: Array

    @property
    def has_mode(self) -> bool:
        """Whether the polynomial has a least value."""
        return bool(np.linalg.eigvalsh(self.curvature)[0] > 0.0)

    def change(self, step: Array) -> float:
        """Over a step (P,)."""
        return float(self.slope @ step + 0.5 * step @ self.curvature @ step)

    def step(self, radius: float = FARTHEST) -> Array:
        """From the centre to its least value within a sphere (P,)."""
        return least_within(self.slope, self.curvature, radius)


class LinearErrors(NamedTuple):
    """What linear models leave out of the marginal log density at theta_0, in standard coordinates.

    Attributes:
        slope: Of minus the log density (P,).
        information: Fisher information that the data have on the parameters through the covariances of the innovations
            alone, ``1/2 tr(S^-1 dS_i S^-1 dS_j)`` summed over samples (P, P) (Harvey 1989, section 3.4.5). It is what
            the curvature of the log determinant and of the squares by their covariances is on average.
    """

    slope: Array
    information: Array


def linear_errors(marginal: Marginal, step: float = 0.4) -> LinearErrors:
    """Gradient of the correction to the linear models, and the information in covariances, by one-sided differences.

    Flights stay where their slopes lead, a linear problem away from their conditional modes: at rest slopes are within
    0.03 of those, which by differences to the other side are 0.05 off (root mean squares over parameters, set S).

    Where a flight near the optimum fails, the difference is taken to the other side; likewise where the covariances
    jump: where a riser goes slack on one of the two paths alone, their difference is no derivative.

    Raises:
        FloatingPointError: If flights fail, or covariances jump, to both sides.
    """
    felt, size = marginal.felt, np.size(marginal.centre)
    slope, rank = np.zeros(size), np.cumsum(felt, axis=1) - 1
    changes = [np.zeros((sum(row), np.size(one.gains.root))) for row, one in zip(felt, marginal.along, strict=True)]

    def look(axes: NDArray[np.intp], by: float) -> None:
        points = by * np.eye(size)[axes]
        here = at(marginal, np.zeros(size), most=_SLOPE_STEPS)
        inverse = [np.linalg.inv(root) for root in here.roots]

        def end(axis: int, point: Array) -> Laplace:
            one = at(marginal, point, most=_SLOPE_STEPS, here=here)
            for k in np.flatnonzero(felt[:, axis]):
                unit = inverse[k] @ one.roots[k]
                changes[k][rank[k, axis]] = (unit @ np.swapaxes(unit, 1, 2) - np.eye(unit.shape[1])).ravel() / by
            return one.bare()

        there = _at_each(end, axes, points)
        slope[axes] = _beyond_linear(marginal, here, points, there, felt.T[axes]).sum(axis=(1, 2)) / by

    def information() -> Array:
        made = np.zeros((size, size))
        for row, change in zip(felt, changes, strict=True):
            made[np.ix_(row, row)] += 0.5 * change @ change.T
        return made

    look(np.arange(size), step)
    told = information()
    lost = ~np.isfinite(slope) | _jump(told)
    if lost.any():
        look(np.flatnonzero(lost), -step)
        told = information()
    if not np.isfinite(slope).all():
        raise FloatingPointError("flights to both sides of the optimum fail: the log density has no slope there")
    if _jump(told).any():
        raise FloatingPointError(
            "covariances of the innovations jump to both sides: a riser goes slack in some of the flights alone"
        )
    return LinearErrors(slope, told)


def _jump(information: Array) -> NDArray[np.bool_]:
    """Whether relative changes of covariances along an axis (P,) are none of a smooth function, by their squares."""
    return np.asarray(np.diag(information) > _JUMP)


class Sides(NamedTuple):
    """Laplace's approximation at theta_0, and a step to either side along every axis.

    Attributes:
        here: At theta_0.
        up: To one side (P entries).
        down: To the other.
        steps: How far (P,).
    """

    here: Laplace
    up: Sequence[Laplace]
    down: Sequence[Laplace]
    steps: Array


def sides(marginal: Marginal, step: float = 1.0, progress: Progress | None = None) -> Sides:
    """Laplace's approximation beside theta_0.

    Along an axis on which a flight fails there, a half, a quarter or an eighth as far.

    Args:
        marginal: The posterior.
        step: How far to look [standard deviations].
        progress: See `Progress`.

    Raises:
        FloatingPointError: If a flight fails at an eighth of the step too.
    """
    count, ends = np.size(marginal.centre), dict[tuple[float, ...], Laplace]()
    here = at(marginal, np.zeros(count))

    def end(point: Array) -> Laplace:
        return at(marginal, point, here=here)._replace(roots=())

    def told(points: Array) -> Array:
        found = _at_each(end, points, progress=progress)
        ends.update(zip(map(tuple, points.tolist()), found, strict=True))
        return np.array([[one.square, one.determinant] for one in found])

    *_, h = beside(told, count, step, "the marginal log density")
    up, down = ([ends[tuple(row.tolist())] for row in sign * h * np.eye(count)] for sign in (1.0, -1.0))
    return Sides(here, up, down, h[:, 0])


def expanded(marginal: Marginal, near: Sides) -> Expansion:
    """Minus the log density about theta_0, whose products of axes are the linear models' own.

    What `corrected` costs more are the corners, one for each pair of axes, against two points for each axis here. It
    shows the way where the mode is far off.

    Args:
        marginal: The posterior.
        near: From `sides`.
    """
    slope, own = _expansion(marginal, near.steps)
    up, down = (change.sum(axis=(1, 2)) for change in _changes(marginal, near))
    bend = np.diag((up + down) / near.steps**2)
    return Expansion(slope + (up - down) / (2.0 * near.steps), own + bend)


def corrected(
    marginal: Marginal, step: float = 1.0, near: Sides | None = None, progress: Progress | None = None
) -> tuple[Marginal, Expansion]:
    """The posterior with corrections of its linear models, from Laplace's approximation to both sides along every axis.

    Starts, process noise and paths then follow theta as the exact optima do. The polynomials have the products of all
    axes: along a direction in which the data tell of the parameters by the covariances of the innovations alone, the
    density would be flat without them. A product at both corners of which a flight fails is left out (`error` tells
    what is missing). An axis along which all that leaves next to no curvature is looked at itself, on either side: it
    adds up from small differences.

    Args:
        marginal: The posterior.
        step: How far to look [standard deviations].
        near: From `sides`; found here where None.
        progress: Of the products of axes, see `Progress`.

    Returns:
        The posterior, and its expansion about the centre, which tells where the mode is.

    Raises:
        FloatingPointError: If a flight fails at an eighth of the step too.
    """
    near = sides(marginal, step) if near is None else near
    bend, determinant = _polynomials(marginal, near, progress)
    made = replace(_followed(marginal, near), determinant=determinant, bend=bend)
    return _measured(made, expansion(made, near.steps), near.here, float(np.min(near.steps)))


def expansion(marginal: Marginal, steps: Array | None = None) -> Expansion:
    """Minus the log density about the centre, with the corrections.

    Args:
        marginal: From `corrected`.
        steps: How far to look along every axis for the curvature of the linear models (P,); one where None.
    """
    slope, own = _expansion(marginal, np.ones(np.size(marginal.centre)) if steps is None else steps)
    return Expansion(slope + np.asarray(marginal.correction.slope), own + np.asarray(marginal.correction.curvature))


def _measured(made: Marginal, expansion: Expansion, here: Laplace, step: float) -> tuple[Marginal, Expansion]:
    """Slope and curvature along the flattest axes by Laplace's approximation on either side, the rest being kept."""
    for _ in range(_LOOKS):
        values, axes = np.linalg.eigh(expansion.curvature)
        axis = axes[:, 0]
        if values[0] >= _FLATTEST:
            break
        up, down = _more(here, [at(made, step * axis), at(made, -step * axis)]).sum(axis=1)
        found = float(up + down) / step**2
        if not np.isfinite(found):
            break
        slope = ((up - down) / (2.0 * step) - expansion.slope @ axis) * axis
        curvature = (found - values[0]) * np.outer(axis, axis)
        expansion = Expansion(expansion.slope + slope, expansion.curvature + curvature)
        made = replace(made, bend=Quadratic(made.bend.slope + slope, made.bend.curvature + curvature))
        if found < _FLATTEST:  # it is as flat as it seemed
            break
    return made, expansion


def flattened(made: Marginal, expansion: Expansion) -> tuple[Marginal, Expansion]:
    """A posterior whose density has no mode, with as much less of the correction's curvature as it takes to have one.

    Along axes on which the corrections leave less than a fifth of the curvature of a Gaussian density, that is left.

    Args:
        made: From `corrected`.
        expansion: Likewise.
    """
    values, axes = np.linalg.eigh(expansion.curvature)
    more = np.asarray((axes * (np.maximum(values, _FLATTEST) - values)) @ axes.T)
    bend = Quadratic(made.bend.slope, np.asarray(made.bend.curvature) + more)
    return replace(made, bend=bend), expansion._replace(curvature=expansion.curvature + more)


def least_within(slope: Array, curvature: Array, radius: float = FARTHEST) -> Array:
    """Where a quadratic polynomial is least within a sphere about the centre (Moré and Sorensen 1983).

    Args:
        slope: At the centre (P,).
        curvature: (P, P).
        radius: Of the sphere.
    """
    values, axes = np.linalg.eigh(curvature)
    along = axes.T @ slope

    def step(shift: float) -> Array:
        return np.asarray(-along / (values + shift))

    if values[0] > 0.0 and np.linalg.norm(step(0.0)) <= radius:
        return np.asarray(axes @ step(0.0))
    least = max(0.0, -values[0]) + 1e-9 * (1.0 + abs(values[0]))
    made = step(least)
    if (short := float(np.linalg.norm(made))) > radius:
        most = least + float(np.linalg.norm(along)) / radius
        made = step(brentq(lambda shift: float(np.linalg.norm(step(shift))) - radius, least, most))
    else:  # no slope along the axis on which it falls: to either side alike
        made[0] += np.copysign(np.sqrt(radius**2 - short**2), made[0])
    return np.asarray(axes @ made)


def _changes(marginal: Marginal, near: Sides) -> tuple[Array, Array]:
    """`_beyond_linear` to both sides along every axis (P, F, 2)."""
    axes, which = np.diag(near.steps), marginal.felt.T
    up = _beyond_linear(marginal, near.here, axes, near.up, which)
    return up, _beyond_linear(marginal, near.here, -axes, near.down, which)


def _polynomials(marginal: Marginal, near: Sides, progress: Progress | None = None) -> tuple[Quadratic, Quadratic]:
    """What squares are more than the linear models', and the log determinant: along every axis, and at corners.

    Two axes have a product if they move the same flight; of each flight that both move it is looked at.
    """
    here, h, axes = near.here, near.steps, np.diag(near.steps)
    up, down = _changes(marginal, near)
    curvature = np.array([np.diag(column) for column in ((up + down).sum(axis=1) / h[:, None] ** 2).T])
    left = np.array(np.triu_indices(len(h), 1)).T
    both = np.all(marginal.felt.T[left], axis=1)
    shared = np.any(both, axis=1)
    left, both = left[shared], both[shared]
    for change, ends, sign in ((up, near.up, 1.0), (down, near.down, -1.0)):
        if not left.size:
            break
        i, j = left.T
        points = sign * (axes[i] + axes[j])

        def corner(point: Array, pair: Array, moved: NDArray[np.bool_], ends: Sequence[Laplace] = ends) -> Laplace:
            return at_corner(marginal, here, ends[pair[0]], ends[pair[1]], point, moved)

        there = _at_each(corner, points, left, both, progress=progress)
        mixed = _beyond_linear(marginal, here, points, there, both) - change[i] - change[j]
        mixed = np.sum(mixed, axis=1, where=both[:, :, None]) / (h[i] * h[j])[:, None]
        known = np.isfinite(mixed).all(axis=1)
        curvature[:, i[known], j[known]] = curvature[:, j[known], i[known]] = mixed[known].T
        left, both = left[~known], both[~known]
    slope = ((up - down).sum(axis=1) / (2.0 * h[:, None])).T
    return Quadratic(slope[0], curvature[0]), Quadratic(slope[1], curvature[1])


def _beyond(
    flight: FlightData, here: Lifted, one: Lifted, other: Lifted, theta: Component, change: Component
) -> Lifted:
    """Where two steps lead together, from theta (P,) with a change (P,)."""
    here, one, other = jax.tree.map(np.asarray, (here, one, other))
    both = jax.tree.map(lambda a, b, c: b + c - a, here, one, other)
    return both._replace(path=moved(flight, here.path, both.path - here.path, theta, change))


def _expansion(marginal: Marginal, h: Array) -> tuple[Array, Array]:
    """Slope and curvature of minus the log density of the linear models at theta_0, without flights that fail there."""
    here, *along = prior_lines(marginal).T
    slope, curvature = np.array(along) @ here, np.array(along) @ np.array(along).T
    for number, row in enumerate(marginal.felt):
        axes = np.flatnonzero(row)
        steps, (i, j) = h[axes], np.triu_indices(len(axes), 1)
        sides = np.diag(h)[axes]
        points = np.concatenate([sides, -sides, sides[i] + sides[j], -sides[i] - sides[j]])
        which = np.zeros((len(points), len(marginal.felt)), bool)
        which[:, number] = True
        value = _own(marginal, points, which)[:, number]
        up, down, first, second = np.split(value, np.cumsum([len(axes), len(axes), len(i)]))
        made = np.diag((up + down) / steps**2)
        made[i, j] = made[j, i] = (first + second - up[i] - up[j] - down[i] - down[j]) / (2.0 * steps[i] * steps[j])
        slope[axes] += np.nan_to_num((up - down) / (2.0 * steps), nan=0.0)
        curvature[np.ix_(axes, axes)] += np.nan_to_num(made, nan=0.0)
    return np.asarray(slope), np.asarray(curvature)


def _followed(marginal: Marginal, near: Sides) -> Marginal:
    """The posterior whose draws follow theta as conditional optima on either side along every axis do."""
    inverse, made = np.linalg.inv(np.asarray(marginal.scale)), []
    for number, along in enumerate(marginal.along):
        up, down = ([end.flights[number] for end in side] for side in (near.up, near.down))
        slopes = [
            jax.tree.map(lambda a, b, h=h: (np.asarray(a) - np.asarray(b)) / (2.0 * h), *pair)
            for *pair, h in zip(up, down, near.steps, strict=True)
        ]
        exact = jax.tree.map(lambda *columns: np.stack(columns, axis=-1) @ inverse, *slopes)
        made.append(along._replace(aside=jax.tree.map(lambda a, b: np.asarray(a - b), exact, along.slope)))
    return replace(marginal, along=tuple(made))


class Compared(NamedTuple):
    """Minus the log density at points less that at the centre, of a posterior and by Laplace's approximation there.

    Attributes:
        own: The posterior's (N,).
        laplace: Laplace's (N,); neither is finite where a flight fails.
        in_range: Whether the linear models tell anything there (N,).
        missing: What the posterior's lacks, by group of flights (G, N): see `felt_axes.groups`.
    """

    own: Array
    laplace: Array
    in_range: NDArray[np.bool_]
    missing: Array

    @classmethod
    def none(cls, parts: int) -> Compared:
        """Of no points, for so many groups of flights."""
        return cls(np.zeros(0), np.zeros(0), np.zeros(0, bool), np.zeros((parts, 0)))

    @property
    def known(self) -> NDArray[np.bool_]:
        """Where no flight fails (N,)."""
        return np.isfinite(self.own) & np.isfinite(self.laplace)

    @property
    def errors(self) -> Array:
        """What the posterior's lacks (N,)."""
        return self.laplace - self.own

    def and_at(self, more: Compared) -> Compared:
        """At further points, too."""
        return Compared(*(np.concatenate(both, axis=-1) for both in zip(self, more, strict=True)))


def compared(marginal: Marginal, points: Array, progress: Progress | None = None) -> Compared:
    """A posterior's density beside Laplace's approximation at points.

    Args:
        marginal: From `corrected`.
        points: Standard coordinates (N, P).
        progress: See `Progress`.
    """
    here = at(marginal, np.zeros(points.shape[1]))
    there = _at_each(lambda point: at(marginal, point).bare(), points, progress=progress)
    places = np.vstack([0.0 * points[:1], points]).T
    own, prices = np.zeros((2, len(marginal.flights), len(points)))
    for number in range(len(own)):
        squares, price = in_batches(partial(flight_half_squares, marginal, number), places)
        own[number], prices[number] = squares[1:] - squares[0], price[1:]
    exact = np.array([one.squares + one.determinants - here.squares - here.determinants for one in there]).T
    parts, before = groups(marginal), 0.5 * np.sum(prior_residuals(marginal, places) ** 2, axis=0)
    corrections = [one.at(points[:, g.axes].T) for one, g in zip(apart(marginal.correction, parts), parts, strict=True)]
    own = np.array([own[list(g.flights)].sum(axis=0) + more for g, more in zip(parts, corrections, strict=True)])
    exact = np.array([exact[list(g.flights)].sum(axis=0) for g in parts])
    more = before[1:] - before[0]
    return Compared(more + own.sum(axis=0), more + exact.sum(axis=0), in_range(prices), exact - own)
