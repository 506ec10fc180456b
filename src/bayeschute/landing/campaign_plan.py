"""A campaign of landings as numbers: what they are drawn from, which of them, and how they are flown.

A landing is five whole numbers: its draw of the parameters, its wind, start, gusts and canopies. Each begins a stream
of random numbers of its own, so a landing is the same in whatever batch, process or order it is flown, and landings
that share some of the five differ in the others alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import numpy as np
from numpy.typing import NDArray

from bayeschute.core.random import stream
from bayeschute.dynamics.cluster_flight import ClusterFlight, ClusterInputs
from bayeschute.dynamics.initial_state import Start, tangent_basis
from bayeschute.dynamics.parameters import Cluster, Structure
from bayeschute.dynamics.step_size import fastest_pole, substeps
from bayeschute.landing import measures, start_plan, touchdown
from bayeschute.landing.descend import SAMPLE, SECOND, Landed, Weather, descend
from bayeschute.landing.landing_model import LandingFlight, density_law
from bayeschute.landing.latent_draws import latent_rows, without_wind
from bayeschute.landing.motion_label import motion
from bayeschute.landing.start_plan import StartPlan
from bayeschute.landing.wind_plan import STEP, WindPlan, shear_of
from bayeschute.likelihood.disturbances import Latent

Array = NDArray[np.float64]
Ids = NDArray[np.int64]
BATCH = 1024
"""Landings that are flown side by side, and kept in one file."""
_BELOW, _ABOVE = 800.0, 300.0  # [m] beyond the way down for which winds and density are held
_SLOWEST, _SPARE = 0.6, 30.0  # share of the steady speed, and time [s] on top, that a way down may take


@dataclass(frozen=True)
class Parameters:
    """Draws of one model's parameters, each with its noise parameters.

    Attributes:
        base: The other numbers of the cluster.
        structure: Terms and options.
        names: Parameters, in the order of `theta`; empty for those that this model doesn't have.
        theta: (D, P), working coordinates.
        latent: Disturbances that the model doesn't explain.
        laws: Parameters of every group of them (D, number).
    """

    base: Cluster
    structure: Structure
    names: tuple[str, ...]
    theta: Array
    latent: Latent
    laws: tuple[Array, ...]


@dataclass(frozen=True)
class CampaignPlan:
    """What landings are drawn from.

    Attributes:
        models: Draws of the posterior; several where it mixes models. Draws are counted through all of them.
        start: Starts.
        winds: Winds.
        ground: Altitude of the ground [m].
        contact: Height of the capsule's centre of mass over the ground at touchdown [m].
        canopy_sd: Relative standard deviation of a canopy's axial coefficient about the draw's [1].
        seed: Of all random numbers.
    """

    models: tuple[Parameters, ...]
    start: StartPlan
    winds: WindPlan
    ground: float = 0.0
    contact: float = 0.0
    canopy_sd: float = 0.0
    seed: int = 0

    @property
    def draws(self) -> int:
        """Number of draws of the parameters."""
        return sum(len(one.theta) for one in self.models)

    @property
    def floor(self) -> float:
        """Altitude of the capsule at touchdown [m]."""
        return self.ground + self.contact

    @property
    def altitudes(self) -> Array:
        """Altitudes at which winds are held (K,) [m]."""
        return np.arange(self.floor - 20.0, self.start.highest() + _ABOVE, STEP)


def nested(draws: int, landings: int, first: int = 0) -> Ids:
    """Landings (N, 5) that take the draws in turn, each with a wind, a start, gusts and canopies of its own."""
    each = np.arange(first, first + landings)
    return np.stack([each % draws, each, each, each, each], axis=1)


def fly(plan: CampaignPlan, ids: Ids) -> NDArray[np.void]:
    """Fly landings.

    Args:
        plan: What they are drawn from.
        ids: (N, 5), in the order of `measures.IDS`.

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
    one, model = plan.models[number], flight_model(plan, number)
    n, count = one.structure.canopies, len(ids)
    theta = one.theta[local].T
    u_start = _each(plan.seed, "starts of landings", ids[:, 2], (start_plan.SIZE,))
    winds = plan.winds
    u_wind = _each(plan.seed, "winds of landings", ids[:, 1], (winds.size,))
    wind = winds.by_altitude(u_wind, plan.altitudes)
    shear = shear_of(wind)
    latent, wind = _gusts(plan, one, model, ids, local, wind)
    axial = plan.canopy_sd * _each(plan.seed, "canopies of landings", ids[:, 4], (n,))
    weather = Weather(plan.altitudes[0], wind, latent, axial)
    from_start = np.array(
        [np.interp(plan.start.altitudes(u_start), plan.altitudes, np.arange(len(plan.altitudes)))]
    ).astype(int)[0]
    x = start_plan.begin(plan.start, model, theta, u_start, wind[from_start, :, np.arange(count)].T)
    landed = descend(model, theta, x, weather, plan.floor)
    made = _rows(model, theta, x, landed, ids, shear)
    made["profile"] = winds.member(u_wind)
    return made


def _gusts(
    plan: CampaignPlan, one: Parameters, model: LandingFlight, ids: Ids, local: Ids, wind: Array
) -> tuple[Array, Array]:
    """Disturbances by time (T, 4 + 3 n, B), and the wind by altitude with turbulence added where it is by altitude."""
    n, laws = one.structure.canopies, [law[local].T for law in one.laws]
    own = plan.winds.turbulence is not None
    latent = without_wind(one.latent) if own else one.latent
    samples = _samples(plan, model, one)
    shape = plan.winds.gust_shape(float(np.ptp(plan.altitudes)))
    z = _each(plan.seed, "gusts of landings", ids[:, 3], (shape[0] * shape[1] + samples * latent.size,))
    split = shape[0] * shape[1]
    if own:
        wind = wind + plan.winds.gusts(z[:split].reshape(*shape, -1), len(wind))
    rows = latent_rows(latent, laws, SAMPLE, z[split:].reshape(samples, latent.size, -1), 4 + 3 * n)
    return rows, wind


def _samples(plan: CampaignPlan, model: LandingFlight, one: Parameters) -> int:
    """Samples for which disturbances are drawn: the way down at a low speed, and some more."""
    theta = one.theta.mean(axis=0)[:, None]
    place = np.array([[0.0], [0.0], [-plan.floor]])
    speed = float(np.asarray(start_plan.steady_speed(model, theta, place))[0])
    seconds = (plan.start.highest() - plan.floor) / (_SLOWEST * speed) + _SPARE
    return SECOND * int(np.ceil(seconds / SAMPLE / SECOND)) + 1


def _each(seed: int, name: str, ids: Ids, shape: tuple[int, ...]) -> Array:
    """Standard normal numbers (..., B), a stream for each landing's number; numbers that repeat share theirs."""
    made = np.empty((*shape, len(ids)))
    known, back = np.unique(ids, return_inverse=True)
    for i, key in enumerate(known):
        made[..., back == i] = stream(seed, name, int(key)).standard_normal(shape)[..., None]
    return made


def _rows(model: LandingFlight, theta: Array, x: Array, landed: Landed, ids: Ids, shear: Array) -> NDArray[np.void]:
    made = np.zeros(len(ids), measures.ROW)
    for i, name in enumerate(measures.IDS):
        made[name] = ids[:, i]
    with np.errstate(invalid="ignore"):
        numbers = touchdown.at_ground(model, theta, landed.states)
        moving = motion(landed.across, landed.path, SAMPLE)
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


_MODELS: dict[tuple[int, int], tuple[CampaignPlan, LandingFlight]] = {}


def flight_model(plan: CampaignPlan, number: int) -> LandingFlight:
    """The model of some draws, made once for a plan."""
    key = id(plan), number
    if key not in _MODELS or _MODELS[key][0] is not plan:
        _MODELS.clear()
        _MODELS[key] = plan, _made(plan, number)
    return _MODELS[key][1]


def _made(plan: CampaignPlan, number: int) -> LandingFlight:
    one, low, high = plan.models[number], plan.floor - _BELOW, plan.start.highest() + _ABOVE
    law, middle, half = density_law(low, high)
    clock = SAMPLE * np.arange(SECOND + 1)
    base = jax.tree.map(lambda a: np.asarray(a, float), one.base)
    return LandingFlight(base, law, middle, half, clock, SAMPLE, one.structure, one.names, steps_per_sample(one))


def steps_per_sample(one: Parameters) -> int:
    """Runge-Kutta steps per sample that are stable for the stiffest of the draws, by their risers."""
    n = one.structure.canopies
    up = np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0])
    lean = 0.15 if n > 1 else 0.0
    turns = 2.0 * np.pi * np.arange(n) / n
    direction = np.stack([np.sin(lean) * np.cos(turns), np.sin(lean) * np.sin(turns), -np.cos(lean) + 0.0 * turns])
    still = np.zeros((3, n))
    start = Start(np.zeros(3), np.array([0.0, 0.0, 9.0]), up, np.zeros(3), direction, still)
    inputs = ClusterInputs(np.zeros((2, 3)), np.full(2, 1.0), np.ones((2, n)), np.zeros((2, 4)))
    flight = ClusterFlight(one.base, start, tangent_basis(direction), inputs, SAMPLE, one.structure, one.names, ())
    stiffest = one.theta.max(axis=0) if len(one.theta) else one.theta
    hard = [i for i, name in enumerate(one.names) if name in ("riser_stiffness", "riser_damping")]
    theta = one.theta.mean(axis=0)
    theta[hard] = stiffest[hard]
    return substeps(fastest_pole(flight, theta, 9 + 4 * n), SAMPLE)
