"""Derivatives along a flight from those of its steps, with as little work as knots of a time series need."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bayeschute.dynamics.kernel.machine import Array, aligned


class Along(NamedTuple):
    """Derivatives of every step and of the outputs, arrays of NumPy; X states, P parameters, A disturbances.

    Attributes:
        step: Next state (T - 1, X, P + 2 A + X + any): by parameters, by disturbances at the sample and at the next
            one, by state; columns beyond are zero.
        first_theta: First state by parameters (X, P).
        first_start: First state by initial deviations (X, D).
        out_state: Outputs by state (T, C, X).
        out_theta: Outputs by parameters (T, C, P).
    """

    step: Array
    first_theta: Array
    first_start: Array
    out_state: Array
    out_theta: Array


def reached(weights: Array) -> list[int]:
    """How many leading knots have had any weight up to each sample (T entries), for weights (T, K)."""
    last = np.where(weights != 0.0, np.arange(1, weights.shape[1] + 1), 0).max(axis=1, initial=0)
    return np.maximum.accumulate(last).tolist()


def chained(along: Along, weights: Array, axes: int) -> Array:
    """Derivatives of the outputs (T, C, P + D + K A), as `integrate.chained`.

    A step is one product of its derivatives with what they multiply. Nothing depends on a knot before its time: columns
    of knots to come are left alone.

    Args:
        along: The steps.
        weights: Interpolation weights of the knots (T, K).
        axes: Number A of disturbances.
    """
    samples, outputs, size = along.out_state.shape
    p, d = along.first_theta.shape[1], along.first_start.shape[1]
    knots, driven = weights.shape[1], p + 2 * axes
    total = aligned(samples, outputs, p + d + knots * axes)
    given = aligned(along.step.shape[2], p + d + knots * axes)
    now, then, state = (given[row : row + rows] for row, rows in ((p, axes), (p + axes, axes), (driven, size)))
    given[:p, :p] = np.eye(p)
    state[:, :p], state[:, p : p + d] = along.first_theta, along.first_start
    spread = [row[p + d + a :: axes] for rows in (now, then) for a, row in enumerate(rows)]
    ends = [p + d + axes * count for count in reached(weights)]
    for t in range(samples):
        end = ends[t]
        np.matmul(along.out_state[t], state[:, :end], out=total[t, :, :end])
        if t + 1 < samples:
            for a, row in enumerate(spread):
                row[:] = weights[t + a // axes]
            end = ends[t + 1]
            state[:, :end] = along.step[t] @ given[:, :end]
    total[:, :, :p] += along.out_theta
    return total
