"""Term selection within the fit: Bayes factors by Savage-Dickey density ratios.

The whole library is fitted to the flight once, under weakly informative priors, with start and disturbances integrated
out. Its posterior is nearly Gaussian, and the Bayes factor of a model without some terms against the whole is the
posterior density of these coefficients at zero divided by their prior density there (Dickey 1971). Terms are removed,
or added again, one by one as long as the evidence, less a penalty for each term, grows. Equation error does the same
with forces; here the error of the wind is part of the model.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.likelihood.priors import Prior, covariance, given_zero, working

Array = NDArray[np.float64]
PENALTY = 2.0
"""Least logarithm of the evidence, for a model with a term over one without, at which the term is kept.

Positive evidence in the words of Kass and Raftery (1995). At zero, the median probability model of Barbieri and Berger
(2004), two predicted flights of other programs were held by two points more and two as before, and one worse: 21 of 23
parameters were kept there, the posterior was so flat that checks of its corrections were missed."""


class Chosen(NamedTuple):
    """A model taken out of a library.

    Attributes:
        priors: Of its parameters, the other terms known to be zero.
        theta: Its most probable parameters in the Gaussian of the library (P,).
        kept: Which of the library's parameters it has.
        evidence: By optional parameter, the logarithm of its Bayes factor: gain in evidence of the chosen model by
            it, or would.
    """

    priors: tuple[Prior, ...]
    theta: Array
    kept: NDArray[np.bool_]
    evidence: dict[str, float]


def log_evidence_without(
    priors: Sequence[Prior], mean: Array, posterior_covariance: Array, out: NDArray[np.bool_]
) -> float:
    """Logarithm of the evidence of a model whose parameters `out` are zero, over that of the whole.

    Args:
        priors: Of all parameters.
        mean: Posterior mean (P,), working coordinates.
        posterior_covariance: Posterior covariance (P, P).
        out: Which parameters are zero (P,).
    """
    if not out.any():
        return 0.0

    def density(centre: Array, spread: Array) -> float:
        root = np.linalg.cholesky(spread[np.ix_(out, out)])
        return float(-0.5 * np.sum(np.linalg.solve(root, centre[out]) ** 2) - np.sum(np.log(np.diag(root))))

    return density(mean, posterior_covariance) - density(working(priors)[0], covariance(priors))


def most_probable(mean: Array, posterior_covariance: Array, kept: NDArray[np.bool_]) -> Array:
    """Most probable parameters (Q,) in the Gaussian of a library, mean (P,), where those that are not kept are zero."""
    out = ~kept
    if not out.any():
        return mean
    away = np.linalg.solve(posterior_covariance[np.ix_(out, out)], mean[out])
    return np.asarray(mean[kept] - posterior_covariance[np.ix_(kept, out)] @ away)


def choose(
    priors: Sequence[Prior], mean: Array, posterior_covariance: Array, may_go: Collection[str], penalty: float = PENALTY
) -> Chosen:
    """Leave terms of a library out, and take back those that pay.

    Args:
        priors: Of all parameters.
        mean: Posterior mean of the library (P,), working coordinates.
        posterior_covariance: Its covariance (P, P).
        may_go: Names of the parameters that may be left out.
        penalty: Least logarithm of the evidence at which a term is kept.

    Returns:
        The model.
    """
    free = np.array([p.name in may_go for p in priors])
    out = np.zeros(len(priors), bool)

    def told(gone: NDArray[np.bool_]) -> float:
        return log_evidence_without(priors, mean, posterior_covariance, gone) + penalty * int(gone.sum())

    def toggled(i: int) -> NDArray[np.bool_]:
        other = out.copy()
        other[i] = not other[i]
        return other

    now = 0.0
    while free.any():
        found = {i: told(toggled(i)) for i in map(int, np.flatnonzero(free))}
        best = max(found, key=lambda i: found[i])
        if found[best] <= now:
            break
        out, now = toggled(best), found[best]
    here = log_evidence_without(priors, mean, posterior_covariance, out)
    gains = {}
    for i in map(int, np.flatnonzero(free)):
        change = log_evidence_without(priors, mean, posterior_covariance, toggled(i)) - here
        gains[priors[i].name] = change if out[i] else -change
    kept = ~out
    theta = most_probable(mean, posterior_covariance, kept)
    names = [p.name for p, gone in zip(priors, out, strict=True) if gone]
    return Chosen(tuple(given_zero(priors, names)), theta, kept, gains)
