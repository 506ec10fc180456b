"""Swing of a hanging body from its gyro and accelerometer, with the spin removed.

The gyro is integrated to an attitude from an arbitrary start. In those axes, which do not turn, the mean specific force
points up (drag and weight balance), and so does, in the body, the axis that the body hangs by. The swing is the motion
of that axis across the vertical. Spin about the axis does not matter, except that the axis is known imperfectly: a
misalignment traces a circle with the spin's phase. Its two directions are returned as regressors, so that what is
fitted to the swing can separate it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.errors import Fault, InputError

Array = NDArray[np.float64]

LONGEST_GAP = 0.1  # of the gyro that is bridged [s]
_LEAST_FORCE = 0.3  # length of the mean specific force over its mean length below which the body does not hang


class HangingMotion(NamedTuple):
    """Motion of the hanging axis across the vertical, in axes that don't turn.

    Attributes:
        rate: Rate of the axis's direction (T, 2) [rad/s], NaN where the gyro is missing.
        tilt: The direction itself (T, 2), sine of the angle off the vertical by component; drifts with the gyro.
        misalignment: Rates that a misalignment of 1 rad in either of two directions of the body would add (T, 2, 2).
        spin: Rate about the vertical (T,) [rad/s].
        axis_b: The hanging axis, upwards, body axes (3,).
    """

    rate: Array
    tilt: Array
    misalignment: Array
    spin: Array
    axis_b: Array


def _bridged(x: Array, dt: float, where: str) -> tuple[Array, NDArray[np.bool_]]:
    """Series (T, 3) with short gaps filled linearly, and where they were not missing."""
    seen = np.asarray(np.isfinite(x).all(axis=1))
    if not seen.any():
        raise InputError(Fault(where, "no sample", "a record of it"))
    places = np.flatnonzero(seen)
    gap = float(np.max(np.diff(places), initial=1)) * dt
    if gap > LONGEST_GAP + dt or places[0] > 0 or places[-1] < len(x) - 1:
        got = f"a gap of {max(gap, (places[0] + 1) * dt, (len(x) - places[-1]) * dt):.2f} s"
        wanted = f"gaps up to {LONGEST_GAP:g} s, none at the ends"
        raise InputError(Fault(where, got, wanted, "Choose a window without it."))
    index = np.arange(len(x))
    return np.stack([np.interp(index, places, c[places]) for c in x.T], axis=1), seen


def attitudes(rate_b: Array, dt: float) -> Array:
    """Rotations from body axes to those of the first sample, by constant rates over each step.

    Args:
        rate_b: Angular velocity (T, 3) [rad/s].
        dt: Sample interval [s].

    Returns:
        (T, 3, 3).
    """
    from scipy.spatial.transform import Rotation

    steps = Rotation.from_rotvec(0.5 * (rate_b[1:] + rate_b[:-1]) * dt).as_matrix()
    out = np.empty((len(rate_b), 3, 3))
    out[0] = np.eye(3)
    for i, step in enumerate(steps):
        out[i + 1] = out[i] @ step
    return out


def _across(axis: Array) -> tuple[Array, Array]:
    """Two unit vectors across a unit vector."""
    first = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = first - axis * (first @ axis)
    first /= np.linalg.norm(first)
    return first, np.cross(axis, first)


def hanging_motion(rate_b: Array, specific_force_b: Array, dt: float) -> HangingMotion:
    """Motion of a hanging body over a stretch in which it hangs all the time.

    Args:
        rate_b: Angular velocity (T, 3), body axes [rad/s].
        specific_force_b: (T, 3), body axes [m/s^2].
        dt: Sample interval [s]; some tens of samples per turn of the spin.

    Returns:
        The motion.

    Raises:
        InputError: If samples are missing for longer than 0.1 s, or the body does not hang.
    """
    rate, force = np.asarray(rate_b, dtype=float), np.asarray(specific_force_b, dtype=float)
    if rate.ndim != 2 or rate.shape != force.shape or rate.shape[1] != 3 or len(rate) < 10:
        got = f"shapes {rate.shape} and {force.shape}"
        raise InputError(Fault("hanging body", got, "rates and specific forces of equal shape (T, 3), T >= 10"))
    rate, seen = _bridged(rate, dt, "hanging body, angular rate")
    force, _ = _bridged(force, dt, "hanging body, specific force")
    R = attitudes(rate, dt)
    up, axis = (R @ force[:, :, None])[:, :, 0].mean(axis=0), force.mean(axis=0)
    size = float(np.linalg.norm(force, axis=1).mean())
    for vector, what in ((up, "in space"), (axis, "in the body")):
        if np.linalg.norm(vector) < _LEAST_FORCE * size:
            got = f"a specific force whose direction {what} averages out"
            raise InputError(Fault("hanging body", got, "a body that hangs", "Choose a window of steady descent."))
    up, axis = up / np.linalg.norm(up), axis / np.linalg.norm(axis)
    horizontal = np.stack(_across(up), axis=1)
    turning = (R @ rate[:, :, None])[:, :, 0]

    def moved(direction: Array) -> Array:
        return np.asarray(np.cross(turning, R @ direction) @ horizontal)

    missing = np.where(seen, 0.0, np.nan)[:, None]
    return HangingMotion(
        rate=moved(axis) + missing,
        tilt=(R @ axis) @ horizontal,
        misalignment=np.stack([moved(direction) for direction in _across(axis)], axis=2),
        spin=turning @ up,
        axis_b=axis,
    )
