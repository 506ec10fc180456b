"""Requirements on landings: limits, alone or together, and exceedance probabilities."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from bayeschute.landing.decisions.decision import Chance, Verdict, chance, decide
from bayeschute.prediction.binomial_limits import clopper_pearson


class Limit(NamedTuple):
    """A limit on one number of a landing.

    Attributes:
        quantity: One of `measures.MEASURES`.
        at_most: Upper limit [SI]; None: none.
        at_least: Lower limit [SI]; None: none.
    """

    quantity: str
    at_most: float | None = None
    at_least: float | None = None

    def kept(self, rows: NDArray[np.void]) -> NDArray[np.bool_]:
        """Which landings keep it; those that failed don't."""
        x = rows[self.quantity]
        with np.errstate(invalid="ignore"):
            low = np.isfinite(x) if self.at_least is None else x >= self.at_least
            high = np.isfinite(x) if self.at_most is None else x <= self.at_most
        return np.asarray(low & high & (rows["outcome"] == 0))


class Requirement(NamedTuple):
    """Limits that a landing must keep all together, and how surely.

    Attributes:
        name: For tables.
        limits: The limits.
        probability: Least probability [1].
        confidence: Posterior probability with which it must be reached [1].
    """

    name: str
    limits: tuple[Limit, ...]
    probability: float
    confidence: float

    def met(self, rows: NDArray[np.void]) -> NDArray[np.bool_]:
        """Which landings keep all limits."""
        return np.all([limit.kept(rows) for limit in self.limits], axis=0)


class Judgement(NamedTuple):
    """A requirement, P(met) and what may be decided by it."""

    requirement: Requirement
    chance: Chance
    verdict: Verdict


def judge(requirement: Requirement, rows: NDArray[np.void]) -> Judgement:
    """Judge a requirement by landings (N,) of `measures.ROW`."""
    failed = int((rows["outcome"] != 0).sum())
    found = chance(rows["draw"], requirement.met(rows), failed)
    return Judgement(requirement, found, decide(found, requirement.probability, requirement.confidence))


def effective(found: Chance) -> float:
    """Independent landings that would tell the mean of P(met) as well: draws that are shared make them fewer."""
    scatter = found.epistemic_sd**2 / found.draws + found.aleatory_sd**2 / found.landings
    worst = found.met * (1.0 - found.met)
    if not (scatter > 0.0 and worst > 0.0):
        return float(found.landings)
    return float(np.clip(worst / scatter, found.draws, found.landings))


def exceedance(
    rows: NDArray[np.void], quantity: str, thresholds: ArrayLike | None = None, confidence: float = 0.9
) -> pd.DataFrame:
    """P(quantity > threshold) with the limits of both spreads.

    Args:
        rows: Landings.
        quantity: One of `measures.MEASURES`.
        thresholds: Of the quantity [SI]; None: twenty-one over what was seen.
        confidence: Of all limits, two-sided [1].

    Returns:
        Columns threshold, probability, posterior_low, posterior_high (over the parameters, Monte Carlo error
        included), clopper_pearson_low, clopper_pearson_high (of the mean, for the number of landings), failed.
        Landings that failed exceed, and those whose quantity is not a number.
    """
    x = np.where((rows["outcome"] == 0) & np.isfinite(rows[quantity]), rows[quantity], np.inf)
    seen = x[np.isfinite(x)]
    if thresholds is None:
        ends = np.quantile(seen, [0.005, 0.9995]) if seen.size else np.zeros(2)
        thresholds = np.linspace(ends[0], ends[1], 21) if seen.size else []
    failed = int((~np.isfinite(x)).sum())
    made = []
    for at in np.asarray(thresholds, float):
        found = chance(rows["draw"], x > at, failed, confidence)
        count = effective(found)
        limits = clopper_pearson(found.met * count, count, confidence)
        made.append((at, found.met, found.low, found.high, *limits, failed))
    limits_of = ("posterior_low", "posterior_high", "clopper_pearson_low", "clopper_pearson_high")
    return pd.DataFrame(made, columns=["threshold", "probability", *limits_of, "failed"])
