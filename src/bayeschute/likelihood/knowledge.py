"""What others know about parameters, as Gaussian observations of linear combinations of them.

Coefficients enter the forces linearly: an estimate of a coefficient, or a measured curve, says ``values = design theta
+ error`` with a Gaussian error. A Gaussian prior given that is Gaussian again, exactly (Gelman et al., Bayesian Data
Analysis, 3rd ed., 14.7). Whether it agrees with what flights say is a chi-square test of their difference, whose
covariance is the sum of both where both are independent (prior-data conflict: Evans and Moshonov 2006).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy import stats

from bayeschute.likelihood.priors import Prior, correlated, covariance, working

Array = NDArray[np.float64]
_LEAST = 1e-9  # eigenvalues of a covariance below this share of the largest tell nothing beyond rounding


class Observed(NamedTuple):
    """Knowledge about parameters: ``values = design theta + error``.

    Attributes:
        design: By parameter, in working coordinates (K, P).
        values: What is known (K,).
        covariance: Of its error (K, K), positive definite.
    """

    design: Array
    values: Array
    covariance: Array


class Conflict(NamedTuple):
    """How far two sources disagree.

    Attributes:
        z: Difference of every value, knowledge less the other, over its standard deviation (K,).
        chi_square: Of all differences together.
        freedom: How many independent differences there are.
        p_value: Of a chi square that large if both are right.
    """

    z: Array
    chi_square: float
    freedom: int
    p_value: float


def conditioned(priors: Sequence[Prior], known: Observed) -> list[Prior]:
    """Priors given what is known: Gaussian conditioning, all correlations included.

    Args:
        priors: Of all parameters.
        known: About them.
    """
    centre, prior_covariance = working(priors)[0], covariance(priors)
    after = scipy.linalg.cho_factor(known.design @ prior_covariance @ known.design.T + known.covariance, lower=True)
    gain = scipy.linalg.cho_solve(after, known.design @ prior_covariance).T
    left = prior_covariance - gain @ known.design @ prior_covariance
    return correlated(priors, centre + gain @ (known.values - known.design @ centre), 0.5 * (left + left.T))


def without(mean: Array, posterior_covariance: Array, known: Observed) -> tuple[Array, Array] | None:
    """A Gaussian posterior with knowledge that was in its prior taken out again.

    Args:
        mean: Posterior mean (P,), working coordinates.
        posterior_covariance: Posterior covariance (P, P).
        known: What the prior held.

    Returns:
        Mean and covariance; None where what is left is no Gaussian: without the knowledge, nothing is known there.
    """
    inverse = np.linalg.inv(known.covariance)
    precision = np.linalg.inv(posterior_covariance)
    left = precision - known.design.T @ inverse @ known.design
    scale = np.sqrt(np.diag(precision))
    values = np.linalg.eigvalsh(left / np.outer(scale, scale))
    if values[0] <= _LEAST:
        return None
    covariance_: Array = np.asarray(np.linalg.inv(left), np.float64)
    return covariance_ @ (precision @ mean - known.design.T @ inverse @ known.values), covariance_


def conflict(mean: Array, posterior_covariance: Array, known: Observed) -> Conflict:
    """Whether knowledge agrees with a Gaussian that is independent of it.

    Args:
        mean: Of the parameters (P,), working coordinates.
        posterior_covariance: Their covariance (P, P).
        known: About them.
    """
    apart = known.values - known.design @ mean
    both = known.design @ posterior_covariance @ known.design.T + known.covariance
    scale = np.sqrt(np.diag(both))
    values, vectors = np.linalg.eigh(both / np.outer(scale, scale))
    told = values > _LEAST * values[-1]
    parts = (vectors.T @ (apart / scale))[told]
    chi = float(np.sum(parts**2 / values[told]))
    freedom = int(told.sum())
    return Conflict(apart / scale, chi, freedom, float(stats.chi2.sf(chi, freedom)))
