"""Fits of a study: groups of flights that share parameters, their data, and stored fits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayeschute.aero.coefficient import terms_of
from bayeschute.core.netcdf_files import load_groups
from bayeschute.core.trees import load_tree, save_tree
from bayeschute.dynamics.parameters import Structure
from bayeschute.likelihood.channels import cluster_data, descent_data
from bayeschute.likelihood.joint import FlightData, Lifted, NoiseParameters
from bayeschute.likelihood.priors import Prior, correlated, saturation_of
from bayeschute.posterior.fit.laplace_fit import LaplaceFit
from bayeschute.posterior.joint_mode import Optimum
from bayeschute.posterior.marginal import Linearisation, Marginal, Quadratic, marginalise
from bayeschute.posterior.noise_uncertainty import NoiseEffect
from bayeschute.posterior.sampling.protocol import Draws
from bayeschute.posterior.sampling.sampler_checks import pareto_k
from bayeschute.study.assembly import assemble, canopies, flight_parameters
from bayeschute.study.assembly.canopy_wind import by_altitude
from bayeschute.study.job import Job, load_flight, load_priors
from bayeschute.study.study import Flight

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Group:
    """Flights that share their parameters in one fit; in a descent study, and where drops vary, each is alone."""

    name: str
    flights: tuple[Flight, ...]
    priors: tuple[Prior, ...]


def groups(job: Job) -> list[Group]:
    """The fits of a study."""
    study, priors = job.study, tuple(load_priors(job))
    flights = study.with_role("identify")
    several = len(flights) > 1
    if study.model == "cluster":
        assert study.vehicle is not None
        if study.priors.hierarchical:  # a population's members are independent of the other parameters
            priors = tuple(replace(p, correlation={}) for p in priors)
        together = [(f.name, (f,)) for f in flights] if study.priors.vary else [("all", flights)]
        vary, n = study.priors.vary_canopies or (), study.vehicle.canopies.number
        made = list[Group]()
        for name, some in together:
            own = [f.name for f in some]
            of_each = flight_parameters.each(priors, own) if several else priors
            made.append(Group(name, some, canopies.each(of_each, vary, own, n)))
        return made
    return [
        Group(f.name, (f,), tuple(replace(p, name=f"{p.name}[{f.name}]") if several else p for p in priors))
        for f in flights
    ]


def structure_of(priors: Sequence[Prior], n: int) -> Structure:
    """The structure of `n` canopies whose coefficients are among the parameters."""
    axial, transverse, _ = terms_of([p.name for p in canopies.together(priors)])
    return Structure(tuple(axial), tuple(transverse), n, saturation=saturation_of(priors))


def data_of(job: Job, flight: Flight, priors: Sequence[Prior], like: Flight | None = None) -> FlightData:
    """A flight ready to be fitted or predicted.

    Args:
        job: The run.
        flight: The flight.
        priors: Of all parameters.
        like: The flight whose canopy parameters are used; None: this flight's.
    """
    study, record = job.study, load_flight(job, flight.name)
    time = record["time"].values
    until = None if flight.identify_until is None else flight.identify_until.at(time[0], time[-1])
    if study.model == "descent":
        return descent_data(record, assemble.latent(study, 1), until)
    vehicle = study.vehicle_of(flight)
    n = vehicle.canopies.number
    base, _ = assemble.cluster(vehicle, flight.capsule_mass)
    structure = structure_of(priors, n)
    blank = replace(base, axial=(0.0,) * len(structure.axial), transverse=(0.0,) * len(structure.transverse))
    channels = tuple(study.noise.channels())
    own = () if flight.capsule_mass is None else ("capsule_mass",)
    names = flight_parameters.in_flight(priors, (like or flight).name, own)
    made = cluster_data(record, blank, structure, priors, channels, assemble.latent(study, n), until, names)
    return made if flight.wind_profile is None else by_altitude(made, record, flight.wind_profile)


class _Kept(NamedTuple):
    """Stored results of a fit, as in `LaplaceFit` and `Draws`, without what can be recomputed from the flights."""

    optimum: Optimum
    asides: tuple[Lifted, ...]
    determinant: Quadratic
    bend: Quadratic
    hyper: NoiseParameters
    xi: Array
    wide: Array
    noise_parameter_covariance: Array
    noise_effect: NoiseEffect
    determinant_error: float
    least_fall: float
    is_mode: bool
    failed: int
    evaluations: int
    pareto_k: float | None


def _file(job: Job, group: Group) -> Path:
    return job.out / "fit" / f"{group.name}.npz"


def save_fit(job: Job, group: Group, found: LaplaceFit, draws: Draws, wide: Array) -> None:
    """Store a finished fit, for `load_fit`."""
    made, ratio = found.marginal, draws.stats.get("log_ratio")
    best = replace(found.optimum, flights=tuple(along.at for along in made.along), trace=())
    kept = _Kept(
        best, tuple(along.aside for along in made.along), made.determinant, made.bend, found.hyper, draws.xi, wide,
        found.noise_parameter_covariance, found.noise_effect, found.determinant_error, found.profile.worst,
        found.profile.is_mode, draws.failed, draws.evaluations, None if ratio is None else pareto_k(ratio),
    )  # fmt: skip
    save_tree(_file(job, group), kept)


@dataclass(frozen=True)
class Stored:
    """A finished fit, read back.

    Attributes:
        marginal: The marginal posterior.
        optimum: The optimum.
        hyper: Noise parameters.
        theta: Draws in working coordinates (chain, draw, P).
        held: Conditional draws, with the noise parameters fixed at their estimate, as the sampler returned them.
        failed: Simulations that failed while sampling.
        evaluations: Evaluations of the exact density.
        noise_parameter_covariance: Of the logarithms of the noise parameters.
        noise_effect: How the parameters' conditional posterior follows those.
        determinant_error: What the error of the log density against Laplace's does to means and widths.
        least_fall: Of the log density at one standard deviation along any axis.
        is_mode: Whether it falls to both sides along every axis.
        pareto_k: Of the ratios exact/surrogate; None where the draws were not corrected ones.
    """

    marginal: Marginal
    optimum: Optimum
    hyper: NoiseParameters
    theta: Array
    held: Array
    failed: int
    evaluations: int
    noise_parameter_covariance: Array
    noise_effect: NoiseEffect
    determinant_error: float
    least_fall: float
    is_mode: bool
    pareto_k: float | None


def load_noise_parameters(job: Job, group: Group) -> NoiseParameters:
    """Noise parameters of a finished fit."""
    return load_tree(_file(job, group), NoiseParameters, "hyper")


def load_optimum(job: Job, group: Group) -> Optimum:
    """Parameters, paths and disturbances of a finished fit at its mode."""
    return load_tree(_file(job, group), Optimum, "optimum")


def load_fit(job: Job, group: Group) -> Stored:
    """Read a fit back and set its marginal posterior up again."""
    kept = load_tree(_file(job, group), _Kept)
    flights = [data_of(job, f, group.priors) for f in group.flights]
    marginal = marginalise(flights, kept.hyper, group.priors, kept.optimum)
    along = tuple(
        one._replace(aside=_of_own(aside, one)) for one, aside in zip(marginal.along, kept.asides, strict=True)
    )
    marginal = replace(marginal, along=along, determinant=kept.determinant, bend=kept.bend)
    theta, held = (kept.optimum.theta + xi @ np.asarray(marginal.scale).T for xi in (kept.wide, kept.xi))
    return Stored(
        marginal, kept.optimum, kept.hyper, theta, held, kept.failed, kept.evaluations, kept.noise_parameter_covariance,
        kept.noise_effect, kept.determinant_error, kept.least_fall, kept.is_mode, kept.pareto_k,
    )  # fmt: skip


def _of_own(aside: Lifted, along: Linearisation) -> Lifted:
    """Derivatives by the parameters that move a flight, of those by all parameters that fits stored until 0.2."""
    own, whole = np.size(along.parameters), np.size(along.theta)
    return jax.tree.map(lambda a: a[..., along.parameters] if np.shape(a)[-1] == whole != own else a, aside)


def posterior_groups(job: Job, *names: str) -> tuple[xr.Dataset, ...]:
    """Some groups of ``posterior.nc``, in memory; an empty one for a group that it does not have."""
    return load_groups(job.out / "posterior.nc", *names)


def summary_draws(job: Job) -> tuple[dict[str, Array], dict[str, str]]:
    """Draws of every parameter in its unit (chain, draw), and the units."""
    (posterior,) = posterior_groups(job, "posterior")
    draws = {str(name): posterior[name].values for name in posterior.data_vars}
    return draws, {str(name): str(posterior[name].attrs.get("units", "1")) for name in posterior.data_vars}


def gaussian_summary(priors: Sequence[Prior], theta: Array) -> list[Prior]:
    """Posterior draws (chain, draw, P) as Gaussian priors of another flight, such as for its initialisation window."""
    flat = theta.reshape(-1, theta.shape[-1])
    named = [replace(p, source="posterior") for p in priors]
    after = correlated(named, flat.mean(axis=0), np.cov(flat, rowvar=False).reshape(len(priors), -1))
    return flight_parameters.of_unseen(priors, after)
