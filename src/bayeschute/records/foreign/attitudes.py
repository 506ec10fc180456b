"""Attitudes of other conventions as quaternions from NED to body: Euler angles, other axes, the inverse rotation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bayeschute.records.foreign.conventions import Conventions

Array = NDArray[np.float64]

_SMOOTHING = 1.0  # length of the local quadratics that a rate is found with [s]


def product(a: Array, b: Array) -> Array:
    """Product of quaternions, scalar first (..., 4): first turn by `b`, then by `a`, as matrices do."""
    w, v = a[..., :1], a[..., 1:]
    u, q = b[..., :1], b[..., 1:]
    return np.concatenate([w * u - np.sum(v * q, axis=-1, keepdims=True), w * q + u * v + np.cross(v, q)], axis=-1)


def of_matrix(matrix: Array) -> Array:
    """Quaternion of a rotation matrix (3, 3), scalar first and not negative (4,)."""
    # The eigenvector of Bar-Itzhack's matrix (J. Guidance 23(6), 2000); no case distinctions.
    m = matrix
    k = np.array(
        [
            [m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 0] - m[1, 1] - m[2, 2], m[1, 0] + m[0, 1], m[2, 0] + m[0, 2]],
            [m[0, 2] - m[2, 0], m[1, 0] + m[0, 1], m[1, 1] - m[0, 0] - m[2, 2], m[2, 1] + m[1, 2]],
            [m[1, 0] - m[0, 1], m[2, 0] + m[0, 2], m[2, 1] + m[1, 2], m[2, 2] - m[0, 0] - m[1, 1]],
        ]
    )
    q = np.linalg.eigh(k)[1][:, -1]
    return np.asarray(q if q[0] >= 0.0 else -q)


def of_euler(yaw: Array, pitch: Array, roll: Array, order: str = "zyx") -> Array:
    """Quaternion of turns about z (yaw), y (pitch) and x (roll) in an order, each about axes turned before (T, 4)."""
    angles = {"z": (3, yaw), "y": (2, pitch), "x": (1, roll)}
    made = None
    for letter in order:
        place, angle = angles[letter]
        turn = np.zeros((len(angle), 4))
        turn[:, 0], turn[:, place] = np.cos(0.5 * angle), np.sin(0.5 * angle)
        made = turn if made is None else product(made, turn)
    assert made is not None
    return made


def in_schema(q: Array, said: Conventions) -> Array:
    """Quaternions of the schema, NED to the vehicle's body axes, of those of a record (T, 4); signs without jumps."""
    q = q * np.array([1.0, -1.0, -1.0, -1.0]) if said.attitude == "earth to body" else q
    made = product(of_matrix(said.earth()), product(q, of_matrix(said.body().T)))
    seen = np.isfinite(made).all(axis=1)
    x = made[seen]
    if len(x) > 1:
        flips = np.where(np.sum(x[1:] * x[:-1], axis=1) < 0.0, -1.0, 1.0)
        made[seen] = x * np.concatenate([[1.0], np.cumprod(flips)])[:, None]
    return made


def rate_of_attitude(time: Array, q: Array, length: float = _SMOOTHING) -> Array:
    """Angular rate about the body axes (T, 3) [rad/s], by local quadratics; NaN where the attitude is missing.

    Args:
        time: (T,) [s].
        q: Attitude without jumps (T, 4).
        length: Of the local quadratics [s].
    """
    from bayeschute.records.differentiate import savitzky_golay  # imports SciPy

    seen = np.asarray(np.isfinite(q).all(axis=1))
    if seen.sum() < 10:
        return np.full((len(q), 3), np.nan)
    step = float(np.median(np.diff(time[seen])))
    even = np.arange(time[seen][0], time[seen][-1] + 0.5 * step, step)
    filled = np.stack([np.interp(even, time[seen], x[seen]) for x in q.T], axis=1)
    window = max(5, 2 * round(0.5 * length / step) + 1)
    window = min(window, 2 * ((len(even) - 1) // 2) + 1)
    change = np.stack([savitzky_golay(x, step, window) for x in filled.T], axis=1)
    turning = 2.0 * product(filled * np.array([1.0, -1.0, -1.0, -1.0]), change)[:, 1:]
    out = np.stack([np.interp(time, even, x) for x in turning.T], axis=1)
    return np.where(seen[:, None], out, np.nan)
