"""Fits of a study: which flights share parameters, their data, and finished fits as they are kept."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayeschute.core.files import write_whole
from bayeschute.dynamics.parameters import Structure
from bayeschute.likelihood.channels import cluster_data, descent_data
from bayeschute.likelihood.joint import FlightData, Hyper, Lifted, Unknowns
from bayeschute.likelihood.priors import Prior, correlated
from bayeschute.posterior.fit import Found
from bayeschute.posterior.joint_mode import Optimum
from bayeschute.posterior.marginal import Marginal, Quadratic, marginalise
from bayeschute.posterior.noise_evidence import from_vector, to_vector
from bayeschute.posterior.noise_uncertainty import LawEffect
from bayeschute.posterior.sampling.protocol import Draws
from bayeschute.posterior.sampling.sampler_checks import pareto_k
from bayeschute.study.assembly import assemble, canopies
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
    if study.model == "cluster":
        assert study.vehicle is not None
        if study.priors.hierarchical:  # a population's members are independent of the other parameters
            priors = tuple(replace(p, correlation={}) for p in priors)
        together = [(f.name, (f,)) for f in flights] if study.priors.vary else [("all", flights)]
        vary, n = study.priors.vary_canopies or (), study.vehicle.canopies.number
        return [Group(name, some, canopies.each(priors, vary, [f.name for f in some], n)) for name, some in together]
    several = len(flights) > 1
    return [
        Group(f.name, (f,), tuple(replace(p, name=f"{p.name}[{f.name}]") if several else p for p in priors))
        for f in flights
    ]


def structure_of(priors: Sequence[Prior], n: int) -> Structure:
    """The structure of `n` canopies whose coefficients are among the parameters."""
    names = [p.name for p in canopies.together(priors)]
    terms = {
        kind: tuple(name[len(kind) + 1 : -1] for name in names if name.startswith(f"{kind}["))
        for kind in ("axial", "transverse")
    }
    return Structure(terms["axial"], terms["transverse"], n)


def data_of(job: Job, flight: Flight, priors: Sequence[Prior], like: Flight | None = None) -> FlightData:
    """A flight ready to be fitted or predicted.

    Args:
        job: The run.
        flight: The flight.
        priors: Of all parameters.
        like: The flight whose canopies' parameters this one has; None: its own.
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
    names = canopies.in_flight([p.name for p in priors], (like or flight).name)
    names = tuple("" if name in own else name for name in names)
    made = cluster_data(record, blank, structure, priors, channels, assemble.latent(study, n), until, names)
    return made if flight.wind_profile is None else by_altitude(made, record, flight.wind_profile)


def as_arrays(at: Lifted, number: int, name: str = "") -> dict[str, Array]:
    """A flight's unknowns and path as named arrays of a file."""
    parts = {"start": at.unknowns.start, "shocks": at.unknowns.shocks, "error": at.error, "path": at.path}
    return {f"{name}{part}{number}": np.asarray(value) for part, value in parts.items()}


def from_arrays(arrays: Mapping[str, Array], number: int, name: str = "") -> Lifted:
    """What `as_arrays` took apart."""
    start, shocks, error, path = (arrays[f"{name}{part}{number}"] for part in ("start", "shocks", "error", "path"))
    return Lifted(Unknowns(start, shocks), error, path)


def save_fit(job: Job, group: Group, found: Found, draws: Draws, wide: Array) -> None:
    """Keep a finished fit: what `load_fit` needs to set it up again."""
    best = found.optimum
    arrays: dict[str, Any] = {
        "theta": best.theta,
        "covariance": best.covariance,
        "determinant_slope": found.marginal.determinant.slope,
        "determinant_curvature": found.marginal.determinant.curvature,
        "bend_slope": found.marginal.bend.slope,
        "bend_curvature": found.marginal.bend.curvature,
        "hyper": to_vector(found.hyper),
        "xi": draws.xi,
        "wide": wide,
        "law_covariance": found.law_covariance,
        "law_slope": found.law_effect.slope,
        "law_spread": found.law_effect.spread,
        "law_excess": found.law_effect.excess,
        "facts": np.array(
            [
                best.cost,
                best.converged,
                best.iterations,
                best.last_step,
                found.evidence,
                draws.failed,
                draws.evaluations,
                found.determinant_error,
                found.profile.worst,
                found.profile.is_mode,
            ]
        ),
    }
    for i, along in enumerate(found.marginal.along):
        arrays |= as_arrays(along.at, i) | as_arrays(along.aside, i, "aside_")
    if "log_ratio" in draws.stats:
        arrays["pareto_k"] = pareto_k(draws.stats["log_ratio"])

    def write(path: Any) -> None:
        with path.open("wb") as file:
            np.savez(file, **arrays)

    write_whole(job.out / "fit" / f"{group.name}.npz", write)


@dataclass(frozen=True)
class Stored:
    """A finished fit, read back.

    Attributes:
        marginal: The marginal posterior.
        optimum: The optimum.
        hyper: Noise parameters.
        theta: Draws in working coordinates (chain, draw, P).
        held: The same with the noise parameters held at their optimum, as the sampler made them.
        failed: Simulations that failed while sampling.
        evaluations: Evaluations of the exact density.
        law_covariance: Of the logarithms of the noise parameters.
        law_effect: How the parameters' conditional posterior follows those.
        determinant_error: Root mean square error of the log density against Laplace's.
        least_fall: Of the log density at one standard deviation along any axis.
        is_mode: Whether it falls to both sides along every axis.
        pareto_k: Of the ratios exact/surrogate; None where the draws were not corrected ones.
    """

    marginal: Marginal
    optimum: Optimum
    hyper: Hyper
    theta: Array
    held: Array
    failed: int
    evaluations: int
    law_covariance: Array
    law_effect: LawEffect
    determinant_error: float
    least_fall: float
    is_mode: bool
    pareto_k: float | None


def load_hyper(job: Job, group: Group) -> Hyper:
    """Noise parameters of a finished fit."""
    with np.load(job.out / "fit" / f"{group.name}.npz") as file:
        return jax.tree.map(np.asarray, from_vector(file["hyper"], assemble.hyper(job.study)))


def load_fit(job: Job, group: Group) -> Stored:
    """Read a fit back and set its marginal posterior up again."""
    with np.load(job.out / "fit" / f"{group.name}.npz") as file:
        a = {k: file[k] for k in file.files}
    hyper = load_hyper(job, group)
    cost, converged, iterations, last, _, failed, evaluations, wrong, fall, mode = a["facts"]
    at, asides = ([from_arrays(a, i, name) for i in range(len(group.flights))] for name in ("", "aside_"))
    best = Optimum(
        a["theta"], tuple(at), a["covariance"], float(cost), bool(converged), int(iterations), float(last), ()
    )
    flights = [data_of(job, f, group.priors) for f in group.flights]
    marginal = marginalise(flights, hyper, group.priors, best)
    along = tuple(one._replace(aside=aside) for one, aside in zip(marginal.along, asides, strict=True))
    determinant = Quadratic(a["determinant_slope"], a["determinant_curvature"])
    bend = Quadratic(a["bend_slope"], a["bend_curvature"])
    marginal = replace(marginal, along=along, determinant=determinant, bend=bend)
    scale, known = np.asarray(marginal.scale), a["law_covariance"]
    theta, held = (best.theta + a[name] @ scale.T for name in ("wide", "xi"))
    counts, effect = (int(failed), int(evaluations)), LawEffect(a["law_slope"], a["law_spread"], a["law_excess"])
    k = float(a["pareto_k"]) if "pareto_k" in a else None
    return Stored(marginal, best, hyper, theta, held, *counts, known, effect, float(wrong), float(fall), bool(mode), k)


def summary_draws(job: Job) -> tuple[dict[str, Array], dict[str, str]]:
    """Draws of every parameter in its own unit (chain, draw), and the units."""
    tree = xr.open_datatree(job.out / "posterior.nc", engine="h5netcdf")
    posterior = tree["posterior"].ds.load()
    tree.close()
    draws = {str(name): posterior[name].values for name in posterior.data_vars}
    return draws, {str(name): str(posterior[name].attrs.get("units", "1")) for name in posterior.data_vars}


def gaussian_summary(priors: Sequence[Prior], theta: Array) -> list[Prior]:
    """Posterior draws (chain, draw, P) as Gaussian priors, for the opening of another flight."""
    flat = theta.reshape(-1, theta.shape[-1])
    named = [replace(p, source="posterior") for p in priors]
    return correlated(named, flat.mean(axis=0), np.cov(flat, rowvar=False).reshape(len(priors), -1))
