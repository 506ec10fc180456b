"""Prediction tests: a model identified on one canopy or flight, applied to the others (report, figures 7.3-2 to -4)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from bayeschute.core.errors import Fault, InputError
from bayeschute.regression.equation_error import EquationErrorFit
from bayeschute.regression.fit_statistics import Theil, theil
from bayeschute.regression.problem import group_variance, read_problem, row_labels
from bayeschute.regression.series import Labels


class PredictionTest(NamedTuple):
    """How a fit predicts a record that it has not seen.

    Attributes:
        label: Name of the record.
        rms: Root mean square of the prediction error [unit of z].
        rms_ratio: That over the rms of the fit's own residuals; about 1 for a good model. NaN for a perfect fit.
        least_ratio: The same ratio for the least that any coefficients of these terms leave on that record (its own
            least squares): a record with more noise than that of the fit has more than 1 here, whatever the model.
        expected_ratio: What the fit's residuals and the errors of its coefficients lead one to expect,
            ``sqrt(rms^2 + mean x'Cov x)/rms``. Beyond it: chance, or errors that are the same all along a record (the
            mean of the wind's) and that no record can show by itself.
        theil: Theil's inequality.
        r2: 1 - mean squared error/variance of the data about their mean; NaN if they are constant.
        bias: Mean prediction error [unit of z].
        extrapolated: Share of rows whose leverage is larger than any in the fit: extrapolation of the model.
        samples: Rows used.
        residual: Data minus prediction, NaN in gaps, (N,).
    """

    label: str
    rms: float
    rms_ratio: float
    least_ratio: float
    expected_ratio: float
    theil: Theil
    r2: float
    bias: float
    extrapolated: float
    samples: int
    residual: Float[np.ndarray, " N"]


def predict_record(
    fit: EquationErrorFit,
    X: Float[np.ndarray, "N p"],
    z: Float[np.ndarray, " N"],
    *,
    label: str = "",
    components: Labels = None,
) -> PredictionTest:
    """Try a fit on another record.

    Args:
        fit: The model, as identified.
        X: Its regressors along the other record, same columns in the same order, (N, p).
        z: Force coefficient along the other record; for a vector the stacked components, (N,).
        label: Name of the record.
        components: Label of each row; r2 is about the mean of each. None: one.

    Returns:
        The test; rows with a NaN are left out.

    Raises:
        InputError: For bad input, or another number of columns than the fit has.
    """
    where = f"prediction of {label}" if label else "prediction"
    if np.ndim(X) != 2 or np.shape(X)[1] != len(fit.names):
        got = f"regressors of shape {np.shape(X)}"
        raise InputError(Fault(where, got, f"{len(fit.names)} columns: {', '.join(fit.names)}"))
    problem = read_problem(X, z, fit.names, where)
    prediction = fit.predict(problem.X)
    error = problem.z - prediction
    mse = float(np.mean(error**2))
    own, *_ = np.linalg.lstsq(problem.X, problem.z, rcond=None)
    least = float(np.mean((problem.z - problem.X @ own) ** 2))
    why_not_trusted = float(np.mean(np.einsum("ij,jk,ik->i", problem.X, fit.covariance, problem.X)))
    labels = row_labels(components, problem.used.size, f"{where} components")[problem.used]
    variance = group_variance(problem.z, labels)
    leverage = fit.leverage(problem.X)
    residual = np.full(problem.used.size, np.nan)
    residual[problem.used] = error
    return PredictionTest(
        label=label,
        rms=float(np.sqrt(mse)),
        rms_ratio=_over(mse, fit.rms),
        least_ratio=_over(least, fit.rms),
        expected_ratio=_over(fit.rms**2 + why_not_trusted, fit.rms),
        theil=theil(problem.z, prediction),
        r2=1.0 - mse / variance if variance > 0.0 else np.nan,
        bias=float(np.mean(error)),
        extrapolated=float(np.mean(leverage > fit.max_leverage * (1.0 + 1e-9))),
        samples=error.size,
        residual=residual,
    )


def _over(mean_square: float, rms: float) -> float:
    return float(np.sqrt(mean_square)) / rms if rms > 0.0 else np.nan
