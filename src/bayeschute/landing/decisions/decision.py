"""P(met) with epistemic, aleatory and Monte Carlo uncertainty kept apart, and the decision that follows.

Of every draw k of the parameters, m_k of M_k landings meet a requirement. The probabilities of the draws are taken as
p_k = Phi(mu + s z_k), z_k standard normal: exact where a margin is linear in Gaussian parameters and scatters normally
from landing to landing. The binomial scatter of m_k is thereby taken out of the spread over draws: s is what the
posterior leaves open (epistemic), p (1 - p) what winds and starts bring (aleatory), and the uncertainty of (mu, s)
given the counts is the Monte Carlo error. The latter is found on a grid, with Jeffreys' prior on the mean of p and a
standard half-normal one on s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaln, log_ndtr, logsumexp, ndtr, ndtri

from bayeschute.core.errors import Fault, InputError

Array = NDArray[np.float64]
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(40)
_LOG_WEIGHTS = np.log(_WEIGHTS / np.sqrt(2.0 * np.pi))
_GRID = 41
_WIDEST = 6.0  # of the mean of p, in standard deviations of a normal
_SHARES = np.linspace(0.0005, 0.9995, 1000)


@dataclass(frozen=True)
class Chance:
    """P(a requirement is met) by posterior draws x landings.

    Attributes:
        met: Mean over draws and landings.
        low: Lower end of the central interval of P(met | parameters) over the posterior.
        high: Its upper end.
        confidence: Of that interval.
        epistemic_sd: Standard deviation of P(met | parameters) over the posterior.
        aleatory_sd: Root of the mean of p (1 - p): scatter of met or not met from landing to landing.
        monte_carlo_sd: Standard error of `met` for the number of draws and landings.
        draws: Draws of the parameters.
        landings: Landings.
        failed: Of these, those whose simulation failed: they count as not met.
        mu: Grid of mu, flat.
        spread: Grid of s, flat.
        weight: Of its points; they sum to one.
    """

    met: float
    low: float
    high: float
    confidence: float
    epistemic_sd: float
    aleatory_sd: float
    monte_carlo_sd: float
    draws: int
    landings: int
    failed: int
    mu: Array
    spread: Array
    weight: Array

    def reaches(self, probability: float) -> tuple[float, float, float]:
        """Posterior probability that P(met) is at least this, and its 10 % and 90 % limits by Monte Carlo error."""
        each = ndtr((self.mu - ndtri(probability)) / self.spread)
        order = np.argsort(each)
        total = np.cumsum(self.weight[order])
        low, high = (float(each[order][min(np.searchsorted(total, q), total.size - 1)]) for q in (0.1, 0.9))
        return float(each @ self.weight), low, high


@dataclass(frozen=True)
class Verdict:
    """What may be decided.

    Attributes:
        verdict: ``met``, ``not met`` or ``can't tell yet``.
        reached: Posterior probability that P(met) is at least the wanted one.
        more_draws: About how many times as many draws and landings would make the Monte Carlo error small enough; 1
            where it is, None where no number of them would tell.
        more_drops: About how many more drops as informative as those fitted would decide it, if P(met) is as estimated;
            0 where none is needed.
        why: A sentence.
    """

    verdict: str
    reached: float
    more_draws: float | None
    more_drops: float
    why: str


def counts(draw: ArrayLike, met: ArrayLike) -> tuple[Array, Array]:
    """Landings that met it and landings flown, by draw (K,)."""
    _, back = np.unique(np.asarray(draw), return_inverse=True)
    return np.asarray(np.bincount(back, np.asarray(met, float)), float), np.asarray(np.bincount(back), float)


def _log_likelihood(m: Array, total: Array, mu: Array, s: Array) -> Array:
    """Of counts, up to a constant, at points (G,); landings of draws with the same counts are alike."""
    pairs, often = np.unique(np.stack([m, total]), axis=1, return_counts=True)
    at = mu[:, None] + s[:, None] * _NODES
    up, down = log_ndtr(at), log_ndtr(-at)
    made = np.zeros(mu.size)
    for (k, n), times in zip(pairs.T, often, strict=True):
        choose = gammaln(n + 1.0) - gammaln(k + 1.0) - gammaln(n - k + 1.0)
        made += times * (choose + logsumexp(k * up + (n - k) * down + _LOG_WEIGHTS, axis=1))
    return made


def _grid(m: Array, total: Array) -> tuple[Array, Array, Array]:
    """mu, s and weights: a grid over the probit of the mean of p and log s, drawn together about what is likely."""
    low, high = np.array([-_WIDEST, np.log(1e-3)]), np.array([_WIDEST, np.log(10.0)])
    for last in (False, False, True):
        axes = [np.linspace(a, b, _GRID) for a, b in zip(low, high, strict=True)]
        middle, log_s = (a.ravel() for a in np.meshgrid(*axes, indexing="ij"))
        s = np.exp(log_s)
        mu = middle * np.sqrt(1.0 + s**2)
        # Jeffreys' prior of Phi(middle), a half-normal one of s; both as densities on the grid's axes.
        prior = -0.5 * (log_ndtr(middle) + log_ndtr(-middle)) - 0.5 * middle**2 - 0.5 * s**2 + log_s
        log_p = _log_likelihood(m, total, mu, s) + prior
        if not last:
            likely = (log_p > log_p.max() - 12.0).reshape(_GRID, _GRID)
            for axis in (0, 1):
                here = np.flatnonzero(likely.any(axis=1 - axis))
                low[axis] = axes[axis][max(here[0] - 1, 0)]
                high[axis] = axes[axis][min(here[-1] + 1, _GRID - 1)]
    weight = np.exp(log_p - log_p.max())
    return mu, s, weight / weight.sum()


def chance(draw: ArrayLike, met: ArrayLike, failed: int = 0, confidence: float = 0.9) -> Chance:
    """P(met) from landings.

    Args:
        draw: Draw of the parameters of every landing (N,), any labels.
        met: Whether it met the requirement (N,); failed simulations did not.
        failed: How many of them failed.
        confidence: Of the interval over the posterior [1].

    Raises:
        InputError: If there are less than two draws.
    """
    m, total = counts(draw, met)
    if m.size < 2:
        raise InputError(Fault("landings", f"{m.size} draws of the parameters", "two or more, better a hundred"))
    mu, s, weight = _grid(m, total)
    mean, sd = float(m.sum() / total.sum()), np.sqrt(1.0 + s**2)
    keep = np.argsort(weight)[::-1][: 1 + int(np.searchsorted(np.cumsum(np.sort(weight)[::-1]), 0.999))]
    part = weight[keep] / weight[keep].sum()
    p = ndtr(mu[keep, None] + s[keep, None] * ndtri(_SHARES))
    order = np.argsort(p, axis=None)
    mass = np.cumsum((part[:, None] * np.full(_SHARES.size, 1.0 / _SHARES.size)).ravel()[order])
    ends = [
        float(p.ravel()[order][min(np.searchsorted(mass, q), mass.size - 1)]) for q in (0.5 - 0.5 * confidence,
        0.5 + 0.5 * confidence)
    ]  # fmt: skip
    each, square = p.mean(axis=1), (p**2).mean(axis=1)
    whole = ndtr(mu / sd)
    error = float(np.sqrt(weight @ (whole - weight @ whole) ** 2))
    return Chance(
        mean, ends[0], ends[1], confidence, float(np.sqrt(max(part @ (square - each**2), 0.0))),
        float(np.sqrt(max(part @ (each - square), 0.0))), error, m.size, int(total.sum()), failed, mu, s, weight,
    )  # fmt: skip


def decide(found: Chance, probability: float, confidence: float) -> Verdict:
    """Whether P(met) is at least a wanted probability, with a wanted confidence.

    Args:
        found: P(met).
        probability: Wanted [1].
        confidence: Posterior probability with which P(met) must be that, or must not be that [1].

    Returns:
        The verdict; the Monte Carlo error counts against it.
    """
    reached, low, high = found.reaches(probability)
    mu, s = float(found.mu @ found.weight), float(found.spread @ found.weight)
    gap, need = abs(mu - float(ndtri(probability))), float(ndtri(confidence))
    wanted = f"P(met) >= {probability:g} with confidence {confidence:g}"
    if low >= confidence:
        return Verdict("met", reached, 1.0, 0.0, f"{wanted}: posterior probability {reached:.3f}.")
    if high <= 1.0 - confidence:
        why = f"{wanted}: posterior probability of the opposite {1.0 - reached:.3f}."
        return Verdict("not met", reached, 1.0, 0.0, why)
    if high >= confidence or low <= 1.0 - confidence:  # within the Monte Carlo error it may be decided
        edge = need if high >= confidence else -need
        ends = np.clip(ndtri(np.clip([low, reached, high], 1e-12, 1.0 - 1e-12)), -7.0, 7.0)
        factor = float(np.clip((0.5 * (ends[2] - ends[0]) / max(abs(ends[1] - edge), 1e-3)) ** 2, 1.5, 100.0))
        why = f"{wanted}: open within the Monte Carlo error; about {factor:.1f} times the landings may tell."
        return Verdict("can't tell yet", reached, factor, 0.0, why)
    drops = (need * s / max(gap, 1e-12)) ** 2 - 1.0
    if drops > 1000.0:
        why = f"{wanted}: P(met) lies at the limit; no number of drops is likely to tell."
    else:
        more = f"{max(int(np.ceil(drops)), 1)} more drop{'s' if drops > 1.0 else ''}"
        why = f"{wanted}: the parameters leave it open; about {more} as telling as those fitted may tell."
    return Verdict("can't tell yet", reached, None, float(drops), why)
