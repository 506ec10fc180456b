"""Aerodynamic results of a run beside its parameters: ``curves.csv``, external knowledge, proposals for terms."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayeschute.aero.curve_names import CURVES
from bayeschute.core.files import write_whole
from bayeschute.study.aerodynamics.agreement import agreement
from bayeschute.study.aerodynamics.curve_bands import table
from bayeschute.study.aerodynamics.flown import flown, ranges
from bayeschute.study.aerodynamics.term_proposals import as_rows, proposed_terms
from bayeschute.study.job import Job

Array = NDArray[np.float64]
FILE = "curves.csv"


def told_curves(job: Job, draws: Mapping[str, Array], prior: Mapping[str, Array]) -> dict[str, Any]:
    """Write the curves of a run, and say what is known of them.

    Args:
        job: A run that was fitted.
        draws: Of the posterior by parameter (chain, draw).
        prior: Likewise.

    Returns:
        For the summary: ``curves`` (words by curve and ranges flown), ``knowledge`` and ``proposals``; empty where the
        model has no curves.
    """
    (job.out / FILE).unlink(missing_ok=True)
    flights = flown(job)
    if not flights:
        return {}
    saturation = flights[0].saturation
    known, over = agreement(job.study, draws, saturation), ranges(flights)
    made = table(draws, prior, over, _reach(known), _truth(job), saturation)
    if not made.empty:
        write_whole(job.out / FILE, lambda path: made.to_csv(path, index=False))
    names = list(dict.fromkeys(made["curve"])) if not made.empty else []
    curves = {"words": {name: CURVES[name].words for name in names}, "flown": {k: list(v) for k, v in over.items()}}
    return {"curves": curves, "knowledge": known, "proposals": as_rows(proposed_terms(flights))}


def _reach(known: list[dict[str, Any]]) -> dict[str, float]:
    """How far curves go beyond the range flown, to meet what others know of them."""
    found: dict[str, float] = {}
    for one in known:
        if one["kind"] == "curve":
            name = one["target"]
            found[name] = max(found.get(name, 0.0), *one["at"])
            found[f"{name} from"] = min(found.get(f"{name} from", np.inf), *one["at"])
    return found


def _truth(job: Job) -> dict[str, float] | None:
    """Coefficients that virtual drops were flown with; None where a fitted flight was measured."""
    study = job.study
    if study.vehicle is None or any(f.virtual is None for f in study.with_role("identify")):
        return None
    return study.vehicle.aero.coefficients()
