"""Groups of the ArviZ DataTree that have an entry per flight: data, log likelihood and predictions.

Dimensions are (chain, draw, ``time_<flight>``, ``channel``). Flights differ in length and ArviZ wants one coordinate
per dimension of a group, so every flight has its own time: in a shared one, padded, `arviz_stats.loo` would meet NaN.
All groups hold the same samples of a flight: those where at least one output was recorded. An output that was not
recorded at one of them is NaN; so is a channel that a flight lacks and another has.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayeschute.core.errors import Fault, InputError
from bayeschute.core.vectors import Component
from bayeschute.dynamics.cluster_flight import ClusterFlight, output_names
from bayeschute.dynamics.descent import DescentFlight
from bayeschute.likelihood.joint import FlightData, NoiseParameters, Unknowns, compared, latent_path_of, states
from bayeschute.likelihood.noise import colour
from bayeschute.likelihood.simulation_smoother import Normals, normals
from bayeschute.posterior.marginal import (
    Marginal,
    draw_flights,
    in_batches,
    one_step_errors,
    sample_log_likelihoods,
)
from bayeschute.records.record import VARIABLES

Array = NDArray[np.float64]
Single = NDArray[np.float32]
PRIOR_DRAWS = 100  # of the prior that are flown
MOST_DRAWS = 500  # posterior draws with predictions
_FAR = 1e30  # what single precision can still hold: states beyond count as failed
MOST_BYTES = 24_000_000  # of the predictions of one flight
GROUPS = (
    "observed_data", "log_likelihood", "posterior_predictive", "one_step_predictive", "prior_predictive",
)  # fmt: skip
HELD = "the sampler's own: noise parameters held at their estimate (the group conditional, where there is one)"
_PACKED = {"zlib": True, "shuffle": True, "complevel": 1}  # a fifth less; more work on noise saves no more
_LONG: dict[str, Any] = {"draws": HELD}
_OBSERVED = {"entry": "the records; NaN where nothing was recorded"}
_EACH = _LONG | {
    "entry": "log density of a sample, its outputs together, given all earlier samples and the parameters; initial "
    "state and disturbances integrated out",
    "shared": "terms of whole flights (log determinant, curvature, penalties) are spread evenly over recorded data",
}
_SMOOTHED = {"entry": "records read by other instruments on the same flight: path drawn given the record, new noise"}
_ONE_STEP = {"entry": "every sample drawn given all earlier ones, as in log_likelihood"}
_FLOWN = {
    "draws": "the first of the group prior; noise parameters at their estimate",
    "entry": "simulated from drawn initial states under drawn disturbances, with noise; NaN where that failed",
}


def labelled(flight: FlightData, name: str, values: NDArray[Any], time: Array) -> xr.Dataset:
    """A variable of one flight with named dimensions, at the samples where an output was recorded.

    Args:
        flight: The flight.
        name: Its name.
        values: (T,), or with the outputs (T, C); (chain, draw, ...) may come before.
        time: Times of all its samples (T,) [s].
    """
    here = np.asarray(flight.present).any(axis=1)
    lead, per_output = ("chain", "draw")[: 2 * (values.ndim > 2)], values.ndim % 2 == 0
    dims = (*lead, f"time_{name}", *(("channel",) if per_output else ()))
    made = xr.Dataset({name: (dims, np.compress(here, values, axis=len(lead)))})
    made = made.assign_coords({f"time_{name}": (f"time_{name}", np.asarray(time)[here], {"units": "s"})})
    if per_output:
        names, units = outputs_of(flight)
        made = made.assign_coords(channel=list(names), units=("channel", list(units)))
    return made


def outputs_of(flight: FlightData) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and units of a flight's outputs."""
    model: Any = flight.model
    if isinstance(model, ClusterFlight):
        names = output_names(model.channels, model.structure.canopies)
    elif isinstance(model, DescentFlight):
        names = ("descent_rate",)
    else:
        names = tuple(f"output.{i + 1}" for i in range(np.shape(flight.observed)[1]))
    units = {name: variable.unit for name, variable in VARIABLES.items()} | {"capsule_attitude": "rad"}
    return names, tuple(units.get(name.split(".")[0], "1") for name in names)


def joined(parts: Sequence[xr.Dataset]) -> xr.Dataset:
    """The flights of one group in one dataset."""
    return xr.merge(parts, join="outer", compat="no_conflicts", combine_attrs="drop_conflicts")


def flight_groups(
    marginal: Marginal,
    xi: Array,
    before: Array,
    flight_names: Sequence[str],
    times: Sequence[Array] | None,
    rng: np.random.Generator,
    progress: Callable[[float, str], None] | None = None,
    predictions: bool = True,
) -> dict[str, xr.Dataset]:
    """The groups in `GROUPS`.

    - ``observed_data``: the records.
    - ``log_likelihood``: see `sample_log_likelihoods`; of every draw.
    - ``posterior_predictive``: records that would be read on the same flight by other instruments: paths drawn given
      the whole record, with new noise.
    - ``one_step_predictive``: every sample drawn given all before it, as in ``log_likelihood``; see `for_loo_pit`.
    - ``prior_predictive``: records of flights of prior draws under disturbances and starts drawn from their priors,
      with noise. They are simulated from the first sample on; NaN where that fails, its share is in ``failed``.

    Args:
        marginal: The posterior.
        xi: Draws in standard coordinates (chain, draw, P).
        before: Draws of the prior in working coordinates (N, P); the first `PRIOR_DRAWS` are flown.
        flight_names: Names of the flights.
        times: Times of their samples [s]; from zero where None.
        rng: Random numbers.
        progress: Called with a share done and words.
        predictions: Whether the groups of predictions are made.
    """
    chains, count, parameters = xi.shape
    flights = marginal.flights
    largest = 4 * max(np.size(flight.observed) for flight in flights)
    thin = -(-chains * count // max(min(MOST_DRAWS, MOST_BYTES // largest), 1))
    some = np.arange(0, count, thin)

    def said(function: Callable[[Array], Any], words: str, total: int) -> Callable[[Array], Any]:
        done = 0

        def made(part: Array) -> Any:
            nonlocal done
            done += part.shape[1]
            if progress is not None:
                progress(min(done / total, 1.0), words)
            return function(part)

        return made

    def rows(
        function: Callable[[Array], Any], words: str, draws: NDArray[np.int_], side_by_side: bool = False
    ) -> list[Any]:
        """Of each flight, (chain, draw, ...)."""
        flat = xi[:, draws].reshape(-1, parameters).T
        found = in_batches(said(function, words, flat.shape[1]), flat, side_by_side=side_by_side)
        return [np.moveaxis(a, -1, 0).reshape(chains, draws.size, *a.shape[:-1]) for a in found]

    clock = times or [np.arange(flight.samples, dtype=float) * float(flight.dt) for flight in flights]
    thinned = _LONG | {"thin": thin}

    def group(values: Sequence[NDArray[Any]], attrs: Mapping[str, Any], labels: Mapping[str, Any]) -> xr.Dataset:
        each = zip(flights, flight_names, values, clock, strict=True)
        made = joined([labelled(*row) for row in each]).assign_coords(labels).assign_attrs(attrs)
        for variable in made.data_vars.values():
            variable.encoding = dict(_PACKED)
        return made

    places = {"chain": np.arange(chains), "draw": np.arange(count)}
    observed: list[Any] = [np.where(np.asarray(f.present), np.asarray(f.observed), np.nan) for f in flights]
    everywhere = rows(
        lambda part: sample_log_likelihoods(marginal, part), "log likelihood", places["draw"], side_by_side=True
    )
    made = {"observed_data": group(observed, _OBSERVED, {}), "log_likelihood": group(everywhere, _EACH, places)}
    if not predictions:
        return made
    smoothed = rows(lambda part: _smoothed(marginal, part, rng), "posterior predictions", some)
    one_step = rows(lambda part: _one_step(marginal, part, rng), "one-step predictions", some)
    flown = [_from_prior(flight, marginal.hyper, before[:PRIOR_DRAWS], rng) for flight in flights]
    of_prior = group(flown, _FLOWN, {"chain": [0], "draw": np.arange(flown[0].shape[1])})
    for name, row in zip(flight_names, flown, strict=True):
        of_prior[name].attrs["failed"] = float(np.isnan(row).all(axis=(2, 3)).mean())
    return made | {
        "posterior_predictive": group(smoothed, thinned | _SMOOTHED, places | {"draw": some}),
        "one_step_predictive": group(one_step, thinned | _ONE_STEP, places | {"draw": some}),
        "prior_predictive": of_prior,
    }


def _read(flight: FlightData, hyper: NoiseParameters, theta: Component, path: Component, z: Normals) -> Single:
    """Data (T, C, B) read on paths (T, X, B) with noise; NaN where nothing was recorded."""
    off = np.asarray(compared(flight, theta, path))
    noise = colour(hyper.outputs(flight), flight.dt, z.drift, z.white)
    return _seen(flight, np.asarray(flight.observed)[..., None] - off + noise)


def _seen(flight: FlightData, made: Array) -> Single:
    """Predictions (T, C, B) where something was recorded, NaN elsewhere."""
    return np.where(np.asarray(flight.present)[..., None], made, np.nan).astype(np.float32)


def _smoothed(marginal: Marginal, xi: Array, rng: np.random.Generator) -> tuple[Single, ...]:
    """Records (T, C, B) on paths given the whole record, per flight."""
    flights, hyper, many = marginal.flights, marginal.hyper, xi.shape[1]
    theta = marginal.theta(xi)
    drawn = draw_flights(marginal, xi, tuple(normals(flight, many, rng) for flight in flights))
    return tuple(
        _read(flight, hyper, theta, one.path, normals(flight, many, rng))
        for flight, one in zip(flights, drawn, strict=True)
    )


def _one_step(marginal: Marginal, xi: Array, rng: np.random.Generator) -> tuple[Single, ...]:
    """Samples (T, C, B) given all before them, per flight."""
    made = []
    for flight, along, unit in zip(marginal.flights, marginal.along, one_step_errors(marginal, xi), strict=True):
        off = np.asarray(along.gains.root) @ (np.asarray(unit) - rng.standard_normal(unit.shape))
        made.append(_seen(flight, np.asarray(flight.observed)[..., None] - off))
    return tuple(made)


def _from_prior(flight: FlightData, hyper: NoiseParameters, theta: Array, rng: np.random.Generator) -> Single:
    """Records (1, N, T, C) of flights of the parameters (N, P), NaN where the simulation fails."""
    z, parameters = normals(flight, len(theta), rng), theta.T
    unknowns = Unknowns(z.start, z.process_noise)
    path = np.asarray(states(flight, parameters, latent_path_of(flight, hyper, unknowns)))
    flew = np.all(np.abs(path) < _FAR, axis=(0, 1))  # of NaN that is false
    return np.moveaxis(_read(flight, hyper, parameters, np.where(flew, path, np.nan), z), -1, 0)[None]


def for_loo_pit(tree: xr.DataTree, flight: str, channel: str | None = None) -> xr.DataTree:
    """What `arviz_stats.loo_pit` and `arviz_plots.plot_loo_pit` need of a stored posterior, for one flight.

    They want predictions from the density that `log_likelihood` holds, the same draws and shape of both, and no gaps.
    So the tree has the one-step predictions as its ``posterior_predictive``, the draws that have them, and recorded
    data only, along the dimension ``datum``; the weight of a datum is that of leaving out its sample. (Predictions
    given the whole record know the datum already: their values would lie too close to 1/2.)

    Args:
        tree: From `data_tree`, or ``posterior.nc``.
        flight: Its name.
        channel: One of its outputs; all together where None.

    Returns:
        Groups posterior, log_likelihood, posterior_predictive, observed_data.

    Raises:
        InputError: If there is no such flight or output.
    """
    seen = tree["observed_data"].ds
    for what, got, known in (("flight", flight, seen.data_vars), ("channel", channel, seen["channel"].values)):
        if got is not None and got not in known:
            raise InputError(Fault(f"for_loo_pit {what}", got, f"one of {', '.join(map(str, known))}"))
    channels, stacked = seen["channel"].values if channel is None else [channel], (f"time_{flight}", "channel")
    predicted = tree["one_step_predictive"].ds[flight].sel(channel=channels)
    draws = {"draw": predicted["draw"].values}
    data = seen[flight].sel(channel=channels).stack(datum=stacked)
    recorded = np.isfinite(data.values)

    def flat(array: xr.DataArray) -> xr.Dataset:
        row = array if "datum" in array.dims else array.broadcast_like(predicted).stack(datum=stacked)
        kept = row.isel(datum=recorded).drop_vars(("datum", *stacked, "units"), errors="ignore")
        return kept.to_dataset(name=flight)

    group = "conditional" if "conditional" in tree.children else "posterior"
    return xr.DataTree.from_dict(
        {
            "posterior": tree[group].ds.sel(draws),
            "log_likelihood": flat(tree["log_likelihood"].ds[flight].sel(draws)),
            "posterior_predictive": flat(predicted),
            "observed_data": flat(data),
        }
    )
