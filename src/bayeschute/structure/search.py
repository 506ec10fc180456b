"""Structure selection for an aerodynamic coefficient: the terms that the data support, their stability and estimates.

The regressions come from `bayeschute.regression.vector_equation` (equivariant terms, what the simulator flies with) or
from `bayeschute.structure.polar_equation` (the report's C_A, C_Y, C_N).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from bayeschute.core.errors import Fault, InputError
from bayeschute.regression.bootstrap import Bootstrap, block_bootstrap
from bayeschute.regression.equation_error import EquationErrorFit, fit
from bayeschute.regression.noise_level import NoiseLevel, SeriesNoise, noise_level, series_noise
from bayeschute.regression.orthogonal import select
from bayeschute.regression.selection import Selection
from bayeschute.regression.stacked import Stack
from bayeschute.structure.exchange import Compressed, Exchanged, exchange
from bayeschute.structure.selection_stability import (
    CandidateStructure,
    SelectionFrequency,
    best_structures,
    selection_frequency,
)

_PATHS = (40, 300)  # terms of a path at most
CEILINGS = (0.25, 0.5, 2.0, 4.0)  # multiples of sigma_max^2 at which the selection frequency is reported too


@dataclass(frozen=True)
class Search:
    """How a structure is searched for.

    Attributes:
        sigma_max: Noise ceiling sigma_max^2 as a multiple of sigma^2.
        noise: Where sigma^2 comes from, see `bayeschute.regression.noise_level`.
        sigma: For noise ``"given"`` [unit of the coefficient].
        penalty_factor: f of the predicted squared error.
        exchange: Whether the selection is followed by an exchange of terms.
        first: Terms that are selected first and always kept.
        replicates: Moving-block replicates of the record; 0 for none.
    """

    sigma_max: float = 25.0
    noise: str = "colored"
    sigma: float | None = None
    penalty_factor: float = 2.0
    exchange: bool = False
    first: tuple[str, ...] = ()
    replicates: int = 0


class SearchResult(NamedTuple):
    """Selected terms of a search.

    Attributes:
        selection: The path of the orthogonal functions.
        exchanged: The set after the exchange of terms; None if not requested.
        level: The noise level.
        columns: Columns kept.
    """

    selection: Selection
    exchanged: Exchanged | None
    level: NoiseLevel
    columns: tuple[int, ...]


@dataclass(frozen=True)
class Identified:
    """Result of equation error for one coefficient.

    Attributes:
        found: The selected terms.
        fit: Least squares of the kept terms.
        stack: The regression, all candidates.
        noise: Signal and white noise of the response.
        bootstrap: Block bootstrap of the kept terms, the check of the fit's covariance; None without replicates.
        frequency: How often terms and structures are kept; None without replicates.
        structures: The few best structures; empty without replicates.
    """

    found: SearchResult
    fit: EquationErrorFit
    stack: Stack
    noise: SeriesNoise
    bootstrap: Bootstrap | None
    frequency: SelectionFrequency | None
    structures: tuple[CandidateStructure, ...]


def search(
    stack: Stack,
    names: Sequence[str],
    dt: float,
    how: Search,
    indices: Sequence[str] | None = None,
    compressed: Compressed | None = None,
) -> SearchResult:
    """Rank the candidates and select those that lower the predicted squared error.

    Args:
        stack: The regression.
        names: Candidates.
        dt: Sample interval [s].
        how: Options.
        indices: The report's decimal index of each candidate.
        compressed: See `bayeschute.structure.exchange.exchange`.

    Returns:
        Path, level and columns kept (none if nothing pays).

    Raises:
        InputError: For options out of range, or a first term that is no candidate.
    """
    unknown = [term for term in how.first if term not in names]
    if unknown:
        raise InputError(Fault("structure, first terms", f"{unknown}", f"some of the {len(names)} candidates"))
    forced = [list(names).index(term) for term in how.first]
    level = noise_level(
        stack,
        names,
        dt,
        source=how.noise,
        sigma=how.sigma,
        factor=how.sigma_max,
        penalty_factor=how.penalty_factor,
        forced=forced,
    )
    for longest in _PATHS:  # a short path is enough where no longer one could lower the minimum
        selection = select(
            stack.X,
            stack.z,
            list(names),
            indices=indices,
            groups=stack.components,
            rule="fixed",
            sigma_max2=how.sigma_max * level.variance,
            noise_variance=level.variance,
            penalty_factor=how.penalty_factor,
            max_terms=max(longest, len(forced)),
            forced=forced,
        )
        if selection.certain:
            break
    if not how.exchange:
        return SearchResult(selection, None, level, selection.selected)
    changed = exchange(selection, stack.X, stack.z, compressed=compressed)
    return SearchResult(selection, changed, level, changed.columns)


def identify(
    stack: Stack,
    names: Sequence[str],
    dt: float,
    how: Search,
    rng: np.random.Generator,
    indices: Sequence[str] | None = None,
) -> Identified:
    """Select the structure of one coefficient, fit it, and assess the stability of the selection.

    Args:
        stack: The regression, all candidates.
        names: Candidates.
        dt: Sample interval [s].
        how: Options.
        rng: Of the bootstrap.
        indices: The report's decimal index of each candidate.

    Returns:
        The structure and its fit.

    Raises:
        InputError: If no candidate pays for itself; as `search`.
    """
    noise = series_noise(stack, dt)
    found = search(stack, names, dt, how, indices)
    if not found.columns:
        do = "Lower sigma_max, or use a record with more motion."
        raise InputError(
            Fault("equation error", "no term that lowers the predicted squared error", "at least one term", do)
        )
    kept = list(found.columns)
    layout: dict[str, Any] = {"blocks": stack.blocks, "groups": stack.groups}
    terms = [names[j] for j in kept]
    fitted = fit(stack.X[:, kept], stack.z, terms, components=stack.components, **layout)
    if not how.replicates:
        return Identified(found, fitted, stack, noise, None, None, ())
    bootstrap = block_bootstrap(stack.X[:, kept], stack.z, rng=rng, replicates=how.replicates, **layout)
    frequency = selection_frequency(
        stack.X,
        stack.z,
        found.selection,
        rng=rng,
        replicates=how.replicates,
        sigma_max2=[factor * found.selection.ceiling.value for factor in CEILINGS],
        exchanged=how.exchange,
        **layout,
    )
    structures = best_structures(frequency, stack, found.selection)
    return Identified(found, fitted, stack, noise, bootstrap, frequency, structures)
