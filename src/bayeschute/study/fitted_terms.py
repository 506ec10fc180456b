"""Terms that equation error did not select, kept at hand for a fit that asks for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bayeschute.inference.priors import Prior, from_equation_error
from bayeschute.study import canopies
from bayeschute.study.study import Study

if TYPE_CHECKING:
    from bayeschute.study.stages import Job

ADDED = "added since the fitted flight asked for it"
KEPT = "left out by equation error, kept since the whole pool is fitted"


def terms_left_out(job: Job, why: str = ADDED) -> list[Prior]:
    """Priors of the terms that equation error did not select, from the fit of all candidates together.

    Args:
        job: A run whose structure is known.
        why: Ends the source of each prior.
    """
    study = job.study
    if study.model != "cluster":
        return []
    flight = ", ".join(f.name for f in study.with_role("structure"))
    found = job.load("structure.json")["coefficients"]
    made = []
    for kind, entry in found.items():
        for term in entry.get("left_out", ()):
            name, table = f"{kind}[{term['term']}]", study.priors
            one = from_equation_error(name, term["estimate"], term["se"], table.inflation, table.floor, flight=flight)
            made.append(replace(one, source=f"{one.source}; {why}"))
    return made


def in_order(study: Study, priors: Sequence[Prior]) -> list[Prior]:
    """Priors in the order of the study: coefficients as its pools name their terms, then all others as they are.

    Which order equation error ranks terms in is chance where they tell as much. Fits of the same terms, as those of
    replicates are, would compile a function for every one of these orders.
    """
    table = study.structure
    pools = [] if table is None else [f"{k}[{term}]" for k in ("axial", "transverse") for term in getattr(table, k)]
    place = {name: i for i, name in enumerate(pools)}
    return sorted(priors, key=lambda p: place.get(canopies.coefficient(p.name), len(place)))


def with_terms(study: Study, priors: Sequence[Prior], more: Sequence[Prior]) -> tuple[list[Prior], NDArray[np.bool_]]:
    """Priors with those of more terms in their places, and which of them were there before."""
    made = in_order(study, [*priors, *more])
    return made, np.array([p not in more for p in made])
