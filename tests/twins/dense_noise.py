"""Naive twins of the Gaussian laws: dense covariance matrices, factored as they are."""

from __future__ import annotations

import numpy as np


def stationary_covariance(times: np.ndarray, sd: float, time_constant: float) -> np.ndarray:
    """Covariance of an Ornstein-Uhlenbeck process at any times."""
    return sd**2 * np.exp(-np.abs(times[:, None] - times[None, :]) / time_constant)


def oscillator_covariance(times: np.ndarray, sd: float, frequency: float, damping_ratio: float) -> np.ndarray:
    """Covariance of ``x'' + 2 zeta w x' + w^2 x = white noise`` at any times: under- or overdamped, not critical."""
    omega, lag = 2.0 * np.pi * frequency, np.abs(times[:, None] - times[None, :])
    damped = omega * np.sqrt(1.0 - damping_ratio**2 + 0.0j)
    swing = np.cos(damped * lag) + damping_ratio * omega / damped * np.sin(damped * lag)
    return sd**2 * np.exp(-damping_ratio * omega * lag) * swing.real


def disturbance_covariance(latent, laws, times: np.ndarray) -> np.ndarray:
    """Covariance of the disturbances (T, A) of several processes, rows of one sample next to each other."""
    kernel = {"drift": stationary_covariance, "oscillator": oscillator_covariance}
    rows = 1 + max(row for row, _ in latent.processes)
    out = np.zeros((times.size, rows, times.size, rows))
    for row, group in latent.processes:
        out[:, row, :, row] += kernel[latent.kinds[group]](times, *laws[group])
    return out.reshape(times.size * rows, -1)


def noise_covariance(
    times: np.ndarray, present: np.ndarray, white: np.ndarray, correlated: np.ndarray, time_constant: np.ndarray
) -> np.ndarray:
    """Covariance of the present samples of all outputs, one output after the other."""
    blocks = [
        stationary_covariance(times[here], c, tau) + w**2 * np.eye(int(here.sum()))
        for here, w, c, tau in zip(present.T, white, correlated, time_constant, strict=True)
    ]
    size = sum(len(b) for b in blocks)
    out, at = np.zeros((size, size)), 0
    for b in blocks:
        out[at : at + len(b), at : at + len(b)] = b
        at += len(b)
    return out


def stack(series: np.ndarray, present: np.ndarray) -> np.ndarray:
    """Present samples of (T, C, ...) in the order of `noise_covariance`."""
    return np.concatenate([series[here, c] for c, here in enumerate(present.T)])


def gaussian_log_density(x: np.ndarray, covariance: np.ndarray) -> float:
    """Log density of a centred Gaussian."""
    sign, log_det = np.linalg.slogdet(covariance)
    assert sign > 0
    return float(-0.5 * (x @ np.linalg.solve(covariance, x) + log_det + x.size * np.log(2.0 * np.pi)))
