"""A body that hangs, swings and spins, and what its gyro, accelerometer and altimeter would log."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation


def log(
    tilt: np.ndarray, spin: np.ndarray, dt: float, mounted: Rotation, offset: tuple[float, float] = (0.0, 0.0)
) -> tuple[np.ndarray, np.ndarray]:
    """Angular rate and specific force (T, 3), axes of an instrument mounted anyhow.

    Args:
        tilt: Rotation vector of the axis off the vertical by its two horizontal components (T, 2) [rad].
        spin: Rate about the axis (T,) [rad/s].
        dt: Sample interval [s].
        mounted: From the body to the instrument.
        offset: Of the mean specific force from the spin axis, as two small angles in the body [rad].
    """
    turn = np.concatenate([[0.0], np.cumsum(0.5 * (spin[1:] + spin[:-1]) * dt)])
    lean = Rotation.from_rotvec(np.column_stack([tilt, np.zeros(len(tilt))]))
    attitude = lean * Rotation.from_rotvec(turn[:, None] * np.array([0.0, 0.0, 1.0]))
    step = (attitude[:-1].inv() * attitude[1:]).as_rotvec() / dt
    rate = np.concatenate([step[:1], 0.5 * (step[1:] + step[:-1]), step[-1:]])
    force = np.tile([0.0, 0.0, 9.80665], (len(tilt), 1))  # the pull of the lines, along the axis
    force = Rotation.from_rotvec([*offset, 0.0]).apply(force)
    return mounted.apply(rate), mounted.apply(force)
