"""Value of a further drop: the expected reduction of the spread of P(met).

Of every candidate the covariance of the parameters is known that its record would leave (from the linearised flight,
start and disturbances integrated out). P(met | theta) = Phi(c + b' theta) is fitted to the landings of the draws; then
the posterior standard deviation of c + b' theta is s_0 now and s_1 after the drop. Its mean after the drop is not known
yet: it is normal with variance s_0^2 - s_1^2. The expected spread is the mean over it (goal-oriented Bayesian design;
Chaloner and Verdinelli, Statist. Sci. 10, 1995, 273).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize
from scipy.special import log_ndtr, ndtr
from scipy.stats import norm

from bayeschute.landing.decisions.decision import counts

Array = NDArray[np.float64]
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(31)
_WEIGHTS = _WEIGHTS / _WEIGHTS.sum()
_LOOSE = 3.0  # prior standard deviation of every slope


class Slope(NamedTuple):
    """P(met | theta) = Phi(at_mean + slope' (theta - mean)).

    Attributes:
        at_mean: Probit at the parameters' mean.
        slope: By working coordinates (P,).
    """

    at_mean: float
    slope: Array


def probit_slope(theta: Array, draw: ArrayLike, met: ArrayLike) -> Slope:
    """Fit how P(met) follows the parameters.

    Args:
        theta: Draws (D, P), working coordinates.
        draw: Draw of every landing (N,), a row of `theta`.
        met: Whether it met the requirement (N,).
    """
    used = np.unique(np.asarray(draw))
    m, total = counts(draw, met)
    mean, sd = theta.mean(axis=0), np.maximum(theta.std(axis=0), 1e-300)
    z = (theta[used] - mean) / sd

    def cost(b: Array) -> tuple[float, Array]:
        eta = b[0] + z @ b[1:]
        value = -(m @ log_ndtr(eta) + (total - m) @ log_ndtr(-eta)) + 0.5 * (b[1:] ** 2).sum() / _LOOSE**2
        up, down = (np.exp(norm.logpdf(eta) - log_ndtr(s * eta)) for s in (1.0, -1.0))
        by_eta = -(m * up - (total - m) * down)
        return float(value), np.concatenate([[by_eta.sum()], z.T @ by_eta + b[1:] / _LOOSE**2])

    start = np.concatenate([[0.0], np.zeros(z.shape[1])])
    found = minimize(cost, start, jac=True, method="BFGS").x
    return Slope(float(found[0]), found[1:] / sd)


def spread(at_mean: float, now: float, after: float) -> float:
    """Expected standard deviation of P(met) over the posterior when its probit's is to fall from `now` to `after`."""
    moved = np.sqrt(max(now**2 - after**2, 0.0)) * _NODES
    p = ndtr(at_mean + moved[:, None] + after * _NODES)
    mean = p @ _WEIGHTS
    return float(np.sqrt(np.maximum((p**2) @ _WEIGHTS - mean**2, 0.0)) @ _WEIGHTS)


def ranking(
    slope: Slope, covariance: Array, after: Mapping[str, Array], names: Sequence[str], chosen: str | None = None
) -> pd.DataFrame:
    """Candidates, the most informative first.

    Args:
        slope: Of P(met).
        covariance: Of the parameters now (P, P).
        after: The same after each candidate, by name.
        names: Parameters.
        chosen: A parameter by whose interval candidates are ranked in place of P(met).

    Returns:
        Columns candidate, spread_now, spread_expected (standard deviations of P(met) over the posterior), shrinking
        (1 - their ratio), probit_sd_left (share of the probit's standard deviation that would be left), information
        (half the fall of the log determinant [nat]), and for each parameter the share of its standard deviation that
        would be left.
    """
    now = float(np.sqrt(slope.slope @ covariance @ slope.slope))
    present = spread(slope.at_mean, now, now)
    rows = []
    for name, left in after.items():
        then = min(float(np.sqrt(np.maximum(slope.slope @ left @ slope.slope, 0.0))), now)
        expected = spread(slope.at_mean, now, then)
        row = {"candidate": name, "spread_now": present, "spread_expected": expected}
        row |= {"shrinking": 1.0 - expected / present if present > 0.0 else 0.0}
        row |= {"probit_sd_left": then / now if now > 0.0 else 1.0}
        row |= {"information": 0.5 * float(np.linalg.slogdet(covariance)[1] - np.linalg.slogdet(left)[1])}
        row |= {f"sd left of {p}": np.sqrt(left[i, i] / covariance[i, i]) for i, p in enumerate(names)}
        rows.append(row)
    table = pd.DataFrame(rows)
    by, up = ("shrinking", False) if chosen is None else (f"sd left of {chosen}", True)
    return table.sort_values(by, ascending=up, ignore_index=True)
