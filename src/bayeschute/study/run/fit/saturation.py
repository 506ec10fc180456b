"""Whether a fitted library of terms can fly its own flights, and priors of one whose powers of the angle level off.

A polynomial in the angle of attack that fits its record may turn canopies over just beyond the angles that are flown.
Whether it does is tried: the flights are simulated with draws of the parameters, from the beginning of their records
and in air of their own. Looking at the normal force alone would not tell: a canopy that damps its swing, or stays in a
limit cycle, never comes to where that turns (set T).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bayeschute.core.random import seed_of, stream
from bayeschute.likelihood.joint import NoiseParameters
from bayeschute.posterior.marginal import Marginal
from bayeschute.prediction import bands
from bayeschute.study.aerodynamics.known import informed
from bayeschute.study.assembly.fits import Group
from bayeschute.study.job import Job
from bayeschute.study.run.stage_data import of_structure

_FLOWN = 96
"""Simulations of every flight that are tried."""
MANY = 0.05
"""Share of them that may be lost. From 2 % on a run says that bands are of too few simulations: of a fit that loses as
many, this share of so few is passed once in twenty."""


def needed(job: Job, group: Group) -> Group | None:
    """The group with powers that level off, where the study leaves that to the fit (``saturate = "auto"``).

    Args:
        job: The run.
        group: With the priors that equation error left.

    Returns:
        The group with priors by equation error on such terms; None where the study says otherwise, or its priors don't
        come from equation error alone.
    """
    study = job.study
    assert study.structure is not None
    if study.structure.saturate != "auto" or study.priors.vary_canopies:
        return None
    found, now = job.load("structure.json"), {p.name: p for p in group.priors}
    if "saturated" not in found:
        return None
    before, after = (informed(study, of_structure(study, found[name])) for name in ("coefficients", "saturated"))
    if any(now.get(p.name) != p for p in before):
        return None
    told = {p.name: p for p in after}
    return replace(group, priors=tuple(told.get(p.name, p) for p in group.priors))


def lost(made: Marginal, hyper: NoiseParameters, seed: int) -> float:
    """Share of simulations that are lost, of the flight of which most are [1].

    Args:
        made: The posterior, by whose normal approximation parameters are drawn.
        hyper: Noise parameters.
        seed: Of parameters and air.
    """
    rng = stream(seed, "parameters of flights that are tried")
    theta = np.asarray(made.centre) + rng.standard_normal((_FLOWN, np.size(made.centre))) @ np.asarray(made.scale).T
    air = seed_of(seed, "air of flights that are tried")
    tried = (
        bands.predict(made, i, theta, [hyper], air, data_end=bands.OPENING).failed for i in range(len(made.flights))
    )
    return max(tried) / _FLOWN
