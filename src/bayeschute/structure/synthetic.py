"""Simulation study of structure selection: known terms on the motion of a record, selected over many replicates.

The explanatory variables are those of a record, the coefficient is a sum of known terms of them plus autocorrelated
noise (Ornstein-Uhlenbeck), independent in every replicate. Results are the selection frequency of every term, the
coverage of intervals, and the collinear candidate that is selected in place of a term that is missed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.errors import Fault, InputError
from bayeschute.records.sensors import ornstein_uhlenbeck
from bayeschute.regression.bootstrap import block_bootstrap
from bayeschute.regression.equation_error import EquationErrorFit, fit
from bayeschute.regression.noise_level import SeriesNoise, series_noise
from bayeschute.regression.problem import positive
from bayeschute.regression.stacked import Stack, stack_components
from bayeschute.structure.candidates import Pool
from bayeschute.structure.confusable_terms import Rival, rivals
from bayeschute.structure.exchange import Compressed, compress
from bayeschute.structure.polar_names import canonical
from bayeschute.structure.search import Search, SearchResult, search

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
LEVEL = 0.9  # of the intervals whose coverage is counted
_BOOTSTRAP = 200  # block replicates of the first replicate


@dataclass(frozen=True)
class Making:
    """How data are made.

    Attributes:
        snr: Root mean square of the sum of terms over the standard deviation of the noise.
        time_constant: Of the noise [s]; 0 for white noise.
        replicates: Number of replicates, each with independent noise.
    """

    snr: float
    time_constant: float
    replicates: int


class Replicates(NamedTuple):
    """Results over the replicates; B replicates, p candidates, k true terms.

    Attributes:
        names: Candidates.
        true: Columns of the true terms, (k,).
        value: Their coefficients, (k,).
        sigma: Standard deviation of the noise [unit of z].
        memory: Its integrated autocorrelation time [samples].
        ranked: Whether the orthogonal functions alone kept a candidate, (B, p).
        kept: Whether the search selected it, including the exchange of terms if requested, (B, p).
        estimate: Estimates of the true terms when the structure is known, (B, k).
        se: Their standard errors under colored residuals, (B, k).
        white_se: The same as if residuals were white, (B, k).
        inside: Whether the 90 % intervals cover, (B, k).
        white_inside: Whether the white-noise ones do, (B, k).
        kept_inside: Whether the intervals of the model that was selected cover; False where a term was missed, (B, k).
        ceiling: sigma_max^2 of each replicate, (B,) [unit of z, squared].
        rivals: For each true term the candidate that is most easily confused with it.
        first: The search in the first replicate.
        first_fit: The true structure fitted to the first replicate.
        bootstrap_se: Standard errors of that fit by moving blocks, (k,).
        seen: Signal and noise as Fourier smoothing sees the first replicate.
    """

    names: tuple[str, ...]
    true: tuple[int, ...]
    value: Array
    sigma: float
    memory: float
    ranked: Flags
    kept: Flags
    estimate: Array
    se: Array
    white_se: Array
    inside: Flags
    white_inside: Flags
    kept_inside: Flags
    ceiling: Array
    rivals: tuple[Rival, ...]
    first: SearchResult
    first_fit: EquationErrorFit
    bootstrap_se: Array
    seen: SeriesNoise

    @property
    def z(self) -> Array:
        """Errors of the estimates in colored standard errors, (B, k)."""
        return np.asarray((self.estimate - self.value) / self.se)

    @property
    def exact(self) -> float:
        """Share of the replicates that kept the true terms and no other."""
        truth = np.zeros(len(self.names), dtype=bool)
        truth[list(self.true)] = True
        return float(np.mean((self.kept == truth).all(axis=1)))


def true_columns(pool: Pool, truth: Mapping[str, float], where: str) -> tuple[int, ...]:
    """Columns of the true terms in a pool, however their products are written.

    Raises:
        InputError: If a term is no candidate.
    """
    known = {canonical(name): j for j, name in enumerate(pool.names)}
    lacking = [term for term in truth if canonical(term) not in known]
    if lacking:
        wanted = "only terms that the pool holds"
        raise InputError(Fault(where, f"true terms {lacking} that are no candidates", wanted, "Widen the pool."))
    return tuple(known[canonical(term)] for term in truth)


class _Made(NamedTuple):
    """Everything that the replicates share."""

    pool: Pool
    X: Array
    signal: Array
    true: tuple[int, ...]
    value: Array
    sigma: float
    memory: float
    compressed: Compressed | None


class _Once(NamedTuple):
    """One replicate."""

    found: SearchResult
    known: EquationErrorFit
    inside: Flags
    white_inside: Flags
    kept_inside: Flags
    stack: Stack


def replicate(
    pool: Pool,
    truth: Mapping[str, float],
    making: Making,
    dt: float,
    how: Search,
    rng: np.random.Generator,
    *,
    where: str = "synthetic data",
    progress: Callable[[float], None] | None = None,
) -> Replicates:
    """Make data from true terms, search for them, and count.

    Args:
        pool: All candidates along the record; NaN where a variable can't be had.
        truth: Coefficients by term [SI].
        making: How data are made.
        dt: Sample interval [s].
        how: Settings of the search, as for real data: the noise level is estimated in every replicate.
        rng: Of the noise.
        where: Name of the data, for faults.
        progress: Called with the share done.

    Returns:
        The results.

    Raises:
        InputError: For true terms that are no candidates, fewer than 2 replicates, or a signal that is zero.
    """
    if making.replicates < 2:
        raise InputError(Fault(f"{where} replicates", str(making.replicates), "at least 2"))
    made = _prepared(pool, truth, making, dt, how, where)
    all_of = []
    for b in range(making.replicates):
        all_of.append(_once(made, making, dt, how, rng))
        if progress is not None:
            progress((b + 1) / making.replicates)
    first, columns = all_of[0], list(made.true)
    draws = block_bootstrap(made.X[:, columns], first.stack.z, rng=rng, replicates=_BOOTSTRAP)
    return Replicates(
        names=pool.names,
        true=made.true,
        value=made.value,
        sigma=made.sigma,
        memory=made.memory,
        ranked=_flags([once.found.selection.selected for once in all_of], len(pool)),
        kept=_flags([once.found.columns for once in all_of], len(pool)),
        estimate=np.array([once.known.estimate for once in all_of]),
        se=np.array([once.known.se for once in all_of]),
        white_se=np.array([once.known.white_se for once in all_of]),
        inside=np.array([once.inside for once in all_of]),
        white_inside=np.array([once.white_inside for once in all_of]),
        kept_inside=np.array([once.kept_inside for once in all_of]),
        ceiling=np.array([once.found.selection.ceiling.value for once in all_of]),
        rivals=rivals(made.X, pool.names, columns, made.value, made.sigma**2 * made.memory),
        first=first.found,
        first_fit=first.known,
        bootstrap_se=draws.se,
        seen=series_noise(first.stack, dt),
    )


def _prepared(pool: Pool, truth: Mapping[str, float], making: Making, dt: float, how: Search, where: str) -> _Made:
    true, value = true_columns(pool, truth, where), np.array(list(truth.values()), dtype=np.float64)
    positive(f"{where} snr", making.snr)
    X = pool.matrix()
    signal = X[:, list(true)] @ value
    used = np.isfinite(X).all(axis=1)
    if not used.any():
        raise InputError(Fault(where, "no row with all variables", "a record with complete rows"))
    sigma = float(np.sqrt(np.mean(signal[used] ** 2))) / making.snr
    positive(f"{where}, standard deviation of the noise", sigma)
    phi = float(np.exp(-dt / making.time_constant)) if making.time_constant > 0.0 else 0.0
    compressed = compress(X, signal) if how.exchange else None
    return _Made(pool, X, signal, true, value, sigma, (1.0 + phi) / (1.0 - phi), compressed)


def _once(made: _Made, making: Making, dt: float, how: Search, rng: np.random.Generator) -> _Once:
    length, tau = made.signal.size, making.time_constant
    noise = ornstein_uhlenbeck(1.0, tau, dt, (length,), rng) if tau > 0.0 else rng.standard_normal(length)
    z = made.signal + made.sigma * noise
    stack = stack_components(made.X[:, None, :], z[:, None])
    found = search(stack, made.pool.names, dt, how, made.pool.indices, made.compressed)
    known = fit(made.X[:, list(made.true)], z, [made.pool.names[j] for j in made.true])
    kept_inside = np.zeros(len(made.true), dtype=bool)
    if found.columns:
        selected = fit(made.X[:, list(found.columns)], z).intervals(LEVEL)
        for i, column in enumerate(made.true):
            if column in found.columns:
                low, high = selected[found.columns.index(column)]
                kept_inside[i] = low <= made.value[i] <= high
    return _Once(
        found,
        known,
        _covers(known.intervals(LEVEL), made.value),
        _covers(known.intervals(LEVEL, white=True), made.value),
        kept_inside,
        stack,
    )


def _covers(intervals: Array, value: Array) -> Flags:
    return np.asarray((intervals[:, 0] <= value) & (value <= intervals[:, 1]))


def _flags(columns: list[tuple[int, ...]], candidates: int) -> Flags:
    flags = np.zeros((len(columns), candidates), dtype=bool)
    for row, chosen in zip(flags, columns, strict=True):
        row[list(chosen)] = True
    return flags
