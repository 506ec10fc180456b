"""Sensor models for virtual drops: correlated and white noise, dropouts, errors of the recorded wind."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SensorNoise:
    """Noise of one channel, in its SI unit: white and AR(1) standard deviations, time constant [s]."""

    white: float = 0.0
    correlated: float = 0.0
    time_constant: float = 1.0


@dataclass(frozen=True)
class Dropouts:
    """Missing stretches of a channel: share of samples, mean length [s]."""

    share: float = 0.0
    mean_length: float = 0.5


def ornstein_uhlenbeck(
    sd: float, time_constant: float, dt: float, shape: tuple[int, ...], rng: np.random.Generator
) -> Array:
    """A stationary Ornstein-Uhlenbeck process sampled along the first axis, exactly."""
    phi = float(np.exp(-dt / time_constant))
    z = rng.standard_normal(shape) * sd
    z[1:] *= np.sqrt(1.0 - phi**2)
    return np.asarray(lfilter([1.0], [1.0, -phi], z, axis=0))


def noisy(truth: Array, noise: SensorNoise, dt: float, rng: np.random.Generator) -> Array:
    """A series (T, ...) with a sensor's noise added."""
    correlated = ornstein_uhlenbeck(noise.correlated, noise.time_constant, dt, truth.shape, rng)
    return truth + correlated + noise.white * rng.standard_normal(truth.shape)


def missing(samples: int, dropouts: Dropouts, dt: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Which samples drop out: a two-state chain with the given share and mean length."""
    if dropouts.share <= 0.0:
        return np.zeros(samples, bool)
    leave = min(1.0, dt / dropouts.mean_length)
    enter = min(1.0, leave * dropouts.share / (1.0 - dropouts.share))
    lost, here = np.zeros(samples, bool), False
    for i, u in enumerate(rng.random(samples)):
        here = (u >= leave) if here else (u < enter)
        lost[i] = here
    return lost


def _turned(attitude: Array, turn: Array) -> Array:
    """Quaternions (T, 4) followed by small rotations (T, 3) [rad] in body axes."""
    w, v = attitude[:, :1], attitude[:, 1:]
    half = 0.5 * turn
    out = np.concatenate([w - np.sum(v * half, axis=1, keepdims=True), v + w * half + np.cross(v, half)], axis=1)
    return out / np.linalg.norm(out, axis=1, keepdims=True)


def record_of(
    truth: xr.Dataset, sensors: Mapping[str, SensorNoise], dropouts: Dropouts, rng: np.random.Generator
) -> xr.Dataset:
    """The record that instruments make of a true flight.

    Canopy positions are seen from the capsule (videogrammetry), so their noise adds to the capsule's recorded position.

    Args:
        truth: Noise-free record at a uniform rate, with `wind` the steady wind that forecasts could know.
        sensors: Noise by variable; variables without an entry are recorded exactly.
        dropouts: Missing stretches of `canopy_position`, per canopy.
        rng: Source of randomness.

    Returns:
        The record, same variables.
    """
    dt = float(truth["time"][1] - truth["time"][0])
    record = truth.copy(deep=True)
    for name in map(str, record.data_vars):
        if name in ("canopy_position", "capsule_attitude") or name not in sensors:
            continue
        record[name].values = noisy(truth[name].values, sensors[name], dt, rng)
    if "capsule_attitude" in truth and "capsule_attitude" in sensors:
        turn = noisy(np.zeros((truth.sizes["time"], 3)), sensors["capsule_attitude"], dt, rng)
        record["capsule_attitude"].values = _turned(truth["capsule_attitude"].values, turn)
    if "canopy_position" in truth:
        apart = (truth["canopy_position"] - truth["capsule_position"]).transpose("time", "canopy", "axis").values
        seen = noisy(apart, sensors.get("canopy_position", SensorNoise()), dt, rng)
        for i in range(seen.shape[1]):
            seen[missing(seen.shape[0], dropouts, dt, rng), i] = np.nan
        record["canopy_position"].values = record["capsule_position"].values[:, None, :] + seen
    return record
