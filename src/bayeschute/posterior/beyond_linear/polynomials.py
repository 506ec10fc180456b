"""Polynomials that correct the linearised marginal by Laplace's approximation.

That is evaluated on either side along every axis and at corners between them, and two quadratic polynomials correct the
linearised marginal: one for the squares, one for the log determinant (`linear_errors` says of what).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

from bayeschute.posterior.beyond_linear import laplace
from bayeschute.posterior.beyond_linear.expansion import Expansion, expansion_of, linear_expansion
from bayeschute.posterior.beyond_linear.laplace import Laplace, Progress
from bayeschute.posterior.beyond_linear.linear_errors import beyond_linear
from bayeschute.posterior.differences import beside
from bayeschute.posterior.marginal import Marginal, Quadratic

Array = NDArray[np.float64]
_FLATTEST = 0.2  # curvature of a Gaussian density in standard coordinates is one; the least that is left along an axis
_LOOKS = 3  # most axes on which a curvature less than that is measured


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
    here = laplace.at(marginal, np.zeros(count))

    def end(point: Array) -> Laplace:
        return laplace.at(marginal, point, here=here)._replace(roots=())

    def told(points: Array) -> Array:
        found = laplace.at_each(end, points, progress=progress)
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
    own = linear_expansion(marginal, near.steps)
    up, down = (change.sum(axis=(1, 2)) for change in _changes(marginal, near))
    bend = np.diag((up + down) / near.steps**2)
    return Expansion(own.slope + (up - down) / (2.0 * near.steps), own.curvature + bend)


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
    return _measured(made, expansion_of(made, near.steps), near.here, float(np.min(near.steps)))


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


def _measured(made: Marginal, expansion: Expansion, here: Laplace, step: float) -> tuple[Marginal, Expansion]:
    """Slope and curvature along the flattest axes by Laplace's approximation on either side, the rest being kept."""
    for _ in range(_LOOKS):
        values, axes = np.linalg.eigh(expansion.curvature)
        axis = axes[:, 0]
        if values[0] >= _FLATTEST:
            break
        up, down = (laplace.at(made, sign * step * axis).rise(here) for sign in (1.0, -1.0))
        found = (up + down) / step**2
        if not np.isfinite(found):
            break
        slope = ((up - down) / (2.0 * step) - expansion.slope @ axis) * axis
        curvature = (found - values[0]) * np.outer(axis, axis)
        expansion = Expansion(expansion.slope + slope, expansion.curvature + curvature)
        made = replace(made, bend=Quadratic(made.bend.slope + slope, made.bend.curvature + curvature))
        if found < _FLATTEST:  # it is as flat as it seemed
            break
    return made, expansion


def _changes(marginal: Marginal, near: Sides) -> tuple[Array, Array]:
    """`beyond_linear` to both sides along every axis (P, F, 2)."""
    axes, which = np.diag(near.steps), marginal.felt.T
    up = beyond_linear(marginal, near.here, axes, near.up, which)
    return up, beyond_linear(marginal, near.here, -axes, near.down, which)


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
            return laplace.at_corner(marginal, here, ends[pair[0]], ends[pair[1]], point, moved)

        there = laplace.at_each(corner, points, left, both, progress=progress)
        mixed = beyond_linear(marginal, here, points, there, both) - change[i] - change[j]
        mixed = np.sum(mixed, axis=1, where=both[:, :, None]) / (h[i] * h[j])[:, None]
        known = np.isfinite(mixed).all(axis=1)
        curvature[:, i[known], j[known]] = curvature[:, j[known], i[known]] = mixed[known].T
        left, both = left[~known], both[~known]
    slope = ((up - down).sum(axis=1) / (2.0 * h[:, None])).T
    return Quadratic(slope[0], curvature[0]), Quadratic(slope[1], curvature[1])


def _followed(marginal: Marginal, near: Sides) -> Marginal:
    """The posterior whose draws follow theta as conditional optima on either side along every axis do."""
    inverse, made = np.linalg.inv(np.asarray(marginal.scale)), []
    for number, along in enumerate(marginal.along):
        up, down = ([end.flights[number] for end in side] for side in (near.up, near.down))
        slopes = [
            jax.tree.map(lambda a, b, h=h: (np.asarray(a) - np.asarray(b)) / (2.0 * h), *pair)
            for *pair, h in zip(up, down, near.steps, strict=True)
        ]
        own = inverse[:, along.parameters]
        exact = jax.tree.map(lambda *columns, own=own: np.stack(columns, axis=-1) @ own, *slopes)
        made.append(along._replace(aside=jax.tree.map(lambda a, b: np.asarray(a - b), exact, along.slope)))
    return replace(marginal, along=tuple(made))
