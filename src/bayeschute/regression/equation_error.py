"""Equation error: least squares on force coefficients (report, 6.3.5), with errors that allow for colored residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy import linalg, stats

from bayeschute.core.errors import Fault, InputError
from bayeschute.regression.colored_errors import ColoredNoise, residual_noise
from bayeschute.regression.problem import Problem, group_variance, read_problem, row_labels
from bayeschute.regression.series import Labels

_DEPENDENT = 1e-11


@dataclass(frozen=True)
class EquationErrorFit:
    """A least-squares fit.

    Attributes:
        names: Name of each regressor.
        estimate: Coefficients, (p,).
        covariance: Their covariance under colored residuals, (p, p).
        white_covariance: The same as if residuals were white, sigma^2 (X'X)^-1 (6.3.5-7).
        residual: z - X estimate, NaN in gaps, (N,) (6.3.5-11).
        used: Rows in use, (N,).
        sigma: Standard deviation of the residuals, with N - p (6.3.5-9) [unit of z].
        r2: Share of the variance of z about its mean (of each component) that is explained; NaN if z is constant.
        samples: Rows in use.
        dof: samples - p.
        condition: Condition number of the columns scaled to length 1.
        noise: Autocovariance of the residuals.
        max_leverage: Largest leverage of a row; beyond it a prediction extrapolates.
    """

    names: tuple[str, ...]
    estimate: Float[np.ndarray, " p"]
    covariance: Float[np.ndarray, "p p"]
    white_covariance: Float[np.ndarray, "p p"]
    residual: Float[np.ndarray, " N"]
    used: Bool[np.ndarray, " N"]
    sigma: float
    r2: float
    samples: int
    dof: int
    condition: float
    noise: ColoredNoise
    max_leverage: float

    @property
    def se(self) -> Float[np.ndarray, " p"]:
        """Standard errors under colored residuals."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def white_se(self) -> Float[np.ndarray, " p"]:
        """Standard errors as if residuals were white (6.3.5-10); far too small for flight data."""
        return np.sqrt(np.diag(self.white_covariance))

    @property
    def rms(self) -> float:
        """Root mean square of the residuals [unit of z]."""
        return float(np.sqrt(np.nanmean(self.residual**2)))

    @property
    def autocorrelation_time(self) -> float:
        """Integrated autocorrelation time of the residuals [samples]."""
        return self.noise.integrated_time

    def intervals(self, level: float = 0.9, *, white: bool = False) -> Float[np.ndarray, "p 2"]:
        """Intervals of the coefficients, Student's t with the degrees of freedom of the noise's spectrum.

        Args:
            level: Nominal coverage.
            white: As if residuals were white, for comparison only.

        Returns:
            Lower and upper limits, (p, 2).

        Raises:
            InputError: If the level isn't between 0 and 1.
        """
        if not 0.0 < level < 1.0:
            raise InputError(Fault("interval level", repr(level), "a share between 0 and 1"))
        dof = float(self.dof) if white else float(np.clip(self.noise.dof, 1.0, self.dof))
        half = stats.t.ppf(0.5 + level / 2.0, dof) * (self.white_se if white else self.se)
        return np.stack([self.estimate - half, self.estimate + half], axis=1)

    def predict(self, X: Float[np.ndarray, "N p"]) -> Float[np.ndarray, " N"]:
        """X estimate, NaN where X has a NaN."""
        X = np.asarray(X, dtype=np.float64)
        if X.ndim != 2 or X.shape[1] != self.estimate.size:
            raise InputError(Fault("predict X", f"shape {X.shape}", f"(N, {self.estimate.size})"))
        return np.asarray(X @ self.estimate)

    def leverage(self, X: Float[np.ndarray, "N p"]) -> Float[np.ndarray, " N"]:
        """x'(X'X)^-1 x of each row, NaN where X has a NaN."""
        X = np.asarray(X, dtype=np.float64)
        inverse = (
            self.white_covariance / self.sigma**2 if self.sigma > 0.0 else np.full_like(self.white_covariance, np.nan)
        )
        return np.asarray(np.einsum("ij,jk,ik->i", X, inverse, X))


def fit(
    X: Float[np.ndarray, "N p"],
    z: Float[np.ndarray, " N"],
    names: Sequence[str] | None = None,
    *,
    blocks: Labels = None,
    groups: Labels = None,
    components: Labels = None,
    time: Float[np.ndarray, " N"] | None = None,
    max_lag_fraction: float = 0.1,
    taper: str = "parzen",
    pool: bool = False,
    bias_passes: int = 3,
) -> EquationErrorFit:
    """Least squares by QR, with white and colored covariance (6.3.5-6, -7 and the correction of its reference 16).

    Rows with a NaN are left out of the fit and are gaps for the autocorrelation.

    Args:
        X: Regressors, (N, p).
        z: Response, (N,).
        names: Name of each regressor.
        blocks: Time series of each row: component, record, canopy. None: one series.
        groups: Label of each row; series that share it are simultaneous and their cross-correlation counts.
        components: Label of each row; r2 is about the mean of each. None: one.
        time: Time of each row [s]; None: each row of a series is one step.
        max_lag_fraction: Lags are cut at this share of each series.
        taper: ``"parzen"`` or ``"bartlett"``.
        pool: One autocovariance for all series.
        bias_passes: See `bayeschute.regression.colored_errors.residual_noise`.

    Returns:
        The fit.

    Raises:
        InputError: For wrong shapes, infinite values, no more rows than columns, or columns that depend on each other.
    """
    problem = read_problem(X, z, names, "fit")
    if problem.X.shape[0] <= problem.X.shape[1]:
        got = f"{problem.X.shape[0]} usable rows for {problem.X.shape[1]} columns"
        raise InputError(Fault("fit", got, "more rows than columns"))
    solved = _solved(problem)
    noise = residual_noise(
        solved.residual,
        blocks=blocks,
        groups=groups,
        time=time,
        Q=solved.Q,
        max_lag_fraction=max_lag_fraction,
        taper=taper,
        pool=pool,
        bias_passes=bias_passes,
    )
    labels = row_labels(components, problem.used.size, "fit components")[problem.used]
    return _with_errors(problem, solved, noise, group_variance(problem.z, labels))


class _Solved(NamedTuple):
    """Least squares: estimate, residual (NaN in gaps), basis Q, R^-1 and singular values of the scaled columns."""

    estimate: np.ndarray
    residual: np.ndarray
    Q: np.ndarray
    inverse: np.ndarray
    singular: np.ndarray


def _solved(problem: Problem) -> _Solved:
    Q, inverse, singular = _factor(problem.X, problem.names)
    along = Q.T @ problem.z
    rest = problem.z - Q @ along
    rest -= Q @ (Q.T @ rest)
    residual = np.full(problem.used.size, np.nan)
    residual[problem.used] = rest
    return _Solved(inverse @ along, residual, Q, inverse, singular)


def _with_errors(problem: Problem, solved: _Solved, noise: ColoredNoise, variance: float) -> EquationErrorFit:
    """The fit with both covariances; `variance` is that of z about the means of its components."""
    (n, p), Q, inverse = problem.X.shape, solved.Q, solved.inverse
    rest = solved.residual[problem.used]
    sigma2 = float(rest @ rest) / (n - p)
    return EquationErrorFit(
        names=problem.names,
        estimate=solved.estimate,
        covariance=inverse @ noise.quadratic(Q) @ inverse.T,
        white_covariance=sigma2 * inverse @ inverse.T,
        residual=solved.residual,
        used=problem.used,
        sigma=float(np.sqrt(sigma2)),
        r2=1.0 - float(rest @ rest) / n / variance if variance > 0.0 else np.nan,
        samples=n,
        dof=n - p,
        condition=float(solved.singular[0] / solved.singular[-1]),
        noise=noise,
        max_leverage=float(np.max(np.einsum("ij,ij->i", Q, Q))),
    )


def _factor(X: np.ndarray, names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Q, the matrix that turns Q'z into coefficients, and the singular values of the scaled columns."""
    length = np.linalg.norm(X, axis=0)
    if (length == 0.0).any() or not np.isfinite(length).all():
        bad = [names[j] for j in np.flatnonzero((length == 0.0) | ~np.isfinite(length))]
        raise InputError(Fault("fit columns", f"zeros or unbounded values in {bad}", "columns that vary", "Drop them."))
    Q, R, order = linalg.qr(X / length, mode="economic", pivoting=True)
    weak = np.abs(np.diag(R)) <= _DEPENDENT
    if weak.any():
        bad = [names[j] for j in order[weak]]
        did = "Drop them, or let the orthogonal functions choose."
        raise InputError(Fault("fit columns", f"{bad} as combinations of the others", "independent columns", did))
    inverse = np.empty_like(R)
    inverse[order] = linalg.solve_triangular(R, np.eye(R.shape[0]))
    return Q, inverse / length[:, None], np.linalg.svd(R, compute_uv=False)
