"""Misspecification scenarios: named changes of simulated flights unknown to the identification; free of JAX."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from bayeschute.study.study import Flight, Study

Change = Callable[[Study], Study]
HEAVIER = 1.03


def _same(study: Study) -> Study:
    return study


def _table(name: str, change: Callable[[Any], dict[str, Any]]) -> Change:
    """The change of a study by which a table of every virtual drop changes, where it has one."""

    def flight(one: Flight) -> Flight:
        table = getattr(one.virtual, name, None)
        if one.virtual is None or table is None:
            return one
        changed = table.model_copy(update=change(table))
        return replace(one, virtual=one.virtual.model_copy(update={name: changed}))

    return lambda study: replace(study, flights=tuple(map(flight, study.flights)))


def _wind_profile(sensors: Any) -> dict[str, Any]:
    wind = sensors.wind
    update = {"correlated": 3.0 * max(wind.correlated, 0.3), "time_constant": 60.0}
    return {"wind": wind.model_copy(update=update)}


def _dropouts(sensors: Any) -> dict[str, Any]:
    given = sensors.dropouts
    return {} if given is None else {"dropouts": given.model_copy(update={"share": 0.2, "mean_length": 2.0})}


def _mass(study: Study) -> Study:
    vehicle = study.vehicle
    if vehicle is None:
        return study
    capsule = vehicle.capsule.model_copy(update={"mass": HEAVIER * vehicle.capsule.mass})
    flights = (
        f if f.capsule_mass is None else replace(f, capsule_mass=HEAVIER * f.capsule_mass) for f in study.flights
    )
    return replace(study, vehicle=vehicle.model_copy(update={"capsule": capsule}), flights=tuple(flights))


def _form(study: Study) -> Study:
    vehicle = study.vehicle
    if vehicle is None:
        return study
    aero = vehicle.aero
    axial, transverse = {**aero.axial, "alpha^3": 0.3}, {**aero.transverse, "e*alpha": -0.06}
    changed = aero.model_copy(update={"axial": axial, "transverse": transverse})
    return replace(study, vehicle=vehicle.model_copy(update={"aero": changed}))


@dataclass(frozen=True)
class Scenario:
    """A misspecification scenario: a change of the simulated flights that the identification doesn't know.

    Attributes:
        says: In words.
        flown: The study that is flown.
        terms_known: Whether true values of the aerodynamic parameters exist in the form that is fitted.
    """

    says: str
    flown: Change = _same
    terms_known: bool = True


SCENARIOS = {
    "none": Scenario("flights as in the study: turbulence, breathing, sensor errors, dropouts"),
    "strong-gusts": Scenario(
        "turbulence twice as strong",
        _table("turbulence", lambda t: {"horizontal": 2.0 * t.horizontal, "vertical": 2.0 * t.vertical}),
    ),
    "short-gusts": Scenario(
        "turbulence with a time constant of 1.5 s", _table("turbulence", lambda _: {"time_constant": 1.5})
    ),
    "long-gusts": Scenario(
        "turbulence with a time constant of 30 s", _table("turbulence", lambda _: {"time_constant": 30.0})
    ),
    "breathing": Scenario(
        "breathing three times as strong", _table("breathing", lambda t: {"amplitude": 3.0 * t.amplitude})
    ),
    "wind-profile": Scenario(
        "error of the recorded wind three times as large, with a time constant of 60 s",
        _table("sensors", _wind_profile),
    ),
    "mass": Scenario("a capsule 3 % heavier than the identification assumes", _mass),
    "form": Scenario(
        "additional aerodynamic terms alpha^3 and e*alpha, which are no candidates", _form, terms_known=False
    ),
    "dropouts": Scenario("20 % of the canopy positions missing, in gaps of 2 s", _table("sensors", _dropouts)),
}
"""By name."""
