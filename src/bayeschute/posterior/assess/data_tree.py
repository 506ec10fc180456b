"""A posterior as one ArviZ DataTree."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import xarray as xr
from arviz_base import from_dict
from numpy.typing import NDArray

from bayeschute.core.random import stream
from bayeschute.likelihood.joint import NoiseParameters
from bayeschute.likelihood.priors import Prior, factor, standard, values, working
from bayeschute.posterior.assess.flight_groups import HELD, flight_groups
from bayeschute.posterior.marginal import Marginal
from bayeschute.posterior.sampling.protocol import Draws

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]
WIDENED = "unconditional: the sampler's own, widened by the uncertainty of the noise parameters"
_NOISE = ("white", "correlated", "time_constant", "frequency", "damping_ratio")


def data_tree(
    marginal: Marginal,
    priors: Sequence[Prior],
    draws: Draws,
    seed: int,
    flight_names: Sequence[str],
    progress: Progress | None = None,
    wide: Array | None = None,
    times: Sequence[Array] | None = None,
    predictions: bool = True,
    noise_names: tuple[Sequence[str], Sequence[str]] | None = None,
) -> xr.DataTree:
    """Everything about a posterior in one ArviZ DataTree.

    ``log_likelihood``, ``log_prior`` and ``lp`` (in ``sample_stats``) are of the same draws, the sampler's own. Summed
    over samples, flights and parameters, the first two are ``lp`` up to a constant; the attribute ``lp_error`` of
    ``log_likelihood`` is the largest departure from that. `arviz_stats.loo` leaves out a sample given all earlier
    ones. The attribute ``draws`` of a group says which draws it is about; where these are not in the group
    ``posterior``, ``tree.assign(posterior=tree["conditional"])`` is the tree of the sampler's own.

    Args:
        marginal: The posterior.
        priors: Priors of the parameters.
        draws: Draws in standard coordinates.
        seed: Seed of prior draws, unknowns and predictions.
        flight_names: Names of the flights, in order.
        progress: Called with a share done and words.
        wide: The draws widened by the uncertainty of the noise parameters, for the posterior; the group
            ``conditional`` then holds the sampler's own.
        times: Times of the samples of every flight (T,) [s]; from zero where None.
        predictions: Whether posterior, one-step and prior predictions are made; they cost simulations.
        noise_names: Of the channels, and of the groups of disturbances; numbers where None.

    Returns:
        Groups posterior, prior, sample_stats, log_prior, constant_data, those of `flight_groups`, and conditional where
        draws are widened.
    """
    rng = stream(seed, "prior and predictive draws")
    parameters = draws.xi.shape[-1]
    held = np.asarray(marginal.centre) + draws.xi @ np.asarray(marginal.scale).T
    theta = held if wide is None else np.asarray(marginal.centre) + wide @ np.asarray(marginal.scale).T
    centre, root = working(priors)[0], factor(priors)
    prior_draws = centre + rng.standard_normal((1, 2000, parameters)) @ root.T
    log_prior = -0.5 * standard(priors, held) ** 2 - np.log(np.diag(root)) - 0.5 * np.log(2.0 * np.pi)
    of_flights = flight_groups(marginal, draws.xi, prior_draws[0], flight_names, times, rng, progress, predictions)
    groups: dict[str, Any] = {
        "posterior": _named(priors, values(priors, theta)),
        "prior": _named(priors, values(priors, prior_draws)),
        "sample_stats": {"lp": draws.log_density, **draws.stats},
        "log_prior": _named(priors, log_prior),
    }
    said = {name: {"draws": HELD} for name in ("posterior", "sample_stats", "log_prior")}
    said["log_prior"]["entry"] = "log density of a parameter's working coordinate given the parameters before it"
    if wide is not None:
        groups["conditional"] = _named(priors, values(priors, held))
        said |= {"conditional": {"draws": HELD}, "posterior": {"draws": WIDENED}}
    tree = from_dict(groups, attrs=said)
    tree["constant_data"] = xr.DataTree(_noise_parameters(marginal.hyper, noise_names))
    for name, dataset in of_flights.items():
        tree[name] = xr.DataTree(dataset)
    total = sum(row.values.sum(axis=-1) for row in of_flights["log_likelihood"].data_vars.values())
    off = total + log_prior.sum(axis=-1) - draws.log_density
    tree["log_likelihood"].attrs["lp_error"] = float(np.max(np.abs(off - np.median(off))))
    for group in {"posterior", "prior", "conditional"} & set(tree.children):
        for p in priors:
            tree[group][p.name].attrs["units"] = p.unit
    return tree


def _noise_parameters(hyper: NoiseParameters, names: tuple[Sequence[str], Sequence[str]] | None) -> xr.Dataset:
    """Noise parameters by channel and group of disturbances, NaN where one has no such number."""
    groups = [np.asarray(group) for group in hyper.disturbance_parameters]
    own = np.transpose([np.asarray(getattr(hyper.noise, key)) for key in _NOISE[:3]])
    channels, processes = names or (
        [f"channel {i + 1}" for i in range(len(own))],
        [f"disturbance {i + 1}" for i in range(len(groups))],
    )
    rows = {name: dict(zip(_NOISE[:3], row, strict=True)) for name, row in zip(channels, own, strict=True)}
    for name, row in zip(processes, groups, strict=True):
        rows[name] = dict(zip(("correlated", *(_NOISE[3:] if row.size == 3 else _NOISE[2:3])), row, strict=True))
    table = {name: ("noise_parameter", [float(row.get(key, np.nan)) for key in _NOISE]) for name, row in rows.items()}
    said = {
        "entry": "standard deviations, time constant [s] and frequency [Hz] at their estimate; units of the channel"
    }
    return xr.Dataset(table, {"noise_parameter": list(_NOISE)}, said)


def _named(priors: Sequence[Prior], array: Array) -> dict[str, Array]:
    return {p.name: array[..., i] for i, p in enumerate(priors)}
