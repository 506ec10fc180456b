"""Terms that equation error did not select, kept at hand for a fit that asks for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bayeschute.inference.priors import Prior, from_equation_error

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


def with_terms(priors: Sequence[Prior], more: Sequence[Prior]) -> tuple[list[Prior], NDArray[np.bool_]]:
    """Priors with those of more terms after the terms of their kind, and which of them were there before."""

    def kind(p: Prior) -> int:
        return next((i for i, k in enumerate(("axial[", "transverse[")) if p.name.startswith(k)), 2)

    made = sorted([*priors, *more], key=kind)
    return made, np.array([p not in more for p in made])
