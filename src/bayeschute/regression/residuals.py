"""Residual analysis: autocorrelation and spectrum of residuals, and predictions of rows that were left out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy import linalg

from bayeschute.core.errors import Fault, InputError
from bayeschute.regression.colored_errors import ColoredNoise
from bayeschute.regression.problem import group_variance, read_problem, row_labels
from bayeschute.regression.series import Labels


class Autocorrelation(NamedTuple):
    """Autocorrelation and spectrum of residuals, both tapered as in the colored covariance.

    Attributes:
        lag: Lags [s].
        correlation: Autocorrelation at these lags.
        frequency: Frequencies [Hz].
        spectrum: One-sided power spectral density [unit of z, squared, per Hz].
        integrated_time: Integrated autocorrelation time; dt for white noise [s].
    """

    lag: Float[np.ndarray, " K"]
    correlation: Float[np.ndarray, " K"]
    frequency: Float[np.ndarray, " F"]
    spectrum: Float[np.ndarray, " F"]
    integrated_time: float


class Press(NamedTuple):
    """Predictions of rows, or whole blocks, that were left out of the fit.

    Attributes:
        residual: z minus the prediction from the other rows, NaN in gaps, (N,).
        press: Sum of their squares [unit of z, squared].
        rms: Root mean square [unit of z].
        r2: 1 - press/N/variance of z about its mean; NaN if z is constant.
        ratio: rms over the rms of the fit's residuals; NaN for a perfect fit.
    """

    residual: Float[np.ndarray, " N"]
    press: float
    rms: float
    r2: float
    ratio: float


def autocorrelation(noise: ColoredNoise, dt: float, *, frequencies: int = 257) -> Autocorrelation:
    """Autocorrelation and spectrum of residuals, series weighted by their number of rows.

    Args:
        noise: From `residual_noise` or `EquationErrorFit.noise`.
        dt: Sample interval [s].
        frequencies: Number of frequencies from 0 to 1/(2 dt).

    Returns:
        Lags, correlation, frequencies, spectrum and integrated time.

    Raises:
        InputError: If dt isn't above 0 or fewer than 2 frequencies are requested.
    """
    if not (np.isfinite(dt) and dt > 0.0) or frequencies < 2:
        raise InputError(Fault("autocorrelation", f"dt {dt!r}, {frequencies} frequencies", "dt > 0 and 2 or more"))
    last = max(c.shape[2] // 2 for c in noise.covariance)
    mean, rows = np.zeros(last + 1), 0
    for series, c in zip(noise.series, noise.covariance, strict=True):
        K = c.shape[2] // 2
        for i, members in enumerate(series.rows):
            mean[: K + 1] += members.size * c[i, i, K:]
            rows += members.size
    mean /= max(rows, 1)
    frequency = np.linspace(0.0, 0.5 / dt, frequencies)
    phase = 2.0 * np.pi * dt * np.outer(frequency, np.arange(1, last + 1))
    spectrum = 2.0 * dt * (mean[0] + 2.0 * np.cos(phase) @ mean[1:])
    shape = mean / mean[0] if mean[0] > 0.0 else np.zeros_like(mean)
    return Autocorrelation(
        dt * np.arange(last + 1), shape, frequency, np.maximum(spectrum, 0.0), dt * noise.integrated_time
    )


def press(
    X: Float[np.ndarray, "N p"],
    z: Float[np.ndarray, " N"],
    *,
    folds: Labels = None,
    components: Labels = None,
) -> Press:
    """Residuals of predictions from the other rows, without refitting: e_i/(1 - h_ii), or (I - H_bb)^-1 e_b by block.

    Leaving out single rows flatters a model when residuals remember; leave out blocks longer than their memory then.

    Args:
        X: Regressors, (N, p).
        z: Response, (N,).
        folds: Rows with the same label are left out together. None: one at a time.
        components: Label of each row; r2 is about the mean of each. None: one.

    Returns:
        Left-out residuals and their size.

    Raises:
        InputError: For bad input, dependent columns, or a row or block without which the fit is impossible.
    """
    problem = read_problem(X, z, None, "press")
    n, p = problem.X.shape
    length = np.linalg.norm(problem.X, axis=0)
    if n <= p or (length == 0.0).any():
        raise InputError(Fault("press", f"{n} rows, {p} columns", "more rows than columns, no column of zeros"))
    Q, R, _ = linalg.qr(problem.X / length, mode="economic", pivoting=True)
    if np.abs(R[-1, -1]) <= 1e-11:
        raise InputError(Fault("press columns", "columns that depend on each other", "independent columns"))
    rest = problem.z - Q @ (Q.T @ problem.z)
    fold = np.arange(n) if folds is None else row_labels(folds, problem.used.size, "press folds")[problem.used]
    out = np.empty(n)
    order = np.argsort(fold, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(fold[order])) + 1):
        # (I - QQ')^-1 = I + Q (I - Q'Q)^-1 Q' in the block: p x p however long the block
        block = Q[rows]
        kept = np.eye(p) - block.T @ block
        if np.linalg.eigvalsh(kept)[0] <= 1e-10:
            got = f"{rows.size} row(s) that alone carry some coefficient"
            raise InputError(Fault("press", got, "rows or blocks that the others can replace", "Use longer records."))
        out[rows] = rest[rows] + block @ np.linalg.solve(kept, block.T @ rest[rows])
    labels = row_labels(components, problem.used.size, "press components")[problem.used]
    variance = group_variance(problem.z, labels)
    total, fitted = float(out @ out), float(rest @ rest)
    residual = np.full(problem.used.size, np.nan)
    residual[problem.used] = out
    return Press(
        residual,
        total,
        float(np.sqrt(total / n)),
        1.0 - total / n / variance if variance > 0.0 else np.nan,
        float(np.sqrt(total / fitted)) if fitted > 0.0 else np.nan,
    )
