"""External knowledge in a study as Gaussian observations of the coefficients, and priors that include it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.aero.coefficient import terms_of
from bayeschute.aero.curves import Setting, regressors
from bayeschute.aero.published import load_published
from bayeschute.aero.published_curve import planar_curve, usual_angles
from bayeschute.likelihood.knowledge import Observed, conditioned
from bayeschute.likelihood.priors import Prior, saturation_of
from bayeschute.study.schema.knowledge.knowledge_schema import KnowledgeTable
from bayeschute.study.study import Study

Array = NDArray[np.float64]


class Points(NamedTuple):
    """What a table says, by itself.

    Attributes:
        at: Angles [rad] or D_prox [1] of a curve (K,); empty of a coefficient.
        values: (K,) [1].
        covariance: Of their errors (K, K).
    """

    at: Array
    values: Array
    covariance: Array


def points(study: Study, table: KnowledgeTable) -> Points:
    """Values of a table and the covariance of their errors.

    Args:
        study: For the vehicle's reference length and speed, by which published rates are reduced.
        table: The table.
    """
    if table.kind == "coefficient":
        return Points(np.zeros(0), np.array([table.mean]), np.array([[float(table.sd or 0.0) ** 2]]))
    if table.published is not None:
        assert study.vehicle is not None
        canopies, found = study.vehicle.canopies, load_published(table.published)
        at = usual_angles(found)
        return Points(at, *planar_curve(found, table.target, at, canopies.reference_length, canopies.reference_speed))
    at, values, sd = np.array(table.samples).T
    return Points(at, values, np.diag(sd**2) + table.common_sd**2)


def observed(study: Study, table: KnowledgeTable, names: Sequence[str], saturation: float | None = None) -> Observed:
    """A table as an observation of parameters; a term that is not among them counts as zero.

    Args:
        study: The study.
        table: Of the study.
        names: Of the parameters, in order.
        saturation: As of `Structure` [rad].
    """
    told = points(study, table)
    design: Array = np.zeros((told.values.size, len(names)))
    if table.kind == "coefficient":
        if table.target in names:
            design[0, list(names).index(table.target)] = 1.0
    else:
        axial, transverse, places = terms_of(names)
        design[:, places] = regressors(table.target, axial, transverse, told.at, Setting(saturation=saturation))
    return Observed(design, told.values, told.covariance)


def informed(study: Study, priors: Sequence[Prior]) -> list[Prior]:
    """Priors multiplied by what the study says is to be used as prior: exact, all coefficients being linear.

    A coefficient or curve of which no parameter is part is left out; the report says so.

    Args:
        study: The study.
        priors: Of all parameters.
    """
    made = list(priors)
    for table in study.knowledge:
        if table.use != "prior":
            continue
        known = observed(study, table, [p.name for p in made], saturation_of(made))
        part = np.any(known.design != 0.0, axis=0)
        if part.any():
            made = [
                replace(p, source=f"{p.source}; and {table.name} ({table.source})") if here else p
                for p, here in zip(conditioned(made, known), part, strict=True)
            ]
    return made
