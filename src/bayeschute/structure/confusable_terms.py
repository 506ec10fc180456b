"""Confusable terms: the candidate most easily selected in place of a true term, and the probability of that.

Let u be the unit vector of a selected term orthogonalised against the other selected terms, v that of a candidate,
r = u.v >= 0 their partial correlation, and a the size of the term's part of the signal along u. The term explains
(a + e_u)^2, the candidate (a r + e_v)^2, and the candidate explains more where a (1 - r) < e_v - e_u, whose variance is
2 (1 - r) sigma^2 for noise of (long-run) variance sigma^2. Its probability is ``Phi(-a sqrt((1 - r)/2)/sigma)``, which
weighs collinearity against signal and noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from bayeschute.core.errors import Fault, InputError
from bayeschute.regression.orthogonal import orthonormal
from bayeschute.regression.problem import positive, read_problem

_NOTHING_LEFT = 1e-6


class Rival(NamedTuple):
    """The candidate that is most easily confused with a selected term.

    Attributes:
        term: The selected term.
        rival: The candidate; empty if there is no other.
        correlation: Partial correlation given the other selected terms; 1: not separable by any record of this motion.
        strength: Size of the term's own part of the signal, in standard deviations of the noise along it.
        chance: Probability that noise makes the candidate explain more.
    """

    term: str
    rival: str
    correlation: float
    strength: float
    chance: float


def rivals(
    X: Float[np.ndarray, "N p"],
    names: Sequence[str],
    kept: Sequence[int],
    estimate: Float[np.ndarray, " n"],
    noise_variance: float,
) -> tuple[Rival, ...]:
    """For each selected term the candidate that is most easily confused with it.

    Args:
        X: All candidates; rows with a NaN are left out, (N, p).
        names: Their names.
        kept: Columns of the model.
        estimate: Their coefficients.
        noise_variance: Variance of the noise times its integrated autocorrelation time [unit of z, squared].

    Returns:
        One candidate per selected term.

    Raises:
        InputError: For bad X, coefficients that don't fit, or a noise variance not above 0.
    """
    problem = read_problem(X, np.zeros(np.shape(X)[0] if np.ndim(X) else 0), names, "rivals")
    positive("rivals, noise variance", noise_variance)
    if len(kept) != len(estimate) or not set(kept) <= set(range(problem.X.shape[1])):
        raise InputError(Fault("rivals", f"{len(kept)} columns, {len(estimate)} coefficients", "one for each column"))
    columns = problem.X
    own = np.linalg.norm(columns, axis=0)
    found = []
    for column, coefficient in zip(kept, estimate, strict=True):
        others = [j for j in kept if j != column]
        basis = orthonormal(columns[:, others])
        left = columns - basis @ (basis.T @ columns)
        size = np.linalg.norm(left, axis=0)
        seen = size > _NOTHING_LEFT * np.where(own > 0.0, own, 1.0)
        seen[list(kept)] = False
        strength = abs(float(coefficient)) * size[column] / np.sqrt(noise_variance)
        candidates = np.flatnonzero(seen)
        if not candidates.size or size[column] == 0.0:
            found.append(Rival(problem.names[column], "", 0.0, float(strength), 0.0))
            continue
        r = np.abs(left[:, candidates].T @ left[:, column]) / (size[candidates] * size[column])
        r = np.minimum(r, 1.0)
        best = int(np.argmax(r))
        chance = float(ndtr(-strength * np.sqrt((1.0 - r[best]) / 2.0)))
        found.append(
            Rival(problem.names[column], problem.names[candidates[best]], float(r[best]), float(strength), chance)
        )
    return tuple(found)
