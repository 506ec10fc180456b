"""Biases of recorded velocities (report, section 7.4).

A bias of the recorded velocity shows as a drift of what velocities carry the body to, away from where it was.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.signal import lfilter
from scipy.stats import norm

from bayeschute.core.errors import Fault, InputError
from bayeschute.records.derive import uniform_interval
from bayeschute.records.record import AXIS, Repair, values_of, with_repairs

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

SHORTEST = 20  # samples
LEVEL = 0.999  # of confidence that a bias isn't chance; measured, chance alone passes it once in 280 axes
_BLOCKS = 40  # means of so many parts of a record tell its noise
_RATIOS = np.geomspace(1e-2, 1e4, 19)  # of what the noises of velocity and position do to those means
_MEMORIES = (0.0, 0.02, 0.06, 0.18)  # time constants of either noise, over the record's length


class VelocityBias(NamedTuple):
    """Biases of recorded velocities; components (...).

    Attributes:
        bias: Mean of the recorded less the true velocity (...) [m/s].
        se: Its standard error (...) [m/s].
        drift: Where the bias would carry the body over the record, off its place (...) [m].
    """

    bias: Array
    se: Array
    drift: Array

    def found(self, level: float = LEVEL) -> NDArray[np.bool_]:
        """Which components have a bias that isn't chance, at a level of confidence (...)."""
        return np.asarray(np.abs(self.bias) > norm.ppf(0.5 + 0.5 * level) * self.se)


def velocity_bias(velocity: NDArray, position: NDArray, dt: float) -> VelocityBias:
    """Constant biases of recorded velocities, from the positions recorded beside.

    Integrals of velocity less positions are a line whose slope is the bias, plus the noise of the positions, plus the
    integral of the velocities' noise; each noise is a first-order Markov process. Means over forty parts of the record
    tell how much there is of either and how long it remembers: the slope is their generalised least squares estimate,
    averaged over ratios and time constants of the noises by their likelihood, with line and scale integrated out. The
    axes of a vector have ratio and time constants in common, and scales of their own.

    Args:
        velocity: Recorded (T, ..., axis) [m/s], or (T,); NaN where missing: the longest stretch without a gap counts.
        position: Recorded, same shape [m]; NaN where missing.
        dt: Sample interval [s].

    Raises:
        InputError: If shapes differ or fewer than `SHORTEST` samples are there.
    """
    v, p = _alike(velocity, position, "velocity")
    shape = np.shape(velocity)[1:]
    axes = shape[-1] if shape else 1
    told = [_slope(v[:, c : c + axes], p[:, c : c + axes], dt) for c in range(0, v.shape[1], axes)]
    bias, se, drift = np.array(told).reshape(-1, 3, axes).swapaxes(0, 1).reshape(3, *shape)
    return VelocityBias(bias, se, drift)


def _slope(v: Array, p: Array, dt: float) -> tuple[Array, Array, Array]:
    """Bias, its standard error and its drift of the axes (T, axes) of one vector."""
    run = _longest(np.asarray(np.isfinite(v).all(axis=1)))
    v, p = v[run], p[run]
    known = np.asarray(np.isfinite(p).all(axis=1))
    _enough(int(known.sum()), "positions with velocities")
    t = dt * np.arange(len(v))
    carried = np.concatenate([np.zeros((1, v.shape[1])), np.cumsum(0.5 * dt * (v[1:] + v[:-1]), axis=0)]) - p
    part = np.minimum(_BLOCKS * np.arange(len(v)) // len(v), _BLOCKS - 1)
    mean = (part == np.unique(part[known])[:, None]) & known
    mean = mean / mean.sum(axis=1, keepdims=True)
    y, x = mean @ np.where(known[:, None], carried, 0.0), np.stack([np.ones(len(mean)), mean @ t], axis=1)
    after = np.cumsum(mean[:, ::-1], axis=1)[:, ::-1][:, 1:]  # what a velocity's noise does to every mean
    by_velocity, by_position = (_covariances(effect) for effect in (after, mean))
    cases = product(by_position, by_velocity, _RATIOS)
    tried = [_known_noise(y, x, first + ratio * second) for first, second, ratio in cases]
    log_weight, slope, variance = (np.array(rows) for rows in zip(*tried, strict=True))
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    bias = weight @ slope
    se = np.sqrt(weight @ (variance + (slope - bias) ** 2))
    return bias, se, bias * float(t[-1])


def _covariances(effect: Array) -> list[Array]:
    """Covariances, of mean trace one, of what noise of every memory does to means; effect (means, samples) of each."""
    made = []
    for memory in _MEMORIES:
        phi = np.exp(-1.0 / (memory * effect.shape[1])) if memory else 0.0
        by_shock = lfilter([1.0], [1.0, -phi], effect[:, ::-1], axis=1)[:, ::-1].copy()
        by_shock[:, 0] /= np.sqrt(1.0 - phi**2)  # stationary from the start
        covariance = by_shock @ by_shock.T
        made.append(covariance * (len(covariance) / np.trace(covariance)))
    return made


def _known_noise(y: Array, x: Array, covariance: Array) -> tuple[float, Array, Array]:
    """Log likelihood (lines and scales integrated out), slopes and their variances; covariance up to its scale."""
    factor = cho_factor(covariance, lower=True)
    solved = cho_solve(factor, x)
    information = x.T @ solved
    line = np.linalg.solve(information, solved.T @ y)
    off = y - x @ line
    misfit = (off * cho_solve(factor, off)).sum(axis=0) + 1e-30
    freedom, axes = y.shape[0] - 2, y.shape[1]
    log_determinant = 2.0 * float(np.log(np.diag(factor[0])).sum()) + float(np.linalg.slogdet(information)[1])
    variance = misfit / (freedom - 2) * float(np.linalg.inv(information)[1, 1])  # of Student's t
    log_likelihood = -0.5 * (freedom * float(np.log(misfit).sum()) + axes * log_determinant)
    return log_likelihood, line[1], variance


def remove_velocity_bias(record: xr.Dataset, level: float = LEVEL) -> tuple[xr.Dataset, VelocityBias]:
    """Take constant biases off the capsule's recorded velocity, component by component.

    Args:
        record: At a uniform rate, with ``capsule_velocity`` and ``capsule_position``.
        level: Of confidence at which a component's bias counts as found; others stay as they are.

    Returns:
        The record, with what was done among its repairs, and the biases that were found before.

    Raises:
        InputError: If a variable is missing, the rate isn't uniform or too few samples are there.
    """
    missing = [name for name in ("capsule_velocity", "capsule_position") if name not in record]
    if missing:
        wanted = "that variable beside the other"
        raise InputError([Fault("velocity bias", f"a record without {name}", wanted) for name in missing])
    time, name = record["time"].values, "capsule_velocity"
    dt = uniform_interval(time, "velocity bias")
    velocity = values_of(record, name)
    told = velocity_bias(velocity, values_of(record, "capsule_position"), dt)
    found = told.found(level)
    parts = zip(AXIS, told.bias, told.se, found, strict=True)
    words = [f"{axis} {b:+.3g} +- {se:.2g} m/s {'removed' if f else 'kept as chance'}" for axis, b, se, f in parts]
    count = int(np.isfinite(velocity).all(axis=1).sum())
    kind = "bias" if found.any() else "derived"
    note = Repair(kind, name, float(time[0]), float(time[-1]), count, "constant bias: " + ", ".join(words))
    values = velocity - np.where(found, told.bias, 0.0)
    changed = record.assign({name: (("time", "axis"), values, record[name].attrs)})
    return with_repairs(changed, [note]), told


def _alike(driving: NDArray, position: NDArray, what: str) -> tuple[Array, Array]:
    """Both as (T, components)."""
    if np.shape(driving) != np.shape(position) or np.ndim(driving) < 1:
        raise InputError(Fault(f"back-driving, {what}", f"shape {np.shape(driving)}", f"{np.shape(position)}"))
    samples = len(driving)
    return np.asarray(driving, float).reshape(samples, -1), np.asarray(position, float).reshape(samples, -1)


def _longest(present: NDArray[np.bool_]) -> slice:
    """The longest stretch without a gap."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], present.astype(np.int8), [0]])))
    starts, ends = edges[::2], edges[1::2]
    if not starts.size:
        return slice(0, 0)
    at = int(np.argmax(ends - starts))
    return slice(int(starts[at]), int(ends[at]))


def _enough(count: int, what: str) -> None:
    if count < SHORTEST:
        raise InputError(Fault("back-driving", f"{count} {what} in one stretch", f"at least {SHORTEST}"))
