"""Minus the log density about a point as a quadratic polynomial, and where that is least."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from bayeschute.posterior.marginal import Marginal, flight_half_squares, in_batches, prior_lines

Array = NDArray[np.float64]
FARTHEST = 3.0  # standard deviations that a step to the mode may be long


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


def expansion_of(marginal: Marginal, steps: Array | None = None) -> Expansion:
    """Minus the log density about the centre, with the corrections.

    Args:
        marginal: From `corrected`.
        steps: How far to look along every axis for the curvature of the linear models (P,); one where None.
    """
    own = linear_expansion(marginal, np.ones(np.size(marginal.centre)) if steps is None else steps)
    more = marginal.correction
    return Expansion(own.slope + np.asarray(more.slope), own.curvature + np.asarray(more.curvature))


def linear_expansion(marginal: Marginal, h: Array) -> Expansion:
    """Minus the log density of the linear models about theta_0, without flights that fail there.

    Args:
        marginal: The posterior; its corrections are left out.
        h: How far to look along every axis (P,).
    """
    here, *along = prior_lines(marginal).T
    slope, curvature = np.array(along) @ here, np.array(along) @ np.array(along).T
    for number, row in enumerate(marginal.felt):
        axes = np.flatnonzero(row)
        steps, (i, j) = h[axes], np.triu_indices(len(axes), 1)
        sides = np.diag(h)[axes]
        points = np.concatenate([sides, -sides, sides[i] + sides[j], -sides[i] - sides[j]])
        value = linear_change(marginal, number, points)
        up, down, first, second = np.split(value, np.cumsum([len(axes), len(axes), len(i)]))
        made = np.diag((up + down) / steps**2)
        made[i, j] = made[j, i] = (first + second - up[i] - up[j] - down[i] - down[j]) / (2.0 * steps[i] * steps[j])
        slope[axes] += np.nan_to_num((up - down) / (2.0 * steps), nan=0.0)
        curvature[np.ix_(axes, axes)] += np.nan_to_num(made, nan=0.0)
    return Expansion(np.asarray(slope), np.asarray(curvature))


def linear_change(marginal: Marginal, number: int, points: Array) -> Array:
    """Half the squares of the linear model of one flight (N,) at points (N, P), less those at theta_0."""
    places = np.vstack([0.0 * points[:1], points])
    squares, _ = in_batches(partial(flight_half_squares, marginal, number), places.T)
    return np.asarray(squares[1:] - squares[0])
