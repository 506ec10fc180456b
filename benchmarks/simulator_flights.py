"""Flights for the benchmarks of the simulator, and how far a simulated flight lies from a tight reference."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray

from bayeschute.aero.coefficient import Coefficient
from bayeschute.atmosphere.standard import standard_density
from bayeschute.compiler.runge_kutta import CLASSICAL, Stepping
from bayeschute.dynamics.cluster_flight import LOGARITHMIC, ClusterFlight, ClusterInputs, quantity
from bayeschute.dynamics.initial_state import tangent_basis
from bayeschute.dynamics.parameters import Structure
from bayeschute.dynamics.step_size import enough, poles
from bayeschute.study.assembly import assemble
from bayeschute.study.load import load_study
from bayeschute.virtual.drop import start_of

Array = NDArray[np.float64]
STUDY = Path(__file__).parents[1] / "models" / "studies" / "cdt-3-11.toml"
SAMPLES, DT = 901, 0.1  # 90 s at 10 Hz
PLAIN = Structure(("1", "alpha^2"), ("e", "e*alpha^2", "rate", "repulsion(0.8)"))
RICH = Structure(
    ("1", "alpha", "alpha^2", "q", "speed"),
    ("e", "e*alpha", "e*alpha^2", "angle", "rate", "rate*q", "rate*alpha^2", "repulsion(0.8)", "e*q", "side*e"),
)
BODY = {
    PLAIN: ("riser_stiffness", "riser_damping", "enclosed_air_factor"),
    RICH: ("riser_length", "riser_stiffness", "riser_damping", "capsule_mass", "enclosed_air_factor"),
}


@dataclass(frozen=True)
class Flights:
    """A model and a batch of what drives it: theta (P, B), start (D, B), error (T, A, B)."""

    model: ClusterFlight
    theta: Array
    start: Array
    error: Array

    def first(self, count: int) -> Flights:
        """The first so many of them."""
        return Flights(
            self.model, *(np.ascontiguousarray(a[..., :count]) for a in (self.theta, self.start, self.error))
        )

    def one(self) -> tuple[Any, ...]:
        """Arguments of a simulation of the first of them."""
        return self.model, *(np.ascontiguousarray(a[..., 0]) for a in (self.theta, self.start, self.error))

    def all(self) -> tuple[Any, ...]:
        """Arguments of a simulation of all of them."""
        return self.model, self.theta, self.start, self.error


def flights(structure: Structure, samples: int, batch: int, axes: int = 5) -> Flights:
    """Flights of the default vehicle with other terms: those that it doesn't have are nearly zero.

    Args:
        structure: `PLAIN` or `RICH`.
        samples: Length of the record.
        batch: Number of flights, whose parameters, starts and disturbances differ.
        axes: Disturbances: of the wind (3), and of both axial factors (5).
    """
    study, rng = load_study(STUDY), np.random.default_rng(1)
    base, own = assemble.cluster(study.vehicle)
    known = dict(zip((*own.axial, *own.transverse), (*base.axial, *base.transverse), strict=True))
    kinds = {"axial": structure.axial, "transverse": structure.transverse}
    base = replace(base, **{kind: tuple(float(known.get(t, 0.0)) for t in terms) for kind, terms in kinds.items()})
    drop = assemble.drop(study.flights[0].virtual)
    start = start_of(drop, base, structure.canopies)
    time = np.arange(samples) * DT
    altitude = drop.altitude - start.velocity[2] * time
    record = ClusterInputs(
        drop.wind.at(altitude) + smooth(rng, time, 1.0, 3),
        standard_density(altitude),
        1.0 + smooth(rng, time, 0.02, structure.canopies),
        np.tile(start.attitude, (samples, 1)),
    )
    numbers = {
        str(Coefficient(kind, t)): v
        for kind, terms in kinds.items()
        for t, v in zip(terms, getattr(base, kind), strict=True)
    }
    risers = {f"riser_{name}": getattr(base.risers, name) for name in ("length", "stiffness", "damping")}
    names = (*numbers, *BODY[structure])
    numbers |= risers | {"capsule_mass": base.capsule.mass, "enclosed_air_factor": 1.0}
    centre = np.array([np.log(numbers[n]) if n in LOGARITHMIC else numbers[n] for n in names])
    channels = ("canopy_position", "capsule_velocity", "capsule_attitude")
    model = ClusterFlight(base, start, tangent_basis(start.direction), record, DT, structure, names, channels)
    deviations = 9 + 4 * structure.canopies
    scatter = [0.02 if n in LOGARITHMIC else 0.01 * abs(c) or 0.001 for n, c in zip(names, centre, strict=True)]
    theta = centre[:, None] + np.array(scatter)[:, None] * rng.standard_normal((centre.size, batch))
    model = replace(model, stepping=Stepping(enough(CLASSICAL, poles(model, [theta.max(axis=1)], deviations), DT, 3)))
    scale = np.where(np.arange(axes) < 3, 0.2, 0.02)
    error = np.stack([smooth(rng, time, 1.0, axes) * scale for _ in range(batch)], axis=-1)
    return Flights(model, theta, 0.01 * rng.standard_normal((deviations, batch)), np.ascontiguousarray(error))


def smooth(rng: np.random.Generator, time: Array, size: float, columns: int) -> Array:
    """Random series (T, columns), linear between values 2 s apart."""
    at = np.arange(0.0, time[-1] + 2.0, 2.0)
    return np.stack([np.interp(time, at, size * rng.standard_normal(at.size)) for _ in range(columns)], axis=1)


def errors(model: ClusterFlight, x: Array, reference: Array) -> tuple[float, float]:
    """Largest errors of the swing angle [deg] and of the descent rate [ft/s] of states (T, X) or (T, X, B)."""
    attach, n, rho = model.base.capsule.attach_b, model.structure.canopies, np.asarray(model.record.density)
    seen = jax.vmap(lambda s, d: [quantity(q, s, d, attach, n) for q in ("swing_angle", "descent_rate")])
    swing, descent = (
        float(np.max(np.abs(np.asarray(a - b)))) for a, b in zip(seen(x, rho), seen(reference, rho), strict=True)
    )
    return float(np.rad2deg(swing)), descent / 0.3048
