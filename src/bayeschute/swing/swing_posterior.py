"""Posterior density of a swing's frequency and damping, its noise unknown.

Amplitudes (normal, broad), offsets and nuisances (flat) are integrated out, the former apart from the latter; six
numbers remain (`bayeschute.swing.oscillator`).

Priors: given the amplitude at the start, Jeffreys' prior of frequency and decay rate is the energy
``int exp(-2 b t) dt`` of the motion, which falls as 1/b for damped swings; growing ones get no more than a steady one.
(Flat in b, the damping of short records came out half a standard error too high, and with amplitudes flat over the
record as low [measured].) Frequency and damping are bounded softly by the band and by b = omega_d. Noise: flat in its
variance below a scale taken from the data, with Cauchy tails above; forcing likewise, with a density that rises as its
square, since a few cycles show less of it than there is [measured]. The noise's time constant is log-normal.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from bayeschute.swing.oscillator import Observed, free_response, whiten

LEAST_FORCING = -40.0  # log of a forcing that does nothing

_STEP = np.array([0.01, 0.06, 0.4, 0.3, 0.3, 0.3])  # sizes of the parameters, for steps and differences
_CHUNK = 4_000_000  # numbers held at once
_TAU_SD = 1.0  # of the logarithm of the time constant
_EDGE = 0.05  # softness of the bounds of log frequency and of b/omega_d
_BROAD = 10.0  # prior sd of an amplitude over the size of the data
_MOST_DAMPED = 1.0  # b/omega_d beyond which a motion is no swing


@dataclass(frozen=True)
class SwingProblem:
    """Data and settings of the posterior.

    Attributes:
        data: Channels along time (N, C); a sample is missing in all of them or in none.
        nuisance: Regressors with one coefficient for all channels (N, C, k).
        dt: Sample interval [s].
        observed: Whether data are angles or rates.
        forcing: Whether the swing is forced by noise.
        frequency: Where to start [Hz].
        band: Where the frequency must lie, softly [Hz].
        scale: Size of the data, for priors.
    """

    data: Float[np.ndarray, "N C"]
    nuisance: Float[np.ndarray, "N C k"]
    dt: float
    observed: Observed
    forcing: bool
    frequency: float
    band: tuple[float, float]
    scale: float

    @property
    def free(self) -> list[int]:
        """Places of the parameters that are estimated."""
        return [0, 1, 2, 3, 4, 5] if self.forcing else [0, 1, 3, 4, 5]

    @property
    def centre(self) -> Float[np.ndarray, " 6"]:
        """Scales of the priors, and where the search starts."""
        omega, sd = 2.0 * np.pi * self.frequency, self.scale
        forced = 0.3 * sd * np.sqrt(2.0 * self.frequency) * (omega if self.observed == "angle" else 1.0)
        noise = np.log([forced, 0.5 * sd, 0.3 / self.frequency, 0.1 * sd])
        if not self.forcing:
            noise[0] = LEAST_FORCING
        return np.array([np.log(omega), 0.0, *noise])

    @property
    def step(self) -> Float[np.ndarray, " 6"]:
        """Sizes of the parameters."""
        return np.asarray(_STEP * np.array([1.0, self.frequency, 1.0, 1.0, 1.0, 1.0]))


class Solved(NamedTuple):
    """Marginal posterior of parameter sets and what is linear given them.

    Attributes:
        log_density: (B,).
        linear: Coefficients (B, p): sine and cosine per channel, offset per channel, nuisances.
        precision: Of the coefficients (B, p, p).
    """

    log_density: Float[np.ndarray, " B"]
    linear: Float[np.ndarray, "B p"]
    precision: Float[np.ndarray, "B p p"]


def _columns(problem: SwingProblem, psi: np.ndarray) -> np.ndarray:
    """Data, nuisances, offset and free motion (B, N, C + C k + 3)."""
    N, C = problem.data.shape
    free = free_response(psi, np.arange(N) * problem.dt)
    fixed = np.concatenate([problem.data, problem.nuisance.reshape(N, -1), np.ones((N, 1))], axis=1)
    shared = np.broadcast_to(fixed, (len(psi), *fixed.shape))
    return np.concatenate([shared, free], axis=2)


def design(problem: SwingProblem, columns: np.ndarray, channel: int) -> tuple[np.ndarray, np.ndarray]:
    """Regressors (B, N, p) of a channel and its data (B, N), taken from columns in the order of `_columns`."""
    C, k = problem.data.shape[1], problem.nuisance.shape[2]
    made = np.zeros((*columns.shape[:2], 3 * C + k))
    made[:, :, 2 * channel : 2 * channel + 2] = columns[:, :, -2:]
    made[:, :, 2 * C + channel] = columns[:, :, -3]
    made[:, :, 3 * C :] = columns[:, :, C + channel * k : C + (channel + 1) * k]
    return made, columns[:, :, channel]


def _log_prior(problem: SwingProblem, psi: np.ndarray) -> np.ndarray:
    away = psi - problem.centre
    low, high = (np.log(2.0 * np.pi * f) for f in problem.band)
    outside = np.maximum(low - psi[:, 0], 0.0) + np.maximum(psi[:, 0] - high, 0.0)
    damped = np.maximum(np.abs(psi[:, 1]) * np.exp(-psi[:, 0]) - _MOST_DAMPED, 0.0)
    walls = -0.5 * (outside**2 + damped**2) / _EDGE**2
    span = 2.0 * psi[:, 1] * problem.dt * problem.data.shape[0]
    total = walls - np.log1p(np.logaddexp(0.0, span)) - 0.5 * (away[:, 4] / _TAU_SD) ** 2
    for place, power in ((2, 3.0), (3, 2.0), (5, 2.0)):
        if place != 2 or problem.forcing:
            total = total + power * away[:, place] - 0.5 * (power + 1.0) * np.logaddexp(0.0, 2.0 * away[:, place])
    return np.asarray(total)


def solve(problem: SwingProblem, psi: Float[np.ndarray, "B 6"]) -> Solved:
    """Log density of parameter sets, linear parameters integrated out.

    Args:
        problem: The data.
        psi: Rows of `PARAMETERS`.

    Returns:
        Density up to a constant, -inf where it can't be computed; coefficients and their precision.
    """
    N, C = problem.data.shape
    rows = max(_CHUNK // (N * (C + problem.nuisance.shape[2] * C + 3)), 1)
    parts = [_solve(problem, psi[i : i + rows]) for i in range(0, len(psi), rows)]
    return Solved(*(np.concatenate([part[i] for part in parts]) for i in range(3)))


def _solve(problem: SwingProblem, psi: np.ndarray) -> Solved:
    C = problem.data.shape[1]
    with np.errstate(all="ignore"):
        columns = _columns(problem, psi)
        white = whiten(columns, psi, problem.dt, problem.observed)
        p = 3 * C + problem.nuisance.shape[2]
        precision, right, square = np.zeros((len(psi), p, p)), np.zeros((len(psi), p)), np.zeros(len(psi))
        waves = np.arange(2 * C)
        precision[:, waves, waves] = 1.0 / (_BROAD * problem.scale) ** 2
        for channel in range(C):
            X, z = design(problem, white.columns, channel)
            turned = np.swapaxes(X, 1, 2)
            precision, right = precision + turned @ X, right + (turned @ z[:, :, None])[:, :, 0]
            square = square + np.einsum("bn,bn->b", z, z)
        # By blocks: a frequency at which the swing repeats a nuisance would gain by the determinant of both.
        spread = sum(
            np.linalg.slogdet(block)[1] for block in (precision[:, : 2 * C, : 2 * C], precision[:, 2 * C :, 2 * C :])
        )
        good = (
            (np.linalg.slogdet(precision)[0] > 0)
            & np.isfinite(spread)
            & np.isfinite(square)
            & np.isfinite(white.log_determinant)
        )
        eye = np.eye(precision.shape[1])
        precision = np.where(good[:, None, None], precision, eye)
        linear = np.linalg.solve(precision, np.where(good[:, None], right, 0.0)[:, :, None])[:, :, 0]
        cost = C * white.log_determinant + spread + square - np.einsum("bp,bp->b", linear, right)
        density = -0.5 * cost + _log_prior(problem, psi)
    return Solved(np.where(good & np.isfinite(density), density, -np.inf), linear, precision)


def whitened(
    problem: SwingProblem, psi: Float[np.ndarray, "B 6"]
) -> tuple[list[tuple[np.ndarray, np.ndarray]], np.ndarray]:
    """Per channel the regressors and data after the filter, and the coefficients of the one on the other.

    Args:
        problem: The data.
        psi: Rows of `PARAMETERS`.

    Returns:
        Regressors (B, N, p) and data (B, N) of every channel; coefficients (B, p).
    """
    white = whiten(_columns(problem, psi), psi, problem.dt, problem.observed)
    parts = [design(problem, white.columns, channel) for channel in range(problem.data.shape[1])]
    return parts, solve(problem, psi).linear
