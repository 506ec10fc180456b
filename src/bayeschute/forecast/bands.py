"""Bands of quantities of interest: parameters, initial state and latent disturbances drawn together.

A flight to be predicted is known by the opening of its record only: those samples fix the initial state (and what they
say of the disturbances); beyond them the disturbances follow their process. The same code serves a part of a record
held out in time, and the smoothing of a fitted flight.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayeschute.dynamics import cluster_flight, descent
from bayeschute.dynamics.cluster_flight import ClusterFlight
from bayeschute.flight.sensors import ornstein_uhlenbeck
from bayeschute.inference.map import fit
from bayeschute.inference.marginal import Marginal, draw_unknowns, marginalise
from bayeschute.inference.posterior import BATCH
from bayeschute.inference.priors import Prior
from bayeschute.inference.target import FlightData, Hyper, split, states

Array = NDArray[np.float64]
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
UNITS = {"swing_angle": "rad", "flyout_angle": "rad", "descent_rate": "m/s", "sea_level_descent_rate": "m/s"}


@dataclass(frozen=True)
class Prediction:
    """Draws of a flight.

    Attributes:
        time: (T,) [s].
        draws: Quantity by name, (draw, T); NaN where a simulation failed.
        touchdown: Capsule velocity at the last sample, (draw, 3) NED [m/s]; descents hold (0, 0, rate).
        failed: Simulations that were not finite.
        shares: Share of variance by quantity and source.
    """

    time: Array
    draws: Mapping[str, Array]
    touchdown: Array
    failed: int
    shares: Mapping[str, Mapping[str, float]]


@jax.jit
def _simulate(flight: FlightData, theta: jax.Array, u: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Quantities (Q, T, B) and the last velocity (3, B)."""
    x = states(flight, theta, u)
    model: Any = flight.model
    extra = (1,) * (x.ndim - 2)
    if isinstance(model, ClusterFlight):
        density = jnp.reshape(model.record.density, (-1, *extra))
        attach, n = model.base.capsule.attach_b, model.structure.canopies
        rows = [
            jax.vmap(lambda s, rho, q=q: cluster_flight.quantity(q, s, rho, attach, n))(x, density)
            for q in cluster_flight.QUANTITIES
        ]
        return jnp.stack(rows), x[-1, 3:6]
    rows = [jax.vmap(lambda s, q=q: descent.quantity(q, s, model.air))(x) for q in descent.QUANTITIES]
    return jnp.stack(rows), jnp.stack([0.0 * x[-1, 1], 0.0 * x[-1, 1], x[-1, 1]])


def quantities_of(flight: FlightData) -> tuple[str, ...]:
    """Quantities that a flight's model offers."""
    return cluster_flight.QUANTITIES if isinstance(flight.model, ClusterFlight) else descent.QUANTITIES


def opening(flight: FlightData, seconds: float) -> FlightData:
    """The first seconds of a flight as a flight of its own, up to the next knot; same knots as the whole."""
    kept = int(np.ceil(seconds / float(flight.spacing) - 1e-9))
    samples = int(np.floor(kept * float(flight.spacing) / float(flight.dt) + 1e-9)) + 1
    model: Any = flight.model
    shorter = replace(model, record=jax.tree.map(lambda a: np.asarray(a)[:samples], model.record))
    return replace(
        flight,
        model=shorter,
        observed=np.asarray(flight.observed)[:samples],
        present=np.asarray(flight.present)[:samples],
        weights=np.asarray(flight.weights)[:samples, : kept + 1],
    )


def opened(flight: FlightData, hyper: Hyper, posterior: Sequence[Prior]) -> Marginal:
    """What an opening's data say of its own unknowns, the parameters as the posterior has them.

    Args:
        flight: From `opening`.
        hyper: Noise parameters.
        posterior: Gaussian summary of the posterior, as priors here.

    Returns:
        The marginal posterior whose unknowns `predict` draws and continues.
    """
    theta = np.array([p.centre for p in posterior])
    best = fit([flight], hyper, posterior, theta, [np.zeros(flight.unknowns)], tolerance=0.1, most=12)
    return marginalise([flight], hyper, posterior, best)


def latent_draws(hyper: Hyper, covariance: Array, draws: int, rng: np.random.Generator) -> Hyper:
    """Noise parameters, those of the latent processes drawn about their optimum: sd and time constants (G, B)."""
    both = np.log(np.concatenate([np.asarray(hyper.latent_sd), np.asarray(hyper.latent_time_constant)]))
    drawn = np.exp(both[:, None] + np.linalg.cholesky(covariance) @ rng.standard_normal((both.size, draws)))
    groups = both.size // 2
    return Hyper(hyper.noise, drawn[:groups], drawn[groups:])


def continued(
    knots: Array, kept: int, total: int, hyper: Hyper, group: Sequence[int], spacing: float, z: Array
) -> Array:
    """Knots (total, A, B): the first `kept` as given, the rest from each draw's own process.

    Args:
        knots: Known knots (K, A, B), K >= kept.
        kept: How many of them the data have told.
        total: How many are wanted.
        hyper: From `latent_draws`, (G, B).
        group: Group of every process (A entries).
        spacing: Distance of the knots [s].
        z: Standard normal numbers (total, A, B).
    """
    sd, tau = hyper.latent_sd[list(group)], hyper.latent_time_constant[list(group)]
    phi = np.exp(-spacing / tau)
    made = np.empty((total, *knots.shape[1:]))
    made[:kept] = knots[:kept]
    for j in range(kept, total):
        made[j] = phi * made[j - 1] + sd * np.sqrt(1.0 - phi**2) * z[j]
    return made


def predict(
    marginal: Marginal,
    index: int,
    theta: Array,
    hyper: Hyper,
    seed: int,
    whole: FlightData | None = None,
    told: float = np.inf,
    progress: Callable[[float], None] | None = None,
) -> Prediction:
    """Draw a flight's quantities.

    Args:
        marginal: Of the fit the flight was part of, or from `opened`.
        index: Which of its flights.
        theta: Draws of the parameters, working coordinates (B, P).
        hyper: Latent processes of every draw, from `latent_draws`.
        seed: Seed of unknowns.
        whole: The whole flight where the marginal holds its opening only.
        told: Data end here [s from the first sample]; knots beyond follow each draw's own process.
        progress: Called with a share done.

    Returns:
        The prediction.
    """
    part, rng = marginal.flights[index], np.random.default_rng([seed, index])
    flight, draws = whole or part, theta.shape[0]
    spacing, total = float(flight.spacing), int(flight.weights.shape[1])
    kept = min(int(np.ceil(told / spacing)) + 1 if np.isfinite(told) else total, int(part.weights.shape[1]))
    xi = np.linalg.solve(np.asarray(marginal.scale), (theta - np.asarray(marginal.centre)).T)
    z = tuple(rng.standard_normal((f.unknowns, draws)) for f in marginal.flights)
    beyond = rng.standard_normal((total, len(flight.group), draws))

    def unknowns(xi_part: Array, z_part: tuple[Array, ...], later: Array, law: Hyper) -> Array:
        u = np.asarray(draw_unknowns(marginal, xi_part, z_part)[index])
        start, knots = (np.asarray(a) for a in split(part, jnp.asarray(u)))
        knots = continued(knots, kept, total, law, flight.group, spacing, later)
        return np.concatenate([start, knots.reshape(-1, u.shape[1])])

    rows, lasts = [], []
    for at in range(0, draws, BATCH):
        pick = np.minimum(np.arange(at, at + BATCH), draws - 1)
        keep = min(BATCH, draws - at)
        law = Hyper(hyper.noise, hyper.latent_sd[:, pick], hyper.latent_time_constant[:, pick])
        u = unknowns(xi[:, pick], tuple(x[:, pick] for x in z), beyond[..., pick], law)
        quantities, last = _simulate(flight, marginal.theta(jnp.asarray(xi[:, pick])), u)
        rows.append(np.asarray(quantities)[..., :keep])
        lasts.append(np.asarray(last)[:, :keep])
        if progress is not None:
            progress(min((at + BATCH) / draws, 1.0))
    made, last = np.concatenate(rows, axis=-1), np.concatenate(lasts, axis=-1)
    bad = ~np.isfinite(made).all(axis=(0, 1))
    made[..., bad], last[:, bad] = np.nan, np.nan
    names = quantities_of(flight)
    time = np.arange(flight.observed.shape[0]) * float(flight.dt)

    pick = np.minimum(np.arange(BATCH), draws - 1)
    law = Hyper(hyper.noise, hyper.latent_sd[:, pick], hyper.latent_time_constant[:, pick])
    few = (xi[:, pick], tuple(x[:, pick] for x in z), beyond[..., pick])
    still = (0.0 * few[0], tuple(0.0 * x for x in few[1]), 0.0 * few[2])
    middle, drawn = unknowns(*still, law), unknowns(still[0], few[1], few[2], law)
    followed = unknowns(few[0], still[1], still[2], law)
    shares = _shares(marginal, flight, few[0], middle, drawn, followed, names)
    return Prediction(time, {name: made[i].T for i, name in enumerate(names)}, last.T, int(bad.sum()), shares)


def _shares(
    marginal: Marginal,
    flight: FlightData,
    xi: Array,
    middle: Array,
    drawn: Array,
    followed: Array,
    names: Sequence[str],
) -> dict[str, dict[str, float]]:
    """Variance of each quantity when one source alone varies, as shares of their sum, averaged over the flight."""
    axes, knots = len(flight.group), int(flight.weights.shape[1])
    kind = np.array(["initial state"] * flight.starts + [_latent(flight, a) for _ in range(knots) for a in range(axes)])
    cases = {"parameter": (xi, followed)}
    for source in dict.fromkeys(kind):
        cases[str(source)] = (0.0 * xi, np.where((kind == source)[:, None], drawn, middle))
    variance = {}
    for source, (x, u) in cases.items():
        quantities, _ = _simulate(flight, marginal.theta(jnp.asarray(x)), u)
        variance[source] = np.nanmean(np.nanvar(np.asarray(quantities), axis=-1), axis=-1)
    total = np.sum(list(variance.values()), axis=0)
    return {
        name: {source: float(v[i] / total[i]) if total[i] > 0.0 else 0.0 for source, v in variance.items()}
        for i, name in enumerate(names)
    }


def _latent(flight: FlightData, axis: int) -> str:
    return "canopy force" if isinstance(flight.model, ClusterFlight) and axis >= 3 else "wind"


def recorded_draws(prediction: Prediction, name: str, noise: tuple[float, float, float] | None, seed: int) -> Array:
    """Draws of a quantity as instruments record it: with AR(1) and white noise (white, correlated, time constant)."""
    values = prediction.draws[name]
    if noise is None:
        return values
    white, correlated, tau = noise
    rng = np.random.default_rng([seed, 7])
    dt = float(prediction.time[1] - prediction.time[0])
    drift = ornstein_uhlenbeck(correlated, tau, dt, values.T.shape, rng).T
    return values + drift + white * rng.standard_normal(values.shape)


def coverage(draws: Array, reference: Array, counted: NDArray[np.bool_]) -> float | None:
    """Share of counted samples with the reference (T,) inside the 90 % band of draws (B, T); None if none is known."""
    low, high = np.nanquantile(draws, [QUANTILES[0], QUANTILES[-1]], axis=0)
    known = np.isfinite(reference) & counted
    return float(np.mean((reference[known] >= low[known]) & (reference[known] <= high[known]))) if known.any() else None


def dataset(
    prediction: Prediction,
    time: Array,
    wanted: Sequence[str],
    truth: xr.Dataset | None,
    record: Mapping[str, Array],
    held_out: NDArray[np.bool_],
    role: str,
) -> xr.Dataset:
    """The entry of ``predictions.nc`` for a flight.

    Args:
        prediction: Its draws.
        time: Times of the record [s].
        wanted: Quantities to keep.
        truth: Truth, where known.
        record: Quantities as the record has them, (T,) each.
        held_out: Samples that the fit did not see.
        role: ``identify`` or ``predict``.
    """
    made = xr.Dataset(coords={"quantile": ("quantile", list(QUANTILES)), "time": ("time", time, {"units": "s"})})
    names = [q for q in wanted if q in prediction.draws]
    for name in names:
        unit = {"units": UNITS[name]}
        made[name] = (("quantile", "time"), np.nanquantile(prediction.draws[name], QUANTILES, axis=0), unit)
        if truth is not None and name in truth:
            made[f"{name}_truth"] = ("time", truth[name].values, unit)
        if name in record:
            made[f"{name}_record"] = ("time", record[name], unit)
    made["held_out"] = ("time", held_out)
    sources = list(next(iter(prediction.shares.values())))
    table = [[prediction.shares[name][s] for name in names] for s in sources]
    made["variance_share"] = (("source", "quantity"), np.array(table), {"units": "1"})
    made = made.assign_coords(source=sources, quantity=names)
    made.attrs = {"role": role, "failed": prediction.failed}
    return made
