"""Goodness of fit against references: Theil's inequality coefficient, and null models without aerodynamics."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from bayeschute.core.errors import Fault, InputError
from bayeschute.regression.problem import group_variance, out_of_range, row_labels
from bayeschute.regression.series import Labels


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
    """Null model without aerodynamics, as a reference for a fit.

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
