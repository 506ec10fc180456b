"""Bands of quantities of interest: parameters, initial state and latent disturbances drawn together.

A flight to be predicted is known by the opening of its record only: those samples fix the initial state (and what they
say of the disturbances); beyond them the disturbances follow their process. The same code serves a part of a record held
out in time, and the smoothing of a fitted flight.
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


def opened(flight: FlightData, hyper: Hyper, posterior: Sequence[Prior]) -> Marginal:
    """What the present data of a flight say of its own unknowns, the parameters as the posterior has them.

    Args:
        flight: The flight; data that must not be seen are absent.
        hyper: Noise parameters.
        posterior: Gaussian summary of the posterior, as priors here.

    Returns:
        The marginal posterior whose unknowns `predict` draws.
    """
    theta = np.array([p.centre for p in posterior])
    best = fit([flight], hyper, posterior, theta, [np.zeros(flight.unknowns)], tolerance=0.1, most=12)
    return marginalise([flight], hyper, posterior, best)


def predict(marginal: Marginal, index: int, theta: Array, seed: int, progress: Callable[[float], None] | None = None) -> Prediction:
    """Draw a flight's quantities.

    Args:
        marginal: Of the fit the flight was part of, or from `opened`.
        index: Which of its flights.
        theta: Draws of the parameters, working coordinates (draw, P).
        seed: Seed of unknowns.
        progress: Called with a share done.

    Returns:
        The prediction.
    """
    flight = marginal.flights[index]
    rng = np.random.default_rng([seed, index])
    xi = np.linalg.solve(np.asarray(marginal.scale), (theta - np.asarray(marginal.centre)).T)
    z = tuple(rng.standard_normal((f.unknowns, xi.shape[1])) for f in marginal.flights)

    def run(xi_part: Array, z_part: tuple[Array, ...]) -> tuple[Array, Array]:
        u = draw_unknowns(marginal, xi_part, z_part)[index]
        quantities, last = _simulate(flight, marginal.theta(jnp.asarray(xi_part)), u)
        return np.asarray(quantities), np.asarray(last)

    rows, lasts = [], []
    for at in range(0, xi.shape[1], BATCH):
        part = np.minimum(np.arange(at, at + BATCH), xi.shape[1] - 1)
        keep = min(BATCH, xi.shape[1] - at)
        quantities, last = run(xi[:, part], tuple(x[:, part] for x in z))
        rows.append(quantities[..., :keep])
        lasts.append(last[:, :keep])
        if progress is not None:
            progress(min((at + BATCH) / xi.shape[1], 1.0))
    made, last = np.concatenate(rows, axis=-1), np.concatenate(lasts, axis=-1)
    bad = ~np.isfinite(made).all(axis=(0, 1))
    made[..., bad], last[:, bad] = np.nan, np.nan
    names = quantities_of(flight)
    time = np.arange(flight.observed.shape[0]) * float(flight.dt)
    draws = {name: made[i].T for i, name in enumerate(names)}
    return Prediction(time, draws, last.T, int(bad.sum()), _shares(marginal, index, xi[:, :BATCH], z, names))


def _shares(marginal: Marginal, index: int, xi: Array, z: tuple[Array, ...], names: Sequence[str]) -> dict[str, dict[str, float]]:
    """Variance of each quantity when one source alone varies, as shares of their sum, averaged over the flight."""
    flight = marginal.flights[index]
    xi = xi[:, np.minimum(np.arange(BATCH), xi.shape[1] - 1)]
    part = [x[:, np.minimum(np.arange(BATCH), x.shape[1] - 1)] for x in z]
    still = tuple(0.0 * x for x in part)
    middle_xi = 0.0 * xi
    u_middle = np.asarray(draw_unknowns(marginal, middle_xi, still)[index])
    u_drawn = np.asarray(draw_unknowns(marginal, middle_xi, tuple(part))[index])
    u_follow = np.asarray(draw_unknowns(marginal, xi, still)[index])
    starts, knots = flight.starts, split(flight, u_middle)[1].shape[0]
    axes = len(flight.group)
    kind = np.array(["initial state"] * starts + [_latent(flight, a) for _ in range(knots) for a in range(axes)])
    cases = {"parameter": (xi, u_follow)}
    for source in dict.fromkeys(kind):
        cases[str(source)] = (middle_xi, np.where((kind == source)[:, None], u_drawn, u_middle))
    variance = {}
    for source, (x, u) in cases.items():
        quantities, _ = _simulate(flight, marginal.theta(jnp.asarray(x)), u)
        variance[source] = np.nanmean(np.nanvar(np.asarray(quantities), axis=-1), axis=-1)
    total = sum(variance.values())
    return {
        name: {source: float(v[i] / total[i]) if total[i] > 0.0 else 0.0 for source, v in variance.items()}
        for i, name in enumerate(names)
    }


def _latent(flight: FlightData, axis: int) -> str:
    return "canopy force" if isinstance(flight.model, ClusterFlight) and axis >= 3 else "wind"


def coverage(prediction: Prediction, name: str, reference: Array, counted: NDArray[np.bool_]) -> float | None:
    """Share of counted samples whose reference lies inside the 90 % band; None if none is known."""
    low, high = np.nanquantile(prediction.draws[name], [QUANTILES[0], QUANTILES[-1]], axis=0)
    known = np.isfinite(reference) & counted
    return float(np.mean((reference[known] >= low[known]) & (reference[known] <= high[known]))) if known.any() else None


def dataset(
    prediction: Prediction, time: Array, wanted: Sequence[str], truth: xr.Dataset | None, record: Mapping[str, Array], held_out: NDArray[np.bool_], role: str
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


def hide_after(flight: FlightData, seconds: float) -> FlightData:
    """The flight with data after the opening made absent."""
    time = np.arange(flight.observed.shape[0]) * float(flight.dt)
    seen = np.asarray(flight.present) & (time <= seconds)[:, None]
    return replace(flight, present=seen, observed=np.where(seen, flight.observed, 0.0))
