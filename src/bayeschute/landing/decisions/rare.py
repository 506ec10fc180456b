"""Small failure probabilities by subset simulation in standard normal space.

Au and Beck (Probab. Eng. Mech. 16, 2001, 263): P(F) as a product of conditional probabilities of nested events, each
large enough to be counted; samples of an event begin chains that stay in it. The chains' moves are those of
Papaioannou et al. (Probab. Eng. Mech. 41, 2015, 89), u' = rho u + sqrt(1 - rho^2) xi, which don't suffer from many
dimensions; rho is adapted to an acceptance of 0.44. The limit state sees plain arrays: a formula, or landings.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
LEVEL = 0.1  # conditional probability of each event
_WANTED = 0.44
_MOST_LEVELS = 12


class Rare(NamedTuple):
    """A small probability.

    Attributes:
        probability: Estimate.
        variation: Coefficient of variation of it, samples of a chain counted for what they are worth.
        levels: Thresholds of the nested events, the last one 0.
        evaluations: Limit states that were evaluated.
        samples: Points in the event (N, D), in standard normal space: how it comes about.
    """

    probability: float
    variation: float
    levels: tuple[float, ...]
    evaluations: int
    samples: Array


def subset_simulation(
    limit_state: Callable[[Array], Array], dimension: int, samples: int, rng: np.random.Generator
) -> Rare:
    """P(limit state <= 0).

    Args:
        limit_state: Takes (N, D) standard normal points, gives (N,); at most 0 where it fails, the nearer the smaller.
            What is not finite counts as failed.
        dimension: D.
        samples: N of each level.
        rng: Source of randomness.
    """

    def values(u: Array) -> Array:
        g = np.asarray(limit_state(u), float)
        return np.where(np.isfinite(g), g, -np.inf)

    u = rng.standard_normal((samples, dimension))
    g = values(u)
    chance, scatter, levels, count, spread = 1.0, 0.0, [], samples, 0.6
    chains = np.arange(samples)
    for _ in range(_MOST_LEVELS):
        threshold = float(np.sort(g)[int(np.ceil(LEVEL * samples)) - 1])
        last = threshold <= 0.0
        inside = g <= (0.0 if last else threshold)
        share = float(inside.mean())
        levels.append(0.0 if last else threshold)
        chance *= share
        scatter += _variation(inside, chains)
        if last or share == 0.0:
            return Rare(chance, float(np.sqrt(scatter)), tuple(levels), count, u[inside])
        u, g, chains, spread, more = _chains(values, u[inside], g[inside], threshold, samples, spread, rng)
        count += more
    return Rare(0.0, np.inf, tuple(levels), count, u[:0])


def _variation(inside: NDArray[np.bool_], chains: NDArray[np.int64]) -> float:
    """Squared coefficient of variation of a share, by the scatter between chains."""
    share = float(inside.mean())
    if share <= 0.0:
        return np.inf
    _, back = np.unique(chains, return_inverse=True)
    total = np.bincount(back, inside - share)
    return float((total**2).sum() / inside.size**2 / share**2)


def _chains(
    values: Callable[[Array], Array], seeds: Array, g_seeds: Array, threshold: float, samples: int, spread: float,
    rng: np.random.Generator,
) -> tuple[Array, Array, NDArray[np.int64], float, int]:  # fmt: skip
    """Points of an event by chains from all seeds, side by side.

    Returns:
        Points, their limit states, the chain of each, the moves' spread, and evaluations of the limit state.
    """
    count = len(seeds)
    order = rng.permutation(count)
    u, g = seeds[order], g_seeds[order]
    kept_u, kept_g, kept = [u], [g], [np.arange(count)]
    step = 0
    while sum(map(len, kept_g)) < samples:
        rho = np.sqrt(1.0 - min(spread, 1.0) ** 2)
        tried = rho * u + min(spread, 1.0) * rng.standard_normal(u.shape)
        g_tried = values(tried)
        taken = g_tried <= threshold
        u, g = np.where(taken[:, None], tried, u), np.where(taken, g_tried, g)
        kept_u.append(u)
        kept_g.append(g)
        kept.append(np.arange(count))
        step += 1
        spread = float(np.clip(spread * np.exp((taken.mean() - _WANTED) / np.sqrt(step)), 0.05, 1.0))
    chain = np.concatenate(kept)[:samples]
    return np.concatenate(kept_u)[:samples], np.concatenate(kept_g)[:samples], chain, spread, step * count
