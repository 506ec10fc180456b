"""Moving-block bootstrap of least squares, for comparison with `regression.colored_errors`.

Circular blocks within each series (Politis & Romano 1992), so that correlated rows are resampled together.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from bayeschute.core.errors import Fault, InputError
from bayeschute.regression.problem import read_problem
from bayeschute.regression.series import Labels, Series, time_series


class Bootstrap(NamedTuple):
    """Estimates over moving-block replicates.

    Attributes:
        estimates: One row per replicate, (B, p).
        covariance: Their covariance, (p, p).
        se: Their standard deviations, (p,).
        block_length: Length of the blocks, longest series [samples].
    """

    estimates: Float[np.ndarray, "B p"]
    covariance: Float[np.ndarray, "p p"]
    se: Float[np.ndarray, " p"]
    block_length: int


def block_bootstrap(
    X: Float[np.ndarray, "N p"],
    z: Float[np.ndarray, " N"],
    *,
    rng: np.random.Generator,
    blocks: Labels = None,
    groups: Labels = None,
    time: Float[np.ndarray, " N"] | None = None,
    replicates: int = 400,
    block_length: int | None = None,
    kind: str = "residual",
) -> Bootstrap:
    """Moving-block bootstrap of least squares (circular blocks within each series).

    Args:
        X: Regressors, (N, p).
        z: Response, (N,).
        rng: Source of randomness.
        blocks: As in `time_series`.
        groups: As in `time_series`; simultaneous components are drawn together.
        time: As in `time_series` [s].
        replicates: Number of replicates.
        block_length: Length of the blocks [samples]; None: a tenth of each series, as the lags of `residual_noise`.
        kind: ``"residual"`` keeps X and moves blocks of residuals (matches the covariance above); ``"pairs"`` moves
            blocks of rows.

    Returns:
        The replicate estimates.

    Raises:
        InputError: As `time_series` and `read_problem`; for dependent columns or values out of range.
    """
    problem = read_problem(X, z, None, "bootstrap")
    parts = time_series(problem.used, blocks=blocks, groups=groups, time=time)
    check_bootstrap(kind, replicates, block_length)
    estimates = np.empty((replicates, problem.X.shape[1]))
    for b, (columns, response) in enumerate(redrawn(problem.X, problem.z, parts, rng, replicates, block_length, kind)):
        estimates[b] = np.linalg.lstsq(columns, response, rcond=None)[0]
    covariance = np.atleast_2d(np.cov(estimates, rowvar=False))
    longest = max(_block_length(s, block_length) for s in parts)
    return Bootstrap(estimates, covariance, np.sqrt(np.diag(covariance)), longest)


def check_bootstrap(kind: str, replicates: int, block_length: int | None) -> None:
    """Refuse options out of range, see `block_bootstrap`."""
    if kind not in ("residual", "pairs"):
        raise InputError(Fault("bootstrap kind", repr(kind), "'residual' or 'pairs'"))
    if replicates < 2 or (block_length is not None and block_length < 1):
        got = f"{replicates} replicates, block length {block_length}"
        raise InputError(Fault("bootstrap", got, "at least 2 replicates and blocks of at least 1 sample"))


def _block_length(series: Series, block_length: int | None) -> int:
    return min(block_length or max(1, int(np.ceil(series.length / 10))), series.length)


def redrawn(
    X: np.ndarray,
    z: np.ndarray,
    parts: tuple[Series, ...],
    rng: np.random.Generator,
    replicates: int,
    block_length: int | None,
    kind: str,
    model: list[int] | None = None,
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Columns and response of each replicate, see `block_bootstrap`; `model`: columns that residuals are taken from."""
    if kind == "residual":
        columns = X if model is None else X[:, model]
        estimate, _, rank, _ = np.linalg.lstsq(columns, z, rcond=None)
        if rank < columns.shape[1] or columns.shape[1] >= z.size:
            raise InputError(Fault("bootstrap", "columns that depend on each other", "independent columns"))
        smooth = columns @ estimate
        rest = (z - smooth) * np.sqrt(z.size / (z.size - columns.shape[1]))
    for _ in range(replicates):
        source = np.empty(z.size, dtype=np.intp)
        for series in parts:
            _redraw(series, _block_length(series, block_length), rng, source)
        yield (X, smooth + rest[source]) if kind == "residual" else (X[source], z[source])


def _redraw(series: Series, block_length: int, rng: np.random.Generator, source: np.ndarray) -> None:
    """For each row the row that it is replaced by: circular blocks over the places where no component is missing."""
    full = np.ones(series.length, dtype=bool)
    row_at = np.full((len(series.rows), series.length), -1)
    for i, (rows, places) in enumerate(zip(series.rows, series.places, strict=True)):
        row_at[i, places] = rows
        full &= row_at[i] >= 0
    valid = np.flatnonzero(full)
    if valid.size == 0:
        raise InputError(Fault("bootstrap", "a group whose series are never complete at one time", "common times"))
    starts = rng.integers(valid.size, size=-(-series.length // block_length))
    drawn = valid[(starts[:, None] + np.arange(block_length)) % valid.size].ravel()[: series.length]
    for i, (rows, places) in enumerate(zip(series.rows, series.places, strict=True)):
        source[rows] = row_at[i, drawn[places]]
