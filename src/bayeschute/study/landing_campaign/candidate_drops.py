"""Expected posterior covariance after candidate drops, from virtual flights and their records."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayeschute.core.errors import Fault, InputError
from bayeschute.core.random import seed_of
from bayeschute.dynamics.cluster_flight import with_parameters
from bayeschute.likelihood.joint import FlightData
from bayeschute.likelihood.priors import Prior, own_coordinates
from bayeschute.posterior import noise_evidence
from bayeschute.posterior.fit.joint_fit import NoFitError, joint_fit
from bayeschute.posterior.marginal import marginalise
from bayeschute.posterior.noise_evidence import NoisePrior
from bayeschute.posterior.noise_uncertainty import (
    NoiseEffect,
    joint_covariance,
    noise_parameter_slope,
    noise_parameter_spread,
)
from bayeschute.study.assembly import assemble, flight_parameters
from bayeschute.study.assembly.fits import data_of, gaussian_summary, groups, load_fit, structure_of
from bayeschute.study.job import Job
from bayeschute.study.load import load_candidates
from bayeschute.study.run.stage_data import ingest_flight
from bayeschute.study.schema.belief_schema import NoiseTable
from bayeschute.study.schema.vehicle_schema import NOT_FLOWN
from bayeschute.study.study import Flight, Study
from bayeschute.virtual.drop import fly

Array = NDArray[np.float64]
FLOWN = 3
"""Records of each candidate: what one teaches depends on its gusts."""


class Candidates(NamedTuple):
    """Drops that might be flown next.

    Attributes:
        study: The posterior's, with the drops to be predicted.
        noise: Of each drop's record, by name: the study's but where the drop states another, as for a load cell.
    """

    study: Study
    noise: Mapping[str, NoiseTable]


class Expected(NamedTuple):
    """Covariances of the parameters: values, or logarithms of those that are positive, as landings have them.

    Attributes:
        now: (P, P).
        after: After each candidate, by name.
        lost: Why other candidates have none, by name.
    """

    now: Array
    after: dict[str, Array]
    lost: dict[str, str]


def candidates(path: Path | str, study: Study, data: Path | str | None = None) -> Candidates:
    """Read the candidates of a posterior.

    Args:
        path: TOML of ``[[flight]]`` tables with virtual drops; ``noise`` of a flight has the tables of ``[noise]`` that
            are not as in the study: a channel of its own, or the wind's error as another sounding leaves it.
        study: Of the posterior.
        data: What ``${DATA}`` stands for.

    Raises:
        InputError: With every fault of the file; or if a drop is a record, has the name of a fitted flight, does not
            record a channel whose noise it states, or has canopies that differ.
    """
    known = study.vehicle
    if known is not None and known.aero == NOT_FLOWN:  # drops fly by the posterior's coefficients
        known = known.model_copy(update={"aero": NOT_FLOWN.model_copy(update={"source": "the posterior"})})
    read, noise = load_candidates(path, replace(study, vehicle=known), data)
    taken = {flight.name for flight in study.flights}
    faults = []
    for flight in read.flights:
        where = f"{path} [[flight]] {flight.name}"
        if flight.name in taken:
            faults.append(Fault(where, "the name of a fitted flight", "a name of its own"))
        if flight.virtual is None:
            faults.append(Fault(where, "a record", "a drop that may be flown: [flight.virtual]"))
            continue
        if flight.virtual.canopy_sd:
            do = "Leave it out: all canopies fly by the posterior's mean."
            faults.append(Fault(f"{where} canopy_sd", "canopies that differ", "canopies that are alike", do))
        for channel in noise[flight.name].channels():
            if getattr(flight.virtual.sensors, channel) is None:
                do = f"Add {channel} to [flight.virtual.sensors]."
                faults.append(Fault(f"{where} noise", f"{channel}, which it does not record", "recorded channels", do))
        if noise[flight.name].model != study.noise.model:
            got = f"model {noise[flight.name].model!r}"
            faults.append(Fault(f"{where} noise", got, f"the posterior's: {study.noise.model!r}"))
    if faults:
        raise InputError(faults)
    vehicle = read.vehicle if read.vehicle != known else None
    own = tuple(replace(flight, vehicle=flight.vehicle or vehicle) for flight in read.flights)
    return Candidates(replace(study, flights=(*study.flights, *own)), noise)


def covariances(
    job: Job, noise: Mapping[str, NoiseTable], progress: Callable[[float, str], None] | None = None
) -> Expected:
    """Covariance of the parameters now, and as expected after each candidate.

    A candidate is flown `FLOWN` times by the posterior's mean, with its gusts and sensors. Every record is fitted with
    the posterior as the prior and noise parameters of its own; the covariance there, start and disturbances integrated
    out and the noise parameters' uncertainty included, is averaged over the records.

    Args:
        job: A finished fit whose study names the candidates as flights to be predicted.
        noise: Of each candidate, from `candidates`.
        progress: Called with the share done and words.
    """
    group = groups(job)[0]
    stored = load_fit(job, group)
    theta = own_coordinates(group.priors, stored.theta)
    priors = [replace(p, air_share=0.0) for p in group.priors]
    known, flat = gaussian_summary(priors, theta), theta.reshape(-1, theta.shape[-1])
    after, lost = {}, {}
    todo = job.study.with_role("predict")
    for i, flight in enumerate(todo):
        found: list[Array] = []
        for number in range(FLOWN):
            if progress is not None:
                progress((i + number / FLOWN) / len(todo), f"{flight.name} {number + 1} of {FLOWN}")
            seed = seed_of(job.study.seed, "candidate drop", number)
            drop = replace(job, study=replace(job.study, noise=noise[flight.name], seed=seed))
            try:
                record = fly_candidate(job.study, flight, priors, group.flights[0], flat.mean(axis=0), seed)
                ingest_flight(drop, replace(flight, virtual=None), record)
                data = data_of(drop, flight, priors, like=group.flights[0])
                found.append(_covariance(data, known, assemble.noise_prior(drop.study)))
            except (NoFitError, FloatingPointError) as error:
                lost[flight.name] = " ".join(str(error).split())
        if found:
            after[flight.name] = np.mean(found, axis=0)
    gone = {name: why for name, why in lost.items() if name not in after}
    return Expected(np.cov(flat, rowvar=False).reshape(len(known), -1), after, gone)


def fly_candidate(
    study: Study, flight: Flight, priors: Sequence[Prior], like: Flight, theta: Array, seed: int
) -> xr.Dataset:
    """The record of a candidate that flies with a posterior's parameters, its canopies seen at the posterior's scale.

    Args:
        study: Of the candidates.
        flight: The candidate.
        priors: Of the parameters.
        like: The fitted flight whose canopies' parameters it has.
        theta: Working coordinates, as landings have them (P,).
        seed: Of gusts and sensors.

    Raises:
        FloatingPointError: If the flight is not finite.
    """
    assert flight.virtual is not None
    vehicle = study.vehicle_of(flight)
    structure = structure_of(priors, vehicle.canopies.number)
    base, _ = assemble.cluster(vehicle, flight.capsule_mass)
    base = replace(base, axial=(0.0,) * len(structure.axial), transverse=(0.0,) * len(structure.transverse))
    own = () if flight.capsule_mass is None else ("capsule_mass",)
    names = flight_parameters.in_flight(priors, like.name, (*own, *flight_parameters.biases(priors)))
    numbers = with_parameters(base, structure, names, theta)
    record, _ = fly(assemble.drop(flight.virtual), numbers, structure, seed)
    if numbers.position_scale is not None:
        seen = record["canopy_position"]
        seen.values += (float(numbers.position_scale) - 1.0) * (seen - record["capsule_position"]).values
    return record


def _covariance(data: FlightData, known: Sequence[Prior], prior: NoisePrior) -> Array:
    """Of the parameters (P, P), after one record; at its joint mode, with uncertain noise parameters."""
    best, hyper, _ = joint_fit([data], known, prior)
    made = marginalise([data], hyper, known, best)
    slope, scale = noise_parameter_slope(made), np.asarray(made.scale)
    linear, corrections = [along.linear for along in made.along], [along.mean_correction for along in made.along]
    evidence = noise_evidence.function_of(made.flights, linear, known, prior, corrections)
    before = np.linalg.solve(np.asarray(made.prior_factor), scale)
    spread_of = noise_evidence.noise_parameter_covariance(evidence, hyper, prior, slope, before.T @ before)
    return joint_covariance(scale, NoiseEffect(slope, *noise_parameter_spread(made, spread_of)), spread_of)
