"""The whole way from data and priors to draws: optimum, noise parameters, marginal posterior, sampler, DataTree."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
import xarray as xr
from arviz_base import from_dict
from numpy.typing import NDArray

from bayeschute.inference import evidence
from bayeschute.inference import map as optimum
from bayeschute.inference.evidence import HyperPrior
from bayeschute.inference.law_slope import law_slope
from bayeschute.inference.map import Optimum
from bayeschute.inference.marginal import (
    Marginal,
    determinant_around,
    determinant_error,
    determinant_slope,
    draw_unknowns,
    log_density,
    marginalise,
    normals,
    projected_residuals,
    sample_log_likelihoods,
)
from bayeschute.inference.noise import colour
from bayeschute.inference.priors import Prior, values, working
from bayeschute.inference.surrogate import Surrogate, build
from bayeschute.inference.target import FlightData, Hyper, Linear, Unknowns, course, linearise, residuals
from bayeschute.samplers import ensemble, nuts
from bayeschute.samplers.protocol import Draws

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]
BATCH = 64
HORIZONS = (
    0.2,
    0.5,
    1.0,
)  # shares fitted in turn: an unstable pendulum far from its optimum is lost late in the record
_MODE_STEPS, _NEAR = 8, 0.2  # most steps to the marginal mode; length of the last, in standard deviations
_LEAST_GAIN = 0.05  # share of the record by which the fitted part must at least be lengthened


@dataclass(frozen=True)
class Found:
    """The optimum, its noise parameters, the marginal posterior there, and how well the noise parameters are known.

    Attributes:
        optimum: Mode of the marginal posterior, with start and shocks there.
        hyper: Noise parameters of greatest evidence.
        marginal: The marginal posterior about the optimum.
        evidence: Minus the log evidence up to a constant.
        law_covariance: Of the logarithms of the noise parameters (V, V).
        law_slope: Derivatives of the parameters' standard coordinates by those logarithms (P, V).
        determinant_error: Root mean square error of the log determinant's polynomial over the posterior.
    """

    optimum: Optimum
    hyper: Hyper
    marginal: Marginal
    evidence: float
    law_covariance: Array
    law_slope: Array
    determinant_error: float


def _until(flight: FlightData, share: float) -> FlightData:
    """The flight with data beyond a share of its samples absent; shapes stay, so compiled functions serve."""
    seen = np.array(flight.present)
    seen[int(np.ceil(share * len(seen))) :] = False
    return replace(flight, present=seen)


def _linearised(flights: Sequence[FlightData], hyper: Hyper, best: Optimum) -> list[Linear]:
    pairs = zip(flights, best.unknowns, strict=True)
    return [linearise(f, best.theta, course(f, hyper, x)) for f, x in pairs]


Begin = tuple[Array, Sequence[Unknowns], Hyper]  # parameters, unknowns of every flight, noise parameters


class Settled(NamedTuple):
    """The joint optimum over parameters and disturbances, its noise parameters, and minus the log evidence there."""

    optimum: Optimum
    hyper: Hyper
    evidence: float


def lengthened(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    hyper: Hyper,
    theta: Array,
    say: Progress,
    unknowns: Sequence[Unknowns] | None = None,
) -> tuple[Array, Sequence[Unknowns]]:
    """Parameters and unknowns that follow the whole record, found on longer and longer openings of it.

    Where what one opening told is lost before the end of the next, the next is shortened.

    Args:
        flights: Records.
        priors: Priors of the parameters.
        hyper: Noise parameters, held.
        theta: Where to begin, working coordinates (P,).
        say: Called with a share done and words.
        unknowns: Where to begin, per flight; prior means where None.

    Returns:
        Parameters and unknowns near the optimum for the whole record.

    Raises:
        FloatingPointError: If shortening does not help.
    """
    todo, done = list(HORIZONS), 0.0
    while todo:
        share = todo[0]
        say(0.0, f"opening {100 * share:.0f} % of the record")
        seen = [_until(f, share) for f in flights]
        try:
            best = optimum.fit(seen, hyper, priors, theta, unknowns, tolerance=0.5, most=12)
        except FloatingPointError:
            if done == 0.0 or share - done < 2.0 * _LEAST_GAIN:
                raise
            todo.insert(0, 0.5 * (done + share))
            continue
        theta, unknowns, done = best.theta, best.unknowns, todo.pop(0)
    assert unknowns is not None
    return theta, unknowns


def settle(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    prior: HyperPrior,
    rounds: int = 2,
    progress: Progress | None = None,
    begin: Begin | None = None,
) -> Settled:
    """Fit parameters, start, latent disturbances and noise parameters, by turns.

    Args:
        flights: Records.
        priors: Priors of the parameters.
        prior: Priors of the noise parameters.
        rounds: Turns of optimum and evidence before the last optimum.
        progress: Called with a share done and words.
        begin: Parameters, unknowns and noise parameters to begin with; from the prior means, by openings of the record,
            where None.

    Raises:
        FloatingPointError: If the simulation at the prior means is not finite.
    """
    say = progress or (lambda share, words: None)
    theta, hyper, value = working(priors)[0], prior.median, np.nan
    unknowns: Sequence[Unknowns] | None = None
    if begin is not None:
        theta, unknowns, hyper = begin
    if begin is None:
        theta, unknowns = lengthened(flights, priors, hyper, theta, say)
    for turn in range(rounds + 1):
        last = turn == rounds

        def tell(iteration: int, cost: float, step: float, turn: int = turn) -> None:
            share = (turn + min(iteration / 12.0, 0.8)) / (rounds + 1)
            say(share, f"optimum {turn + 1}: cost {cost:.1f}, step {step:.3f} standard errors")

        best = optimum.fit(flights, hyper, priors, theta, unknowns, 0.01 if last else 0.1, progress=tell)
        theta, unknowns = best.theta, best.unknowns
        if not last:
            say((turn + 0.9) / (rounds + 1), f"noise parameters {turn + 1}")
            linear = _linearised(flights, hyper, best)
            hyper, value = evidence.maximise(flights, linear, priors, hyper, prior, most=20 if turn == 0 else 12)
    return Settled(best, hyper, value)


def marginal_mode(
    flights: Sequence[FlightData], priors: Sequence[Prior], settled: Settled, progress: Progress | None = None
) -> Optimum:
    """From the joint optimum to where cost and log determinant together are least.

    The mode is often five and more standard errors away, too far for one slope of the determinant: every Gauss-Newton
    step is made with the slope where it begins, and shortened by the determinant's curvature along the last one. A rest
    of less than 0.2 standard deviations is left to the sampler, which is exact.

    Args:
        flights: Records.
        priors: Priors of the parameters.
        settled: The joint optimum.
        progress: Called with a share done and words.

    Returns:
        The mode, start and shocks at their best for it; `converged` is false where steps did not become short.
    """
    say = progress or (lambda share, words: None)
    best, length, last = settled.optimum, np.inf, None
    for turn in range(_MODE_STEPS):
        say(turn / _MODE_STEPS, "log determinant")
        factor = np.linalg.cholesky(best.covariance)
        slope = determinant_slope(marginalise(flights, settled.hyper, priors, best))
        tilt: Array = scipy.linalg.solve_triangular(factor.T, slope)
        moved = optimum.fit(flights, settled.hyper, priors, best.theta, best.unknowns, 0.01, most=1, tilt=tilt)
        curvature = 0.0 if last is None else float(last[0] @ (tilt - last[1])) / last[2] ** 2
        share = 1.0 / (1.0 + max(curvature, 0.0))
        step = share * (moved.theta - best.theta)
        length = float(np.linalg.norm(scipy.linalg.solve_triangular(factor, step, lower=True)))
        unknowns = jax.tree.map(
            lambda a, b, s=share: (1.0 - s) * np.asarray(a) + s * np.asarray(b), best.unknowns, moved.unknowns
        )
        best, last = replace(moved, theta=best.theta + step, unknowns=unknowns), (step, tilt, length)
        if length < _NEAR:
            break
    return replace(best, converged=settled.optimum.converged and length < _NEAR)


def conclude(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    prior: HyperPrior,
    settled: Settled,
    progress: Progress | None = None,
) -> Found:
    """Go from the joint optimum to the mode of the marginal posterior, and set that up.

    The joint optimum over parameters and disturbances is not where the marginal posterior of the parameters is
    greatest: see `_marginal_mode`.

    Args:
        flights: Records.
        priors: Priors of the parameters.
        prior: Priors of the noise parameters.
        settled: From `settle`.
        progress: Called with a share done and words.
    """
    say = progress or (lambda share, words: None)
    best, hyper, value = settled
    best = marginal_mode(flights, priors, settled, lambda share, words: say(0.4 * share, words))
    made = marginalise(flights, hyper, priors, best)
    say(0.4, "log determinant at the mode")
    made = replace(made, determinant=determinant_around(made))
    wrong = determinant_error(made, 4, np.random.default_rng(0))
    say(0.8, "uncertainty of the noise parameters")
    known = evidence.law_covariance(flights, _linearised(flights, hyper, best), priors, hyper, prior)
    return Found(best, hyper, made, value, known, law_slope(made), wrong)


def find(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    prior: HyperPrior,
    rounds: int = 2,
    progress: Progress | None = None,
) -> Found:
    """The marginal posterior of the parameters: `settle`, then `conclude`."""
    say = progress or (lambda share, words: None)
    settled = settle(flights, priors, prior, rounds, lambda share, words: say(0.7 * share, words))
    return conclude(flights, priors, prior, settled, lambda share, words: say(0.7 + 0.3 * share, words))


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
        lambda xi: in_batches(lambda part: projected_residuals(marginal, part), xi), marginal.determinant, rng
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
    rng = np.random.default_rng([seed, 3])
    chains, count, parameters = draws.xi.shape
    held = np.asarray(marginal.centre) + draws.xi @ np.asarray(marginal.scale).T
    theta = held if wide is None else np.asarray(marginal.centre) + wide @ np.asarray(marginal.scale).T
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
        drawn = draw_unknowns(marginal, jnp.asarray(part), numbers)
        theta = marginal.theta(jnp.asarray(part))
        return tuple(_predicted(f, marginal.hyper, theta, u, rng) for f, u in zip(marginal.flights, drawn, strict=True))

    made = [np.moveaxis(a, -1, 0).reshape(chains, thin.size, *a.shape[:2]) for a in in_batches(prediction, picked)]
    return rows, made


def _predicted(
    flight: FlightData, hyper: Hyper, theta: jax.Array, unknowns: Unknowns, rng: np.random.Generator
) -> Array:
    """Replicated data (T, C, B): outputs at the drawn unknowns, and new noise; NaN where nothing was recorded."""
    residual = np.asarray(residuals(flight, theta, course(flight, hyper, unknowns)))
    drift, white = (jnp.asarray(rng.standard_normal(residual.shape)) for _ in range(2))
    noisy = np.asarray(flight.observed)[..., None] - residual + colour(hyper.outputs(flight), flight.dt, drift, white)
    return np.where(np.asarray(flight.present)[..., None], noisy, np.nan)
