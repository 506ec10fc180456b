"""Mode of motion of a cluster in the last seconds before touchdown, for many landings at once.

Motion is split by `reduced.mode_labels`: the mean of the risers' directions swings (pendulum), deviations from it
change in length (flyout) or turn as one (maypole). A pendulum whose minor axis is long beside its major one is a cone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.landing.measures import LABELS
from bayeschute.reduced.mode_labels import GLIDE, SCISSORS, SWING, TURN, TURNING, split

Array = NDArray[np.float64]
CONE = 0.5  # least ratio of the minor to the major axis of the swing


class Motion(NamedTuple):
    """The window before touchdown, (B,) each.

    Attributes:
        label: Index into `LABELS`.
        amplitude: Root two times the rms of the swing about its mean [rad].
        phase: Of the swing at touchdown [rad]: 0 at the side to which it leans, pi / 2 on the way back through the
            middle, -pi / 2 on the way out.
        turning: Mean rate of turn of the canopies about each other [rad/s].
        glide_angle: Of the mean path through the air off the vertical [rad].
    """

    label: NDArray[np.int64]
    amplitude: Array
    phase: Array
    turning: Array
    glide_angle: Array


def motion(across: Array, path: Array, dt: float) -> Motion:
    """Label windows.

    Args:
        across: Horizontal parts of the risers' unit directions (T, 2, n, B), touchdown last.
        path: Mean velocity of the canopies through the air over the window, NED (3, B) [m/s].
        dt: Sample interval [s].
    """
    span, parts = len(across) * dt, split(across, dt)
    energy = parts.energy.mean(axis=0)
    off = parts.mean - parts.mean.mean(axis=0)
    amplitude = np.sqrt(2.0 * (off**2).mean(axis=0).sum(axis=0))
    scissors = np.sqrt(2.0 * parts.flyout.var(axis=0))
    turn = parts.turning.mean(axis=0)
    glide = np.arctan2(np.hypot(path[0], path[1]), path[2])
    present = np.stack(
        [
            amplitude >= SWING,
            scissors >= SCISSORS,
            (np.abs(turn) >= TURNING) & (np.abs(turn) * span >= TURN),
        ]
    )
    leading = np.where(present, energy, -1.0).argmax(axis=0)
    major, minor = _axes(off)
    swing = np.where(minor >= CONE * major, LABELS.index("cone"), LABELS.index("pendulum"))
    calm = np.where(glide >= GLIDE, LABELS.index("glide"), LABELS.index("steady"))
    kinds = np.stack([swing, np.full_like(swing, LABELS.index("flyout")), np.full_like(swing, LABELS.index("maypole"))])
    label = np.where(present.any(axis=0), np.take_along_axis(kinds, leading[None], axis=0)[0], calm)
    return Motion(label, amplitude, _phase(off, parts.moving), turn, glide)


def _axes(off: Array) -> tuple[Array, Array]:
    """Rms along the major and the minor axis of the swing (T, 2, B)."""
    xx, yy, xy = (off[:, 0] ** 2).mean(axis=0), (off[:, 1] ** 2).mean(axis=0), (off[:, 0] * off[:, 1]).mean(axis=0)
    middle, apart = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    return np.sqrt(middle + apart), np.sqrt(np.maximum(middle - apart, 0.0))


def _phase(off: Array, moving: Array) -> Array:
    """Phase at the last sample along the major axis, turned so that the swing leans to its positive side."""
    xx, yy, xy = (off[:, 0] ** 2).mean(axis=0), (off[:, 1] ** 2).mean(axis=0), (off[:, 0] * off[:, 1]).mean(axis=0)
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    c, s = np.cos(angle), np.sin(angle)
    place, speed = c * off[:, 0] + s * off[:, 1], c * moving[:, 0] + s * moving[:, 1]
    omega = speed.std(axis=0) / np.maximum(place.std(axis=0), 1e-12)
    side = np.where(place[-1] < 0.0, -1.0, 1.0)
    return np.asarray(np.arctan2(-side * speed[-1] / np.maximum(omega, 1e-12), side * place[-1]))
