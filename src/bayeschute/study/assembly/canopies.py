"""Coefficients that vary between canopies: a parameter for each canopy of each drop, ``axial[1]@drop.canopy2``.

Canopies of different drops are treated as different members of the same population, even if they are the same article.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.random import stream
from bayeschute.likelihood.priors import Prior
from bayeschute.study.study import Flight, Study

Array = NDArray[np.float64]
_MEMBER = re.compile(r"(?P<of>.*\])@(?P<flight>.*)(?P<canopy>\.canopy\d+)")


def coefficient(name: str) -> str:
    """Name of the coefficient without the canopy's suffix; other names are returned unchanged."""
    found = _MEMBER.fullmatch(name)
    return found["of"] if found else name


def is_of_canopy(name: str) -> bool:
    """Whether a parameter is that of one canopy."""
    return _MEMBER.fullmatch(name) is not None


def of_canopy(name: str, flight: str, canopy: int) -> str:
    """Name of a coefficient's parameter for one canopy, counted from 1, of one flight."""
    return f"{name}@{flight}.canopy{canopy}"


def each(priors: Sequence[Prior], vary: Sequence[str], flights: Sequence[str], canopies: int) -> tuple[Prior, ...]:
    """Priors with one for each canopy in the place of those that vary, independent of each other.

    Args:
        priors: Of all parameters.
        vary: Names of those that differ from canopy to canopy.
        flights: Names of the flights that are fitted together.
        canopies: Number of canopies.
    """
    members = [(flight, i + 1) for flight in flights for i in range(canopies)]
    made = [[replace(p, name=of_canopy(p.name, *m)) for m in members] if p.name in vary else [p] for p in priors]
    return tuple(p for some in made for p in some)


def together(priors: Sequence[Prior]) -> list[Prior]:
    """The priors of which `each` made these."""
    made = {coefficient(p.name): replace(p, name=coefficient(p.name)) for p in reversed(priors)}
    return list(reversed(made.values()))


def in_flight(names: Sequence[str], flight: str) -> tuple[str, ...]:
    """What parameters are in a flight's model, as of `cluster_flight.with_parameters`: empty for other flights'.

    Args:
        names: Of the parameters.
        flight: Name of the flight.
    """
    made = []
    for name in names:
        found = _MEMBER.fullmatch(name)
        made.append(name if found is None else found["of"] + found["canopy"] if found["flight"] == flight else "")
    return tuple(made)


def flown(study: Study, flight: Flight, seed: int) -> dict[str, Array]:
    """Coefficients of the canopies of a virtual drop that differ (canopy,), by name; none where all are the vehicle's.

    Args:
        study: The study.
        flight: The flight.
        seed: Of the drop.
    """
    virtual = flight.virtual
    if study.vehicle is None or virtual is None or virtual.canopy_sd is None:
        return {}
    rng, usual = stream(seed, "canopies of a virtual drop"), study.vehicle.aero.coefficients()
    number = study.vehicle.canopies.number
    return {name: usual[name] + sd * rng.standard_normal(number) for name, sd in virtual.canopy_sd.items()}
