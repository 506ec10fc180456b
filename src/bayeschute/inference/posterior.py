"""The whole way from data and priors to draws: optimum, noise parameters, marginal posterior, sampler, DataTree."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from arviz_base import from_dict
from numpy.typing import NDArray

from bayeschute.inference import evidence
from bayeschute.inference import map as optimum
from bayeschute.inference.evidence import HyperPrior
from bayeschute.inference.map import Optimum
from bayeschute.inference.marginal import Marginal, draw_unknowns, log_density, marginalise, projected_residuals
from bayeschute.inference.noise import gains, whiten
from bayeschute.inference.priors import Prior, values, working
from bayeschute.inference.surrogate import Surrogate, build
from bayeschute.inference.target import FlightData, Hyper, linearise, residuals
from bayeschute.samplers import ensemble, nuts
from bayeschute.samplers.protocol import Draws

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]
BATCH = 64
HORIZONS = (0.2, 0.5)  # shares fitted first: an unstable pendulum far from its optimum is lost late in the record


@dataclass(frozen=True)
class Found:
    """The optimum, its noise parameters, the marginal posterior there, and how well the latent processes are known."""

    optimum: Optimum
    hyper: Hyper
    marginal: Marginal
    evidence: float
    latent_covariance: Array


def _until(flight: FlightData, share: float) -> FlightData:
    """The flight with data beyond a share of its samples absent; shapes stay, so compiled functions serve."""
    seen = np.array(flight.present)
    seen[int(np.ceil(share * len(seen))) :] = False
    return replace(flight, present=seen)


def find(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    prior: HyperPrior,
    rounds: int = 2,
    progress: Progress | None = None,
) -> Found:
    """Fit parameters, initial states, latent disturbances and noise parameters, by turns.

    Args:
        flights: Records.
        priors: Priors of the parameters.
        prior: Priors of the noise parameters.
        rounds: Turns of optimum and evidence before the last optimum.
        progress: Called with a share done and words.

    Returns:
        What was found.

    Raises:
        FloatingPointError: If the simulation at the prior means is not finite.
    """
    say = progress or (lambda share, words: None)
    theta, hyper = working(priors)[0], prior.median
    u: list[Array] = [np.zeros(f.unknowns) for f in flights]
    value = np.nan
    for share in HORIZONS:
        say(0.0, f"opening {100 * share:.0f} % of the record")
        seen = [_until(f, share) for f in flights]
        best = optimum.fit(seen, hyper, priors, theta, u, tolerance=0.5, most=12)
        theta, u = best.theta, list(best.u)
    for turn in range(rounds + 1):
        last = turn == rounds

        def tell(iteration: int, cost: float, step: float, turn: int = turn) -> None:
            share = (turn + min(iteration / 12.0, 0.8)) / (rounds + 1)
            say(share, f"optimum {turn + 1}: cost {cost:.1f}, step {step:.3f} standard errors")

        best = optimum.fit(flights, hyper, priors, theta, u, tolerance=0.01 if last else 0.1, progress=tell)
        theta, u = best.theta, list(best.u)
        if not last:
            say((turn + 0.9) / (rounds + 1), f"noise parameters {turn + 1}")
            linear = [linearise(f, theta, x) for f, x in zip(flights, u, strict=True)]
            hyper, value = evidence.maximise(flights, linear, priors, theta, hyper, prior, most=15 if turn == 0 else 10)
    say(0.98, "uncertainty of the noise parameters")
    linear = [linearise(f, theta, x) for f, x in zip(flights, u, strict=True)]
    known = evidence.latent_covariance(flights, linear, priors, theta, hyper, prior)
    return Found(best, hyper, marginalise(flights, hyper, priors, best), value, known)


def in_batches(function: Callable[[Array], Any], xi: Array, batch: int = BATCH) -> Any:
    """Apply a function of (P, batch) to (P, B) in equal pieces, so that one compilation serves; last axes joined."""
    count = xi.shape[-1]
    padded = np.concatenate([xi, np.repeat(xi[..., -1:], -count % batch, axis=-1)], axis=-1)
    pieces = [function(padded[..., i : i + batch]) for i in range(0, padded.shape[-1], batch)]
    return jax.tree.map(lambda *a: np.concatenate([np.asarray(x) for x in a], axis=-1)[..., :count], *pieces)


def sample(
    marginal: Marginal, kind: str, chains: int, warmup: int, draws: int, seed: int, progress: Progress | None = None
) -> Draws:
    """Draw parameters from the marginal posterior in standard coordinates.

    Args:
        marginal: The posterior.
        kind: ``"nuts"`` (numpyro's NUTS on a quadratic surrogate, corrected exactly by delayed acceptance) or
            ``"emcee"`` (ensembles on the same density).
        chains: Chains.
        warmup: Warm-up steps.
        draws: Draws per chain.
        seed: Seed.
        progress: Called with a share done and words.

    Returns:
        The draws.
    """
    parameters = int(np.size(marginal.centre))

    def exact(xi: Array) -> Array:
        if xi.shape[1] in (16, BATCH // 2, BATCH):
            return np.asarray(log_density(marginal, xi))
        return np.asarray(in_batches(lambda part: log_density(marginal, part), xi))

    def tell(done: int, wanted: int) -> None:
        if progress is not None:
            progress(done / wanted, f"{kind}: {done} of {wanted}")

    if kind == "emcee":
        return ensemble.sample(exact, parameters, chains, draws, seed, walkers=BATCH, progress=tell)
    rng = np.random.default_rng([seed, 2])
    surrogate, failed = build(
        lambda xi: in_batches(lambda part: projected_residuals(marginal, part), xi), parameters, rng
    )
    density = jax.tree_util.Partial(Surrogate.log_density, surrogate)
    made = nuts.corrected(exact, density, parameters, chains, warmup, draws, seed, progress=tell)
    note = f"{failed} simulations failed while the surrogate was built" if failed else ""
    return made if not note else Draws(**{**made.__dict__, "notes": (*made.notes, note)})


def data_tree(
    marginal: Marginal,
    priors: Sequence[Prior],
    draws: Draws,
    seed: int,
    flight_names: Sequence[str],
    progress: Progress | None = None,
) -> xr.DataTree:
    """Everything about a posterior in one ArviZ DataTree.

    The log likelihood is conditional on drawn initial states and latent disturbances, one entry per sample of each
    flight (innovations of all its outputs together).

    Args:
        marginal: The posterior.
        priors: Priors of the parameters.
        draws: Draws in standard coordinates.
        seed: Seed of prior draws, unknowns and posterior predictions.
        flight_names: Names of the flights, in order.
        progress: Called with a share done and words.

    Returns:
        Groups posterior, prior, sample_stats, log_likelihood, log_prior, posterior_predictive, observed_data,
        constant_data.
    """
    rng = np.random.default_rng([seed, 3])
    chains, count, parameters = draws.xi.shape
    theta = np.asarray(marginal.centre) + draws.xi @ np.asarray(marginal.scale).T
    centre, scale = working(priors)
    prior_draws = centre + scale * rng.standard_normal((1, 2000, parameters))
    log_prior = -0.5 * ((theta - centre) / scale) ** 2 - np.log(scale) - 0.5 * np.log(2.0 * np.pi)
    likelihood, predictive = _per_sample(marginal, draws, rng, progress)
    groups: dict[str, Any] = {
        "posterior": _named(priors, values(priors, theta)),
        "prior": _named(priors, values(priors, prior_draws)),
        "sample_stats": {"lp": draws.log_density, **draws.stats},
        "log_prior": _named(priors, log_prior),
        "log_likelihood": dict(zip(flight_names, likelihood, strict=True)),
        "posterior_predictive": dict(zip(flight_names, predictive, strict=True)),
        "observed_data": {
            name: np.where(np.asarray(f.present), np.asarray(f.observed), np.nan)
            for name, f in zip(flight_names, marginal.flights, strict=True)
        },
        "constant_data": {
            **{f"noise.{k}": np.asarray(v) for k, v in marginal.hyper.noise.__dict__.items()},
            "latent_sd": np.asarray(marginal.hyper.latent_sd),
            "latent_time_constant": np.asarray(marginal.hyper.latent_time_constant),
        },
    }
    tree = from_dict(groups)
    for group in ("posterior", "prior"):
        for p in priors:
            tree[group][p.name].attrs["units"] = p.unit
    return tree


def _named(priors: Sequence[Prior], array: Array) -> dict[str, Array]:
    return {p.name: array[..., i] for i, p in enumerate(priors)}


@jax.jit
def _innovations(flight: FlightData, hyper: Hyper, theta: jax.Array, u: jax.Array) -> tuple[jax.Array, jax.Array]:
    residual = residuals(flight, theta, u)
    return whiten(hyper.outputs(flight), flight.dt, flight.present, residual), residual


def _per_sample(
    marginal: Marginal, draws: Draws, rng: np.random.Generator, progress: Progress | None
) -> tuple[list, list]:
    """Log likelihood per flight (chain, draw, T) and a posterior prediction per flight (chain, 25, T, C)."""
    chains, count, parameters = draws.xi.shape
    flat = draws.xi.reshape(-1, parameters).T
    z = tuple(rng.standard_normal((f.unknowns, flat.shape[1])) for f in marginal.flights)
    thin = np.unique(np.linspace(0, count - 1, min(25, count)).astype(int))
    picked = (np.arange(chains)[:, None] * count + thin).ravel()
    likelihood, predictive = [], []
    for i, flight in enumerate(marginal.flights):
        noise = marginal.hyper.outputs(flight)
        _, _, variance = gains(noise, flight.dt, jnp.asarray(flight.present))
        constant = -0.5 * np.sum(np.where(flight.present, np.log(2.0 * np.pi * np.asarray(variance)), 0.0), axis=1)
        rows = np.empty((flat.shape[1], flight.observed.shape[0]))
        seen = {}
        for at in range(0, flat.shape[1], BATCH):
            part = np.minimum(np.arange(at, at + BATCH), flat.shape[1] - 1)
            u = draw_unknowns(marginal, flat[:, part], tuple(x[:, part] for x in z))[i]
            e, residual = _innovations(flight, marginal.hyper, marginal.theta(jnp.asarray(flat[:, part])), u)
            rows[part] = (constant[:, None] - 0.5 * np.sum(np.asarray(e) ** 2, axis=1)).T
            for place in np.flatnonzero(np.isin(part, picked)):
                seen[int(part[place])] = np.asarray(flight.observed) - np.asarray(residual[..., place])
            if progress is not None:
                progress(min((at + BATCH) / flat.shape[1], 1.0), "log likelihood and posterior predictions")
        likelihood.append(rows.reshape(chains, count, -1))
        clean = np.stack([seen[int(k)] for k in picked])
        noisy = clean + _noise(marginal.hyper.outputs(flight), float(flight.dt), clean.shape, rng)
        noisy = np.where(np.asarray(flight.present), noisy, np.nan)
        predictive.append(noisy.reshape(chains, thin.size, *noisy.shape[1:]))
    return likelihood, predictive


def _noise(noise: Any, dt: float, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    """Draws (B, T, C) of AR(1) plus white noise."""
    phi = np.exp(-dt / np.asarray(noise.time_constant))
    out = np.empty(shape)
    state = rng.standard_normal((shape[0], shape[2])) * np.asarray(noise.correlated)
    for t in range(shape[1]):
        out[:, t] = state
        driven = rng.standard_normal(state.shape) * np.asarray(noise.correlated) * np.sqrt(1.0 - phi**2)
        state = phi * state + driven
    return out + rng.standard_normal(shape) * np.asarray(noise.white)
