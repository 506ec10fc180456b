"""Proposals for terms: candidates missing from the structure that the latent forces of a fit correlate with."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayeschute.aero.airflow import CanopyFlow
from bayeschute.aero.term_names import is_pairwise
from bayeschute.aero.terms import axial_term, transverse_term
from bayeschute.posterior.assess.latent_terms import Proposal, proposals
from bayeschute.study.aerodynamics.flown import FlownFlight

Array = NDArray[np.float64]
AXIAL = (
    "alpha",
    "alpha^2",
    "alpha^4",
    "restoring(10)",
    "restoring(20)",
    "q",
    "speed",
    "proximity(0.8)",
    "proximity(1.0)",
    "closing",
    "(e.rate)",
    "(e.c)",
)
TRANSVERSE = (
    "e", "e*alpha", "e*alpha^2", "e*alpha^4", "e*restoring(10)", "e*restoring(20)", "e*q", "e*speed",
    "rate", "rate*alpha", "rate*alpha^2", "e*(e.rate)", "e*alpha^2*(e.rate)", "c*(c.rate)",
    "c", "repulsion(0.8)", "repulsion(1.0)", "c*closing", "c*(e.c)", "e*proximity(0.8)", "rate*proximity(0.8)",
    "side*e", "side*rate", "side*c",
)  # fmt: skip
"""Candidates, splines in the angle (`restoring`) among them: broader than a study's pool. Which of them the terms of a
structure make already is found along the record."""
_SHOWN = 5


def proposed_terms(flights: Sequence[FlownFlight]) -> dict[str, list[Proposal]]:
    """Proposals by kind of force, the strongest first; a kind of which the fit has no latent force is left out.

    The latent axial force is a relative change: it is compared with terms over the model's own coefficient's size, one
    constant, which does not matter to shares.

    Args:
        flights: From `flown`.
    """
    several = all(one.along.flow.neighbours for one in flights)
    found = {}
    for kind, known in (("axial", AXIAL), ("transverse", TRANSVERSE)):
        latent = [_latent(one, kind) for one in flights]
        if not flights or not any(np.any(part) for part in latent):
            continue
        has = {term for one in flights for term in getattr(one, kind)}
        candidates = [term for term in known if term not in has and (several or not is_pairwise(term))]
        value: Callable[[str, CanopyFlow], Array] = _axial if kind == "axial" else _transverse
        made = proposals(
            latent,
            {term: [value(term, one.along.flow) for one in flights] for term in sorted(has)},
            {term: [value(term, one.along.flow) for one in flights] for term in candidates},
        )
        if made:
            found[kind] = made
    return found


def _latent(one: FlownFlight, kind: str) -> Array:
    if kind == "axial":
        return np.asarray(one.along.axial)
    return np.asarray(one.along.transverse.stack()).reshape(-1, np.shape(one.along.transverse.x)[-1])


def _axial(term: str, flow: CanopyFlow) -> Array:
    return np.asarray(axial_term(term, flow))


def _transverse(term: str, flow: CanopyFlow) -> Array:
    made = np.asarray(transverse_term(term, flow).stack())
    return made.reshape(-1, made.shape[-1])


def as_rows(found: dict[str, list[Proposal]]) -> list[dict[str, Any]]:
    """The strongest proposals as plain values, a few of each kind."""
    return [{"kind": kind, **one._asdict()} for kind, some in found.items() for one in some[:_SHOWN]]
