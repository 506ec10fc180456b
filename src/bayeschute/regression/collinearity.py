"""Collinearity of regressors: correlation, variance inflation factor, condition index."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from bayeschute.core.errors import Fault, InputError
from bayeschute.regression.problem import read_problem

HIGH_CORRELATION = 0.9
HIGH_VIF = 10.0
HIGH_CONDITION = 30.0


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
        sentences: Flagged collinearities in words, or a sentence that there are none.
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
            "the record can't separate their effects."
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
            f"The terms are separable: largest correlation {largest:.2f}, variance inflation {worst:.2g}, "
            f"condition index {condition:.2g}."
        )
    return tuple(flags), tuple(sentences)
