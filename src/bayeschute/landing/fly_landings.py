"""Simulation of the landings of a campaign in batches: random inputs, flight, one row each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.random import stream
from bayeschute.core.vectors import Vec3, quaternion
from bayeschute.landing import measures, start_plan, touchdown
from bayeschute.landing.campaign_plan import CampaignPlan, Parameters, flight_model
from bayeschute.landing.descend import SAMPLE, SECOND, Landed, Weather, descend
from bayeschute.landing.landing_model import LandingFlight
from bayeschute.landing.latent_draws import latent_rows, without_wind
from bayeschute.landing.motion_label import motion
from bayeschute.landing.surface import Surface, against
from bayeschute.landing.wind_plan import shear_of
from bayeschute.likelihood.disturbances import Latent

Array = NDArray[np.float64]
Ids = NDArray[np.int64]
BATCH = 1024
"""Landings that are flown side by side, and kept in one file."""
_STREAMS = ("winds", "starts", "gusts", "canopies", "surfaces")
_SLOWEST, _SPARE = 0.6, 30.0  # share of the steady speed, and time [s] on top, that a way down may take


@dataclass(frozen=True)
class Normals:
    """Standard normal numbers that landings of one model are made of beside their parameters, (..., B) each."""

    wind: Array
    start: Array
    gust: Array
    canopies: Array
    surface: Array


def nested(draws: int, landings: int, first: int = 0) -> Ids:
    """Landings (N, 6) that take the draws in turn, each with all else of its own."""
    each = np.arange(first, first + landings)
    return np.stack([each % draws, *(each,) * (len(measures.IDS) - 1)], axis=1)


def fly(plan: CampaignPlan, ids: Ids) -> NDArray[np.void]:
    """Fly landings.

    Args:
        plan: What they are drawn from.
        ids: (N, 6), in the order of `measures.IDS`.

    Returns:
        Rows (N,) of `measures.ROW`.
    """
    made = np.zeros(len(ids), measures.ROW)
    first = 0
    for number, one in enumerate(plan.models):
        here = np.flatnonzero((ids[:, 0] >= first) & (ids[:, 0] < first + len(one.theta)))
        for at in range(0, len(here), BATCH):
            some = here[at : at + BATCH]
            made[some] = _batch(plan, number, ids[some], ids[some, 0] - first)
        first += len(one.theta)
    return made


def _batch(plan: CampaignPlan, number: int, ids: Ids, local: Ids) -> NDArray[np.void]:
    """Rows of landings of one model, `local` being their draws of it."""
    one = plan.models[number]
    sizes = normal_sizes(plan, number)
    streams = (partial(stream, plan.seed, f"{what} of landings") for what in _STREAMS)
    given = [_each(*each) for each in zip(streams, ids[:, 1:].T, sizes, strict=True)]
    laws = [law[local].T for law in one.laws]
    return fly_normals(plan, number, one.theta[local].T, laws, Normals(*given), ids)


def normal_sizes(plan: CampaignPlan, number: int) -> tuple[int, int, int, int, int]:
    """Numbers of one landing in `Normals`, in its order."""
    one, winds = plan.models[number], plan.winds
    shape = winds.gust_shape(float(np.ptp(plan.altitudes)))
    gusts = shape[0] * shape[1] + _samples(plan, flight_model(plan, number), one) * _latent(plan, one).size
    return winds.size, start_plan.SIZE, gusts, one.structure.canopies, plan.surface.size


def fly_normals(
    plan: CampaignPlan, number: int, theta: Array, laws: Sequence[Array], given: Normals, ids: Ids
) -> NDArray[np.void]:
    """Fly landings of one model by the numbers that they are made of.

    Args:
        plan: What the numbers mean.
        number: Of the model.
        theta: Parameters (P, B), working coordinates.
        laws: Parameters of every group of disturbances (number, B).
        given: Standard normal numbers.
        ids: What the rows are called (B, 6).
    """
    one, model, winds = plan.models[number], flight_model(plan, number), plan.winds
    wind = winds.by_altitude(given.wind, plan.altitudes)
    shear = shear_of(wind)
    latent, wind = _gusts(plan, one, model, laws, given.gust, wind)
    weather = Weather(plan.altitudes[0], wind, latent, plan.canopy_sd * given.canopies)
    rows = np.interp(plan.start.altitudes(given.start), plan.altitudes, np.arange(len(plan.altitudes))).astype(int)
    x = start_plan.begin(plan.start, model, theta, given.start, wind[rows, :, np.arange(len(ids))].T)
    landed = descend(model, theta, x, weather, plan.floor)
    made = _rows(model, theta, x, landed, ids, shear, plan.surface.drawn(given.surface))
    made["profile"] = winds.member(given.wind)
    return made


def _latent(plan: CampaignPlan, one: Parameters) -> Latent:
    """Disturbances that are drawn by time: those of the wind only where the campaign has no turbulence of its own."""
    return one.latent if plan.winds.turbulence is None else without_wind(one.latent)


def _gusts(
    plan: CampaignPlan, one: Parameters, model: LandingFlight, laws: Sequence[Array], z: Array, wind: Array
) -> tuple[Array, Array]:
    """Disturbances by time (T, 4 + 3 n, B), and the wind by altitude with turbulence added where it is by altitude."""
    n, latent = one.structure.canopies, _latent(plan, one)
    shape = plan.winds.gust_shape(float(np.ptp(plan.altitudes)))
    split = shape[0] * shape[1]
    if plan.winds.turbulence is not None:
        wind = wind + plan.winds.gusts(z[:split].reshape(*shape, -1), len(wind))
    by_time = z[split:].reshape(_samples(plan, model, one), latent.size, -1)
    return latent_rows(latent, laws, SAMPLE, by_time, 4 + 3 * n), wind


def _samples(plan: CampaignPlan, model: LandingFlight, one: Parameters) -> int:
    """Samples for which disturbances are drawn: the way down at a low speed, and some more."""
    theta = one.theta.mean(axis=0)[:, None]
    place = np.array([[0.0], [0.0], [-plan.floor]])
    speed = float(np.asarray(start_plan.steady_speed(model, theta, place))[0])
    seconds = (plan.start.highest() - plan.floor) / (_SLOWEST * speed) + _SPARE
    return SECOND * int(np.ceil(seconds / SAMPLE / SECOND)) + 1


def _each(stream_of: Callable[[int], np.random.Generator], ids: Ids, size: int) -> Array:
    """Standard normal numbers (size, B), a stream for each landing's number; numbers that repeat share theirs."""
    known, back = np.unique(ids, return_inverse=True)
    drawn = [stream_of(int(key)).standard_normal(size) for key in known]
    return np.stack(drawn, axis=1).take(back, axis=1)


def _rows(
    model: LandingFlight, theta: Array, x: Array, landed: Landed, ids: Ids, shear: Array, surface: Surface
) -> NDArray[np.void]:
    made = np.zeros(len(ids), measures.ROW)
    for i, name in enumerate(measures.IDS):
        made[name] = ids[:, i]
    with np.errstate(invalid="ignore"):
        numbers = touchdown.at_ground(model, theta, landed.states)
        moving = motion(landed.across, landed.path, SAMPLE)
        up = quaternion(landed.states[6:10]).to_ned(Vec3(1.0, 0.0, 0.0))
        numbers |= against(surface, landed.states[3:6], np.stack([up.x, up.y, up.z]))
    numbers |= {
        "time": landed.time,
        "swing_amplitude": moving.amplitude,
        "swing_phase": moving.phase,
        "turning": moving.turning,
        "glide_angle": moving.glide_angle,
        "surface_wind_north": landed.wind[0],
        "surface_wind_east": landed.wind[1],
        "wind_shear": shear,
        "start_altitude": -x[2],
        "start_swing": touchdown.at_ground(model, theta, x)["swing_angle"],
    }
    bad = landed.outcome != 0
    for name in measures.MEASURES:
        made[name] = np.where(bad & (not name.startswith(("start_", "wind_"))), np.nan, numbers[name])
    made["outcome"], made["label"] = landed.outcome, np.where(bad, -1, moving.label)
    return made
