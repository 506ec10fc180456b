"""Initial guess of the trajectory: the states of a cluster as its record shows them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.vectors import Vec3, quaternion
from bayeschute.dynamics.initial_state import Start
from bayeschute.dynamics.parameters import STANDARD_GRAVITY, Cluster
from bayeschute.records.differentiate import savitzky_golay

Array = NDArray[np.float64]
_WINDOW = 1.0  # [s] of the smoothing polynomials
_ACCELERATION = 0.1  # standard gravities by which a body's acceleration may be wrong for a sample
_POSITION = 0.05  # defect of a position over that of the velocity, times the second
_ARM = 0.14  # lever of the body's rate, over the risers' length


class RecordPath(NamedTuple):
    """A path read off a record, and by how much its steps may break the equations of motion.

    Attributes:
        states: (T, X), as `dynamics.state.pack` orders them.
        slack: Standard deviations of a step's defects (X,), about those of the path itself.
    """

    states: Array
    slack: Array


def record_path(start: Start, base: Cluster, dt: float, velocity: Array, attitude: Array, apart: Array) -> RecordPath:
    """Smoothed states along a record, the risers at the stretch of their share of the weight.

    Args:
        start: Where the flight begins.
        base: Masses and risers.
        dt: Sample interval [s].
        velocity: Of the capsule (T, 3), without gaps [m/s].
        attitude: Quaternions NED to body (T, 4), without gaps.
        apart: Canopies from the capsule's centre of mass (T, n, 3), without gaps [m].
    """
    window = 2 * max(2, round(0.5 * _WINDOW / dt)) + 1
    window = min(window, 2 * ((len(velocity) - 1) // 2) + 1)

    def smooth(x: Array, order: int = 0) -> Array:
        return savitzky_golay(x.reshape(len(x), -1), dt, window, order).reshape(x.shape)

    turned = (
        attitude
        * np.cumprod(np.where(np.sum(attitude * np.roll(attitude, 1, axis=0), axis=1) < 0.0, -1.0, 1.0))[:, None]
    )
    turned = turned * np.sign(turned[0] @ attitude[0])
    q = smooth(turned)
    q = q / np.linalg.norm(q, axis=1, keepdims=True)
    w, x, y, z = q.T
    dw, dx, dy, dz = smooth(turned, 1).T
    rate = 2.0 * np.stack(
        [
            w * dx - x * dw - y * dz + z * dy,
            w * dy + x * dz - y * dw - z * dx,
            w * dz - x * dy + y * dx - z * dw,
        ],
        axis=1,
    )
    moving = smooth(velocity)
    steps = 0.5 * dt * (moving[1:] + moving[:-1])
    position = np.asarray(start.position) + np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    b = base.capsule.attach_b
    arm = quaternion(q.T).to_ned(Vec3(*(np.full(len(q), float(c)) for c in (b.x, b.y, b.z))))
    attach = np.stack([np.asarray(c) for c in (arm.x, arm.y, arm.z)], axis=1)
    riser = smooth(apart - attach[:, None])
    n = riser.shape[1]
    weight = base.capsule.mass * STANDARD_GRAVITY / n
    length = float(base.risers.length) + weight / float(base.risers.stiffness)
    canopy = (position + attach)[:, None] + length * riser / np.linalg.norm(riser, axis=2, keepdims=True)
    canopies = [a.swapaxes(1, 2).reshape(len(q), 3 * n) for a in (canopy, smooth(canopy, 1))]
    speed = _ACCELERATION * STANDARD_GRAVITY * dt
    place, spin = _POSITION * speed, speed / (_ARM * length)
    sizes = [(3, place), (3, speed), (4, 0.5 * spin * dt), (3, spin), (3 * n, place), (3 * n, speed)]
    slack = np.concatenate([np.full(count, value) for count, value in sizes])
    return RecordPath(np.concatenate([position, moving, q, rate, *canopies], axis=1), slack)
