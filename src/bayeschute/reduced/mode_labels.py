"""Classification of a cluster's motion in a window: pendulum, glide, flyout or maypole (report 6.3.1, 6.3.2).

Directions of the risers are split into their mean (the cluster as a whole) and the deviations from it. The horizontal
motion of the mean is the pendulum mode; the change in length of the deviations is flyout, their rotation about the mean
is maypole. Each is measured twice: as an angle or rotation, which shows whether the mode is present at all, and as a
share of the horizontal kinetic energy of the canopies, which shows the dominant mode. A cluster without any of these
glides, or descends steadily.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from bayeschute.core.errors import Fault, InputError

MODES = ("pendulum", "flyout", "maypole")


# From where on a mode counts as present.
SWING = np.deg2rad(4.0)  # amplitude of a pendulum's swing [rad]
SCISSORS = np.deg2rad(2.0)  # amplitude of the flyout angle [rad]
TURN = np.deg2rad(120.0)  # of a maypole over the window [rad]
TURNING = np.deg2rad(4.0)  # rate of that turn [rad/s]
GLIDE = np.deg2rad(4.0)  # angle of the path through the air off the vertical, mean over the window [rad]


class WindowLabel(NamedTuple):
    """A window and its mode of motion.

    Attributes:
        start: [s].
        end: [s].
        label: ``pendulum``, ``flyout``, ``maypole``, ``glide``, ``steady``, or ``unknown`` where samples are missing.
        present: Every mode beyond its threshold, greatest share first.
        swing_amplitude: Root two times the rms of the swing about its mean [rad].
        flyout_amplitude: Likewise of the flyout angle [rad].
        turning: Mean rate of turn of the canopies about each other [rad/s].
        glide_angle: Of the mean path through the air off the vertical [rad]; NaN without air velocities.
        shares: Of the canopies' kinetic energy across the vertical, by mode, in the order of `MODES`.
    """

    start: float
    end: float
    label: str
    present: tuple[str, ...]
    swing_amplitude: float
    flyout_amplitude: float
    turning: float
    glide_angle: float
    shares: tuple[float, float, float]


class Parts(NamedTuple):
    """Motion split, by time and further axes such as those of a batch.

    Attributes:
        mean: Of the directions across the vertical (T, 2, ...).
        moving: Its rate (T, 2, ...) [1/s].
        flyout: Mean length of the deviations from it (T, ...).
        turning: Rate at which they turn as one (T, ...) [rad/s].
        energy: Of pendulum, flyout and maypole (T, 3, ...) [1/s^2].
    """

    mean: Float[np.ndarray, "T 2 ..."]
    moving: Float[np.ndarray, "T 2 ..."]
    flyout: Float[np.ndarray, "T ..."]
    turning: Float[np.ndarray, "T ..."]
    energy: Float[np.ndarray, "T 3 ..."]


def split(across: Float[np.ndarray, "T 2 n ..."], dt: float) -> Parts:
    """Split the motion of a cluster.

    Args:
        across: Horizontal parts of the risers' unit directions.
        dt: Sample interval [s].
    """
    mean = across.mean(axis=2)
    away = across - mean[:, :, None]
    size = np.sqrt((away**2).sum(axis=1))
    rate = np.gradient(away, dt, axis=0)
    safe = np.maximum(size, 1e-9)
    outward = (away * rate).sum(axis=1) / safe
    around = (away[:, 0] * rate[:, 1] - away[:, 1] * rate[:, 0]) / safe
    moment = (size**2).sum(axis=1)
    turning = (size * around).sum(axis=1) / np.maximum(moment, 1e-12)
    moving = np.gradient(mean, dt, axis=0)
    # Turn as one body, not the single canopies' jitter, is maypole.
    rigid = turning**2 * moment / across.shape[2]
    energy = np.stack([(moving**2).sum(axis=1), (outward**2).mean(axis=1), rigid], axis=1)
    return Parts(mean, moving, size.mean(axis=1), turning, energy)


def label_windows(
    time: Float[np.ndarray, " T"],
    riser_direction: Float[np.ndarray, "T n 3"],
    air_velocity: Float[np.ndarray, "T n 3"] | None = None,
    *,
    length: float = 15.0,
    every: float | None = None,
) -> list[WindowLabel]:
    """Label windows of a record (``riser_direction``, ``air_velocity`` of `bayeschute.records.reconstruct`).

    Args:
        time: Uniform [s].
        riser_direction: Unit vectors from the capsule to the canopies, NED.
        air_velocity: Of the canopies relative to the air, NED [m/s].
        length: Of the windows [s]: about a period of the slowest mode.
        every: Distance of their starts [s]; half their length where none is given.

    Returns:
        The windows in order; one in which more than a fifth of the samples is missing is ``unknown``.

    Raises:
        InputError: For wrong shapes or a record shorter than a window.
    """
    time, direction = np.asarray(time, dtype=float), np.asarray(riser_direction, dtype=float)
    if direction.ndim != 3 or direction.shape[2] != 3 or direction.shape[0] != time.size or time.size < 5:
        raise InputError(Fault("mode labels", f"directions of shape {direction.shape}", "(T, n, 3) along time, T >= 5"))
    dt, step = float(np.median(np.diff(time))), 0.5 * length if every is None else every
    if not (0.0 < length <= time[-1] - time[0] + dt and step > 0.0):
        got = f"windows of {length:g} s, {step:g} s apart, in {time[-1] - time[0]:.1f} s"
        raise InputError(Fault("mode labels", got, "windows inside the record"))
    parts = split(direction[:, :, :2].swapaxes(1, 2), dt)
    found = []
    for start in np.arange(time[0], time[-1] - length + dt + 1e-9, step):
        here = (time >= start - 1e-9) & (time < start + length - 1e-9)
        flow = None if air_velocity is None else np.asarray(air_velocity, dtype=float)[here]
        found.append(_label(float(start), float(start) + length, Parts(*(p[here] for p in parts)), flow))
    return found


def _label(start: float, end: float, parts: Parts, flow: np.ndarray | None) -> WindowLabel:
    seen = np.isfinite(parts.energy).all(axis=1)
    if np.mean(seen) < 0.8:
        nan = float("nan")
        return WindowLabel(start, end, "unknown", (), nan, nan, nan, nan, (nan, nan, nan))
    mean, flyout = parts.mean[seen], parts.flyout[seen]
    swing = float(np.sqrt(2.0 * np.sum(np.var(mean, axis=0))))
    scissors = float(np.sqrt(2.0 * np.var(flyout)))
    turning = float(np.mean(parts.turning[seen]))
    energy = parts.energy[seen].mean(axis=0)
    shares = energy / max(float(energy.sum()), 1e-30)
    glide = float("nan")
    if flow is not None:
        path = np.nanmean(flow, axis=(0, 1))
        glide = float(np.arctan2(np.hypot(path[0], path[1]), path[2]))
    there = {
        "pendulum": swing >= SWING,
        "flyout": scissors >= SCISSORS,
        "maypole": abs(turning) >= TURNING and abs(turning) * (end - start) >= TURN,
    }
    order = [MODES[i] for i in np.argsort(-shares)]
    present = tuple(mode for mode in order if there[mode])
    calm = "glide" if glide >= GLIDE else "steady"
    return WindowLabel(
        start, end, present[0] if present else calm, present, swing, scissors, turning, glide, tuple(shares.tolist())
    )
