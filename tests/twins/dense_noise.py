"""Naive twins of the Gaussian laws: dense covariance matrices, factored as they are."""

from __future__ import annotations

import numpy as np


def stationary_covariance(times: np.ndarray, sd: float, time_constant: float) -> np.ndarray:
    """Covariance of an Ornstein-Uhlenbeck process at any times."""
    return sd**2 * np.exp(-np.abs(times[:, None] - times[None, :]) / time_constant)


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
