"""Aerodynamic terms that a fitted model takes to be zero, as alternatives to be tested for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from bayeschute.aero.coefficient import Coefficient
from bayeschute.aero.term_names import is_pairwise
from bayeschute.likelihood.joint import FlightData
from bayeschute.posterior.assess.alternatives import Alternative


def missing_terms(
    flight: FlightData, library: Mapping[str, Sequence[str]]
) -> Iterator[tuple[Coefficient, Alternative]]:
    """Coefficients that the model of a cluster's flight takes to be zero.

    Args:
        flight: The record.
        library: Terms by kind; those that the model has are left out, and of one canopy those that tell of two.

    Yields:
        Each with the flight's data as they are with some of the term.
    """
    model: Any = flight.model
    base, structure = model.base, model.structure
    lacking = {
        kind: [t for t in terms if t not in getattr(structure, kind) and (structure.canopies > 1 or not is_pairwise(t))]
        for kind, terms in library.items()
    }
    wider: dict[str, Any] = {kind: (*getattr(structure, kind), *terms) for kind, terms in lacking.items()}
    for kind, term in [(kind, term) for kind, terms in lacking.items() for term in terms]:

        def with_term(x: float, its: tuple[str, str] = (kind, term)) -> FlightData:
            values = {k: [x if (k, t) == its else 0.0 for t in terms] for k, terms in lacking.items()}
            more: dict[str, Any] = {k: (*getattr(base, k), *some) for k, some in values.items()}
            changed = replace(model, structure=replace(structure, **wider), base=replace(base, **more))
            return replace(flight, model=changed)

        coefficient = Coefficient(kind, term)
        yield coefficient, Alternative(f"the coefficient {coefficient}, taken to be zero", "", with_term)
