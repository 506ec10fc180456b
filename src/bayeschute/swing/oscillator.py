"""Likelihood of a lightly damped oscillation in colored noise, in one pass of a Kalman filter.

A swing obeys ``x'' + 2 b x' + omega_n^2 x = c xi(t)`` (report, 6.3.1-22, with white forcing xi of intensity c), so
``x = exp(-b t) [C_1 sin(omega_d t) + C_2 cos(omega_d t)]`` (6.3.1-25) plus the response to the forcing since the
start. It is measured as an angle (x) or a rate (x'), in noise that is white plus an Ornstein-Uhlenbeck process. What
is linear (amplitudes, offsets, nuisances) enters as columns: the filter makes innovations of data and columns alike,
and least squares of the one on the others gives the rest. Samples that are missing are steps without an update.

Many sets of parameters go through at once (axis B); one set is a row ``PARAMETERS`` of numbers.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

Observed = Literal["angle", "rate"]

PARAMETERS = ("log_omega_d", "b", "log_forcing", "log_colored", "log_tau", "log_white")

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)


class Innovations(NamedTuple):
    """Columns after the filter.

    Attributes:
        columns: Innovations over their standard deviation (B, N, K); zero where the sample is missing.
        log_determinant: Logarithm of the determinant of the noise's covariance (B,).
    """

    columns: Float[np.ndarray, "B N K"]
    log_determinant: Float[np.ndarray, " B"]


def free_response(psi: Float[np.ndarray, "B 6"], time: Float[np.ndarray, " N"]) -> Float[np.ndarray, "B N 2"]:
    """Damped sine and cosine (6.3.1-25).

    Args:
        psi: Rows of `PARAMETERS`.
        time: Times from the start [s].

    Returns:
        exp(-b t) sin(omega_d t) and exp(-b t) cos(omega_d t).
    """
    phase = np.exp(psi[:, :1]) * time
    decay = np.exp(-psi[:, 1:2] * time)
    return np.stack([decay * np.sin(phase), decay * np.cos(phase)], axis=-1)


def _impulse(omega: np.ndarray, b: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angle and rate a time s after a unit kick."""
    decay, sine = np.exp(-b * s), np.sin(omega * s) / omega
    return decay * sine, decay * (np.cos(omega * s) - b * sine)


def transition(psi: Float[np.ndarray, "B 6"], dt: float) -> tuple[np.ndarray, np.ndarray]:
    """One step of the state (x, x', colored noise): transition and added covariance.

    The covariance added by the forcing, ``c^2 int h h'``, is by Gauss-Legendre quadrature, exact to rounding for steps
    below a radian.

    Args:
        psi: Rows of `PARAMETERS`.
        dt: Step [s].

    Returns:
        (B, 3, 3) and (B, 3, 3).
    """
    omega, b, phi = np.exp(psi[:, 0]), psi[:, 1], np.exp(-dt / np.exp(psi[:, 4]))
    h, g = _impulse(omega, b, np.full_like(omega, dt))
    step, added = np.zeros((psi.shape[0], 3, 3)), np.zeros((psi.shape[0], 3, 3))
    step[:, 0, 0], step[:, 0, 1] = g + 2.0 * b * h, h
    step[:, 1, 0], step[:, 1, 1] = -(omega**2 + b**2) * h, g
    step[:, 2, 2] = phi
    hs, gs = _impulse(omega[:, None], b[:, None], 0.5 * dt * (1.0 + _NODES))
    power = np.exp(2.0 * psi[:, 2]) * 0.5 * dt
    added[:, 0, 0] = power * (hs**2 @ _WEIGHTS)
    added[:, 0, 1] = added[:, 1, 0] = power * ((hs * gs) @ _WEIGHTS)
    added[:, 1, 1] = power * (gs**2 @ _WEIGHTS)
    added[:, 2, 2] = np.exp(2.0 * psi[:, 3]) * (1.0 - phi**2)
    return step, added


def whiten(
    columns: Float[np.ndarray, "B N K"], psi: Float[np.ndarray, "B 6"], dt: float, observed: Observed = "rate"
) -> Innovations:
    """Innovations of columns under the noise of every parameter set.

    The oscillator starts from zero: its free motion belongs to the columns (`free_response`).

    Args:
        columns: Data and regressors along time; a first axis of 1 serves all parameter sets. A sample is missing where
            the first column is NaN.
        psi: Rows of `PARAMETERS`.
        dt: Sample interval [s].
        observed: Whether angle or rate is seen.

    Returns:
        Innovations and the determinant.
    """
    B, N, K = psi.shape[0], columns.shape[1], columns.shape[2]
    step, added = transition(psi, dt)
    place = 0 if observed == "angle" else 1
    white = np.exp(2.0 * psi[:, 5])
    seen = np.isfinite(columns[0, :, 0])
    out, variance = np.zeros((B, N, K)), np.ones((B, N))
    mean, cov = np.zeros((B, 3, K)), np.zeros((B, 3, 3))
    cov[:, 2, 2] = np.exp(2.0 * psi[:, 3])
    turned = np.swapaxes(step, 1, 2)
    for i in range(N):
        if seen[i]:
            cross = cov[:, :, place] + cov[:, :, 2]
            variance[:, i] = cross[:, place] + cross[:, 2] + white
            gain = cross / variance[:, i, None]
            out[:, i] = columns[:, i] - (mean[:, place] + mean[:, 2])
            mean += gain[:, :, None] * out[:, i, None, :]
            cov -= gain[:, :, None] * cross[:, None, :]
        mean = step @ mean
        cov = step @ cov @ turned + added
    out /= np.sqrt(variance)[:, :, None]
    return Innovations(out, np.log(variance).sum(axis=1))
