"""Posterior predictive bands: parameters, initial state and latent disturbances are drawn jointly and simulated.

Of a flight to be predicted only the initialisation window of its record is used: those samples determine the initial
state (and the disturbances, as far as they do); after them the disturbances follow their stochastic process. The same
code serves a part of a record held out in time, and the smoothing of a fitted flight.
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

from bayeschute.core.random import stream
from bayeschute.dynamics import cluster_flight, descent
from bayeschute.dynamics.cluster_flight import ClusterFlight
from bayeschute.likelihood.joint import FlightData, LatentPath, NoiseParameters, Unknowns, latent_path_of, states
from bayeschute.likelihood.priors import Prior
from bayeschute.likelihood.simulation_smoother import Normals, normals
from bayeschute.posterior.fit.joint_fit import joint
from bayeschute.posterior.marginal import Marginal, draw_flights, marginalise
from bayeschute.posterior.noise_evidence import from_vector, to_vector
from bayeschute.posterior.noise_uncertainty import NoiseEffect
from bayeschute.records.sensors import ornstein_uhlenbeck

Array = NDArray[np.float64]
OPENING = 5.0  # [s] initialisation window: the part of its record that a prediction uses
GROUP = 16  # draws that share their noise parameters
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
MOST_DRAWS = 400  # of every flight in ``predictions.nc``
UNITS = {"swing_angle": "rad", "flyout_angle": "rad", "descent_rate": "m/s", "sea_level_descent_rate": "m/s"}


@dataclass(frozen=True)
class Prediction:
    """Draws of a flight.

    Attributes:
        time: (T,) [s].
        draws: Quantity by name, (draw, T); NaN where a simulation failed.
        last: Capsule velocity at the last sample of the record, (draw, 3) NED [m/s]; descents hold (0, 0, rate).
        failed: Simulations that were not finite.
        shares: Share of variance by quantity and source; NaN without successful simulations.
        why: Why no simulation could be begun; empty where one could.
    """

    time: Array
    draws: Mapping[str, Array]
    last: Array
    failed: int
    shares: Mapping[str, Mapping[str, float]]
    why: str = ""


def _simulate(flight: FlightData, theta: jax.Array, latent_path: LatentPath) -> tuple[jax.Array, jax.Array]:
    """Quantities (Q, T, B) and the last velocity (3, B); simulated from the end of the trajectory, if there is one."""
    return _quantities(flight, states(flight, theta, latent_path, latent_path.path))


@jax.jit
def _quantities(flight: FlightData, x: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Quantities (Q, T, B) and the last velocity (3, B) of states (T, X, B)."""
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


def quantities_of_states(flight: FlightData, x: Array) -> dict[str, Array]:
    """Quantities of interest (T, B) of states (T, X, B)."""
    return dict(zip(quantities_of(flight), np.asarray(_quantities(flight, jnp.asarray(x))[0]), strict=True))


def opening(flight: FlightData, seconds: float) -> FlightData:
    """The initialisation window: the first seconds of a flight as a separate flight."""
    samples = int(round(seconds / float(flight.dt))) + 1
    model: Any = flight.model
    shorter = replace(model, record=jax.tree.map(lambda a: np.asarray(a)[:samples], model.record))
    observed, present = (np.asarray(a)[:samples] for a in (flight.observed, flight.present))
    path = None if flight.path is None else flight.path._replace(states=flight.path.states[:samples])
    return replace(flight, model=shorter, observed=observed, present=present, path=path)


def opened(flight: FlightData, hyper: NoiseParameters, posterior: Sequence[Prior]) -> Marginal:
    """Posterior of the unknowns of an initialisation window, with the parameters' posterior as prior.

    Args:
        flight: From `opening`.
        hyper: Noise parameters.
        posterior: Gaussian summary of the posterior, as priors here.

    Returns:
        The marginal posterior whose unknowns `predict` draws and continues.

    Raises:
        NoFitError: If no flight follows the record of the window.
        FloatingPointError: If flights about the one that does fail.
    """
    theta = np.array([p.centre for p in posterior])
    best = joint([flight], hyper, posterior, theta)
    return marginalise([flight], hyper, posterior, best)


def noise_parameter_draws(
    hyper: NoiseParameters, covariance: Array, draws: int, rng: np.random.Generator
) -> list[NoiseParameters]:
    """Noise parameters drawn about those of the fit.

    Args:
        hyper: Noise parameters of the fit.
        covariance: Of their logarithms (V, V).
        draws: How many.
        rng: Source of randomness.
    """
    at, root = to_vector(hyper), np.linalg.cholesky(covariance)
    return [from_vector(at + root @ rng.standard_normal(at.size), hyper) for _ in range(draws)]


def carried(
    marginal: Marginal, theta: Array, noise_parameters: Sequence[NoiseParameters], effect: NoiseEffect
) -> Array:
    """Draws of the parameters, moved from the fixed noise parameters to those that `predict` takes for each draw.

    Args:
        marginal: Of the fit that the draws are from.
        theta: Draws, working coordinates (B, P).
        noise_parameters: Noise parameters, from `noise_parameter_draws`; groups of draws take them in turn.
        effect: Of the noise parameters.

    Returns:
        (B, P).
    """
    off = np.array([to_vector(hyper) for hyper in noise_parameters]) - to_vector(marginal.hyper)
    scale, centre = np.asarray(marginal.scale), np.asarray(marginal.centre)
    xi = np.linalg.solve(scale, (theta - centre).T).T
    return np.asarray(centre + effect.carried(xi, off[np.arange(len(xi)) // GROUP % len(noise_parameters)]) @ scale.T)


def predict(
    marginal: Marginal,
    index: int,
    theta: Array,
    noise_parameters: Sequence[NoiseParameters],
    seed: int,
    whole: FlightData | None = None,
    data_end: float = np.inf,
    progress: Callable[[float], None] | None = None,
    disturbance_log_sd: float = 0.0,
    groups: range | None = None,
) -> Prediction:
    """Draw a flight's quantities.

    Args:
        marginal: Of the fit the flight was part of, or from `opened`.
        index: Which of its flights.
        theta: Draws of the parameters, working coordinates (B, P); see `carried`.
        noise_parameters: Noise parameters, from `noise_parameter_draws`; groups of draws take them in turn.
        seed: Seed of unknowns.
        whole: The whole flight, where the marginal is of its initialisation window only.
        data_end: End of the data that are used [s from the first sample]; disturbances after it follow their process.
        progress: Called with a share done.
        disturbance_log_sd: Standard deviation of the logarithm of a factor on disturbances beyond the data, one a draw.
        groups: Only these groups of `GROUP` draws each, drawn as if all were; all where None. Shares of variance are
            there with the first group only.

    Returns:
        The prediction.
    """
    stronger = stream(seed, "strength of disturbances beyond the data", index)
    part, rng = marginal.flights[index], stream(seed, "unknowns of a flight", index)
    flight, draws = whole or part, theta.shape[0]
    kept = min(
        int(np.floor(data_end / float(flight.dt) + 1e-9)) + 1 if np.isfinite(data_end) else part.samples, part.samples
    )
    xi = np.linalg.solve(np.asarray(marginal.scale), (theta - np.asarray(marginal.centre)).T)

    def latent_path(xi: Array, numbers: tuple[Normals, ...], later: Array, hyper: NoiseParameters) -> LatentPath:
        known = draw_flights(marginal, xi, numbers, hyper)[index]
        process_noise = np.concatenate([np.asarray(known.unknowns.process_noise)[:kept], later])
        return latent_path_of(flight, hyper, Unknowns(known.unknowns.start, process_noise))._replace(
            path=np.asarray(known.path)[:kept]
        )

    rows, lasts = [], []
    first: Any = None
    for i, at in enumerate(range(0, draws, GROUP)):
        pick, keep = np.minimum(np.arange(at, at + GROUP), draws - 1), min(GROUP, draws - at)
        numbers = tuple(normals(f, GROUP, rng) for f in marginal.flights)
        later = rng.standard_normal((flight.samples - kept, flight.latent.size, GROUP))
        later = later * np.exp(disturbance_log_sd * stronger.standard_normal(GROUP))
        given = (xi[:, pick], numbers, later, noise_parameters[i % len(noise_parameters)])
        first = first or given
        if groups is not None and i not in groups:
            continue  # only its random numbers are taken
        quantities, last = _simulate(flight, marginal.theta(xi[:, pick]), latent_path(*given))
        rows.append(np.asarray(quantities)[..., :keep])
        lasts.append(np.asarray(last)[:, :keep])
        if progress is not None:
            progress(min((at + GROUP) / draws, 1.0))
    made: Array = np.concatenate(rows, axis=-1)
    ends: Array = np.concatenate(lasts, axis=-1)
    bad = ~np.isfinite(made).all(axis=(0, 1))
    made[..., bad], ends[:, bad] = np.nan, np.nan
    names = quantities_of(flight)
    time = np.arange(flight.samples, dtype=float) * float(flight.dt)
    if groups is not None and 0 not in groups:
        return Prediction(time, {name: made[i].T for i, name in enumerate(names)}, ends.T, int(bad.sum()), {})
    drawn_xi, numbers, later, hyper = first
    still, quiet, silence = jax.tree.map(np.zeros_like, first[:3])
    middle, drawn = latent_path(still, quiet, silence, hyper), latent_path(still, numbers, later, hyper)
    shares = _shares(marginal, flight, drawn_xi, middle, drawn, latent_path(drawn_xi, quiet, silence, hyper), names)
    return Prediction(time, {name: made[i].T for i, name in enumerate(names)}, ends.T, int(bad.sum()), shares)


def lost(flight: FlightData, draws: int, why: str, groups: range | None = None) -> Prediction:
    """A prediction every simulation of which failed, since none could be begun.

    Args:
        flight: The whole flight.
        draws: How many were wanted.
        why: For the reader.
        groups: Only these groups, as of `predict`.
    """
    count = draws if groups is None else min(groups.stop * GROUP, draws) - groups.start * GROUP
    names, none = quantities_of(flight), {source: np.nan for source in ("parameter", "initial state", *_kinds(flight))}
    time = np.arange(flight.samples, dtype=float) * float(flight.dt)
    nothing = {name: np.full((count, flight.samples), np.nan) for name in names}
    return Prediction(time, nothing, np.full((count, 3), np.nan), count, dict.fromkeys(names, none), why)


def _shares(
    marginal: Marginal,
    flight: FlightData,
    xi: Array,
    middle: LatentPath,
    drawn: LatentPath,
    followed: LatentPath,
    names: Sequence[str],
) -> dict[str, dict[str, float]]:
    """Variance of each quantity when one source alone varies, as shares of their sum, averaged over the flight."""
    cases = {"parameter": (xi, followed), "initial state": (0.0 * xi, LatentPath(drawn.start, middle.error))}
    kind = np.array([_latent(flight, row) for row in range(flight.latent.rows)])
    for source in _kinds(flight):
        error = np.where((kind == source)[:, None], drawn.error, middle.error)
        cases[source] = (0.0 * xi, LatentPath(middle.start, error))
    variance = {}
    for source, (x, latent_path) in cases.items():
        quantities, _ = _simulate(flight, marginal.theta(x), latent_path)
        made = np.array(quantities)
        failed = ~np.isfinite(made).all(axis=(0, 1))
        made[..., failed] = np.nan
        variance[source] = np.full(len(made), np.nan)
        if not failed.all():
            variance[source] = np.nanmean(np.nanvar(made, axis=-1), axis=-1)
    total = np.sum(list(variance.values()), axis=0)
    return {
        name: {source: 0.0 if total[i] == 0.0 else float(v[i] / total[i]) for source, v in variance.items()}
        for i, name in enumerate(names)
    }


def _kinds(flight: FlightData) -> list[str]:
    """Kinds of disturbances, in the order of their rows."""
    return list(dict.fromkeys(_latent(flight, row) for row in range(flight.latent.rows)))


def _latent(flight: FlightData, row: int) -> str:
    return "canopy force" if isinstance(flight.model, ClusterFlight) and row >= 3 else "wind"


def recorded_draws(prediction: Prediction, name: str, noise: tuple[float, float, float] | None, seed: int) -> Array:
    """Draws of a quantity as instruments record it: with AR(1) and white noise (white, correlated, time constant)."""
    values = prediction.draws[name]
    if noise is None:
        return values
    white, correlated, tau = noise
    rng = stream(seed, "instruments", name)
    dt = float(prediction.time[1] - prediction.time[0])
    drift = ornstein_uhlenbeck(correlated, tau, dt, values.T.shape, rng).T
    return values + drift + white * rng.standard_normal(values.shape)


def quantiles(draws: Array, shares: Sequence[float] = QUANTILES) -> Array:
    """Quantiles (Q, T) of draws (B, T), of those that did not fail; NaN where all did."""
    known = np.isfinite(draws).any(axis=0)
    made = np.full((len(shares), draws.shape[1]), np.nan)
    made[:, known] = np.nanquantile(draws[:, known], shares, axis=0)
    return made


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

    A quantity has its quantiles (quantile, time), from all draws, and as ``<quantity>_draws`` (draw, time)
    every k-th draw, `MOST_DRAWS` at most; k is the attribute ``thin``. A draw is the same flight in all quantities; NaN
    where its simulation failed.

    Args:
        prediction: Its draws.
        time: Times of the record [s].
        wanted: Quantities to keep.
        truth: Truth, where known.
        record: Quantities as the record has them, (T,) each.
        held_out: Samples that the fit did not see.
        role: ``identify`` or ``predict``.
    """
    count, names = len(prediction.last), [q for q in wanted if q in prediction.draws]
    thin = max(1, -(-count // MOST_DRAWS))
    axes = {"quantile": list(QUANTILES), "draw": np.arange(0, count, thin)}
    made = xr.Dataset(coords=axes | {"time": ("time", time, {"units": "s"})})
    for name in names:
        unit = {"units": UNITS[name]}
        made[name] = (("quantile", "time"), quantiles(prediction.draws[name]), unit)
        some = prediction.draws[name][::thin].astype(np.float32)
        made[f"{name}_draws"] = (("draw", "time"), some, unit | {"thin": thin}, {"zlib": True, "shuffle": True})
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
