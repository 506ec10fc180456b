"""The cluster of Table 6.1.1 in round SI numbers and flights of it, shared so that tests compile each simulation once."""

from __future__ import annotations

import jax
import numpy as np

from bayeschute.compiler.integrate import trajectory_compiled
from bayeschute.compiler.runge_kutta import Stepping
from bayeschute.core.vectors import Vec3
from bayeschute.dynamics.cluster_flight import ClusterFlight, ClusterInputs
from bayeschute.dynamics.initial_state import Start, tangent_basis
from bayeschute.dynamics.parameters import Canopies, Capsule, Cluster, Risers, Structure

SAMPLES, DT, SUBSTEPS = 201, 0.1, 25
TWO = Structure(("1", "alpha^2"), ("e", "angle", "angle*alpha^2", "rate", "repulsion(0.8)"), 2, "riser")
UPRIGHT = np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0])
CAPSULE = Capsule(
    9463.0,
    Vec3(25e3, 22e3, 20e3),
    Vec3(1.9, 0.1, 0.05),
    Vec3(0.2, 0.0, -0.1),
    19.86,
    5.03,
    -0.9,
    0.3,
    -0.05,
    -0.1,
    -0.2,
)
CANOPIES = Canopies(981.8, 35.36, 9.75, 149.1, 3969.0)
RISERS = Risers(71.3, 2.19e5, 1.46e5, 0.05)


def cluster(axial=(0.95, -0.8), transverse=(-0.1, 0.2, 2.0, 0.3, 0.3), **changes) -> Cluster:
    """The cluster with coefficients in the order of a structure's terms."""
    numbers = {"capsule": CAPSULE, "canopies": CANOPIES, "risers": RISERS} | changes
    return Cluster(axial=tuple(axial), transverse=tuple(transverse), **numbers)


def flight(
    model, start, structure=TWO, wind=(0.0, 0.0, 0.0), density=1.1, samples=SAMPLES, dt=DT, substeps=SUBSTEPS, **options
):
    """A flight in steady air."""
    n = structure.canopies
    inputs = ClusterInputs(
        np.tile(np.asarray(wind, float), (samples, 1)),
        np.full(samples, density),
        np.ones((samples, n)),
        np.tile(UPRIGHT, (samples, 1)),
    )
    model = jax.tree.map(float, model)  # one type of leaf, one compilation
    names, channels = options.get("names", ()), options.get("channels", ())
    return ClusterFlight(
        model, start, tangent_basis(start.direction), inputs, dt, structure, names, channels, Stepping(substeps)
    )


def start(direction, turning=None, velocity=(0.0, 0.0, 10.0)) -> Start:
    """An upright capsule at the origin with risers along `direction` (3, n)."""
    d = np.asarray(direction, float)
    d = d / np.linalg.norm(d, axis=0)
    turning = np.zeros_like(d) if turning is None else np.asarray(turning, float)
    return Start(np.zeros(3), np.asarray(velocity, float), UPRIGHT, np.zeros(3), d, turning)


def fly(one) -> np.ndarray:
    """States (T, X) of a flight without parameters."""
    n, samples = one.structure.canopies, one.record.density.shape[0]
    return np.asarray(trajectory_compiled(one, np.zeros(0), np.zeros(9 + 4 * n), np.zeros((samples, 3))))
