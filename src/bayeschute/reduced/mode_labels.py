"""Classification of a cluster's motion in a window: pendulum, glide, flyout or maypole (report 6.3.1, 6.3.2).

Directions of the risers are split into their mean (the cluster as a whole) and the deviations from it. The horizontal
motion of the mean is the pendulum mode; the change in length of the deviations is flyout, their rotation about the mean
is maypole. Each is measured twice: as an angle or rotation, which shows whether the mode is present at all, and as a
share of the horizontal kinetic energy of the canopies, which shows the dominant mode. A cluster without any of these
glides, or descends steadily.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from bayeschute.core.errors import Fault, InputError

MODES = ("pendulum", "flyout", "maypole")


@dataclass(frozen=True)
class Thresholds:
    """From where on a mode counts as present.

    Attributes:
        pendulum: Amplitude of the swing [rad].
        flyout: Amplitude of the flyout angle [rad].
        turn: Turn of a maypole over the window [rad].
        turning: Rate of that turn [rad/s].
        glide: Angle of the path through the air off the vertical, mean over the window [rad].
    """

    pendulum: float = np.deg2rad(4.0)
    flyout: float = np.deg2rad(2.0)
    turn: float = np.deg2rad(120.0)
    turning: float = np.deg2rad(4.0)
    glide: float = np.deg2rad(4.0)


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


class _Parts(NamedTuple):
    """Motion split: mean direction (T, 2), mean length of deviations (T,), rate of turn (T,), energies (T, 3)."""

    mean: np.ndarray
    flyout: np.ndarray
    turning: np.ndarray
    energy: np.ndarray


def _split(direction: np.ndarray, dt: float) -> _Parts:
    across = direction[:, :, :2]
    mean = across.mean(axis=1)
    away = across - mean[:, None]
    size = np.linalg.norm(away, axis=2)
    rate = np.gradient(away, dt, axis=0)
    safe = np.maximum(size, 1e-9)
    outward = np.sum(away * rate, axis=2) / safe
    around = (away[..., 0] * rate[..., 1] - away[..., 1] * rate[..., 0]) / safe
    moment = np.sum(size**2, axis=1)
    turning = np.sum(size * around, axis=1) / np.maximum(moment, 1e-12)
    swing = np.sum(np.gradient(mean, dt, axis=0) ** 2, axis=1)
    # Turn as one body, not the single canopies' jitter, is maypole.
    rigid = turning**2 * moment / direction.shape[1]
    return _Parts(mean, size.mean(axis=1), turning, np.stack([swing, np.mean(outward**2, axis=1), rigid], axis=1))


def label_windows(
    time: Float[np.ndarray, " T"],
    riser_direction: Float[np.ndarray, "T n 3"],
    air_velocity: Float[np.ndarray, "T n 3"] | None = None,
    *,
    length: float = 15.0,
    every: float | None = None,
    thresholds: Thresholds | None = None,
) -> list[WindowLabel]:
    """Label windows of a record (``riser_direction``, ``air_velocity`` of `bayeschute.records.reconstruct`).

    Args:
        time: Uniform [s].
        riser_direction: Unit vectors from the capsule to the canopies, NED.
        air_velocity: Of the canopies relative to the air, NED [m/s].
        length: Of the windows [s]: about a period of the slowest mode.
        every: Distance of their starts [s]; half their length where none is given.
        thresholds: From where on modes count.

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
    limits = thresholds or Thresholds()
    parts = _split(direction, dt)
    found = []
    for start in np.arange(time[0], time[-1] - length + dt + 1e-9, step):
        here = (time >= start - 1e-9) & (time < start + length - 1e-9)
        flow = None if air_velocity is None else np.asarray(air_velocity, dtype=float)[here]
        found.append(_label(float(start), float(start) + length, _Parts(*(p[here] for p in parts)), flow, limits))
    return found


def _label(start: float, end: float, parts: _Parts, flow: np.ndarray | None, limits: Thresholds) -> WindowLabel:
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
        "pendulum": swing >= limits.pendulum,
        "flyout": scissors >= limits.flyout,
        "maypole": abs(turning) >= limits.turning and abs(turning) * (end - start) >= limits.turn,
    }
    order = [MODES[i] for i in np.argsort(-shares)]
    present = tuple(mode for mode in order if there[mode])
    calm = "glide" if glide >= limits.glide else "steady"
    return WindowLabel(
        start, end, present[0] if present else calm, present, swing, scissors, turning, glide, tuple(shares.tolist())
    )
