"""Drops that share most parameters and differ in a few about a population: fits of each drop, joined exactly.

Every drop is fitted alone, under the same priors. Its posterior with the prior taken out again is a Gaussian likelihood
of all its parameters, correlations included. The shared ones phi then are the same in every drop, those that vary are
``theta_d ~ N(mu, diag(tau^2))``; phi and mu have the priors of the fits, tau is half-normal. Given tau all of it is one
Gaussian law: theta_d, phi and mu are integrated out in closed form, tau is drawn with numpyro's NUTS, and the rest from
its law given tau. For Gaussian likelihoods that is the joint hierarchical posterior, not an approximation of it.

`bayeschute.inference.population` is the case without shared parameters. It must not be used where there are some: every
drop then informs the shared ones, and through their correlations the population (tests show by how much).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from bayeschute.air.vector import Component
from bayeschute.samplers import nuts

Array = NDArray[np.float64]


class Likelihood(NamedTuple):
    """A Gaussian likelihood of a drop's parameters x up to a constant: ``shift x - 1/2 x precision x``."""

    precision: Array
    shift: Array


class Hierarchy(NamedTuple):
    """Draws of the joint posterior.

    Attributes:
        shared: Shared parameters (chain, draw, S).
        mean: Population means (chain, draw, V).
        sd: Population standard deviations (chain, draw, V).
        drops: Parameters that vary, per drop (chain, draw, D, V).
        failed: Evaluations that were not finite.
    """

    shared: Array
    mean: Array
    sd: Array
    drops: Array
    failed: int


class _Split(NamedTuple):
    """Likelihoods of all drops by shared (s) and varying (v) parameters, and the priors."""

    ss: Component
    sv: Component
    vv: Component
    s: Component
    v: Component
    centre: Component
    scale: Component


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


def _split(likelihoods: Sequence[Likelihood], vary: Sequence[int], centre: Array, scale: Array) -> _Split:
    v = np.array(vary, dtype=int)
    s = np.setdiff1d(np.arange(len(centre)), v)
    a, b = (np.array([getattr(one, key) for one in likelihoods]) for key in ("precision", "shift"))
    order = np.concatenate([s, v])
    blocks = (a[:, s[:, None], s], a[:, s[:, None], v], a[:, v[:, None], v], b[:, s], b[:, v])
    return _Split(*blocks, np.asarray(centre)[order], np.asarray(scale)[order])


def _given(split: _Split, sd: Component) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    """Law of shared parameters and population means given the population's standard deviations, the drops out.

    Returns:
        Its precision and shift (S + V), the drops' precisions (D, V, V), and the log density of the data given sd, up
        to a constant.
    """
    weight = 1.0 / sd**2
    own = split.vv + jnp.diag(weight)  # of theta_d given the rest
    both = jnp.concatenate([split.sv, -jnp.tile(jnp.diag(weight), (len(split.vv), 1, 1))], axis=1)
    root = jnp.linalg.cholesky(own)
    half = jax.scipy.linalg.solve_triangular(root, jnp.swapaxes(both, 1, 2), lower=True)
    seen = jax.scipy.linalg.solve_triangular(root, split.v[..., None], lower=True)[..., 0]
    shared, count = split.ss.shape[1], len(split.vv)
    precision = jnp.diag(1.0 / split.scale**2) - jnp.einsum("dvi,dvj->ij", half, half)
    precision = precision.at[:shared, :shared].add(jnp.sum(split.ss, axis=0))
    precision = precision.at[shared:, shared:].add(count * jnp.diag(weight))
    shift = split.centre / split.scale**2 - jnp.einsum("dvi,dv->i", half, seen)
    shift = shift.at[:shared].add(jnp.sum(split.s, axis=0))
    whole = jnp.linalg.cholesky(precision)
    off = jax.scipy.linalg.solve_triangular(whole, shift, lower=True)
    log = 0.5 * jnp.sum(seen**2) + 0.5 * off @ off + 0.5 * count * jnp.sum(jnp.log(weight))
    log -= jnp.sum(jnp.log(jnp.diagonal(root, axis1=1, axis2=2))) + jnp.sum(jnp.log(jnp.diagonal(whole)))
    return precision, shift, own, log


def _log_density(split: _Split, x: jax.Array) -> jax.Array:
    """Log density of ``log(sd / scale)`` (V,): half-normal priors of the sd, the scales those of the means' priors."""
    shared = split.ss.shape[1]
    unit = jnp.exp(x)
    return _given(split, split.scale[shared:] * unit)[3] + jnp.sum(x - 0.5 * unit**2)


@jax.jit
def _draw(split: _Split, sd: jax.Array, z: jax.Array, own_z: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Shared parameters and means (S + V), and the drops' (D, V), from their law given sd and standard normals."""
    precision, shift, own, _ = _given(split, sd)
    whole = jnp.linalg.cholesky(precision)
    both = jax.scipy.linalg.solve_triangular(
        whole.T, jax.scipy.linalg.solve_triangular(whole, shift, lower=True) + z, lower=False
    )
    shared = split.ss.shape[1]
    phi, mean = both[:shared], both[shared:]
    told = split.v + mean / sd**2 - jnp.einsum("dsv,s->dv", split.sv, phi)
    root = jnp.linalg.cholesky(own)
    first = jax.scipy.linalg.solve_triangular(root, told[..., None], lower=True) + own_z[..., None]
    return both, jax.scipy.linalg.solve_triangular(jnp.swapaxes(root, 1, 2), first, lower=False)[..., 0]


def fit(
    likelihoods: Sequence[Likelihood],
    vary: Sequence[int],
    centre: Array,
    scale: Array,
    chains: int,
    warmup: int,
    draws: int,
    seed: int,
) -> Hierarchy:
    """Draw shared parameters, populations and drops.

    Args:
        likelihoods: One per drop, of the same P parameters in the same order.
        vary: Which of them differ from drop to drop.
        centre: Prior means of shared parameters and population means (P,).
        scale: Their prior standard deviations (P,); scales of the half-normal priors of the population's.
        chains: Chains.
        warmup: Warm-up steps.
        draws: Draws per chain.
        seed: Seed.

    Raises:
        ValueError: If nothing varies, a number is out of range or twice there, or there is no drop.
    """
    if not likelihoods or not vary or len(set(vary)) < len(vary) or not set(vary) <= set(range(len(centre))):
        raise ValueError("a hierarchy needs drops, and parameters that vary, each once")
    split = jax.tree.map(jnp.asarray, _split(likelihoods, vary, centre, scale))
    made = nuts.plain(jax.tree_util.Partial(_log_density, split), len(vary), chains, warmup, draws, seed, thinning=3)
    sd = np.asarray(split.scale)[-len(vary) :] * np.exp(made.xi)
    rng = np.random.default_rng([seed, 16])
    flat = sd.reshape(-1, len(vary))
    z = rng.standard_normal((len(flat), len(centre)))
    own = rng.standard_normal((len(flat), len(likelihoods), len(vary)))
    both, drops = (np.asarray(a) for a in jax.vmap(_draw, (None, 0, 0, 0))(split, flat, z, own))
    both = both.reshape(chains, draws, -1)
    shared = len(centre) - len(vary)
    return Hierarchy(
        both[..., :shared], both[..., shared:], sd, drops.reshape(chains, draws, -1, len(vary)), made.failed
    )


def another_drop(made: Hierarchy, rng: np.random.Generator) -> Array:
    """Parameters that vary, of a drop that was not flown (chain, draw, V)."""
    return made.mean + made.sd * rng.standard_normal(made.mean.shape)
