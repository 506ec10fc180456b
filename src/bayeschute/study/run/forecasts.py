"""Posterior predictive draws of every flight, in this process or over Dask, with identical numbers.

The inputs of a flight are gathered here; its draws are computed in parts, by any worker. A part takes its random
numbers from the position in the flight's stream where a single process would, so the numbers do not depend on the
workers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayeschute.calibration.workers import Lost, client_of, finished
from bayeschute.core.errors import Fault, FitError, InputError
from bayeschute.core.netcdf_files import load_groups
from bayeschute.core.random import seed_of, stream
from bayeschute.likelihood.joint import FlightData, NoiseParameters
from bayeschute.likelihood.priors import Prior, saturation_of
from bayeschute.posterior.marginal import Marginal
from bayeschute.prediction import bands
from bayeschute.prediction.mixture import mix
from bayeschute.study.assembly.fits import (
    Group,
    Stored,
    data_of,
    gaussian_summary,
    groups,
    load_fit,
    load_noise_parameters,
)
from bayeschute.study.assembly.flight_parameters import drawn_for_unseen
from bayeschute.study.assembly.populations import by_members
from bayeschute.study.evidence.recalibrate import Widening
from bayeschute.study.job import Job, load_flight, load_priors, load_truth
from bayeschute.study.run.fit import structures
from bayeschute.study.study import Flight

Array = NDArray[np.float64]
PART = 512  # least number of draws for a separate task
_MOST_PARTS = 64  # of a flight: every part steps over the random numbers of those before it
_AHEAD = 2  # parts per core submitted at once


def when_lost(job: Job) -> str:
    """What to do where simulations are lost; empty where powers of the angle of attack level off, or there are none."""
    if job.study.structure is None or saturation_of(load_priors(job)) is not None:
        return ""
    return 'a flight that swings further than the fitted one may turn over: try saturate = "always" in [structure]'


@dataclass(frozen=True)
class FlightForecast:
    """A flight with the draws of its quantities.

    Attributes:
        flight: The flight.
        hyper: Noise parameters of the fit that gives its parameters.
        prediction: Draws.
        time: Times of the record [s].
        held_out: Samples that the fit did not see.
        record: The record.
        truth: The truth, where known.
        seed: Of its random numbers.
        widened_by: Factors on the draws' distance from their median by quantity; empty where they are as drawn.
    """

    flight: Flight
    hyper: NoiseParameters
    prediction: bands.Prediction
    time: Array
    held_out: NDArray[np.bool_]
    record: xr.Dataset
    truth: xr.Dataset | None
    seed: int
    widened_by: Mapping[str, float] = field(default_factory=dict)

    @property
    def counted(self) -> NDArray[np.bool_]:
        """Samples on which bands are scored: those held out, or all if none is."""
        return self.held_out if self.held_out.any() else np.ones(self.time.size, bool)


@dataclass(frozen=True)
class _Order:
    """Inputs for the draws of a flight, on any worker.

    Attributes:
        known: The fit it was part of; or data, noise parameters and Gaussian summary for its initialisation window.
        index: Its place in the fit.
        whole: The whole flight, where it was not fitted.
        theta: Draws of the parameters, those of every group for its noise parameters.
        noise_parameters: Draws of the noise parameters, used in turn.
        seed: Seed.
        data_end: End of the data that are used [s from the first sample].
        spread: Of the strength of disturbances beyond the data.
    """

    known: Marginal | tuple[NoiseParameters, list[Prior]]
    index: int
    whole: FlightData | None
    theta: Array
    noise_parameters: list[NoiseParameters]
    seed: int
    data_end: float
    spread: float

    def parts(self) -> list[range]:
        """Groups of draws, in parts of a task each; the same however many processes there are."""
        count = -(-len(self.theta) // bands.GROUP)
        size = max(PART // bands.GROUP, -(-count // _MOST_PARTS))
        return [range(i, min(i + size, count)) for i in range(0, count, size)]

    def draw(self, groups: range | None = None, share: Callable[[float], None] | None = None) -> bands.Prediction:
        """Draw groups of the flight's draws, or all; where its first seconds can't be fitted all have failed."""
        if isinstance(self.known, Marginal):
            marginal = self.known
        else:
            assert self.whole is not None
            try:
                marginal = bands.opened(bands.opening(self.whole, bands.OPENING), *self.known)
            except (FitError, FloatingPointError) as error:
                return bands.lost(self.whole, len(self.theta), f"its first {bands.OPENING:g} s: {error}", groups)
        return bands.predict(
            marginal, self.index, self.theta, self.noise_parameters, self.seed, self.whole, self.data_end, share,
            self.spread, groups,
        )  # fmt: skip


def _group_of(job: Job, flight: Flight) -> Group:
    """The fit whose parameters predict a flight: its own if it was fitted, else the only one of the study."""
    todo = groups(job)
    return next((g for g in todo if flight in g.flights), todo[0])


def _order(job: Job, flight: Flight, group: Group, stored: Stored, draws: int) -> tuple[_Order, Array]:
    """Inputs for the draws of a flight by one fit.

    Returns:
        That, and the times of its record.
    """
    study = job.study
    flat = stored.held.reshape(-1, stored.held.shape[-1])
    picked = flat[np.linspace(0, len(flat) - 1, min(draws, len(flat))).astype(int)]
    time = load_flight(job, flight.name)["time"].values
    rng = stream(study.seed, "noise parameters of a flight's draws", flight.name, group.name)
    noise_parameters = bands.noise_parameter_draws(
        stored.hyper, stored.noise_parameter_covariance, -(-len(picked) // bands.GROUP), rng
    )
    theta = bands.carried(stored.marginal, picked, noise_parameters, stored.noise_effect)
    known: Marginal | tuple[NoiseParameters, list[Prior]] = stored.marginal
    index, whole, until = 0, None, _until(flight, flight in group.flights, time)
    if flight in group.flights:
        index = group.flights.index(flight)
    else:
        whole = data_of(job, flight, group.priors, like=group.flights[0])
        known = (stored.hyper, gaussian_summary(group.priors, stored.theta))
        errors = stream(study.seed, "constant errors of an unseen flight's record", flight.name, group.name)
        theta = drawn_for_unseen(group.priors, theta, errors)
    seed, spread = seed_of(study.seed, "draws of a flight", flight.name, group.name), study.predict.disturbance_log_sd
    return _Order(known, index, whole, theta, noise_parameters, seed, until - time[0], spread), time


def _until(flight: Flight, fitted: bool, time: Array) -> float:
    """Where the data end by which a flight is known [s]."""
    if not fitted:
        return float(time[0]) + bands.OPENING
    return flight.identify_until.at(time[0], time[-1]) if flight.identify_until is not None else np.inf


Tell = Callable[[Sequence[bands.Prediction]], FlightForecast]


def _orders(job: Job, flight: Flight) -> tuple[list[_Order], Tell]:
    """Inputs for a flight's draws by every structure that contributes, and how the draws are combined."""
    group = _group_of(job, flight)
    stored, flown = load_fit(job, group), flight in group.flights
    draws = min(job.study.predict.draws, stored.held[..., 0].size)
    if job.study.priors.hierarchical:
        by_fit = by_members(job, group, stored, flown, draws)
    else:
        members = structures.members(job, group, draws)
        by_fit = [(one, stored if one is group else load_fit(job, one), n) for one, n in members]
    made = [_order(job, flight, one, of_it, draws) for one, of_it, draws in by_fit]
    orders, time = [order for order, _ in made], made[0][1]
    record, truth = load_flight(job, flight.name), load_truth(job, flight.name)
    held_out = time > _until(flight, flown, time)
    seed = _record_seed(job, flight)
    return orders, lambda made: FlightForecast(flight, stored.hyper, mix(made), time, held_out, record, truth, seed)


def _record_seed(job: Job, flight: Flight) -> int:
    return seed_of(job.study.seed, "record of a flight", flight.name)


def forecast_flights(job: Job) -> Iterator[FlightForecast]:
    """Draw the quantities of every flight that is fitted or predicted.

    Draws whose process was lost count as simulations that failed.

    Raises:
        InputError: If Dask is wanted and not there or breaks off, or the first part of a flight is lost.
    """
    flights = [f for f in job.study.flights if {"identify", "predict"} & set(f.roles)]
    say = job.say("predict")
    with client_of(job.workers, job.address) as client:
        if client is not None:
            asked = [_orders(job, flight) for flight in flights]
            coming = _anywhere([order for orders, _ in asked for order in orders], client, say)
            yield from (tell([next(coming) for _ in orders]) for orders, tell in asked)
            return
        for i, flight in enumerate(flights):
            orders, tell = _orders(job, flight)
            made = []
            for j, order in enumerate(orders):

                def share(done: float, before: float = i + j / len(orders), orders: int = len(orders)) -> None:
                    words = f"{flights[int(before)].name}: {done:.0%} of its draws"
                    say((before + done / orders) / len(flights), words)

                made.append(order.draw(share=share))
            yield tell(made)


def forecast_flight(job: Job, flight: Flight) -> FlightForecast:
    """Draw the quantities of one flight of a job's study, in this process."""
    orders, tell = _orders(job, flight)
    return tell([order.draw() for order in orders])


def stored_forecast(job: Job, flight: Flight) -> FlightForecast | None:
    """Draws of a flight as the stage `predict` wrote them, recalibrated where these are; single precision.

    Returns:
        They, with the quantities that the study asks for; None where ``predictions.nc`` has none or not all of them.
    """
    path = job.out / "predictions.nc"
    (kept,) = load_groups(path, flight.name) if path.is_file() else (xr.Dataset(),)
    names = [str(name) for name in kept["quantity"].values] if "quantity" in kept else []
    drawn = {name: kept[f"{name}_draws"] for name in names}
    if not drawn or any(one.attrs["thin"] > 1 for one in drawn.values()):
        return None
    values, table = {name: one.values.astype(float) for name, one in drawn.items()}, kept["variance_share"]
    shares = {name: table.sel(quantity=name).to_series().to_dict() for name in names}
    last = np.full((kept.sizes["draw"], 3), np.nan)
    made = bands.Prediction(kept["time"].values, values, last, int(kept.attrs["failed"]), shares)
    hyper = load_noise_parameters(job, _group_of(job, flight))
    record, truth = load_flight(job, flight.name), load_truth(job, flight.name)
    held_out, seed = kept["held_out"].values.astype(bool), _record_seed(job, flight)
    return FlightForecast(flight, hyper, made, kept["time"].values, held_out, record, truth, seed)


def _drawn(part: tuple[int, _Order, range]) -> bands.Prediction:
    """A task: part of a flight's draws."""
    _, order, groups = part
    return order.draw(groups)


def _anywhere(orders: Sequence[_Order], client: Any, say: Callable[[float, str], None]) -> Iterator[bands.Prediction]:
    """Predictions in the order of the flights, their parts drawn by the processes of a client."""
    todo = [(i, order, part) for i, order in enumerate(orders) for part in order.parts()]
    waiting: list[dict[int, bands.Prediction | Lost]] = [{} for _ in orders]
    given = lost = 0
    for done, ((i, _, part), made) in enumerate(finished(_drawn, todo, client, _AHEAD), 1):
        waiting[i][part.start] = made
        lost += isinstance(made, Lost)
        say(done / len(todo), f"{done} of {len(todo)} parts" + (f", {lost} lost with their workers" if lost else ""))
        while given < len(orders) and len(waiting[given]) == len(orders[given].parts()):
            yield _joined(orders[given], waiting[given])
            waiting[given], given = {}, given + 1


def _joined(order: _Order, made: Mapping[int, bands.Prediction | Lost]) -> bands.Prediction:
    """The parts of a flight as one prediction; draws of parts that were lost are failed ones."""
    first = made[0]
    if isinstance(first, Lost):
        do = "Give the command again with --resume; if it is memory, with fewer workers."
        raise InputError(Fault("predict", f"worker lost: {first.why}", "draws made to their end", do))
    drawn: dict[str, list[Array]] = {name: [] for name in first.draws}
    ends, failed = [], 0
    for part in order.parts():
        one = made[part.start]
        if isinstance(one, Lost):
            count = min(part.stop * bands.GROUP, len(order.theta)) - part.start * bands.GROUP
            none = {name: np.full((count, first.time.size), np.nan) for name in drawn}
            one = bands.Prediction(first.time, none, np.full((count, 3), np.nan), count, {})
        for name, values in one.draws.items():
            drawn[name].append(values)
        ends.append(one.last)
        failed += one.failed
    whole = {name: np.concatenate(values) for name, values in drawn.items()}
    return bands.Prediction(first.time, whole, np.concatenate(ends), failed, first.shares, first.why)


def widened(one: FlightForecast, by: Widening | None) -> FlightForecast:
    """A flight with its draws moved away from, or towards, their median; a flight that was fitted whole as it is."""
    if by is None or not one.held_out.any():
        return one
    draws = dict(one.prediction.draws)
    for name, factor in by.factors.items():
        middle = bands.quantiles(draws[name], (0.5,))[0]
        draws[name] = middle + factor * (draws[name] - middle)
    return replace(one, prediction=replace(one.prediction, draws=draws), widened_by=by.factors)
