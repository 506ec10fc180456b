"""Drop by drop: a posterior as the prior of the next drop, and what each drop taught.

Given the parameters, drops are independent: the posterior of the first is the prior of the second. As a Gaussian with
the draws' mean and whole covariance in working coordinates it is that exactly where posteriors are Gaussian, and the
fit of both drops together comes out; elsewhere it keeps the first two moments. Noise parameters, initial states and
disturbances are a drop's own and begin anew.

What a drop taught is the Kullback-Leibler divergence of the posterior from the prior, in nats (Lindley 1956): of each
parameter alone, and of all together, where what it says about their sums counts too.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.likelihood.priors import Prior, correlated, covariance, working

Array = NDArray[np.float64]


class Taught(NamedTuple):
    """What a drop taught about one parameter, in working coordinates (the value, or its logarithm).

    Attributes:
        name: Parameter.
        prior_mean: Before the drop.
        prior_sd: Before the drop.
        mean: After it.
        sd: After it.
        shift: Of the mean, in standard deviations of the prior.
        gain: Information gained about it alone [nats].
    """

    name: str
    prior_mean: float
    prior_sd: float
    mean: float
    sd: float
    shift: float
    gain: float


def moments(theta: Array) -> tuple[Array, Array]:
    """Mean (P,) and covariance (P, P) of draws (..., P)."""
    flat = theta.reshape(-1, theta.shape[-1])
    return flat.mean(axis=0), np.cov(flat, rowvar=False).reshape(flat.shape[1], -1)


def as_priors(priors: Sequence[Prior], mean: Array, posterior_covariance: Array, source: str) -> list[Prior]:
    """Priors of the next drop.

    Args:
        priors: Of the drop before: names, units and working coordinates.
        mean: Its posterior mean (P,), working coordinates.
        posterior_covariance: Its posterior covariance (P, P).
        source: Where they come from, in words.
    """
    named = [Prior(p.name, 0.0, 1.0, p.logarithmic, p.unit, source, saturation=p.saturation) for p in priors]
    return correlated(named, np.asarray(mean, float), np.asarray(posterior_covariance, float))


def divergence(mean: Array, posterior_covariance: Array, prior_mean: Array, prior_covariance: Array) -> float:
    """Kullback-Leibler divergence of a Gaussian from another, in nats.

    Args:
        mean: Of the first (P,).
        posterior_covariance: Its covariance (P, P).
        prior_mean: Of the second (P,).
        prior_covariance: Its covariance (P, P).
    """
    root, own = np.linalg.cholesky(prior_covariance), np.linalg.cholesky(posterior_covariance)
    spread = np.linalg.solve(root, own)
    apart = np.linalg.solve(root, mean - prior_mean)
    logs = np.log(np.diag(root)).sum() - np.log(np.diag(own)).sum()
    return float(0.5 * (np.sum(spread**2) + np.sum(apart**2) - len(mean)) + logs)


def taught(priors: Sequence[Prior], mean: Array, posterior_covariance: Array) -> tuple[list[Taught], float]:
    """What a drop taught about every parameter, and about all of them together [nats].

    Args:
        priors: Before the drop.
        mean: Posterior mean (P,), working coordinates.
        posterior_covariance: Posterior covariance (P, P).
    """
    centre, before = working(priors)[0], covariance(priors)
    rows = []
    for i, p in enumerate(priors):
        at = np.ix_([i], [i])
        sd, prior_sd = float(np.sqrt(posterior_covariance[i, i])), float(np.sqrt(before[i, i]))
        gain = divergence(mean[[i]], posterior_covariance[at], centre[[i]], before[at])
        shift = float((mean[i] - centre[i]) / prior_sd)
        rows.append(Taught(p.name, float(centre[i]), prior_sd, float(mean[i]), sd, shift, gain))
    return rows, divergence(mean, posterior_covariance, centre, before)
