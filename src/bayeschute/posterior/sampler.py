"""Draws of the marginal posterior, and everything about them in one ArviZ DataTree."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from arviz_base import from_dict
from numpy.typing import NDArray

from bayeschute.core.random import stream
from bayeschute.likelihood.joint import FlightData, Hyper, compared
from bayeschute.likelihood.noise import colour
from bayeschute.likelihood.priors import Prior, factor, standard, values, working
from bayeschute.likelihood.simulation_smoother import normals
from bayeschute.posterior.marginal import (
    BATCH,
    Marginal,
    draw_flights,
    in_batches,
    linear_residuals,
    log_density,
    sample_log_likelihoods,
)
from bayeschute.posterior.sampling import delayed_acceptance, ensemble, independence
from bayeschute.posterior.sampling.protocol import Draws
from bayeschute.posterior.sampling.sampler_checks import doubt
from bayeschute.posterior.surrogate import Surrogate, build

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]
_LAST_STEPS = 1000  # of emcee's ensembles where all else failed: hours would not make such draws good


def sample(
    marginal: Marginal, kind: str, chains: int, warmup: int, draws: int, seed: int, progress: Progress | None = None
) -> Draws:
    """Draw parameters from the marginal posterior in standard coordinates.

    Args:
        marginal: The posterior.
        kind: ``"nuts"`` (numpyro's NUTS on a quadratic surrogate, corrected exactly by delayed acceptance) or
            ``"emcee"`` (ensembles on the same density). Where NUTS' draws fail their own check (`doubt`), an
            independence sampler (`posterior.sampling.independence`) draws, and where its draws fail it too, emcee; a
            note says why.
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

    def in_range(xi: Array) -> jax.Array:
        """Residuals for the surrogate; NaN where the price of a place out of range would put a kink into them."""
        rows, prices = linear_residuals(marginal, xi)
        return jnp.where(jnp.any(prices > 0.0, axis=0), jnp.nan, rows)

    def tell(name: str) -> Callable[[int, int], None]:
        return lambda done, wanted: progress(done / wanted, f"{name}: {done} of {wanted}") if progress else None

    def by_emcee(most: int = 20_000) -> Draws:
        return ensemble.sample(exact, parameters, chains, draws, seed, BATCH, most, tell("emcee"))

    def by_population() -> tuple[Draws | None, str]:
        """Draws, and why they can't be believed."""
        try:
            made = independence.sample(exact, parameters, chains, draws, seed, progress=tell("independence sampler"))
        except FloatingPointError as error:
            return None, str(error)
        kept = {name: row for name, row in made.stats.items() if name != "log_ratio"}  # not the surrogate's
        return replace(made, stats=kept), doubt(made)

    if kind == "emcee":
        return by_emcee()
    rng = stream(seed, "points of the surrogate")
    surrogate, failed = build(lambda xi: in_batches(in_range, xi), marginal.rest, rng)
    density = jax.tree_util.Partial(Surrogate.log_density, surrogate)
    made = delayed_acceptance.corrected(exact, density, parameters, chains, warmup, draws, seed, progress=tell(kind))
    lost = sum(int(along.lost) for along in marginal.along)
    notes = [f"{failed} simulations failed while the surrogate was built"] if failed else []
    if lost:
        notes.append(f"{lost} pairs of simulations under drawn disturbances failed and are not in the mean flight")
    reason = doubt(made)
    if not reason:
        return replace(made, notes=(*made.notes, *notes))
    words = f"Draws by NUTS on a surrogate failed their check ({reason}); "
    other, why = by_population()
    tried = [made] if other is None else [made, other]
    if other is None or why:
        words += f"so did those of an independence sampler ({why}); emcee drew instead"
        other = by_emcee(_LAST_STEPS)
        tried.append(other)
    else:
        words += "an independence sampler drew instead"
    failures, evaluations = sum(one.failed for one in tried), sum(one.evaluations for one in tried)
    return replace(other, failed=failures, evaluations=evaluations, notes=(*other.notes, *notes, words))


def data_tree(
    marginal: Marginal,
    priors: Sequence[Prior],
    draws: Draws,
    seed: int,
    flight_names: Sequence[str],
    progress: Progress | None = None,
    wide: Array | None = None,
) -> xr.DataTree:
    """Everything about a posterior in one ArviZ DataTree.

    The log likelihood is that of every sample given all earlier ones, initial states and latent disturbances integrated
    out; one entry per sample of each flight, all its outputs together.

    Args:
        marginal: The posterior.
        priors: Priors of the parameters.
        draws: Draws in standard coordinates.
        seed: Seed of prior draws, unknowns and posterior predictions.
        flight_names: Names of the flights, in order.
        progress: Called with a share done and words.
        wide: The draws widened by the uncertainty of the noise parameters, for the posterior; the group
            ``conditional`` then holds the sampler's own, which its diagnostics are about.

    Returns:
        Groups posterior, prior, sample_stats, log_likelihood, log_prior, posterior_predictive, observed_data,
        constant_data.
    """
    rng = stream(seed, "prior and predictive draws")
    chains, count, parameters = draws.xi.shape
    held = np.asarray(marginal.centre) + draws.xi @ np.asarray(marginal.scale).T
    theta = held if wide is None else np.asarray(marginal.centre) + wide @ np.asarray(marginal.scale).T
    centre, root = working(priors)[0], factor(priors)
    prior_draws = centre + rng.standard_normal((1, 2000, parameters)) @ root.T
    log_prior = -0.5 * standard(priors, theta) ** 2 - np.log(np.diag(root)) - 0.5 * np.log(2.0 * np.pi)
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
            **{f"latent.{i + 1}": np.asarray(law) for i, law in enumerate(marginal.hyper.laws)},
        },
    }
    if wide is not None:
        groups["conditional"] = _named(priors, values(priors, held))
    tree = from_dict(groups)
    for group in ("posterior", "prior"):
        for p in priors:
            tree[group][p.name].attrs["units"] = p.unit
    return tree


def _named(priors: Sequence[Prior], array: Array) -> dict[str, Array]:
    return {p.name: array[..., i] for i, p in enumerate(priors)}


def _per_sample(
    marginal: Marginal, draws: Draws, rng: np.random.Generator, progress: Progress | None
) -> tuple[list[Array], list[Array]]:
    """Log likelihood per flight (chain, draw, T) and posterior predictions per flight (chain, up to 25, T, C)."""
    chains, count, parameters = draws.xi.shape
    flat = draws.xi.reshape(-1, parameters).T
    done = 0

    def likelihood(part: Array) -> tuple[jax.Array, ...]:
        nonlocal done
        done += part.shape[1]
        if progress is not None:
            progress(min(done / flat.shape[1], 1.0), "log likelihood")
        return sample_log_likelihoods(marginal, jnp.asarray(part))

    rows = [row.T.reshape(chains, count, -1) for row in in_batches(likelihood, flat)]
    thin = np.unique(np.linspace(0, count - 1, min(25, count)).astype(int))
    picked = flat[:, (np.arange(chains)[:, None] * count + thin).ravel()]

    def prediction(part: Array) -> tuple[Array, ...]:
        numbers = tuple(normals(f, part.shape[1], rng) for f in marginal.flights)
        drawn = draw_flights(marginal, jnp.asarray(part), numbers)
        theta = marginal.theta(jnp.asarray(part))
        return tuple(
            _predicted(f, marginal.hyper, theta, x.path, rng) for f, x in zip(marginal.flights, drawn, strict=True)
        )

    made = [np.moveaxis(a, -1, 0).reshape(chains, thin.size, *a.shape[:2]) for a in in_batches(prediction, picked)]
    return rows, made


def _predicted(flight: FlightData, hyper: Hyper, theta: jax.Array, path: jax.Array, rng: np.random.Generator) -> Array:
    """Replicated data (T, C, B): outputs on the drawn paths, and new noise; NaN where nothing was recorded."""
    residual = np.asarray(compared(flight, theta, path))
    drift, white = (jnp.asarray(rng.standard_normal(residual.shape)) for _ in range(2))
    noisy = np.asarray(flight.observed)[..., None] - residual + colour(hyper.outputs(flight), flight.dt, drift, white)
    return np.where(np.asarray(flight.present)[..., None], noisy, np.nan)
