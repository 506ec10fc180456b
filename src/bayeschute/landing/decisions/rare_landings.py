"""Probability of rare failures of landings, over parameters, winds, starts, gusts and surfaces together."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from bayeschute.core.random import stream
from bayeschute.landing.campaign_plan import CampaignPlan
from bayeschute.landing.decisions.rare import Rare, subset_simulation
from bayeschute.landing.decisions.requirements import Requirement
from bayeschute.landing.fly_landings import BATCH, Normals, fly_normals, normal_sizes
from bayeschute.landing.measures import IDS

Array = NDArray[np.float64]


def failure(plan: CampaignPlan, requirement: Requirement, samples: int = 1000) -> Rare:
    """P(a landing breaks a limit), by subset simulation.

    Parameters follow the normal distribution of the draws' mean and covariance, noise parameters are those of a draw at
    random. Where a posterior mixes models, it is the one with most draws.

    Args:
        plan: What landings are drawn from.
        requirement: Its limits; breaking any is failure, as is a landing whose simulation failed.
        samples: Landings of each level.
    """
    number = int(np.argmax([len(one.theta) for one in plan.models]))
    one, sizes = plan.models[number], normal_sizes(plan, number)
    mean = one.theta.mean(axis=0)
    root = np.linalg.cholesky(np.cov(one.theta, rowvar=False) + 1e-12 * np.diag(1.0 + mean**2))
    parts = np.cumsum([mean.size, 1, *sizes])
    scale = _scales(plan, number, requirement, sizes)

    def limit_state(u: Array) -> Array:
        made = []
        for at in range(0, len(u), BATCH):
            theta, pick, *rest = np.split(u[at : at + BATCH].T, parts[:-1])
            draw = np.minimum((ndtr(pick[0]) * len(one.theta)).astype(int), len(one.theta) - 1)
            ids = np.zeros((theta.shape[1], len(IDS)), np.int64)
            laws = [law[draw].T for law in one.laws]
            rows = fly_normals(plan, number, mean[:, None] + root @ theta, laws, Normals(*rest), ids)
            made.append(margin(requirement, rows, scale))
        return np.concatenate(made)

    return subset_simulation(limit_state, int(parts[-1]), samples, stream(plan.seed, "rare landings", requirement.name))


def margin(requirement: Requirement, rows: NDArray[np.void], scale: Array) -> Array:
    """Least distance of landings (N,) from the limits, each in units of its own; NaN where the simulation failed."""
    each = []
    for limit, unit in zip(requirement.limits, scale, strict=True):
        x = rows[limit.quantity]
        if limit.at_most is not None:
            each.append((limit.at_most - x) / unit)
        if limit.at_least is not None:
            each.append((x - limit.at_least) / unit)
    return np.where(rows["outcome"] == 0, np.min(each, axis=0), np.nan)


def _scales(plan: CampaignPlan, number: int, requirement: Requirement, sizes: tuple[int, ...]) -> Array:
    """Standard deviation of every limited quantity over some landings at the mean parameters."""
    one, rng, count = plan.models[number], stream(plan.seed, "scales of rare landings"), 64
    given = Normals(*(rng.standard_normal((size, count)) for size in sizes))
    theta = np.repeat(one.theta.mean(axis=0)[:, None], count, axis=1)
    laws = [np.repeat(law[:1].T, count, axis=1) for law in one.laws]
    rows = fly_normals(plan, number, theta, laws, given, np.zeros((count, len(IDS)), np.int64))
    return np.array([max(float(np.nanstd(rows[limit.quantity])), 1e-9) for limit in requirement.limits])
