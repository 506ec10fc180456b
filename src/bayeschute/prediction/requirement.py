"""Posterior predictive probability of meeting a requirement, with Monte Carlo limits given separately.

A flight whose simulation failed is never dropped: it counts as not meeting the requirement, and failures are counted.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import betaincinv

from bayeschute.core.errors import Fault, InputError
from bayeschute.prediction.binomial_limits import clopper_pearson, jeffreys


def _spread(met: np.ndarray) -> tuple[float, float, float, float]:
    """How P(met) varies over the posterior: sd and 5/95 % of a Beta with its moments, and the effective number.

    Args:
        met: Flights that meet it, (draw, simulation) of booleans; a row shares one draw of the parameters.
    """
    shares, simulations = met.mean(axis=1), met.shape[1]
    mean = float(shares.mean())
    noise = float((shares * (1 - shares)).mean()) / (simulations - 1)  # binomial scatter of a row's share
    between = max(float(shares.var(ddof=1)) - noise, 0.0)
    variance_of_mean = float(shares.var(ddof=1)) / len(shares)
    worst = mean * (1 - mean)
    effective = np.clip(worst / variance_of_mean if variance_of_mean > 0 else len(shares), len(shares), met.size)
    if between <= 1e-12 or worst <= between:
        return between**0.5, mean, mean, float(effective)
    strength = worst / between - 1
    low, high = betaincinv(mean * strength, (1 - mean) * strength, [0.05, 0.95])
    return between**0.5, float(low), float(high), float(effective)


def requirement_check(
    samples: ArrayLike,
    *,
    name: str,
    quantity: str,
    unit: str,
    at_most: float | None = None,
    at_least: float | None = None,
    run: str = "",
    statistic: str = "",
    confidence: float = 0.9,
    independent: float | None = None,
    widened_by: float = 1.0,
) -> dict[str, Any]:
    """P(requirement met) over the posterior, with Monte Carlo limits for the number of simulated flights.

    Args:
        samples: The quantity by posterior draw, (draw,), or by draw and simulation, (draw, simulation), where each
            draw of the parameters met several winds [unit]. NaN: the solve failed; it counts as not met.
        name: Name of the requirement.
        quantity: Name of the quantity.
        unit: Its unit.
        at_most: Upper limit [unit]; this or `at_least`.
        at_least: Lower limit [unit].
        run: Flight it was predicted on.
        statistic: Statistic over the window: final, maximum, mean.
        confidence: Two-sided confidence of the simulation limits [1].
        independent: Number of independent draws among (draw,) samples, if fewer.
        widened_by: Factor by which the samples were widened before [1]; part of the result.

    Returns:
        Plain numbers for summary.json: probability_met; simulation_low, simulation_high (Clopper-Pearson) and
        credible_low, credible_high (Jeffreys), which shrink with more simulations; posterior_sd, posterior_q05,
        posterior_q95 of P(met | parameters), which don't (None for (draw,) samples, where the two can't be separated
        apart); draws, simulations, met, failed; median, q05, q95 of the quantity; margin, the distance of the median
        from the limit [unit], positive when met (None where every solve failed); widened_by.

    Raises:
        InputError: If not exactly one limit is given or no sample is.
    """
    where = f"requirement_check {name}"
    if (at_most is None) == (at_least is None):
        raise InputError(Fault(where, f"at_most={at_most}, at_least={at_least}", "exactly one of the two"))
    x = np.asarray(samples, dtype=float)
    if x.size == 0 or x.ndim not in (1, 2):
        raise InputError(Fault(where, f"samples of shape {x.shape}", "(draw,) or (draw, simulation), not empty"))
    finite = x[np.isfinite(x)]
    with np.errstate(invalid="ignore"):
        met = np.isfinite(x) & (x <= at_most if at_most is not None else x >= at_least)
    probability = float(met.mean())
    total = min(float(independent or x.size), float(x.size))
    sd: float | None = None
    low: float | None = None
    high: float | None = None
    if x.ndim == 2 and x.shape[0] > 1 and x.shape[1] > 1:
        sd, low, high, total = _spread(met)
    simulation = clopper_pearson(probability * total, total, confidence)
    credible = jeffreys(probability * total, total, confidence)
    q05, median, q95 = (float(q) for q in np.quantile(finite, [0.05, 0.5, 0.95])) if finite.size else (None,) * 3
    margin = None
    if median is not None:
        margin = at_most - median if at_most is not None else median - float(at_least or 0.0)
    return {
        "name": name,
        "run": run,
        "quantity": quantity,
        "statistic": statistic,
        "at_most": at_most,
        "at_least": at_least,
        "unit": unit,
        "probability_met": probability,
        "confidence": confidence,
        "simulation_low": simulation.low,
        "simulation_high": simulation.high,
        "credible_low": credible.low,
        "credible_high": credible.high,
        "posterior_sd": sd,
        "posterior_q05": low,
        "posterior_q95": high,
        "draws": int(x.shape[0]),
        "simulations": int(x.size),
        "independent_simulations": total,
        "met": int(met.sum()),
        "failed": int(x.size - finite.size),
        "q05": q05,
        "median": median,
        "q95": q95,
        "margin": margin,
        "widened_by": widened_by,
    }
