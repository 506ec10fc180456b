"""A batch of landings flown to the ground, second by second, each in its own wind and on its own clock.

Winds are by altitude, disturbances of the model by time. The altitudes of the next second are foreseen by the present
speed (they are off by a metre or two at most), the winds there are interpolated, and the second is flown; landings that
are down leave the batch.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.vectors import Vec3, quaternion
from bayeschute.landing.landing_model import LandingFlight, flown, rows
from bayeschute.landing.wind_plan import STEP

Array = NDArray[np.float64]
SAMPLE = 0.2  # [s] between samples
SECOND = 5  # samples that are flown before winds are looked up again
WINDOW = 75  # samples before touchdown by which the motion is labelled
_SHRINK = 0.6  # the batch is made smaller when fewer than this share of it still fly


@dataclass(frozen=True)
class Weather:
    """What landings of a batch meet.

    Attributes:
        lowest: Altitude of the winds' first row [m].
        wind: By altitude in steps of `wind_plan.STEP` (K, 3, B), NED [m/s].
        latent: Disturbances by time (T, 4 + 3 n, B): wind (3), axial (n), pushes (2 n), roll.
        axial: Changes of the canopies' axial coefficients that last (n, B).
    """

    lowest: float
    wind: Array
    latent: Array
    axial: Array


class Landed(NamedTuple):
    """How a batch came down, (..., B).

    Attributes:
        outcome: 0: down; 1: not finite; 2: not down when the disturbances ended.
        time: Of touchdown from the start [s].
        states: At touchdown (X, B).
        across: Horizontal parts of the risers' directions in the window before (WINDOW, 2, n, B).
        path: Mean velocity of the canopies through the air in that window (3, B) [m/s].
        wind: At the capsule at touchdown (3, B) [m/s].
    """

    outcome: NDArray[np.int64]
    time: Array
    states: Array
    across: Array
    path: Array
    wind: Array


def at_altitude(weather: Weather, altitude: Array, lanes: NDArray[np.int64]) -> Array:
    """Wind (..., 3, B) at altitudes (..., B) of some landings, linear between rows [m/s]."""
    place = np.clip((altitude - weather.lowest) / STEP, 0.0, len(weather.wind) - 1.001)
    at = place.astype(int)
    within = (place - at)[..., None]
    values = (1.0 - within) * weather.wind[at, :, lanes] + within * weather.wind[at + 1, :, lanes]
    return np.asarray(np.moveaxis(values, -1, -2))


def descend(model: LandingFlight, theta: Array, x: Array, weather: Weather, floor: float) -> Landed:
    """Fly to the ground.

    Args:
        model: The cluster; its clock holds `SECOND` + 1 samples.
        theta: Parameters (P, B), working coordinates.
        x: States at the start (X, B).
        weather: What is met.
        floor: Altitude of the capsule's centre of mass at touchdown [m].
    """
    n, count = model.structure.canopies, x.shape[1]
    keep = WINDOW + SECOND + 1
    seen = np.zeros((keep, 2 * n + 3, count))
    landed = Landed(
        np.full(count, 2), np.full(count, np.nan), np.full_like(x, np.nan), np.full((WINDOW, 2, n, count), np.nan),
        np.full((3, count), np.nan), np.full((3, count), np.nan),
    )  # fmt: skip
    lanes = np.arange(count)
    attach = model.base.capsule.attach_b
    for k in range(0, len(weather.latent) - SECOND, SECOND):
        error = _met(weather, x, lanes, k, n)
        states = flown(model, theta, x, error)
        finite = np.isfinite(states).all(axis=(0, 1))
        fine = np.where(finite, states, 0.0)
        seen[(k + np.arange(SECOND + 1)) % keep] = _scattered(_watched(fine, error, n, attach), lanes, count)
        down = fine[:, 2] >= -floor
        over = down.any(axis=0) & finite & (landed.outcome[lanes] == 2)
        _touch(landed, states, error, down, seen, lanes, k, over, floor, n)
        landed.outcome[lanes[~finite & (landed.outcome[lanes] == 2)]] = 1
        x = np.where(finite, _unit(states[-1]), x)
        flying = landed.outcome[lanes] == 2
        if flying.sum() < _SHRINK * flying.size:  # until then, those that are down or failed fly on unheeded
            x, theta, lanes = x[:, flying], theta[:, flying], lanes[flying]
        if not lanes.size:
            break
    return landed


def _unit(x: Array) -> Array:
    """States with quaternions of unit length."""
    made = x.copy()
    made[6:10] /= np.linalg.norm(x[6:10], axis=0)
    return made


def _met(weather: Weather, x: Array, lanes: NDArray[np.int64], k: int, n: int) -> Array:
    """Disturbances (SECOND + 1, 7 + 3 n, B) of the next second."""
    ahead = SAMPLE * np.arange(SECOND + 1)[:, None]
    low = -x[2] - x[5] * ahead
    split = 13 + 3 * n
    canopies, moving = x[13:split].reshape(3, n, -1), x[split : split + 3 * n].reshape(3, n, -1)
    high = -canopies[2].mean(axis=0) - moving[2].mean(axis=0) * ahead
    latent = weather.latent[k : k + SECOND + 1][..., lanes]
    made = np.empty((SECOND + 1, rows(n), x.shape[1]))
    made[:, 0:3] = at_altitude(weather, low, lanes) + latent[:, :3]
    made[:, 3:6] = at_altitude(weather, high, lanes) + latent[:, :3]
    made[:, 6:] = latent[:, 3:]
    made[:, 6 : 6 + n] += weather.axial[:, lanes]
    return made


def _watched(states: Array, error: Array, n: int, attach: Vec3) -> Array:
    """Horizontal parts of the risers' directions and the canopies' mean velocity through the air (T, 2 n + 3, B)."""
    split = 13 + 3 * n
    shape = (len(states), 3, n, states.shape[2])
    place, speed = states[:, 13:split].reshape(shape), states[:, split : split + 3 * n].reshape(shape)
    arm = quaternion(states[:, 6:10].swapaxes(0, 1)).to_ned(attach)
    along = place - (states[:, 0:3] + np.stack([arm.x, arm.y, arm.z], axis=1))[:, :, None]
    unit = along[:, :2] / np.maximum(np.linalg.norm(along, axis=1), 1e-9)[:, None]
    air = speed.mean(axis=2) - error[:, 3:6]
    return np.concatenate([unit.reshape(len(states), 2 * n, -1), air], axis=1)


def _scattered(values: Array, lanes: NDArray[np.int64], count: int) -> Array:
    """Values of some landings (..., b) in their places among all (..., B)."""
    made = np.zeros((*values.shape[:-1], count))
    made[..., lanes] = values
    return made


def _touch(
    landed: Landed, states: Array, error: Array, down: NDArray[np.bool_], seen: Array, lanes: NDArray[np.int64],
    k: int, over: NDArray[np.bool_], floor: float, n: int,
) -> None:  # fmt: skip
    """Enter the landings that came down in this second, their states linear between the samples around touchdown."""
    keep = len(seen)
    for b in np.flatnonzero(over):
        lane, j = lanes[b], int(down[:, b].argmax())
        i = max(j - 1, 0)
        fall = states[j, 2, b] - states[i, 2, b]
        share = (-floor - states[i, 2, b]) / fall if j and fall > 0.0 else 0.0
        landed.outcome[lane] = 0
        landed.time[lane] = SAMPLE * (k + i + share)
        landed.states[:, lane] = (1.0 - share) * states[i, :, b] + share * states[j, :, b]
        landed.wind[:, lane] = (1.0 - share) * error[i, :3, b] + share * error[j, :3, b]
        last = k + j
        window = seen[np.arange(max(last - WINDOW + 1, 0), last + 1) % keep, :, lane]
        landed.path[:, lane] = window[:, 2 * n :].mean(axis=0)
        landed.across[-len(window) :, :, :, lane] = window[:, : 2 * n].reshape(-1, 2, n)
