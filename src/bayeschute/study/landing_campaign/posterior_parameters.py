"""Posterior draws of a finished fit for landings, each with noise parameters of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.errors import Fault, InputError
from bayeschute.core.random import stream
from bayeschute.dynamics.cluster_flight import LOGARITHMIC
from bayeschute.landing.campaign_plan import Parameters
from bayeschute.likelihood.priors import own_coordinates
from bayeschute.prediction import bands
from bayeschute.study.assembly import assemble, flight_parameters
from bayeschute.study.assembly.fits import Group, Stored, groups, load_fit, structure_of
from bayeschute.study.assembly.populations import by_members
from bayeschute.study.job import Job
from bayeschute.study.run.fit import structures
from bayeschute.study.schema.vehicle_schema import Vehicle

Array = NDArray[np.float64]


def parameters_of(
    job: Job, vehicle: Vehicle | None, capsule_mass: float | None, draws: int | None
) -> tuple[Parameters, ...]:
    """Draws of every model that the posterior mixes.

    Args:
        job: A finished fit.
        vehicle: That lands; None: the study's.
        capsule_mass: Replaces the vehicle's [kg].
        draws: How many in all, evenly through the chains; None: all.

    Raises:
        InputError: If the posterior is of a point mass, which has no landing but a speed.
    """
    if job.study.model != "cluster":
        do = "Ask it for `sea_level_descent_rate` by `predict`."
        raise InputError(Fault("landings of this posterior", f"model {job.study.model!r}", "model 'cluster'", do))
    group = groups(job)[0]
    stored = load_fit(job, group)
    most = stored.held[..., 0].size
    count = min(draws or most, most)
    if job.study.priors.hierarchical:
        told = by_members(job, group, stored, False, count)
    else:
        some = structures.members(job, group, count)
        told = [(one, stored if one is group else load_fit(job, one), n) for one, n in some]
    return tuple(_of(job, vehicle, capsule_mass, one, of_it, n) for one, of_it, n in told)


def _of(
    job: Job, vehicle: Vehicle | None, capsule_mass: float | None, group: Group, stored: Stored, draws: int
) -> Parameters:
    study, flight = job.study, group.flights[0]
    flat = stored.held.reshape(-1, stored.held.shape[-1])
    picked = flat[np.linspace(0, len(flat) - 1, min(draws, len(flat))).astype(int)]
    rng = stream(study.seed, "noise parameters of landings", group.name)
    shared = -(-len(picked) // bands.GROUP)
    hypers = bands.noise_parameter_draws(stored.hyper, stored.noise_parameter_covariance, shared, rng)
    theta = bands.carried(stored.marginal, picked, hypers, stored.noise_effect)
    turn = np.arange(len(picked)) // bands.GROUP % len(hypers)
    groups_of_processes = range(len(stored.hyper.disturbance_parameters))
    rows = tuple(np.array([np.asarray(h.disturbance_parameters[g]) for h in hypers])[turn] for g in groups_of_processes)
    flown = vehicle or study.vehicle_of(flight)
    n = flown.canopies.number
    base, _ = assemble.cluster(flown, capsule_mass)
    structure = structure_of(group.priors, n)
    blank = replace(base, axial=(0.0,) * len(structure.axial), transverse=(0.0,) * len(structure.transverse))
    own = ("capsule_mass",) if capsule_mass is not None or vehicle is not None else ()
    names = flight_parameters.in_flight(group.priors, flight.name, (*own, *flight_parameters.biases(group.priors)))
    return Parameters(blank, structure, names, own_coordinates(group.priors, theta), assemble.latent(study, n), rows)


def drawn_values(models: Sequence[Parameters]) -> dict[str, Array]:
    """Draws of the parameters by name in their own units; those that not all models have are left out."""
    shared = [name for name in models[0].names if name and all(name in one.names for one in models)]
    made = {}
    for name in shared:
        values = np.concatenate([one.theta[:, one.names.index(name)] for one in models])
        made[name] = np.exp(values) if name in LOGARITHMIC else values
    return made
