"""Misfit of the fitted records: innovations, process noise, noise parameters and coefficients against the model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.random import stream
from bayeschute.likelihood.disturbances import STATES
from bayeschute.likelihood.joint import FlightData, Unknowns, latent_path_of
from bayeschute.likelihood.priors import working
from bayeschute.likelihood.simulation_smoother import normals
from bayeschute.posterior.assess.alternatives import Score, scores
from bayeschute.posterior.assess.flight_groups import outputs_of
from bayeschute.posterior.marginal import Linearisation, draw_flights
from bayeschute.posterior.sampling.sampler_checks import effective_draws
from bayeschute.prediction.predictive_checks import (
    BOUND,
    Check,
    draws_checks,
    error_check,
    mean_check,
    pit_counts,
    prior_check,
    series_checks,
)
from bayeschute.study.assembly import assemble
from bayeschute.study.assembly.fits import Group, Stored
from bayeschute.study.evidence.possible_errors import possible_errors
from bayeschute.study.job import Job

Array = NDArray[np.float64]
NAME = "predictive.json"
"""File of a run with its predictive checks."""
FREQUENCIES = {"pendulum": 0.07, "scissors": 0.23}
"""Modes of a cluster under mains [Hz] (NASA/TM-2019-220410), for clusters only."""
STATED = 1.5
"""Factor within which a stated standard deviation of a disturbance is taken to be right."""
SIMULATED = 400
"""Disturbances simulated as stated."""
_UNSURE = 2.0  # standard errors of a variance of draws that count
_LEAST_TOLD = 0.05  # share of a prior's variance that a distance has before the data at least
_AXES = ("north", "east", "down")
_ALONG = ("", "north ", "east ")  # a canopy's force along its axis, and across towards
DRAWS = 16
"""Of the process noise, of each fit."""
MATTERS = 0.5
"""Posterior standard deviations by which an error moves some parameter where it matters: 90 % intervals hold 86 %."""
LOG_SD = 0.7
"""Of the priors of noise parameters (`posterior.noise_evidence.NoisePrior`)."""


def flight_innovations(flight: FlightData, along: Linearisation) -> Array:
    """Standardised innovations (T, C) at the optimum; NaN where nothing was recorded."""
    return np.where(np.asarray(flight.present), np.asarray(along.unit)[..., 0], np.nan)


def latent_names(job: Job, flight: FlightData) -> list[str]:
    """Names of the columns of the process noise of a flight: the group, and which of its processes."""
    groups, count, made = assemble.noise_parameter_names(job.study), dict[int, int](), list[str]()
    for _, group in flight.latent.processes:
        count[group] = count.get(group, 0) + 1
        states = STATES[flight.latent.kinds[group]]
        made += [f"{groups[group]} {count[group]}" + (f".{i + 1}" if states > 1 else "") for i in range(states)]
    return made


class Misfit(NamedTuple):
    """Predictive checks of the records of one fit.

    Attributes:
        checks: All checks.
        pit: Counts of the probability integral transform of the innovations in ten equal bins, by flight and channel.
        errors: Errors of record and vehicle that were tested for, and what to do about each, by flight.
    """

    checks: list[Check]
    pit: dict[str, dict[str, list[int]]]
    errors: dict[str, list[tuple[Score, str]]]


def misfit_of_fit(job: Job, group: Group, one: Stored) -> Misfit:
    """Predictive checks of the records of one fit.

    Args:
        job: The run.
        group: Its flights and priors.
        one: The fit.
    """
    frequencies = FREQUENCIES if job.study.model == "cluster" else {}
    flights = [flight.name for flight in group.flights]
    checks: list[Check] = []
    pit: dict[str, dict[str, list[int]]] = {}
    errors: dict[str, list[tuple[Score, str]]] = {}
    for place, (name, flight, along) in enumerate(zip(flights, one.marginal.flights, one.marginal.along, strict=True)):
        unit, by_channel = flight_innovations(flight, along), dict[str, list[Array]]()
        for i, output in enumerate(outputs_of(flight)[0]):
            checks += series_checks(name, f"innovations of {output}", unit[:, i], float(flight.dt), frequencies)
            by_channel.setdefault(output.split(".")[0], []).append(unit[:, i])
        pit[name] = {channel: pit_counts(np.stack(some)) for channel, some in by_channel.items()}
        known = possible_errors(flight, along)
        remedies = {error.alternative.what: error.do for error in known}
        tested = scores(one.marginal, place, [error.alternative for error in known])
        checks += [error_check(name, s.what, s.unit, s.estimate, s.p, s.moves >= MATTERS) for s in tested]
        errors[name] = [(s, remedies[s.what]) for s in sorted(tested, key=lambda one: one.p)]
    checks += _of_disturbances(job, one, flights, frequencies)
    checks += _of_priors(job, group, one)
    return Misfit(checks, pit, errors)


def as_document(misfit: Sequence[Misfit]) -> dict[str, Any]:
    """What a run stores of the checks of its fits."""
    checks = [one for fit in misfit for one in fit.checks]
    pit = {flight: counts for fit in misfit for flight, counts in fit.pit.items()}
    errors = [
        {"flight": flight, **s._asdict(), "p": s.p, "matters": s.moves >= MATTERS, "do": do}
        for fit in misfit
        for flight, some in fit.errors.items()
        for s, do in some
    ]
    return {"bound": BOUND, "checks": [one._asdict() for one in checks], "pit": pit, "errors": errors}


def _of_disturbances(job: Job, one: Stored, flights: list[str], frequencies: dict[str, float]) -> Iterator[Check]:
    """Checks of draws of the process noise."""
    rng = stream(job.study.seed, "process noise of predictive checks")
    xi = np.zeros((one.optimum.theta.size, DRAWS))
    if not any(flight.latent.size for flight in one.marginal.flights):
        return
    numbers = tuple(normals(flight, DRAWS, rng) for flight in one.marginal.flights)
    drawn = draw_flights(one.marginal, xi, numbers)
    for name, flight, found in zip(flights, one.marginal.flights, drawn, strict=True):
        yield from _time_means(job, name, flight, np.asarray(found.error))
        shocks = np.asarray(found.unknowns.process_noise)
        for i, what in enumerate(latent_names(job, flight)):
            yield from draws_checks(name, f"disturbance {what}", shocks[:, i], float(flight.dt), frequencies)


def _time_means(job: Job, name: str, flight: FlightData, error: Array) -> Iterator[Check]:
    """Time means of the estimated disturbances against the standard deviations that the study states for them.

    A recorded wind that is off, or a canopy that differs, shows as a disturbance that does not average out. The fitted
    standard deviations would follow it, so those stated are used, taken to be right within a factor of `STATED`.

    Args:
        job: The run.
        name: Name of the flight.
        flight: Its data.
        error: Draws of its disturbances given the record (T, A, B).
    """
    rng = stream(job.study.seed, "disturbances as stated")
    still = Unknowns(
        np.zeros((flight.starts, SIMULATED)), rng.standard_normal((error.shape[0], flight.latent.size, SIMULATED))
    )
    stated = np.asarray(latent_path_of(flight, assemble.hyper(job.study), still).error).mean(axis=0)
    for row, what in sorted(disturbance_rows(job, flight).items()):
        spread = STATED * float(stated[row].std())
        if spread > 0.0:
            yield mean_check(name, what, float(error[:, row].mean()), spread)


def disturbance_rows(job: Job, flight: FlightData) -> dict[int, str]:
    """Names of the disturbances of a flight, by row."""
    groups = assemble.noise_parameter_names(job.study)
    made: dict[int, str] = {}
    model: Any = flight.model
    for row, group in flight.latent.processes:
        where = place_of(row, model.structure.canopies) if job.study.model == "cluster" else "down"
        made[row] = f"{groups[group].split(',')[0].removeprefix('slow ')} {where}".strip()
    return made


def place_of(row: int, n: int) -> str:
    """Axis or canopy that a disturbance of a cluster of `n` canopies acts on, by row (`cluster_flight.air_between`)."""
    if row < len(_AXES):
        return _AXES[row]
    axis, canopy = divmod(row - len(_AXES), n)
    if axis < len(_ALONG):
        return f"{_ALONG[axis]}of canopy {canopy + 1}"
    return ""


def _of_priors(job: Job, group: Group, one: Stored) -> Iterator[Check]:
    """Distances of estimates from their priors, in standard deviations that the distance has before the data.

    Before the data the posterior mean has the prior's variance less the posterior's. That is the model's own posterior:
    one that was widened since parts of the record disagree is as wide as the prior, and any distance would seem absurd.
    Where a record hardly tells of a parameter the two variances differ by less than draws know the posterior's: two
    standard errors of that count as well. Two samplings of one posterior of set T had distances of 3.4 and 5.6 without.
    """
    where = " and ".join(flight.name for flight in group.flights)
    centre, scale = working(group.priors)
    variance, own = scale**2, one.held.reshape(-1, centre.size)
    after, mean = np.var(own, axis=0), np.mean(own, axis=0)
    unsure = _UNSURE * after * np.sqrt(2.0 / effective_draws(one.held))
    for i, prior in enumerate(group.priors):
        spread = np.sqrt(max(variance[i] - after[i] + unsure[i], _LEAST_TOLD * variance[i]))
        yield prior_check(where, prior.name, (mean[i] - centre[i]) / spread)
    for name, z in noise_distances(job, one).items():
        yield prior_check(where, name, z)


def noise_distances(job: Job, one: Stored) -> dict[str, float]:
    """Distance of the logarithm of every standard deviation of the noise from its prior median [prior sd]."""
    median, made = assemble.hyper(job.study), dict[str, float]()
    for i, name in enumerate(job.study.noise.channels()):
        for kind in ("white", "correlated"):
            before, now = float(getattr(median.noise, kind)[i]), float(getattr(one.hyper.noise, kind)[i])
            if before > 0.0 and now > 0.0:
                made[f"{kind} noise of {name}"] = np.log(now / before) / LOG_SD
    for name, before, now in zip(
        assemble.noise_parameter_names(job.study),
        median.disturbance_parameters,
        one.hyper.disturbance_parameters,
        strict=True,
    ):
        made[f"standard deviation of {name}"] = float(np.log(now[0] / before[0])) / LOG_SD
    return made
