"""Adaptive independence sampler: population Monte Carlo proposals of t mixtures, then Metropolis-Hastings.

Adaptive importance sampling (Cappé, Guillin, Marin and Robert 2004): a population is drawn from a t distribution and
weighed by the exact density over that of the mixture of the last ones (Veach and Guibas' balance heuristic); its
weighed mean and covariance make the next. Where few draws have all the weight, weights are flattened by a power until
enough have some. Independent draws from the best of these proposals are accepted or rejected by the exact ratio, so the
draws have the exact density however good the proposal is. For a posterior with one mode it needs no gradient, no
surrogate and no more than some thousand evaluations, in large batches.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import logsumexp

from bayeschute.core.random import stream
from bayeschute.posterior.sampling.protocol import Array, Counted, Draws, LogDensity, Progress

_FREEDOM = 5.0  # degrees of freedom of the proposals
_SIZE, _MOST = 768, 12  # of a population; most populations
_MIXED = 5  # populations whose mixture weighs
_GOOD = 0.2  # share of effective draws at which learning ends
_MOMENTS = 6  # effective draws per parameter from which a proposal is made
_FLATTER = 0.8


class Proposal(NamedTuple):
    """A t distribution.

    Attributes:
        middle: (P,).
        factor: Lower Cholesky factor of its scale matrix (P, P).
        freedom: Degrees of freedom.
    """

    middle: Array
    factor: Array
    freedom: float = _FREEDOM

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """Draws (count, P)."""
        wide = np.sqrt(self.freedom / rng.chisquare(self.freedom, (count, 1)))
        return np.asarray(self.middle + wide * rng.standard_normal((count, self.middle.size)) @ self.factor.T)

    def log_density(self, x: Array) -> Array:
        """Log density (N,) of points (N, P), a constant of P aside."""
        unit = solve_triangular(self.factor, (x - self.middle).T, lower=True)
        size = np.log(np.diag(self.factor)).sum()
        return np.asarray(-0.5 * (self.freedom + len(unit)) * np.log1p((unit**2).sum(axis=0) / self.freedom) - size)


def effective(log_weight: Array) -> float:
    """Effective number of weighed draws; 0 where none has a weight."""
    if not np.isfinite(log_weight).any():
        return 0.0
    return float(np.exp(2.0 * logsumexp(log_weight) - logsumexp(2.0 * log_weight)))


def fitted(x: Array, log_weight: Array) -> Proposal:
    """The proposal with mean and covariance of weighed draws (N, P).

    Where few draws have all the weight, weights are flattened by a power until enough have some.
    """
    least = min(_MOMENTS * x.shape[1], 0.5 * np.isfinite(log_weight).sum())
    while effective(log_weight) < least:
        log_weight = _FLATTER * log_weight
    w = np.exp(log_weight - logsumexp(log_weight))
    middle = w @ x
    return Proposal(middle, np.linalg.cholesky(((x - middle) * w[:, None]).T @ (x - middle)))


def learned(log_density: LogDensity, parameters: int, rng: np.random.Generator) -> tuple[Proposal, Array]:
    """The proposal of most effective draws, beginning with standard coordinates' own, and a draw's worth of starts.

    Args:
        log_density: Log densities (B,) of points (P, B), minus infinity where they fail.
        parameters: P.
        rng: Random numbers.

    Returns:
        The proposal, and points drawn about as the density has them (N, P).

    Raises:
        FloatingPointError: If no more draws than parameters have a density.
    """
    made = [Proposal(np.zeros(parameters), np.eye(parameters))]
    points: list[Array] = []
    values: list[Array] = []
    shares: list[float] = []
    for _ in range(_MOST):
        points.append(made[-1].draw(_SIZE, rng))
        values.append(log_density(points[-1].T))
        shares.append(effective(values[-1] - made[-1].log_density(points[-1])) / _SIZE)
        if shares[-1] > _GOOD:
            break
        x, value = np.concatenate(points[-_MIXED:]), np.concatenate(values[-_MIXED:])
        if np.isfinite(value).sum() <= 2 * parameters:
            raise FloatingPointError(f"{np.isfinite(value).sum()} of {value.size} points have a density: too few")
        made.append(fitted(x, value - logsumexp([one.log_density(x) for one in made[-_MIXED:]], axis=0)))
    best = int(np.argmax(shares))
    log_weight = values[best] - made[best].log_density(points[best])
    weight = np.exp(log_weight - logsumexp(log_weight))
    return made[best], points[best][rng.choice(_SIZE, _SIZE, p=weight)]


def sample(
    log_density: LogDensity,
    parameters: int,
    chains: int,
    draws: int,
    seed: int,
    thin: int = 12,
    progress: Progress | None = None,
) -> Draws:
    """Draw by independent proposals.

    Args:
        log_density: Log densities (B,) of points (P, B).
        parameters: P.
        chains: Chains.
        draws: Draws per chain.
        seed: Seed.
        thin: Proposals per draw.
        progress: Called with draws done and wanted.

    Returns:
        The draws, with acceptance rates, and ``log_ratio``: exact less proposal log density at what was proposed last,
        minus infinity where a simulation failed (`why_not_trusted.pareto_k`).

    Raises:
        FloatingPointError: If hardly any point has a density.
    """
    counted, rng = Counted(log_density), stream(seed, "independence sampler")
    proposal, starts = learned(counted, parameters, rng)
    here = starts[:chains]
    value = counted(here.T)
    ratio = value - proposal.log_density(here)
    rows: dict[str, list[Array]] = {"xi": [], "log_density": [], "acceptance_rate": [], "log_ratio": []}
    block = max(_SIZE // (chains * thin), 1)
    for begin in range(0, draws, block):
        count = min(block, draws - begin)
        x = proposal.draw(count * thin * chains, rng)
        there = counted(x.T)
        offered = (there - proposal.log_density(x)).reshape(count, thin, chains)
        x, there = x.reshape(count, thin, chains, parameters), there.reshape(count, thin, chains)
        chance = np.log(rng.random((count, thin, chains)))
        for i in range(count):
            accepted = np.zeros(chains)
            for j in range(thin):
                taken = chance[i, j] < offered[i, j] - ratio
                here = np.where(taken[:, None], x[i, j], here)
                value, ratio = np.where(taken, there[i, j], value), np.where(taken, offered[i, j], ratio)
                accepted += taken / thin
            for name, row in zip(rows, (here, value, accepted, offered[i, -1]), strict=True):
                rows[name].append(row)
        if progress is not None:
            progress((begin + count) * chains, draws * chains)
    made = {name: np.stack(row, axis=1) for name, row in rows.items()}
    xi, lp = made.pop("xi"), made.pop("log_density")
    return Draws(xi, lp, made, counted.failed, counted.evaluations)
