"""Errors of a cluster's record or vehicle that a fit is tested for, each with what to do about it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from bayeschute.compiler.integrate import outputs
from bayeschute.dynamics.cluster_flight import ClusterFlight, output_names
from bayeschute.dynamics.parameters import BIASES
from bayeschute.dynamics.state import unpack
from bayeschute.likelihood.joint import FlightData
from bayeschute.posterior.assess.alternatives import Alternative
from bayeschute.posterior.marginal import Linearisation

Array = NDArray[np.float64]
_DEGREE = np.pi / 180.0
_PERCENT = 0.01
_AXES = ("north", "east", "down")
_BIASES = {  # what is wrong, the unit in which it is told, and that in the model's
    "wind_bias": ("the recorded wind", "m/s", 1.0),
    "canopy_position_bias": ("the recorded distance to the canopies", "m", 1.0),
    "capsule_attitude_bias": ("the recorded attitude about body axis", "deg", _DEGREE),
}
_CHANNELS = {"canopy_position_bias": "canopy_position", "capsule_attitude_bias": "capsule_attitude"}
_OF_CAPSULE = {  # parameters: field of `dynamics.parameters.Capsule`, words
    "capsule_normal_force_slope": ("normal_force_slope", "the slope of the capsule's normal force"),
    "capsule_pitch_moment_slope": ("moment_slope", "the slope of the capsule's pitching moment"),
    "capsule_pitch_damping": ("pitch_damping", "the pitch damping of the capsule"),
}
_LATE = {
    "canopy_position": "the clock of the canopy positions",
    "capsule_velocity": "the clock of the capsule's velocity",
    "capsule_attitude": "the clock of the attitude",
}
REMEDIES = {
    "the mass": "Weigh it; or `capsule_mass` in `[priors.given]`. Moments of inertia wrong the other way look alike.",
    "the slope of the capsule's normal": "`capsule_normal_force_slope` in `[priors.given]`.",
    "the slope of the capsule's pitching": "`capsule_pitch_moment_slope` in `[priors.given]`.",
    "the pitch damping": "`capsule_pitch_damping` in `[priors.given]`.",
    "the axial force": 'Canopies that differ: `vary_canopies = ["axial[1]"]` in `[priors]`, with `fit = "pool"`.',
    "the recorded wind": "The sounding and its axes; or `wind_bias` in `[priors.given]`.",
    "the recorded distance": "The origins of capsule and canopies; or `canopy_position_bias` in `[priors.given]`.",
    "the recorded attitude": "How the sensor is mounted, and the centre of mass; or `capsule_attitude_bias` there.",
    "the clock": "Time stamps of the instruments. If they are right, forces lag in a way that the model lacks.",
    "the gain": "The calibration of the load cells: `scale` of the column.",
}
"""What to do, by the beginning of what is wrong."""


def remedy(what: str) -> str:
    """What to do about an error; empty for one that is not known."""
    return next((do for begins, do in REMEDIES.items() if what.startswith(begins)), "")


def possible_errors(flight: FlightData, along: Linearisation) -> list[Alternative]:
    """Alternatives for a flight: none for a descent, and none of what the fit has as a parameter.

    Args:
        flight: The record.
        along: About its conditional mode.
    """
    model = flight.model
    if not isinstance(model, ClusterFlight):
        return []
    fitted = {name.partition(".")[0] for name in model.names}
    found = _of_bodies(flight, model, fitted), _constant(flight, model, fitted), _of_instruments(flight, model, along)
    return [one for some in found for one in some]


def _of_bodies(flight: FlightData, model: ClusterFlight, fitted: Collection[str]) -> Iterator[Alternative]:
    """Of the bodies: mass of the capsule (moments of inertia stay), its aerodynamics, and a canopy's axial force."""
    base = model.base

    def heavier(x: float) -> FlightData:
        capsule = replace(base.capsule, mass=base.capsule.mass * (1.0 + _PERCENT * x))
        return replace(flight, model=replace(model, base=replace(base, capsule=capsule)))

    if "capsule_mass" not in fitted:
        yield Alternative("the mass of the capsule", "%", heavier)
    for name, (field, words) in _OF_CAPSULE.items():
        if name not in fitted and base.capsule.table is None:

            def more(x: float, field: str = field) -> FlightData:
                capsule = replace(base.capsule, **{field: getattr(base.capsule, field) + x})
                return replace(flight, model=replace(model, base=replace(base, capsule=capsule)))

            yield Alternative(words, "", more)
    n = model.structure.canopies
    for k in range(n if n > 2 else n - 1):
        own = np.eye(n)[k]

        def stronger(x: float, own: Array = own) -> FlightData:
            factor = np.asarray(model.record.axial_factor) * (1.0 + _PERCENT * x * own)
            return replace(flight, model=replace(model, record=replace(model.record, axial_factor=factor)))

        yield Alternative(f"the axial force of canopy {k + 1} beside the others", "%", stronger)


def _constant(flight: FlightData, model: ClusterFlight, fitted: Collection[str]) -> Iterator[Alternative]:
    """Constant errors of the record, as of `dynamics.parameters.BIASES`."""
    names, record = output_names(model.channels, model.structure.canopies), model.record
    for name, (words, unit, size) in _BIASES.items():
        channel = _CHANNELS.get(name)
        if name in fitted or (channel is not None and channel not in model.channels):
            continue
        for axis in BIASES[name][1]:
            if channel is None:
                own = np.eye(3)[_AXES.index(axis)]

                def calmer(x: float, own: Array = own) -> FlightData:
                    return replace(flight, model=replace(model, record=replace(record, wind=record.wind - x * own)))

                yield Alternative(f"{words} {axis}", unit, calmer)
            else:
                own = np.array([one.startswith(channel) and one.endswith(axis) for one in names])
                yield Alternative(f"{words} {axis}", unit, _corrected(flight, size * own), of_data=True)


def _of_instruments(flight: FlightData, model: ClusterFlight, along: Linearisation) -> Iterator[Alternative]:
    """Clocks of the instruments against each other, and the gain of load cells."""
    names = output_names(model.channels, model.structure.canopies)
    seen = np.asarray(outputs(model, along.at.path, along.theta))
    rates = np.gradient(seen, float(flight.dt), axis=0)
    body = unpack(jnp.asarray(along.at.path).T, model.structure.canopies).rate
    for i, name in enumerate(names):  # told relative to the recorded attitude, which is what is late
        rates[:, i] = getattr(body, name[-1]) if name.startswith("capsule_attitude") else rates[:, i]
    for channel, words in _LATE.items():
        if channel in model.channels:
            own = np.array([name.startswith(channel) for name in names])
            yield Alternative(words, "s late", _corrected(flight, np.where(own, -rates, 0.0)), of_data=True)
    if "riser_tension" in model.channels:
        own = np.array([name.startswith("riser_tension") for name in names])
        gain = _PERCENT * np.where(own, seen, 0.0)
        yield Alternative("the gain of the load cells", "%", _corrected(flight, gain), of_data=True)


def _corrected(flight: FlightData, added: Array) -> Callable[[float], FlightData]:
    """The data of a flight without so many times what an instrument adds to them (T, C), or (C,)."""
    return lambda x: replace(flight, observed=np.asarray(flight.observed) - x * added)
