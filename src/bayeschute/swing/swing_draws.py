"""Draws of a swing's posterior: its optimum, then adaptive importance sampling.

Importance sampling follows Cappe et al. (2004, "Population Monte Carlo") with the deterministic mixture weights of
Cornuet et al. (2012): Student-t proposals, each round's mean and covariance from all draws before it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from bayeschute.swing.swing_posterior import SwingProblem, solve

_DIFFERENCE = 1e-4
_FREEDOM = 5  # of the proposals


class Posterior(NamedTuple):
    """Weighted draws.

    Attributes:
        psi: Rows of `PARAMETERS` (n, 6).
        weight: Sum to one (n,).
        ess: Effective number of draws.
    """

    psi: Float[np.ndarray, "n 6"]
    weight: Float[np.ndarray, " n"]
    ess: float


def _start(problem: SwingProblem) -> np.ndarray:
    """The best of a grid of frequencies and damping ratios."""
    omega = 2.0 * np.pi * problem.frequency
    reach = min(1.0 / (problem.frequency * problem.dt * problem.data.shape[0]), 0.3)
    grid = np.tile(problem.centre, (25 * 5, 1))
    shift, damping = np.meshgrid(np.linspace(-reach, reach, 25), [-0.01, 0.0, 0.01, 0.03, 0.08])
    low, high = (np.log(2.0 * np.pi * f) for f in problem.band)
    grid[:, 0] = np.clip(grid[:, 0] + shift.ravel(), low, high)
    grid[:, 1] = damping.ravel() * omega
    return np.asarray(grid[np.argmax(solve(problem, grid).log_density)])


class Optimum(NamedTuple):
    """Where the density is greatest, and its curvature there.

    Attributes:
        psi: (6,).
        covariance: Inverse of the Hessian, by the free parameters in units of `SwingProblem.step`.
    """

    psi: Float[np.ndarray, " 6"]
    covariance: Float[np.ndarray, "d d"]


def optimum(problem: SwingProblem) -> Optimum:
    """Maximise the density: BFGS on central differences, all of them in one pass of the filter."""
    from scipy.optimize import minimize

    free, start = problem.free, _start(problem)
    step, d = problem.step[free], len(problem.free)
    offsets = np.concatenate([np.zeros((1, d)), *(_DIFFERENCE * np.array([e, -e]) for e in np.eye(d))])

    def cost(u: np.ndarray) -> tuple[float, np.ndarray]:
        psi = np.tile(start, (len(offsets), 1))
        psi[:, free] += (u + offsets) * step
        values = -solve(problem, psi).log_density
        if not np.isfinite(values).all():
            return 1e12, np.zeros(d)
        return float(values[0]), (values[1::2] - values[2::2]) / (2.0 * _DIFFERENCE)

    found = minimize(cost, np.zeros(d), jac=True, method="BFGS", options={"gtol": 1e-2, "maxiter": 200})
    reach = 0.05
    hessian = np.array(
        [(cost(found.x + reach * e)[1] - cost(found.x - reach * e)[1]) / (2.0 * reach) for e in np.eye(d)]
    )
    values, vectors = np.linalg.eigh((hessian + hessian.T) / 2.0)
    psi = start.copy()
    psi[free] += found.x * step
    return Optimum(psi, (vectors / np.maximum(values, 0.05)) @ vectors.T)


def importance(
    problem: SwingProblem, at: Optimum, rng: np.random.Generator, draws: int = 400, least_ess: float = 150.0
) -> Posterior:
    """Weighted draws of the posterior, in three to eight rounds until there are enough effective ones.

    Args:
        problem: The data.
        at: Its optimum.
        rng: Source of randomness.
        draws: Per round.
        least_ess: Effective draws that end the rounds.

    Returns:
        The draws of all rounds.
    """
    free, d = problem.free, len(problem.free)
    step, mean, cov = problem.step[free], np.zeros(d), at.covariance
    u, density, proposals, weight, ess = np.zeros((0, d)), np.zeros(0), [], np.zeros(0), 0.0
    for round_ in range(8):
        root = np.linalg.cholesky(cov)
        spread = np.sqrt(rng.chisquare(_FREEDOM, draws) / _FREEDOM)[:, None]
        new = mean + (rng.standard_normal((draws, d)) / spread) @ root.T
        psi = np.tile(at.psi, (draws, 1))
        psi[:, free] += new * step
        u, density = np.concatenate([u, new]), np.concatenate([density, solve(problem, psi).log_density])
        proposals.append((mean, root))
        log_weight = density - np.logaddexp.reduce([_student(u, *proposal) for proposal in proposals], axis=0)
        log_weight = np.where(np.isfinite(log_weight), log_weight, -np.inf)
        weight = np.exp(log_weight - log_weight.max())
        weight /= weight.sum()
        ess = float(1.0 / np.sum(weight**2))
        if round_ >= 2 and ess >= least_ess:
            break
        shared = np.minimum(
            weight, max(np.sort(weight)[-20], 1e-12)
        )  # a few great weights would shrink the next proposal
        shared /= shared.sum()
        mean = shared @ u
        cov = ((u - mean) * shared[:, None]).T @ (u - mean) + 1e-6 * np.eye(d)
    psi = np.tile(at.psi, (len(u), 1))
    psi[:, free] += u * step
    return Posterior(psi, weight, ess)


def _student(u: np.ndarray, mean: np.ndarray, root: np.ndarray) -> np.ndarray:
    """Log density of a proposal, up to a constant."""
    distance = np.sum(np.linalg.solve(root, (u - mean).T) ** 2, axis=0)
    d = u.shape[1]
    return np.asarray(-0.5 * (_FREEDOM + d) * np.log1p(distance / _FREEDOM) - np.log(np.diag(root)).sum())
