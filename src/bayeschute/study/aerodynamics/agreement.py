"""Agreement of external knowledge with the posterior (the report's F-5), in numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayeschute.aero.coefficient import Coefficient
from bayeschute.aero.curve_names import CURVES
from bayeschute.likelihood.knowledge import conflict, without
from bayeschute.posterior.combine.sequential import moments
from bayeschute.study.aerodynamics.known import observed, points
from bayeschute.study.schema.knowledge.knowledge_schema import KnowledgeTable
from bayeschute.study.study import Study

Array = NDArray[np.float64]
TENSION, CONFLICT = 0.05, 0.01
"""p-values below which knowledge and flights are said to be in tension, and in conflict."""


def agreement(study: Study, draws: Mapping[str, Array], saturation: float | None = None) -> list[dict[str, Any]]:
    """Each ``[[knowledge]]`` of a study beside the posterior.

    What was used as prior is part of the posterior: it is taken out again, as a Gaussian, so that it is compared with
    what flights and the other priors say without it. Where these say nothing without it, the posterior with it stands
    in its place, and conflict is understated.

    Args:
        study: The study.
        draws: Of the posterior by parameter (chain, draw), in their units.
        saturation: Of the fitted terms, as of `Structure` [rad].

    Returns:
        One entry a table, plain values: ``name``, ``source``, ``kind``, ``target``, ``use``, ``at``, ``unit``,
        ``values``, ``sd``, ``found`` and ``found_sd`` (what it is compared with), ``z``, ``chi_square``, ``freedom``,
        ``p_value``, ``verdict`` and ``in_model``, ``counted`` (whether the posterior still holds it).
    """
    names = [name for name in draws if (one := Coefficient.parse(name)) is not None and one.is_shared]
    if not names or not study.knowledge:
        return []
    mean, posterior_covariance = moments(np.stack([np.ravel(draws[name]) for name in names], axis=-1))
    return [_entry(study, table, names, mean, posterior_covariance, saturation) for table in study.knowledge]


def _entry(
    study: Study,
    table: KnowledgeTable,
    names: Sequence[str],
    mean: Array,
    posterior_covariance: Array,
    saturation: float | None,
) -> dict[str, Any]:
    known = observed(study, table, names, saturation)
    in_model = bool(np.any(known.design != 0.0))
    counted = table.use == "prior" and in_model
    if counted and (apart := without(mean, posterior_covariance, known)) is not None:
        (mean, posterior_covariance), counted = apart, False
    found = conflict(mean, posterior_covariance, known)
    return {
        "name": table.name,
        "source": table.source,
        "kind": table.kind,
        "target": table.target,
        "use": table.use,
        "at": points(study, table).at.tolist(),
        "unit": CURVES[table.target].unit if table.kind == "curve" else "",
        "values": known.values.tolist(),
        "sd": np.sqrt(np.diag(known.covariance)).tolist(),
        "found": (known.design @ mean).tolist(),
        "found_sd": np.sqrt(np.maximum(np.diag(known.design @ posterior_covariance @ known.design.T), 0.0)).tolist(),
        "z": found.z.tolist(),
        "chi_square": found.chi_square,
        "freedom": found.freedom,
        "p_value": found.p_value,
        "verdict": verdict(found.p_value),
        "in_model": in_model,
        "counted": counted,
    }


def verdict(p_value: float) -> str:
    """A p-value in a word: agreement, tension or conflict."""
    return "conflict" if p_value < CONFLICT else "tension" if p_value < TENSION else "agreement"
