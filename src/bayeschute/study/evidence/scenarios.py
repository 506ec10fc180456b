"""Misspecification scenarios: named changes of simulated flights unknown to the identification; free of JAX."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from bayeschute.study.study import Study

Change = Callable[[Study], Study]
HEAVIER = 1.03


def _same(study: Study) -> Study:
    return study


def _flights(study: Study, change: Callable[[Any], Any]) -> Study:
    """The study with every virtual drop changed."""
    flights = (f if f.virtual is None else replace(f, virtual=change(f.virtual)) for f in study.flights)
    return replace(study, flights=tuple(flights))


def _table(study: Study, name: str, change: Callable[[Any], dict[str, Any]]) -> Study:
    """The study with a table of every virtual drop changed, where it has one."""

    def changed(virtual: Any) -> Any:
        table = getattr(virtual, name)
        return virtual if table is None else virtual.model_copy(update={name: table.model_copy(update=change(table))})

    return _flights(study, changed)


def _strong_gusts(study: Study) -> Study:
    return _table(study, "turbulence", lambda t: {"horizontal": 2.0 * t.horizontal, "vertical": 2.0 * t.vertical})


def _short_gusts(study: Study) -> Study:
    return _table(study, "turbulence", lambda t: {"time_constant": 1.5})


def _long_gusts(study: Study) -> Study:
    return _table(study, "turbulence", lambda t: {"time_constant": 30.0})


def _breathing(study: Study) -> Study:
    return _table(study, "breathing", lambda t: {"amplitude": 3.0 * t.amplitude})


def _wind_profile(study: Study) -> Study:
    def wrong(sensors: Any) -> dict[str, Any]:
        wind = sensors.wind
        update = {"correlated": 3.0 * max(wind.correlated, 0.3), "time_constant": 60.0}
        return {"wind": wind.model_copy(update=update)}

    return _table(study, "sensors", wrong)


def _dropouts(study: Study) -> Study:
    def more(sensors: Any) -> dict[str, Any]:
        given = sensors.dropouts
        return {} if given is None else {"dropouts": given.model_copy(update={"share": 0.2, "mean_length": 2.0})}

    return _table(study, "sensors", more)


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
    "strong-gusts": Scenario("turbulence twice as strong", _strong_gusts),
    "short-gusts": Scenario("turbulence with a time constant of 1.5 s", _short_gusts),
    "long-gusts": Scenario("turbulence with a time constant of 30 s", _long_gusts),
    "breathing": Scenario("breathing three times as strong", _breathing),
    "wind-profile": Scenario(
        "error of the recorded wind three times as large, with a time constant of 60 s", _wind_profile
    ),
    "mass": Scenario("a capsule 3 % heavier than the identification assumes", _mass),
    "form": Scenario(
        "additional aerodynamic terms alpha^3 and e*alpha, which are no candidates", _form, terms_known=False
    ),
    "dropouts": Scenario("20 % of the canopy positions missing, in gaps of 2 s", _dropouts),
}
"""By name."""
