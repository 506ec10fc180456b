"""A campaign of landings as numbers: what they are drawn from, which of them, and how they are flown.

A landing is six whole numbers: its draw of the parameters, its wind, start, gusts, canopies and the surface that it
touches. Each begins a stream of random numbers of its own, so a landing is the same in whatever process or order it is
flown (in another batch to the last digits, as sums are vectorised otherwise), and landings that share some of the six
differ in the others alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import jax
import numpy as np
from numpy.typing import NDArray

from bayeschute.compiler.runge_kutta import Stepping
from bayeschute.dynamics.cluster_flight import ClusterFlight, ClusterInputs
from bayeschute.dynamics.initial_state import Start, tangent_basis
from bayeschute.dynamics.parameters import Cluster, Structure
from bayeschute.dynamics.step_size import poles, steps
from bayeschute.landing.descend import SAMPLE, SECOND
from bayeschute.landing.landing_model import LandingFlight, density_law
from bayeschute.landing.start_plan import StartPlan
from bayeschute.landing.surface import SurfacePlan
from bayeschute.landing.wind_plan import STEP, WindPlan
from bayeschute.likelihood.disturbances import Latent

Array = NDArray[np.float64]
_BELOW, _ABOVE = 800.0, 300.0  # [m] below the floor for the density, above the highest start also for winds


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


@dataclass(frozen=True, eq=False)
class CampaignPlan:
    """What landings are drawn from; one plan is never equal to another.

    Attributes:
        models: Draws of the posterior; several where it mixes models. Draws are counted through all of them.
        start: Starts.
        winds: Winds.
        ground: Altitude of the ground [m].
        contact: Height of the capsule's centre of mass over the ground at touchdown [m].
        canopy_sd: Relative standard deviation of a canopy's axial coefficient about the draw's [1].
        seed: Of all random numbers.
        surface: Of the ground or the water.
    """

    models: tuple[Parameters, ...]
    start: StartPlan
    winds: WindPlan
    ground: float = 0.0
    contact: float = 0.0
    canopy_sd: float = 0.0
    seed: int = 0
    surface: SurfacePlan = SurfacePlan()

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


@lru_cache(maxsize=16)
def flight_model(plan: CampaignPlan, number: int) -> LandingFlight:
    """The model of some draws, made once for a plan."""
    one, low, high = plan.models[number], plan.floor - _BELOW, plan.start.highest() + _ABOVE
    law, middle, half = density_law(low, high)
    clock = SAMPLE * np.arange(SECOND + 1)
    base = jax.tree.map(lambda a: np.asarray(a, float), one.base)
    return LandingFlight(base, law, middle, half, clock, SAMPLE, one.structure, one.names, stepping(one))


def stepping(one: Parameters) -> Stepping:
    """Runge-Kutta steps per sample that are stable for the stiffest risers of the draws, damped most and least."""
    n = one.structure.canopies
    up = np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0])
    lean = 0.15 if n > 1 else 0.0
    turns = 2.0 * np.pi * np.arange(n) / n
    direction = np.stack([np.sin(lean) * np.cos(turns), np.sin(lean) * np.sin(turns), -np.cos(lean) + 0.0 * turns])
    still = np.zeros((3, n))
    start = Start(np.zeros(3), np.array([0.0, 0.0, 9.0]), up, np.zeros(3), direction, still)
    inputs = ClusterInputs(np.zeros((2, 3)), np.full(2, 1.0), np.ones((2, n)), np.zeros((2, 4)))
    flight = ClusterFlight(one.base, start, tangent_basis(direction), inputs, SAMPLE, one.structure, one.names, ())
    damped, hardly = one.theta.mean(axis=0), one.theta.mean(axis=0)
    for i, name in enumerate(one.names):
        if len(one.theta) and name in ("riser_stiffness", "riser_damping"):
            damped[i] = one.theta[:, i].max()
            hardly[i] = one.theta[:, i].min() if name == "riser_damping" else damped[i]
    return steps(poles(flight, [damped, hardly], 9 + 4 * n), SAMPLE)
