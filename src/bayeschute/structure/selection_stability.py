"""Selection stability: how often terms and structures are selected over moving-block bootstrap replicates."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from bayeschute.regression.bootstrap import check_bootstrap, redrawn
from bayeschute.regression.equation_error import fit
from bayeschute.regression.noise_ceiling import noise_ceiling
from bayeschute.regression.orthogonal import select
from bayeschute.regression.problem import read_problem
from bayeschute.regression.selection import Selection
from bayeschute.regression.series import Labels, time_series
from bayeschute.regression.stacked import Stack
from bayeschute.structure.exchange import Compressed, compress, exchange


class SelectionFrequency(NamedTuple):
    """How often terms and structures are selected over moving-block replicates.

    Attributes:
        names: All candidates.
        frequency: Share of replicates that keep each candidate, (p,).
        structures: Different sets of terms (in the order of the candidates) and their shares, most frequent first.
        sigma_max2: Further values of sigma_max^2 tried, (G,).
        by_sigma_max: Share of replicates that keep each candidate under each of them, (G, p).
        replicates: Number of replicates.
    """

    names: tuple[str, ...]
    frequency: Float[np.ndarray, " p"]
    structures: tuple[tuple[tuple[str, ...], float], ...]
    sigma_max2: Float[np.ndarray, " G"]
    by_sigma_max: Float[np.ndarray, "G p"]
    replicates: int


class CandidateStructure(NamedTuple):
    """One of the structures that a record may support, fitted to the record itself.

    Attributes:
        terms: Its terms, in the order of the candidates.
        share: Share of the replicates that selected exactly these.
        estimate: Coefficients, (n,).
        se: Their standard errors under colored residuals, (n,).
        rms: Root mean square of the residuals [unit of z].
        pse: Predicted squared error under the ceiling of the selection [unit of z, squared].
    """

    terms: tuple[str, ...]
    share: float
    estimate: Float[np.ndarray, " n"]
    se: Float[np.ndarray, " n"]
    rms: float
    pse: float


def selection_frequency(
    X: Float[np.ndarray, "N p"],
    z: Float[np.ndarray, " N"],
    base: Selection,
    *,
    rng: np.random.Generator,
    blocks: Labels = None,
    groups: Labels = None,
    time: Float[np.ndarray, " N"] | None = None,
    replicates: int = 200,
    block_length: int | None = None,
    kind: str = "pairs",
    sigma_max2: Sequence[float] = (),
    max_terms: int = 60,
    exchanged: bool = False,
) -> SelectionFrequency:
    """How often terms are selected when the record is redrawn in blocks; sigma_max^2 and f are those of `base`.

    ``"pairs"`` redraws rows and assumes no model, but repeats the noise that the record already holds, so that it
    keeps somewhat more terms than new records would. ``"residual"`` adds redrawn residuals to the selected model, so
    that terms it left out are taken as absent.

    Args:
        X: All candidates, (N, p).
        z: Response, (N,).
        base: Selection on the record itself.
        rng: Source of randomness.
        blocks: As in `bayeschute.regression.series.time_series`.
        groups: As there.
        time: As there [s].
        replicates: Number of replicates.
        block_length: As in `bayeschute.regression.bootstrap.block_bootstrap` [samples].
        kind: ``"pairs"`` or ``"residual"``.
        sigma_max2: Further noise ceilings at which each replicate is evaluated [unit of z, squared].
        max_terms: Longest path in a replicate.
        exchanged: Whether each selection is followed by `bayeschute.structure.exchange.exchange`.

    Returns:
        Frequencies of terms and structures.

    Raises:
        InputError: As `block_bootstrap`.
    """
    problem = read_problem(X, z, base.names, "selection frequency")
    parts = time_series(problem.used, blocks=blocks, groups=groups, time=time)
    check_bootstrap(kind, replicates, block_length)
    p, grid = problem.X.shape[1], np.asarray(sigma_max2, dtype=np.float64)
    kept, by_grid, found = np.zeros(p), np.zeros((grid.size, p)), Counter[tuple[int, ...]]()
    model = list(base.selected)
    for columns, response in redrawn(problem.X, problem.z, parts, rng, replicates, block_length, kind, model):
        path = select(
            columns,
            response,
            base.names,
            sigma_max2=base.ceiling.value,
            penalty_factor=base.penalty_factor,
            max_terms=max(max_terms, base.forced),
            forced=base.order[: base.forced],
        )
        compressed = compress(columns, response) if exchanged else None
        found[tuple(sorted(_chosen(path, columns, response, compressed)))] += 1
        for g, value in enumerate(grid):
            other = path.with_ceiling(noise_ceiling("fixed", sigma_max2=float(value)))
            by_grid[g, list(_chosen(other, columns, response, compressed))] += 1.0
    for chosen, times in found.items():
        kept[list(chosen)] += times
    shares = tuple((tuple(base.names[j] for j in chosen), n / replicates) for chosen, n in found.most_common())
    return SelectionFrequency(base.names, kept / replicates, shares, grid, by_grid / replicates, replicates)


def _chosen(path: Selection, X: np.ndarray, z: np.ndarray, compressed: Compressed | None) -> tuple[int, ...]:
    return path.selected if compressed is None else exchange(path, X, z, compressed=compressed).columns


def best_structures(
    frequency: SelectionFrequency, stack: Stack, base: Selection, most: int = 5
) -> tuple[CandidateStructure, ...]:
    """The most frequent structures, each fitted to the record, to be averaged over or compared later.

    Args:
        frequency: From `selection_frequency`.
        stack: The record.
        base: The selection on the record, for its penalty.
        most: Structures at most; the empty one is left out.

    Returns:
        The structures, most frequent first.
    """
    per_term = base.penalty_factor * base.ceiling.value / base.samples
    found = []
    for terms, share in [(t, s) for t, s in frequency.structures if t][:most]:
        columns = [frequency.names.index(t) for t in terms]
        fitted = fit(
            stack.X[:, columns], stack.z, terms, blocks=stack.blocks, groups=stack.groups, components=stack.components
        )
        pse = fitted.rms**2 + per_term * len(terms)
        found.append(CandidateStructure(terms, share, fitted.estimate, fitted.se, fitted.rms, pse))
    return tuple(found)
