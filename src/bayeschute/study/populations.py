"""Several fits side by side: bodies of a kind with their population, and drops that differ about one.

Descents are fits of a parameter each, with a population of their logarithms. Drops of a cluster share most parameters;
those that ``vary`` in ``[priors]`` names are each drop's own. Every drop is fitted alone, then all are joined
(`bayeschute.inference.hierarchy`): drops that were flown are predicted with the parameters that the joined posterior
gives them, a drop that was not with those of another one of the population.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from arviz_base import from_dict
from numpy.typing import NDArray

from bayeschute.inference import hierarchy, population
from bayeschute.inference.hierarchy import Hierarchy
from bayeschute.inference.priors import Prior, values, working
from bayeschute.study.fits import Group, Stored, groups, load_fit
from bayeschute.study.work_data import load_priors

if TYPE_CHECKING:
    from bayeschute.study.stages import Job

Array = NDArray[np.float64]
FILE = "fit/drops.npz"
_PRIOR_DRAWS = 2000
_OWN_LENGTHS = ("log_likelihood", "posterior_predictive", "observed_data")  # groups whose flights differ in length


def joined(job: Job, todo: Sequence[Group], trees: Sequence[xr.DataTree]) -> xr.DataTree:
    """One DataTree of several fits, in the order of the fits."""
    return (_drops if job.study.model == "cluster" else _bodies)(job, todo, trees)


def _bodies(job: Job, todo: Sequence[Group], trees: Sequence[xr.DataTree]) -> xr.DataTree:
    """Several bodies' posteriors, with their population."""
    table, prior = job.study.sampler, load_priors(job)[0]
    own = [load_fit(job, group).theta for group in todo]
    told = [population.likelihood_of(float(x.mean()), float(x.std()), prior.centre, prior.scale) for x in own]
    mean, sd = np.array(told).T
    sizes = (table.chains, table.warmup, table.draws, job.study.seed)
    made = population.fit(mean, sd, (prior.centre, prior.scale), *sizes)
    rng = np.random.default_rng([job.study.seed, 4])
    plain = _together(trees, ("posterior", "conditional", "prior", "log_prior", *_OWN_LENGTHS))
    plain["posterior"] |= {"population_mean": made.mean, "population_sd": made.sd}
    plain["prior"] |= {
        "population_mean": prior.centre + prior.scale * rng.standard_normal((1, _PRIOR_DRAWS)),
        "population_sd": np.abs(prior.scale * rng.standard_normal((1, _PRIOR_DRAWS))),
    }
    units = {name: "1" if name.startswith("population") else prior.unit for name in plain["posterior"]}
    return _tree(plain, units)


def _together(trees: Sequence[xr.DataTree], wanted: Sequence[str]) -> dict[str, dict[str, Array]]:
    """Variables of several trees by group, where their names differ."""
    found: dict[str, dict[str, Array]] = {}
    for tree in trees:
        for name in wanted:
            if name in tree.children:
                rows = {str(k): np.asarray(v) for k, v in tree[name].ds.data_vars.items()}
                found.setdefault(name, {}).update(rows)
    return found


def _tree(plain: dict[str, dict[str, Array]], units: dict[str, str]) -> xr.DataTree:
    tree = from_dict({name: rows for name, rows in plain.items() if name not in _OWN_LENGTHS})
    for name in _OWN_LENGTHS:
        if name in plain:
            tree[name] = xr.DataTree(_own_dims(plain[name], name))
    for name, unit in units.items():
        tree["posterior"][name].attrs["units"] = unit
    return tree


def _own_dims(variables: dict[str, Array], group: str) -> xr.Dataset:
    """Lengths of the flights differ: each keeps dimensions of its own."""
    lead = () if group == "observed_data" else ("chain", "draw")
    made = xr.Dataset()
    for name, array in variables.items():
        rest = [f"{name}_{i}" for i in range(array.ndim - len(lead))]
        made[name] = ((*lead, *rest), array)
    return made


def _places(job: Job, priors: Sequence[Prior]) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Places of the shared parameters and of those that vary, each in the order of the priors."""
    varies = np.array([p.name in (job.study.priors.vary or ()) for p in priors])
    return np.flatnonzero(~varies), np.flatnonzero(varies)


def _drops(job: Job, todo: Sequence[Group], trees: Sequence[xr.DataTree]) -> xr.DataTree:
    """Drops joined; their draws are kept for the predictions.

    Returns:
        ``posterior`` and ``prior``: shared parameters and population means by the parameter's name, standard deviations
        of the population as ``sd(name)`` (of the logarithm where the prior is log-normal), a drop's own as
        ``name@drop``; ``conditional``: draws of each drop's own fit, all as ``name@drop``.
    """
    from bayeschute.study.stages import write_whole

    study, priors = job.study, todo[0].priors
    table, (centre, scale) = study.sampler, working(priors)
    _, vary = _places(job, priors)
    likelihoods = []
    for group in todo:
        flat = load_fit(job, group).theta.reshape(-1, centre.size)
        alone = (flat.mean(axis=0), np.cov(flat, rowvar=False).reshape(centre.size, -1))
        likelihoods.append(hierarchy.likelihood_of(*alone, centre, scale))
    sizes = (table.chains, table.warmup, table.draws, study.seed)
    made = hierarchy.fit(likelihoods, vary.tolist(), centre, scale, *sizes)
    kept: dict[str, Any] = {"shared": made.shared, "mean": made.mean, "sd": made.sd, "drops": made.drops}
    write_whole(job.out / FILE, partial(np.savez, **kept))
    names = [group.name for group in todo]
    plain = _together(trees, _OWN_LENGTHS)
    plain["posterior"] = _named(job, priors, names, made)
    plain["prior"] = _named(job, priors, names, _before(centre, scale, vary, len(todo), study.seed))
    plain["conditional"] = {
        f"{p.name}@{name}": np.asarray(tree["conditional"][p.name])
        for name, tree in zip(names, trees, strict=True)
        for p in priors
    }
    units = {p.name: p.unit for p in priors}
    for i in vary:
        p = priors[i]
        units |= {f"sd({p.name})": "1" if p.logarithmic else p.unit, **{f"{p.name}@{name}": p.unit for name in names}}
    return _tree(plain, units)


def _before(centre: Array, scale: Array, vary: NDArray[np.int_], drops: int, seed: int) -> Hierarchy:
    """Draws of the prior of a hierarchy."""
    rng, size = np.random.default_rng([seed, 4]), (1, _PRIOR_DRAWS)
    both = centre + scale * rng.standard_normal((*size, centre.size))
    sd = np.abs(scale[vary] * rng.standard_normal((*size, vary.size)))
    mean, z = both[..., vary], rng.standard_normal((*size, drops, vary.size))
    own = mean[..., None, :] + sd[..., None, :] * z
    return Hierarchy(np.delete(both, vary, axis=-1), mean, sd, own, 0)


def _named(job: Job, priors: Sequence[Prior], names: Sequence[str], made: Hierarchy) -> dict[str, Array]:
    """Draws of a hierarchy by the names of its posterior, in the parameters' own units."""
    _, vary = _places(job, priors)
    own = values(priors, _whole(job, priors, made))
    found = {p.name: own[..., i] for i, p in enumerate(priors)}
    for k, i in enumerate(vary):
        p = priors[i]
        found[f"sd({p.name})"] = made.sd[..., k]
        found |= {f"{p.name}@{name}": p.value(made.drops[..., d, k]) for d, name in enumerate(names)}
    return found


def _whole(job: Job, priors: Sequence[Prior], made: Hierarchy, own: Array | None = None) -> Array:
    """All parameters (chain, draw, P), working coordinates; those that vary from `own`, else the population's means."""
    shared, vary = _places(job, priors)
    theta = np.empty((*made.sd.shape[:2], len(priors)))
    theta[..., shared], theta[..., vary] = made.shared, made.mean if own is None else own
    return theta


def by_drops(job: Job, group: Group, alone: Stored, flown: bool, draws: int) -> list[tuple[Group, Stored, int]]:
    """Drops that foretell a flight, what the joined posterior says of its parameters, and how many draws each gives.

    Args:
        job: The run.
        group: The drop's own fit where it was flown; any of the study's where it was not, and then all foretell it.
        alone: That fit, as it is kept.
        flown: Whether the flight was fitted.
        draws: Of the flight.
    """
    every = groups(job)
    todo = [group] if flown else every
    share = [len(part) for part in np.array_split(np.arange(draws), len(todo))]
    return [
        (one, _of_drop(job, alone if one == group else load_fit(job, one), one, flown, every.index(one)), n)
        for one, n in zip(todo, share, strict=True)
        if n
    ]


def _of_drop(job: Job, alone: Stored, group: Group, flown: bool, place: int) -> Stored:
    """A drop's fit with the parameters that the joined posterior gives it, or gives another drop of the population.

    Noise stays that of the drop's own fit. The draws are in an order of their own, so that drops which foretell one
    flight together don't all give the same ones.
    """
    with np.load(job.out / FILE) as file:
        made = Hierarchy(**{name: file[name] for name in ("shared", "mean", "sd", "drops")}, failed=0)
    rng = np.random.default_rng([job.study.seed, 17, place])
    own = made.drops[..., place, :] if flown else hierarchy.another_drop(made, rng)
    theta = _whole(job, group.priors, made, own)
    mixed = rng.permutation(theta.reshape(-1, theta.shape[-1])).reshape(theta.shape)
    return replace(alone, theta=mixed, held=mixed, law_slope=0.0 * alone.law_slope)
