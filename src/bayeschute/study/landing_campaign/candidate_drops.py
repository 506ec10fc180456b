"""Expected posterior covariance after candidate drops, from virtual flights and their records."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.errors import Fault, InputError
from bayeschute.posterior.fit.joint_fit import NoFitError, joint
from bayeschute.study.assembly.fits import data_of, gaussian_summary, groups, load_fit
from bayeschute.study.job import Job
from bayeschute.study.load import load_flights
from bayeschute.study.run.stage_data import ingest_flight
from bayeschute.study.study import Study

Array = NDArray[np.float64]


def candidates(path: Path | str, study: Study, data: Path | str | None = None) -> Study:
    """A posterior's study with the drops of a file to be predicted.

    Args:
        path: TOML of ``[[flight]]`` tables with virtual drops.
        study: Of the posterior.
        data: What ``${DATA}`` stands for.

    Raises:
        InputError: With every fault of the file; or if a drop is a record, or has the name of a fitted flight.
    """
    read = load_flights(path, study, data)
    taken = {flight.name for flight in study.flights}
    faults = []
    for flight in read.flights:
        if flight.virtual is None:
            faults.append(
                Fault(f"{path} [[flight]] {flight.name}", "a record", "a drop that may be flown: [flight.virtual]")
            )
        if flight.name in taken:
            faults.append(Fault(f"{path} [[flight]] {flight.name}", "the name of a fitted flight", "a name of its own"))
    if faults:
        raise InputError(faults)
    vehicle = read.vehicle if read.vehicle != study.vehicle else None
    own = tuple(replace(flight, vehicle=flight.vehicle or vehicle) for flight in read.flights)
    return replace(study, flights=(*study.flights, *own))


def covariances(
    job: Job, progress: Callable[[float, str], None] | None = None
) -> tuple[Array, dict[str, Array], dict[str, str]]:
    """Covariance of the parameters now, after each candidate, and why others have none.

    A candidate is flown once, by its vehicle file's aerodynamics, with its gusts and sensors; its record is linearised
    about the best flight, start and disturbances integrated out, with the posterior as the prior.

    Args:
        job: A finished fit whose study names the candidates as flights to be predicted.
        progress: Called with the share done and words.

    Returns:
        (P, P) in working coordinates; the same by candidate; reasons by candidate.
    """
    group = groups(job)[0]
    stored = load_fit(job, group)
    prior = gaussian_summary(group.priors, stored.theta)
    flat = stored.theta.reshape(-1, stored.theta.shape[-1])
    after, lost = {}, {}
    todo = job.study.with_role("predict")
    for i, flight in enumerate(todo):
        if progress is not None:
            progress(i / len(todo), flight.name)
        ingest_flight(job, flight)
        data = data_of(job, flight, group.priors, like=group.flights[0])
        try:
            found = joint([data], stored.hyper, prior, flat.mean(axis=0))
        except (NoFitError, FloatingPointError) as error:
            lost[flight.name] = " ".join(str(error).split())
            continue
        after[flight.name] = np.asarray(found.covariance)
    return np.cov(flat, rowvar=False).reshape(len(prior), -1), after, lost
