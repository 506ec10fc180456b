"""Priors of aerodynamic terms that equation error did not select, for the search within the fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayeschute.aero.coefficient import Coefficient, coefficient_names, shared_name
from bayeschute.atmosphere.standard import SEA_LEVEL_DENSITY
from bayeschute.likelihood.priors import Prior, correlated, from_equation_error
from bayeschute.study.job import Job
from bayeschute.study.study import Study

ADDED = "added by the score test of the fitted flight"
_LARGEST = 0.2
"""Prior standard deviation of a term's contribution to a force coefficient, root mean square over the record [1].

Coefficients of axial force are near 0.9, of transverse force below 0.2 where canopies fly. Where the motion is too
small to separate collinear terms, this prior keeps each of them near zero, and their sum where equation error puts it.
"""


_UNSEEN = 1e-4
"""Least root mean square of a regressor: one that is zero all along carries no information on its coefficient."""


def of_selected(study: Study, kind: str, entry: Mapping[str, Any], flight: str) -> list[Prior]:
    """Priors of the terms that equation error selected, with the covariance of their fit.

    Args:
        study: For inflation and floor.
        kind: ``axial`` or ``transverse``.
        entry: Of structure.json.
        flight: Where estimates come from, for the report.
    """
    rows, table = entry["selected"], study.priors
    made = [
        from_equation_error(
            str(Coefficient(kind, r["term"])), r["estimate"], r["se"], table.inflation, table.floor, flight=flight
        )
        for r in rows
    ]
    made = [replace(p, saturation=entry.get("saturation")) for p in made]
    if entry.get("covariance") is None or not rows:
        return made
    inflated_covariance = table.inflation**2 * np.array(entry["covariance"]) + table.floor**2 * np.eye(len(rows))
    return correlated(made, np.array([r["estimate"] for r in rows]), inflated_covariance)


def of_library(study: Study, kind: str, entry: Mapping[str, Any], flight: str) -> list[Prior]:
    """Priors of all candidates: the covariance of their joint fit, inflated, and none larger than is plausible.

    Equation error's Gaussian, widened, is multiplied by one about zero for every term but the constant, under which the
    term adds no more than `_LARGEST` to the coefficient. Where a record can't separate the candidates, equation error
    gives the selected ones only.

    Args:
        study: For inflation and floor.
        kind: ``axial`` or ``transverse``.
        entry: Of structure.json.
        flight: Where estimates come from, for the report.
    """
    together, table = entry["together"], study.priors
    names, size = list(together["terms"]), np.array(together["rms"], float)
    centre: NDArray[np.float64] = np.zeros(len(names))
    known: NDArray[np.float64] = np.zeros((len(names), len(names)))
    source = f"equation error on {flight}, all candidates together, {table.inflation:g} x colored standard error"
    if together["estimate"] is not None:
        here = [names.index(name) for name in together["fitted"]]
        centre[here] = together["estimate"]
        inflated_covariance = table.inflation**2 * np.array(together["covariance"], float) + table.floor**2 * np.eye(
            len(here)
        )
        known[np.ix_(here, here)] = np.linalg.inv(inflated_covariance)
    else:
        here = [names.index(row["term"]) for row in entry["selected"]]
        inflated_covariance = table.inflation**2 * np.array(entry["covariance"], float) + table.floor**2 * np.eye(
            len(here)
        )
        known[np.ix_(here, here)] = np.linalg.inv(inflated_covariance)
        centre[here] = [row["estimate"] for row in entry["selected"]]
        source += "; it can't separate all of them"
    plausible = np.where(np.array(names) == "1", 0.0, (np.maximum(size, _UNSEEN) / _LARGEST) ** 2)
    both = np.linalg.inv(known + np.diag(np.maximum(plausible, 1e-12)))
    saturation = entry.get("saturation")
    blank = [Prior(str(Coefficient(kind, name)), 0.0, 1.0, False, "1", source, saturation=saturation) for name in names]
    return correlated(blank, both @ known @ centre, 0.5 * (both + both.T))


def at_own_apparent_mass(study: Study, priors: Sequence[Prior]) -> list[Prior]:
    """Priors by equation error as what they are: of coefficients at the vehicle's own apparent mass.

    Equation error takes forces from the motion of the masses that the vehicle has. Where a fit finds another apparent
    mass, its coefficients of transverse force are larger or smaller alike (`Prior.air_share`). Not so where others know
    these coefficients as they are; nor in a population, or without latent disturbances.

    Args:
        study: For the vehicle.
        priors: From equation error.
    """
    told = any(table.use == "prior" for table in study.knowledge)
    if study.vehicle is None or told or study.priors.hierarchical or study.noise.model != "latent":
        return list(priors)
    canopies = study.vehicle_of(study.with_role("structure")[0]).canopies
    air = SEA_LEVEL_DENSITY * canopies.enclosed_volume
    share = air / (canopies.dry_mass + air)
    parsed = [Coefficient.parse(p.name) for p in priors]
    return [
        replace(p, air_share=share) if one is not None and one.kind == "transverse" else p
        for p, one in zip(priors, parsed, strict=True)
    ]


def terms_left_out(job: Job) -> list[Prior]:
    """Priors of the terms that equation error did not select, from the fit of all candidates together.

    Args:
        job: A run whose structure is known.
    """
    study = job.study
    if study.model != "cluster":
        return []
    flight = ", ".join(f.name for f in study.with_role("structure"))
    found = job.load("structure.json")["coefficients"]
    made = []
    for kind, entry in found.items():
        for term in entry.get("left_out", ()):
            name, table = str(Coefficient(kind, term["term"])), study.priors
            one = from_equation_error(name, term["estimate"], term["se"], table.inflation, table.floor, flight=flight)
            made.append(replace(one, source=f"{one.source}; {ADDED}", saturation=entry.get("saturation")))
    return at_own_apparent_mass(study, made)


def in_order(study: Study, priors: Sequence[Prior]) -> list[Prior]:
    """Priors in the order of the study: coefficients as its pools name their terms, then all others in their order.

    The order in which equation error ranks terms is random where they explain as much. Fits of the same terms, as
    those of replicates are, would compile a function for every one of these orders.
    """
    table = study.structure
    pools = [] if table is None else coefficient_names(table)
    place = {name: i for i, name in enumerate(pools)}
    return sorted(priors, key=lambda p: place.get(shared_name(p.name), len(place)))


def with_terms(study: Study, priors: Sequence[Prior], more: Sequence[Prior]) -> tuple[list[Prior], NDArray[np.bool_]]:
    """Priors with those of more terms in their places, and which of them were there before."""
    made = in_order(study, [*priors, *more])
    return made, np.array([p not in more for p in made])
