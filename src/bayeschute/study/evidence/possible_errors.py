"""Errors of a cluster's record, vehicle or terms that a fit is tested for, each with what to do about it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.dynamics.cluster_flight import OF_INERTIA, ClusterFlight, output_names
from bayeschute.dynamics.parameters import BIASES
from bayeschute.dynamics.state import unpack
from bayeschute.likelihood.joint import FlightData, outputs_of
from bayeschute.posterior.assess.alternatives import Alternative
from bayeschute.posterior.marginal import Linearisation
from bayeschute.study.assembly.missing_terms import missing_terms

Array = NDArray[np.float64]
_DEGREE = np.pi / 180.0
_PERCENT = 0.01
_AXES = ("north", "east", "down")
_BIASES = {  # what is wrong, the unit in which it is told, that in the model's, and what to do
    "wind_bias": ("the recorded wind", "m/s", 1.0, "The sounding and its axes; or `wind_bias` in `[priors.given]`."),
    "canopy_position_bias": (
        "the recorded distance to the canopies", "m", 1.0,
        "The origins of capsule and canopies; or `canopy_position_bias` in `[priors.given]`.",
    ),
    "capsule_attitude_bias": (
        "the recorded attitude about body axis", "deg", _DEGREE,
        "How the sensor is mounted, and the centre of mass; or `capsule_attitude_bias` in `[priors.given]`.",
    ),
}  # fmt: skip
_CHANNELS = {"canopy_position_bias": "canopy_position", "capsule_attitude_bias": "capsule_attitude"}
_OF_CAPSULE = {  # parameters: field of `dynamics.parameters.Capsule`, what is wrong
    "capsule_normal_force_slope": ("normal_force_slope", "the slope of the capsule's normal force"),
    "capsule_pitch_moment_slope": ("moment_slope", "the slope of the capsule's pitching moment"),
    "capsule_pitch_damping": ("pitch_damping", "the pitch damping of the capsule"),
}
_LATE = {
    "canopy_position": "the clock of the canopy positions",
    "capsule_velocity": "the clock of the capsule's velocity",
    "capsule_attitude": "the clock of the attitude",
}
LIBRARY = {
    "axial": ("alpha^2", "alpha^4", "proximity(0.8)", "closing"),
    "transverse": (
        "e", "e*alpha^2", "e*alpha^4", "rate", "rate*alpha^2", "e*(e.rate)", "e*alpha^2*(e.rate)",
        "repulsion(0.8)", "c", "side*e", "side*rate",
    ),
}  # fmt: skip
"""Terms of a canopy's force, by kind, that a fit is tested for: those that a new study chooses from."""
_WEIGH = "Weigh it; or `capsule_mass` in `[priors.given]`. Moments of inertia wrong the other way look alike."
_SWING_IT = "Swing it on a cable; or `{}` in `[priors.given]`. A mass wrong the other way looks alike."
_VARY = 'Canopies that differ: `vary_canopies = ["axial[1]"]` in `[priors]`, with `fit = "pool"`.'
_SET_CLOCKS = "Time stamps of the instruments. If they are right, forces lag in a way that the model lacks."
_ADD_IT = "Add `{}` to `{}` and `core` in `[structure]`; or other terms of the angles flown, which act like it."
_CALIBRATE = "The calibration of the load cells: `scale` of the column."


class PossibleError(NamedTuple):
    """An error that a fit is tested for, and what to do where it is found."""

    alternative: Alternative
    do: str


def possible_errors(flight: FlightData, along: Linearisation) -> list[PossibleError]:
    """Errors that a flight is tested for: none for a descent, and none of what the fit has as a parameter.

    Args:
        flight: The record.
        along: About its conditional mode.
    """
    model = flight.model
    if not isinstance(model, ClusterFlight):
        return []
    fitted = {name.partition(".")[0] for name in model.names}
    found = (
        _of_bodies(flight, model, fitted),
        _missing_terms(flight),
        _constant(flight, model, fitted),
        _of_instruments(flight, model, along),
    )
    return [one for some in found for one in some]


def _of_bodies(flight: FlightData, model: ClusterFlight, fitted: Collection[str]) -> Iterator[PossibleError]:
    """Of the bodies: mass of the capsule, its moments of inertia and aerodynamics, and a canopy's axial force."""
    base = model.base

    def heavier(x: float) -> FlightData:
        capsule = replace(base.capsule, mass=base.capsule.mass * (1.0 + _PERCENT * x))
        return replace(flight, model=replace(model, base=replace(base, capsule=capsule)))

    if "capsule_mass" not in fitted:
        yield PossibleError(Alternative("the mass of the capsule", "%", heavier), _WEIGH)
    for name, axis in OF_INERTIA.items():
        if name not in fitted:

            def larger(x: float, axis: str = axis) -> FlightData:
                moments = base.capsule.inertia
                moments = replace(moments, **{axis: getattr(moments, axis) * (1.0 + _PERCENT * x)})
                capsule = replace(base.capsule, inertia=moments)
                return replace(flight, model=replace(model, base=replace(base, capsule=capsule)))

            what = f"the moment of inertia of the capsule about body axis {axis}"
            yield PossibleError(Alternative(what, "%", larger), _SWING_IT.format(name))
    for name, (field, words) in _OF_CAPSULE.items():
        if name not in fitted and base.capsule.table is None:

            def more(x: float, field: str = field) -> FlightData:
                capsule = replace(base.capsule, **{field: getattr(base.capsule, field) + x})
                return replace(flight, model=replace(model, base=replace(base, capsule=capsule)))

            yield PossibleError(Alternative(words, "", more), f"`{name}` in `[priors.given]`.")
    n = model.structure.canopies
    for k in range(n if n > 2 else n - 1):
        own = np.eye(n)[k]

        def stronger(x: float, own: Array = own) -> FlightData:
            factor = np.asarray(model.record.axial_factor) * (1.0 + _PERCENT * x * own)
            return replace(flight, model=replace(model, record=replace(model.record, axial_factor=factor)))

        what = f"the axial force of canopy {k + 1} relative to the others"
        yield PossibleError(Alternative(what, "%", stronger), _VARY)


def _missing_terms(flight: FlightData) -> Iterator[PossibleError]:
    """Terms of a canopy's force that a model does not have."""
    for coefficient, alternative in missing_terms(flight, LIBRARY):
        yield PossibleError(alternative, _ADD_IT.format(coefficient, coefficient.kind))


def _constant(flight: FlightData, model: ClusterFlight, fitted: Collection[str]) -> Iterator[PossibleError]:
    """Constant errors of the record, as of `dynamics.parameters.BIASES`."""
    names, record = output_names(model.channels, model.structure.canopies), model.record
    for name, (words, unit, size, do) in _BIASES.items():
        channel = _CHANNELS.get(name)
        if name in fitted or (channel is not None and channel not in model.channels):
            continue
        for axis in BIASES[name][1]:
            if channel is None:
                own = np.eye(3)[_AXES.index(axis)]

                def calmer(x: float, own: Array = own) -> FlightData:
                    return replace(flight, model=replace(model, record=replace(record, wind=record.wind - x * own)))

                yield PossibleError(Alternative(f"{words} {axis}", unit, calmer), do)
            else:
                own = np.array([one.startswith(channel) and one.endswith(axis) for one in names])
                put_right = _corrected(flight, size * own)
                yield PossibleError(Alternative(f"{words} {axis}", unit, put_right, of_data=True), do)


def _of_instruments(flight: FlightData, model: ClusterFlight, along: Linearisation) -> Iterator[PossibleError]:
    """Clocks of the instruments against each other, and the gain of load cells."""
    names = output_names(model.channels, model.structure.canopies)
    seen = np.asarray(outputs_of(flight, along.theta, along.at.path))
    rates = np.gradient(seen, float(flight.dt), axis=0)
    body = unpack(np.asarray(along.at.path).T, model.structure.canopies).rate
    for i, name in enumerate(names):  # told relative to the recorded attitude, which is what is late
        rates[:, i] = getattr(body, name[-1]) if name.startswith("capsule_attitude") else rates[:, i]
    for channel, words in _LATE.items():
        if channel in model.channels:
            own = np.array([name.startswith(channel) for name in names])
            on_time = _corrected(flight, np.where(own, -rates, 0.0))
            yield PossibleError(Alternative(words, "s late", on_time, of_data=True), _SET_CLOCKS)
    if "riser_tension" in model.channels:
        own = np.array([name.startswith("riser_tension") for name in names])
        gain = _PERCENT * np.where(own, seen, 0.0)
        true = _corrected(flight, gain)
        yield PossibleError(Alternative("the gain of the load cells", "%", true, of_data=True), _CALIBRATE)


def _corrected(flight: FlightData, added: Array) -> Callable[[float], FlightData]:
    """The data of a flight without so many times what an instrument adds to them (T, C), or (C,)."""
    return lambda x: replace(flight, observed=np.asarray(flight.observed) - x * added)
