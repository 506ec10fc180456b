"""Random-effects model: a log-normal population of similar bodies from the posterior of each.

Every body's own posterior, divided by its prior, is a Gaussian likelihood of its logarithm; the population's mean and
standard deviation get weak priors and are drawn with numpyro's NUTS, the bodies' values integrated out exactly.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from bayeschute.posterior.sampling import delayed_acceptance

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Population:
    """Draws (chain, draw) of the population's mean and standard deviation of the logarithm."""

    mean: Array
    sd: Array


def likelihood_of(mean: float, sd: float, prior_mean: float, prior_sd: float) -> tuple[float, float]:
    """Gaussian likelihood (mean, sd) of a posterior whose prior is taken out again."""
    precision = max(1.0 / sd**2 - 1.0 / prior_sd**2, 1e-12)
    return (mean / sd**2 - prior_mean / prior_sd**2) / precision, precision**-0.5


def fit(
    mean: Array, sd: Array, prior: tuple[float, float], chains: int, warmup: int, draws: int, seed: int
) -> Population:
    """Draw the population.

    Args:
        mean: Likelihood means of the bodies' logarithms (B,).
        sd: Their standard deviations (B,).
        prior: Mean and standard deviation of the population's mean; its standard deviation is half-normal of scale
            ``prior[1]``.
        chains: Chains.
        warmup: Warm-up steps.
        draws: Draws per chain.
        seed: Seed.
    """
    density = jax.tree_util.Partial(_log_density, jnp.asarray(mean), jnp.asarray(sd), *prior)
    made = delayed_acceptance.plain(density, 2, chains, warmup, draws, seed, thinning=3).xi
    return Population(prior[0] + prior[1] * made[..., 0], prior[1] * np.exp(made[..., 1]))


def _log_density(mean: jax.Array, sd: jax.Array, prior_mean: float, prior_sd: float, x: jax.Array) -> jax.Array:
    """Log density of the population's mean in units of its prior, and of the logarithm of its sd, the bodies out."""
    mu, spread = prior_mean + prior_sd * x[0], prior_sd * jnp.exp(x[1])
    variance = sd**2 + spread**2
    bodies = -0.5 * jnp.sum((mean - mu) ** 2 / variance + jnp.log(variance))
    return bodies - 0.5 * x[0] ** 2 - 0.5 * (spread / prior_sd) ** 2 + x[1]
