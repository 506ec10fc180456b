"""What the linear models of flights leave out of the marginal log density, by Laplace's approximation beside theta_0.

Because the residuals are noise and not small, the conditional mode is a curved function of theta where the derivatives
change with theta (residual-curvature term); without it the marginal density is too narrow, by a fifth and more for
parameters that determine the response to gusts. And the squares are weighed by covariances that change with theta: on
average the curvatures of this and of the log determinant add up to the Fisher information in the covariances, and the
second alone is negative.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.posterior.beyond_linear import laplace
from bayeschute.posterior.beyond_linear.expansion import linear_change
from bayeschute.posterior.beyond_linear.laplace import Laplace
from bayeschute.posterior.marginal import Marginal

Array = NDArray[np.float64]
_SLOPE_STEPS = 0  # to the conditional mode a little aside
_JUMP = 1e4  # information by covariances along an axis, in standard coordinates, that no difference can mean


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
    size, felt = np.size(marginal.centre), marginal.felt
    slope, changes = np.full(size, np.nan), _Changes([{} for _ in felt], size)
    here = laplace.at(marginal, np.zeros(size), most=_SLOPE_STEPS)
    inverse = [np.linalg.inv(root) for root in here.roots]

    def look(axes: NDArray[np.intp], by: float) -> None:
        def end(axis: int, point: Array) -> Laplace:
            one = laplace.at(marginal, point, most=_SLOPE_STEPS, here=here)
            for k in np.flatnonzero(felt[:, axis]).tolist():
                unit = inverse[k] @ one.roots[k]
                changes.by_flight[k][axis] = (unit @ np.swapaxes(unit, 1, 2) - np.eye(unit.shape[1])).ravel() / by
            return one.bare()

        points = by * np.eye(size)[axes]
        there = laplace.at_each(end, axes.tolist(), points)
        slope[axes] = beyond_linear(marginal, here, points, there, felt.T[axes]).sum(axis=(1, 2)) / by

    look(np.arange(size), step)
    information = changes.information()
    lost = ~np.isfinite(slope) | _jump(information)
    if lost.any():
        look(np.flatnonzero(lost), -step)
        information = changes.information()
    if not np.isfinite(slope).all():
        raise FloatingPointError("flights to both sides of the optimum fail: the log density has no slope there")
    if _jump(information).any():
        raise FloatingPointError(
            "covariances of the innovations jump to both sides: a riser goes slack in some of the flights alone"
        )
    return LinearErrors(slope, information)


class _Changes(NamedTuple):
    """Relative changes of the innovations' covariances along axes, per unit.

    Attributes:
        by_flight: Of all samples (N,), by axis, of the axes that move the flight.
        axes: Number of all P.
    """

    by_flight: list[dict[int, Array]]
    axes: int

    def information(self) -> Array:
        """See `LinearErrors` (P, P)."""
        made = np.zeros((self.axes, self.axes))
        for changes in self.by_flight:
            if changes:
                axes = sorted(changes)
                rows = np.array([changes[axis] for axis in axes])
                made[np.ix_(axes, axes)] += 0.5 * rows @ rows.T
        return made


def _jump(information: Array) -> NDArray[np.bool_]:
    """Whether relative changes of covariances along an axis (P,) are none of a smooth function, by their squares."""
    return np.asarray(np.diag(information) > _JUMP)


def beyond_linear(
    marginal: Marginal, here: Laplace, points: Array, there: Sequence[Laplace], which: NDArray[np.bool_]
) -> Array:
    """What squares are more than the linear models', and the log determinant, at points (N, P), less here (N, F, 2).

    Zero of all flights but `which` (N, F).
    """
    squares, determinants = ([getattr(one, name) for one in there] for name in ("squares", "determinants"))
    more = np.stack([np.array(squares) - here.squares, np.array(determinants) - here.determinants], axis=2)
    for number, rows in enumerate(which.T):
        if rows.any():
            more[rows, number, 0] -= linear_change(marginal, number, points[rows])
    return np.where(which[:, :, None], more, 0.0)
