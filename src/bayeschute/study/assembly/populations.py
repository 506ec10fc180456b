"""Hierarchical models of a study: populations of bodies, drops and canopies.

Descents are fits of one parameter each, with a population of their logarithms. Drops of a cluster share most
parameters; those that ``vary`` in ``[priors]`` names have a value per drop, those of ``vary_canopies`` one per canopy.
Drops are fitted separately if some parameter varies; then all fits are joined (`posterior.combine.hierarchy`). Flights
that were fitted are predicted with the parameters of their drop and canopies in the joined posterior, others with those
of new members of the populations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import xarray as xr
from arviz_base import from_dict
from numpy.typing import NDArray

from bayeschute.aero.coefficient import shared_name
from bayeschute.core.random import stream
from bayeschute.core.trees import load_tree, save_tree
from bayeschute.likelihood.priors import Prior, working
from bayeschute.posterior.assess import flight_groups
from bayeschute.posterior.combine import hierarchy
from bayeschute.posterior.combine.hierarchy import Hierarchy
from bayeschute.posterior.noise_uncertainty import NoiseEffect
from bayeschute.study.assembly import canopies
from bayeschute.study.assembly.fits import Group, Stored, groups, load_fit
from bayeschute.study.job import Job, load_priors

Array = NDArray[np.float64]
FILE = "fit/members.npz"
DIVERGING = "population_diverging"
"""Variable of ``sample_stats``: whether the transition of NUTS to a draw of the populations diverged (chain, draw)."""
_PRIOR_DRAWS = 2000
_JOINED = "of the joined posterior; log_likelihood, log_prior and predictions are of each fit alone"
_POPULATIONS = "of the populations: whether the transition of NUTS to a draw diverged"
_ALONE = "the sampler's own, of each fit alone: noise parameters held at their estimate"


def joined(job: Job, todo: Sequence[Group], trees: Sequence[xr.DataTree]) -> xr.DataTree:
    """One DataTree of several fits, in the order of the fits."""
    return (_joined_groups if job.study.model == "cluster" else _bodies)(job, todo, trees)


def _bodies(job: Job, todo: Sequence[Group], trees: Sequence[xr.DataTree]) -> xr.DataTree:
    """Several bodies' posteriors, with their population."""
    table, prior = job.study.sampler, load_priors(job)[0]
    centre, scale = working([prior])
    own = [load_fit(job, group).theta for group in todo]
    told = [hierarchy.likelihood_of(np.array([x.mean()]), np.array([[x.var()]]), centre, scale) for x in own]
    combined = hierarchy.joint(told, [[i] for i in range(len(told))], len(told))
    sizes = (table.chains, table.warmup, table.draws, job.study.seed)
    made = hierarchy.fit(combined, [len(told)], centre, scale, scale, *sizes)
    rng = stream(job.study.seed, "prior of bodies")
    plain = _together(trees, ("posterior", "conditional", "prior", "log_prior"))
    plain["posterior"] |= {"population_mean": made.mean[..., 0], "population_sd": made.sd[..., 0]}
    plain["sample_stats"] = {DIVERGING: made.diverging}
    plain["prior"] |= {
        "population_mean": prior.centre + prior.scale * rng.standard_normal((1, _PRIOR_DRAWS)),
        "population_sd": np.abs(prior.scale * rng.standard_normal((1, _PRIOR_DRAWS))),
    }
    units = {name: "1" if name.startswith("population") else prior.unit for name in plain["posterior"]}
    return _tree(plain, units, trees)


def _together(trees: Sequence[xr.DataTree], wanted: Sequence[str]) -> dict[str, dict[str, Array]]:
    """Variables of several trees by group, where their names differ."""
    found: dict[str, dict[str, Array]] = {}
    for tree in trees:
        for name in wanted:
            if name in tree.children:
                rows = {str(k): np.asarray(v) for k, v in tree[name].ds.data_vars.items()}
                found.setdefault(name, {}).update(rows)
    return found


def _tree(plain: dict[str, dict[str, Array]], units: dict[str, str], trees: Sequence[xr.DataTree]) -> xr.DataTree:
    """Groups of parameters, then those of the flights of several fits, each with a note on its draws."""
    known = {name: {"draws": _ALONE} for name in plain if name not in ("posterior", "prior")}
    tree = from_dict(plain, attrs=known | {"posterior": {"draws": _JOINED}})
    for name in flight_groups.GROUPS:
        if parts := [tree_of_fit[name].to_dataset() for tree_of_fit in trees if name in tree_of_fit.children]:
            tree[name] = xr.DataTree(flight_groups.joined(parts))
    for name, unit in units.items():
        tree["posterior"][name].attrs["units"] = unit
    tree["sample_stats"][DIVERGING].attrs["draws"] = _POPULATIONS
    return tree


class _Places(NamedTuple):
    """Indices of the parameters of all fits: shared ones first, then the members of every population.

    Attributes:
        shared: Names of the shared parameters.
        populations: Names of the parameters that vary, in the order of their populations.
        members: Names of the members, one population after the other.
        of: Population of each member, by its place.
        fits: Per fit, the place of each of its parameters among shared ones and members.
    """

    shared: tuple[str, ...]
    populations: tuple[str, ...]
    members: tuple[str, ...]
    of: tuple[int, ...]
    fits: tuple[tuple[int, ...], ...]

    @property
    def known(self) -> tuple[str, ...]:
        """Names with a prior: shared parameters, then means of the populations."""
        return self.shared + self.populations


def _places(vary: Sequence[str], todo: Sequence[Group]) -> _Places:
    """Places of the parameters of some fits, of which those in `vary` differ from fit to fit, others by canopy."""

    def member(name: str, group: Group) -> str:
        return f"{name}@{group.name}" if name in vary else name if canopies.is_of_canopy(name) else ""

    of: dict[str, dict[str, None]] = {}
    for group in todo:
        for p in group.priors:
            if own := member(p.name, group):
                of.setdefault(shared_name(p.name), {})[own] = None
    shared = tuple(p.name for p in todo[0].priors if not member(p.name, todo[0]))
    members = tuple(name for some in of.values() for name in some)
    place = {name: i for i, name in enumerate((*shared, *members))}
    fits = tuple(tuple(place[member(p.name, group) or p.name] for p in group.priors) for group in todo)
    return _Places(shared, tuple(of), members, tuple(k for k, some in enumerate(of.values()) for _ in some), fits)


def _joined_groups(job: Job, todo: Sequence[Group], trees: Sequence[xr.DataTree]) -> xr.DataTree:
    """Fits joined; their draws are kept for the predictions.

    Returns:
        ``posterior`` and ``prior``: shared parameters and population means by the parameter's name, standard deviations
        of the population as ``sd(name)`` (of the logarithm where the prior is log-normal), a drop's own as
        ``name@drop``, a canopy's own as ``name@drop.canopy1``; ``conditional``: draws of each fit, as ``name@fit``
        where there are several.
    """
    study, places, priors = job.study, _places(job.study.priors.vary or (), todo), _by_name(todo)
    table, (centre, scale) = study.sampler, working([priors[name] for name in places.known])
    spread, likelihoods = _spread(job, places, priors), []
    for group in todo:
        before = working(group.priors)
        flat = load_fit(job, group).theta.reshape(-1, len(group.priors))
        alone = (flat.mean(axis=0), np.cov(flat, rowvar=False).reshape(flat.shape[1], -1))
        likelihoods.append(hierarchy.likelihood_of(*alone, *before))
    combined = hierarchy.joint(likelihoods, places.fits, len(places.shared) + len(places.members))
    sizes = [places.of.count(k) for k in range(len(places.populations))]
    made = hierarchy.fit(combined, sizes, centre, scale, spread, table.chains, table.warmup, table.draws, study.seed)
    save_tree(job.out / FILE, made)
    plain = _together(trees, ("sample_stats",) if len(todo) == 1 else ())
    plain.setdefault("sample_stats", {})[DIVERGING] = made.diverging
    plain["posterior"] = _named(places, priors, made)
    plain["prior"] = _named(places, priors, _before(places, centre, scale, spread, study.seed))
    plain["conditional"] = {
        p.name if len(todo) == 1 else f"{p.name}@{group.name}": np.asarray(tree["conditional"][p.name])
        for group, tree in zip(todo, trees, strict=True)
        for p in group.priors
    }
    return _tree(plain, _units(places, priors), trees)


def _units(places: _Places, priors: Mapping[str, Prior]) -> dict[str, str]:
    """Units of all that `_named` names; a standard deviation of logarithms has none."""
    units = {name: p.unit for name, p in priors.items()}
    for name in places.populations:
        units[f"sd({name})"] = "1" if priors[name].logarithmic else priors[name].unit
    return units | {name: units[places.populations[k]] for name, k in zip(places.members, places.of, strict=True)}


def _spread(job: Job, places: _Places, priors: Mapping[str, Prior]) -> Array:
    """Scales of the priors of the populations' standard deviations: as given, else those of their means' priors."""
    given = job.study.priors.spread or {}
    return np.array([given.get(name, priors[name].scale) for name in places.populations])


def _by_name(todo: Sequence[Group]) -> dict[str, Prior]:
    """Priors of shared parameters and of population means, by name."""
    return {p.name: p for group in todo for p in canopies.together(group.priors)}


def _before(places: _Places, centre: Array, scale: Array, spread: Array, seed: int) -> Hierarchy:
    """Draws of the prior of a hierarchy."""
    rng, size, shared = stream(seed, "prior of the populations"), (1, _PRIOR_DRAWS), len(places.shared)
    both = centre + scale * rng.standard_normal((*size, centre.size))
    sd = np.abs(spread * rng.standard_normal((*size, spread.size)))
    before = Hierarchy(both[..., :shared], both[..., shared:], sd, both[..., :0], 0, np.zeros(sd.shape[:2], bool))
    return before._replace(members=hierarchy.others(before, places.of, rng))


def _named(places: _Places, priors: Mapping[str, Prior], made: Hierarchy) -> dict[str, Array]:
    """Draws of a hierarchy by the names of its posterior, in the parameters' own units."""
    both = dict(zip(places.known, np.moveaxis(np.concatenate([made.shared, made.mean], axis=-1), -1, 0), strict=True))
    found = {name: p.value(both[name]) for name, p in priors.items()}
    for k, name in enumerate(places.populations):
        found[f"sd({name})"] = made.sd[..., k]
        own = [m for m, of in enumerate(places.of) if of == k]
        found |= {places.members[m]: priors[name].value(made.members[..., m]) for m in own}
    return found


def by_members(job: Job, group: Group, alone: Stored, flown: bool, draws: int) -> list[tuple[Group, Stored, int]]:
    """Fits that predict a flight, with draws of its parameters from the joined posterior, and the number of each.

    Args:
        job: The run.
        group: The fit that the flight was part of; any of the study's where there is none, and then all predict it.
        alone: That fit, as it is kept.
        flown: Whether the flight was fitted.
        draws: Of the flight.
    """
    every = groups(job)
    todo = [group] if flown else every
    share = [len(part) for part in np.array_split(np.arange(draws), len(todo))]
    return [
        (one, _of_members(job, alone if one == group else load_fit(job, one), flown, every, every.index(one)), n)
        for one, n in zip(todo, share, strict=True)
        if n
    ]


def _of_members(job: Job, alone: Stored, flown: bool, todo: Sequence[Group], fit: int) -> Stored:
    """A fit with the parameters that the joined posterior gives it, or gives further members of the populations.

    Noise stays that of the fit alone. The draws are permuted, so that fits which predict one flight
    together don't all give the same ones.
    """
    made = load_tree(job.out / FILE, Hierarchy)
    rng, places = stream(job.study.seed, "further members", todo[fit].name), _places(job.study.priors.vary or (), todo)
    members = made.members if flown else hierarchy.others(made, places.of, rng)
    theta = np.concatenate([made.shared, members], axis=-1)[..., list(places.fits[fit])]
    mixed = rng.permutation(theta.reshape(-1, theta.shape[-1])).reshape(theta.shape)
    return replace(alone, theta=mixed, held=mixed, noise_effect=NoiseEffect.none(*alone.noise_effect.slope.shape))
