"""What a record can and can't tell: collinearity, residuals, left-out predictions, Theil's inequality, null models."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy import linalg

from bayeschute.errors import Fault, InputError
from bayeschute.regression.colored import ColoredNoise, Labels
from bayeschute.regression.orthogonal import group_variance, out_of_range, read_problem, row_labels

HIGH_CORRELATION = 0.9
HIGH_VIF = 10.0
HIGH_CONDITION = 30.0
LOW_SNR = 3.0


class Collinearity(NamedTuple):
    """How much the regressors resemble each other.

    Attributes:
        names: Name of each regressor.
        correlation: Correlation coefficients, NaN for a constant column (6.3.5-12), (p, p).
        max_correlation: The largest magnitude between two different columns; 0 for fewer than two.
        pair: The two columns it belongs to; empty names for fewer than two.
        vif: Variance inflation factor 1/(1 - R_j^2) of each column against the others; NaN for a constant, (p,).
        max_vif: The largest; 1 if there is none.
        condition_index: Largest over smallest singular value of the columns scaled to length 1, means kept (Belsley).
        flags: Which of ``"correlation"``, ``"vif"``, ``"condition"`` are beyond 0.9, 10, 30.
        sentences: What is flagged, in words; says so if nothing is.
    """

    names: tuple[str, ...]
    correlation: Float[np.ndarray, "p p"]
    max_correlation: float
    pair: tuple[str, str]
    vif: Float[np.ndarray, " p"]
    max_vif: float
    condition_index: float
    flags: tuple[str, ...]
    sentences: tuple[str, ...]

    @property
    def flagged(self) -> bool:
        """Whether anything is beyond its limit."""
        return bool(self.flags)


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


class Theil(NamedTuple):
    """Theil's inequality coefficient and where the mean squared error comes from.

    Attributes:
        coefficient: rms(z - y)/(rms(z) + rms(y)); 0 perfect, 1 useless.
        bias: Share from unequal means.
        variance: Share from unequal standard deviations.
        covariance: Share from imperfect correlation; a good model has most here.
    """

    coefficient: float
    bias: float
    variance: float
    covariance: float


class NullModel(NamedTuple):
    """A model that knows no aerodynamics, to stand beside a fit.

    Attributes:
        name: ``"constant"`` or ``"constant force"``.
        coefficient: The constant [unit of z], or the force over reference area [Pa].
        r2: Share of the variance of z about its mean that it explains; below 0 if worse than the mean.
        rms: Root mean square error [unit of z].
        prediction: Its values, NaN in gaps, (N,).
    """

    name: str
    coefficient: float
    r2: float
    rms: float
    prediction: Float[np.ndarray, " N"]


class SignalToNoise(NamedTuple):
    """Signal over noise, both variants.

    Attributes:
        about_mean: rms(signal - mean)/sigma.
        with_mean: rms(signal)/sigma.
        sufficient: Whether `about_mean` is above 3 (report, 6.3.5).
    """

    about_mean: float
    with_mean: float
    sufficient: bool


def collinearity(
    X: Float[np.ndarray, "N p"], names: Sequence[str] | None = None, *, centred: bool = True
) -> Collinearity:
    """Correlation, variance inflation and condition index of regressors, with flags.

    Args:
        X: Regressors; rows with a NaN are left out, (N, p).
        names: Name of each regressor.
        centred: Take means off for correlation and variance inflation, as the report does. False suits the stacked
            components of a vector regression without constant: nothing depends on the axes then.

    Returns:
        The numbers, flags and sentences.

    Raises:
        InputError: For bad X, or a column of zeros.
    """
    problem = read_problem(X, np.zeros(np.shape(X)[0] if np.ndim(X) else 0), names, "collinearity")
    names, columns = problem.names, problem.X
    length = np.linalg.norm(columns, axis=0)
    if (length == 0.0).any() or not np.isfinite(length).all():
        bad = [names[j] for j in np.flatnonzero((length == 0.0) | ~np.isfinite(length))]
        raise InputError(Fault("collinearity columns", f"zeros or unbounded values in {bad}", "columns that vary"))
    singular = np.linalg.svd(columns / length, compute_uv=False)
    full = len(singular) == len(names) and singular[-1] > np.finfo(float).eps * max(columns.shape) * singular[0]
    condition = float(singular[0] / singular[-1]) if full else np.inf
    correlation, vif = _correlation(columns, length, centred)
    off = np.abs(np.triu(correlation, 1))
    largest, pair = 0.0, ("", "")
    if np.isfinite(off).any() and len(names) > 1:
        i, j = np.unravel_index(int(np.nanargmax(np.where(np.isnan(off), -1.0, off))), off.shape)
        if i != j:
            largest, pair = float(off[i, j]), (names[int(i)], names[int(j)])
    worst = float(np.nanmax(vif)) if np.isfinite(vif).any() or np.isinf(vif).any() else 1.0
    flags, sentences = _judged(names, largest, pair, vif, worst, condition)
    return Collinearity(names, correlation, largest, pair, vif, worst, condition, flags, sentences)


def autocorrelation(noise: ColoredNoise, dt: float, *, frequencies: int = 257) -> Autocorrelation:
    """Autocorrelation and spectrum of residuals, series weighted by their number of rows.

    Args:
        noise: From `residual_noise` or `EquationErrorFit.noise`.
        dt: Sample interval [s].
        frequencies: Number of frequencies from 0 to 1/(2 dt).

    Returns:
        Lags, correlation, frequencies, spectrum and integrated time.

    Raises:
        InputError: If dt isn't above 0 or fewer than 2 frequencies are asked for.
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


def theil(z: Float[np.ndarray, " N"], y: Float[np.ndarray, " N"]) -> Theil:
    """Theil's inequality coefficient of a prediction and its three shares.

    Args:
        z: Data, (N,).
        y: Prediction, (N,); pairs with a NaN are left out.

    Returns:
        Coefficient and shares; 0 and equal to 0 for a perfect prediction.

    Raises:
        InputError: For unequal shapes or no complete pair.
    """
    z, y = _pairs(z, y, "theil")
    mse, scale = float(np.mean((z - y) ** 2)), float(np.sqrt(np.mean(z**2)) + np.sqrt(np.mean(y**2)))
    if mse == 0.0:
        return Theil(0.0, 0.0, 0.0, 0.0)
    sz, sy = float(np.std(z)), float(np.std(y))
    bias, variance = float((z.mean() - y.mean()) ** 2) / mse, (sz - sy) ** 2 / mse
    return Theil(float(np.sqrt(mse)) / scale, bias, variance, max(0.0, 1.0 - bias - variance))


def null_models(
    z: Float[np.ndarray, " N"],
    q: Float[np.ndarray, " N"] | None = None,
    *,
    pressure: float | None = None,
    components: Labels = None,
) -> tuple[NullModel, ...]:
    """Models without aerodynamics: a constant, and for the axial coefficient a constant force.

    A canopy that carries its share of the weight and nothing else has ``C_A = (W/S)/q``, whatever the aerodynamics:
    that restates the force balance, and it explains most of the report's 97 %.

    Args:
        z: Force coefficient, (N,).
        q: Dynamic pressure [Pa]; None: no constant-force model.
        pressure: Force share over reference area, W/(n S) [Pa]; None: fitted by least squares.
        components: Label of each row; means and r2 are of each. None: one.

    Returns:
        The constant (its coefficient for several components: root mean square of their means), and the constant force
        if q is given.

    Raises:
        InputError: For shapes that don't fit, no complete row, or q not above 0.
    """
    z = np.asarray(z, dtype=np.float64)
    pressures = np.ones_like(z) if q is None else np.asarray(q, dtype=np.float64)
    _pairs(z, pressures, "null model")
    used = ~(np.isnan(z) | np.isnan(pressures))
    if (pressures[used] <= 0.0).any() or (pressure is not None and not np.isfinite(pressure)):
        raise InputError(Fault("null model", "q not above 0, or an infinite force", "q > 0 and a finite force"))
    labels = row_labels(components, z.size, "null model components")[used]
    means = np.bincount(labels, weights=z[used]) / np.maximum(np.bincount(labels), 1)
    variance = group_variance(z[used], labels)
    level = float(means[0]) if means.size == 1 else float(np.sqrt(np.mean(means**2)))
    found = [_null("constant", level, z[used], means[labels], used, variance)]
    if q is not None:
        shape = 1.0 / pressures[used]
        force = float(pressure) if pressure is not None else float(shape @ z[used] / (shape @ shape))
        found.append(_null("constant force", force, z[used], force * shape, used, variance))
    return tuple(found)


def signal_to_noise(signal: Float[np.ndarray, " N"], sigma: float) -> SignalToNoise:
    """Signal-to-noise ratio of a smoothed signal (report, 6.3.5), with and without its mean.

    Args:
        signal: Smoothed signal; NaN left out, (N,).
        sigma: Standard deviation of the noise [unit of the signal].

    Returns:
        Both ratios.

    Raises:
        InputError: If sigma isn't above 0 or no number is left.
    """
    values = np.asarray(signal, dtype=np.float64)
    values = values[~np.isnan(values)]
    if not values.size or not np.isfinite(values).all() or not (np.isfinite(sigma) and sigma > 0.0):
        raise InputError(Fault("signal-to-noise", f"{values.size} values, sigma {sigma!r}", "finite values, sigma > 0"))
    about = float(np.std(values)) / sigma
    return SignalToNoise(about, float(np.sqrt(np.mean(values**2))) / sigma, about > LOW_SNR)


def _correlation(columns: np.ndarray, length: np.ndarray, centred: bool) -> tuple[np.ndarray, np.ndarray]:
    p = columns.shape[1]
    moved = columns - columns.mean(axis=0) if centred else columns
    spread = np.linalg.norm(moved, axis=0)
    varies = np.flatnonzero(spread > 1e-12 * length)
    correlation, vif = np.full((p, p), np.nan), np.full(p, np.nan)
    if varies.size:
        scaled = moved[:, varies] / spread[varies]
        correlation[np.ix_(varies, varies)] = np.clip(scaled.T @ scaled, -1.0, 1.0)
        vif[varies] = _inverse_diagonal(scaled)
    return correlation, vif


def _inverse_diagonal(scaled: np.ndarray) -> np.ndarray:
    """Diagonal of (X'X)^-1; infinite for the columns that belong to a combination that vanishes."""
    _, singular, vectors = np.linalg.svd(np.linalg.qr(scaled, mode="r"))
    size = np.zeros(scaled.shape[1])
    size[: singular.size] = singular
    null = size <= 1e-11 * size[0]
    out: np.ndarray = np.sum((vectors[~null] / size[~null, None]) ** 2, axis=0)
    out[np.any(np.abs(vectors[null]) > 1e-8, axis=0)] = np.inf
    return out


def _judged(
    names: tuple[str, ...],
    largest: float,
    pair: tuple[str, str],
    vif: np.ndarray,
    worst: float,
    condition: float,
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    flags, sentences = [], []
    if largest > HIGH_CORRELATION:
        flags.append("correlation")
        sentences.append(
            f"{pair[0]} and {pair[1]} move together (correlation {largest:.3f}, limit {HIGH_CORRELATION:g}): "
            "the record can't tell their effects apart."
        )
    if worst > HIGH_VIF:
        flags.append("vif")
        bad = ", ".join(n for n, v in zip(names, vif, strict=True) if v > HIGH_VIF)
        sentences.append(
            f"Variance inflation reaches {worst:.3g} (limit {HIGH_VIF:g}): {bad} can be written from the other terms."
        )
    if condition > HIGH_CONDITION:
        flags.append("condition")
        sentences.append(
            f"The condition index is {condition:.3g} (limit {HIGH_CONDITION:g}): some combination of terms hardly "
            "varies along the record."
        )
    if not flags:
        sentences.append(
            f"The terms can be told apart: largest correlation {largest:.2f}, variance inflation {worst:.2g}, "
            f"condition index {condition:.2g}."
        )
    return tuple(flags), tuple(sentences)


def _pairs(z: np.ndarray, y: np.ndarray, where: str) -> tuple[np.ndarray, np.ndarray]:
    z, y = np.asarray(z, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if z.ndim != 1 or z.shape != y.shape:
        raise InputError(Fault(where, f"shapes {z.shape} and {y.shape}", "two series (N,) of one length"))
    used = ~(np.isnan(z) | np.isnan(y))
    if not used.any() or any(out_of_range(float(np.max(np.abs(x[used])))) for x in (z, y)):
        got = "no complete pair, or a value infinite or out of range"
        raise InputError(Fault(where, got, "finite numbers, NaN where missing"))
    return z[used], y[used]


def _null(name: str, coefficient: float, z: np.ndarray, y: np.ndarray, used: np.ndarray, variance: float) -> NullModel:
    mse = float(np.mean((z - y) ** 2))
    prediction = np.full(used.size, np.nan)
    prediction[used] = y
    return NullModel(
        name, coefficient, 1.0 - mse / variance if variance > 0.0 else np.nan, float(np.sqrt(mse)), prediction
    )
