"""Hierarchical model of drops and canopies that share most parameters and differ in some.

Fits were made under independent priors of all parameters. A posterior divided by its prior is a Gaussian likelihood,
correlations included; those of separate fits are multiplied (`joint`). The shared parameters phi have the priors of the
fits. The others are members of populations, ``theta_m ~ N(mu_k, tau_k^2)``; mu has the priors of the fits, tau is
half-normal. Given tau the joint distribution is Gaussian, from which phi, mu and theta are integrated out in closed
form; tau is drawn with numpyro's NUTS, and the others from their distribution given tau. For Gaussian likelihoods this
is the exact hierarchical posterior.

Without shared parameters it is the random-effects model of bodies. Members must not be reduced to that where there are
some: each informs the shared ones, and through their correlations the population (tests show by how much).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtr, ndtri
from numpy.typing import NDArray

from bayeschute.core.random import stream
from bayeschute.core.vectors import Component
from bayeschute.posterior.sampling import delayed_acceptance

Array = NDArray[np.float64]


class Likelihood(NamedTuple):
    """A Gaussian likelihood of parameters x up to a constant: ``shift x - 1/2 x precision x``."""

    precision: Array
    shift: Array


class Hierarchy(NamedTuple):
    """Draws of the joint posterior.

    Attributes:
        shared: Shared parameters (chain, draw, S).
        mean: Population means (chain, draw, K).
        sd: Population standard deviations (chain, draw, K).
        members: Parameters of the members, one population after the other (chain, draw, M).
        failed: Evaluations that were not finite.
        diverging: Whether the transition of NUTS to a draw diverged (chain, draw).
    """

    shared: Array
    mean: Array
    sd: Array
    members: Array
    failed: int
    diverging: Array


class _Population(NamedTuple):
    """Gaussian parts of the posterior, given the populations' standard deviations.

    Attributes:
        told: Gaussian likelihood of (shared, members).
        centre: Prior means of shared parameters and population means (S + K,).
        scale: Their prior standard deviations (S + K,).
        spread: Scales of the half-normal priors of the populations' standard deviations (K,).
        of: Population of every member (M,).
    """

    told: Likelihood
    centre: Component
    scale: Component
    spread: Component
    of: Component


def likelihood_of(mean: Array, covariance: Array, prior_centre: Array, prior_scale: Array) -> Likelihood:
    """Gaussian likelihood of a posterior whose prior is taken out again.

    Args:
        mean: Posterior mean (P,), working coordinates.
        covariance: Posterior covariance (P, P).
        prior_centre: Prior means (P,).
        prior_scale: Prior standard deviations (P,).

    Returns:
        The likelihood; along directions in which the posterior is wider than the prior, by chance of its draws, it
        tells nothing.
    """
    scale = np.asarray(prior_scale)
    whitened = np.linalg.inv(covariance / np.outer(scale, scale))
    values, vectors = np.linalg.eigh(0.5 * (whitened + whitened.T))
    told = values > 1.0
    off = vectors.T @ ((mean - prior_centre) / scale)
    precision = (vectors * np.where(told, values - 1.0, 0.0)) @ vectors.T / np.outer(scale, scale)
    shift = vectors @ np.where(told, values * off, 0.0) / scale
    return Likelihood(precision, shift + precision @ np.asarray(prior_centre))


def joint(likelihoods: Sequence[Likelihood], places: Sequence[Sequence[int]], size: int) -> Likelihood:
    """Product of several likelihoods of data that are independent given the parameters.

    Args:
        likelihoods: Of some parameters each.
        places: Indices of these among all parameters, per likelihood.
        size: Number of all parameters.
    """
    whole = Likelihood(np.zeros((size, size)), np.zeros(size))
    for one, place in zip(likelihoods, places, strict=True):
        at = np.asarray(place, dtype=int)
        whole.precision[at[:, None], at] += one.precision
        whole.shift[at] += one.shift
    return whole


def _lift(population: _Population, sd: Component) -> jax.Array:
    """From (shared, population means, members' standard scores) to (shared, members)."""
    members, size = population.of.shape[0], population.told.shift.shape[0]
    shared, m = size - members, jnp.arange(members)
    lift = jnp.zeros((size, shared + sd.shape[0] + members)).at[:shared, :shared].set(jnp.eye(shared))
    of = population.of
    return lift.at[shared + m, shared + of].set(1.0).at[shared + m, shared + sd.shape[0] + m].set(sd[of])


def _given(population: _Population, sd: Component) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Distribution of (shared, means, members' standard scores) given the populations' standard deviations.

    Returns:
        Cholesky factor of its precision; the mean in the coordinates of that factor; the log density of the data given
        sd, up to a constant.
    """
    lift, own = _lift(population, sd), jnp.zeros(population.of.shape[0])
    prior = jnp.concatenate([1.0 / population.scale**2, own + 1.0])
    root = jnp.linalg.cholesky(lift.T @ population.told.precision @ lift + jnp.diag(prior))
    shift = lift.T @ population.told.shift + jnp.concatenate([population.centre / population.scale**2, own])
    off = jax.scipy.linalg.solve_triangular(root, shift, lower=True)
    return root, off, 0.5 * off @ off - jnp.sum(jnp.log(jnp.diagonal(root)))


def half_normal(standard: Component) -> jax.Array:
    """A half-normal number of scale one by a standard normal one (...), which rises with it.

    Few members leave a population's standard deviation anywhere between nothing and its prior. In this coordinate its
    density falls on both sides as a Gaussian does; in the logarithm it falls slowly on one side and steeply on the
    other, and no step of the sampler suits both.
    """
    return -ndtri(0.5 * ndtr(-jnp.asarray(standard)))


def _log_density(population: _Population, x: jax.Array) -> jax.Array:
    """Log density of standard coordinates of the populations' standard deviations (K,); see `half_normal`."""
    return _given(population, population.spread * half_normal(x))[2] - 0.5 * x @ x


@jax.jit
def _draw(population: _Population, sd: jax.Array, z: jax.Array) -> jax.Array:
    """Shared parameters, means and members (S + K + M,) drawn given sd, from standard normal numbers."""
    root, off, _ = _given(population, sd)
    drawn = jax.scipy.linalg.solve_triangular(root.T, off + z, lower=False)
    own = (_lift(population, sd) @ drawn)[-population.of.shape[0] :]
    return jnp.concatenate([drawn[: population.centre.shape[0]], own])


def fit(
    likelihood: Likelihood,
    sizes: Sequence[int],
    centre: Array,
    scale: Array,
    spread: Array,
    chains: int,
    warmup: int,
    draws: int,
    seed: int,
) -> Hierarchy:
    """Draw shared parameters, populations and their members.

    Args:
        likelihood: Of the shared parameters, then the members of all populations, one after the other (S + M).
        sizes: Number of members of every population.
        centre: Prior means of shared parameters, then of population means (S + K,).
        scale: Their prior standard deviations (S + K,).
        spread: Scales of the half-normal priors of the populations' standard deviations (K,).
        chains: Chains.
        warmup: Warm-up steps.
        draws: Draws per chain.
        seed: Seed.

    Raises:
        ValueError: If there is no population, one has no member, or lengths don't agree.
    """
    count, known = len(sizes), len(centre)
    fits = len(spread) == count <= known and len(likelihood.shift) == known - count + sum(sizes)
    if not (fits and count and min(sizes) >= 1):
        raise ValueError("a hierarchy needs populations, members of each, and a likelihood of all parameters")
    population = jax.tree.map(
        jnp.asarray, _Population(likelihood, centre, scale, spread, np.repeat(np.arange(count), sizes))
    )
    made = delayed_acceptance.plain(
        jax.tree_util.Partial(_log_density, population), count, chains, warmup, draws, seed, thinning=3
    )
    sd = np.asarray(spread) * np.asarray(half_normal(made.xi))
    flat = sd.reshape(-1, count)
    z = stream(seed, "shared parameters and members").standard_normal((len(flat), known + sum(sizes)))
    drawn = np.asarray(jax.vmap(_draw, (None, 0, 0))(population, flat, z)).reshape(chains, draws, -1)
    shared, mean, members = np.split(drawn, [known - count, known], axis=-1)
    return Hierarchy(shared, mean, sd, members, made.failed, made.stats["diverging"])


def others(made: Hierarchy, of: Sequence[int], rng: np.random.Generator) -> Array:
    """Further members of populations, which no data are of (chain, draw, N).

    Args:
        made: The hierarchy.
        of: The population of each (N,).
        rng: Random numbers.
    """
    mean, sd = made.mean[..., list(of)], made.sd[..., list(of)]
    return mean + sd * rng.standard_normal(mean.shape)
