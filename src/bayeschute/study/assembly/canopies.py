"""Coefficients that vary between canopies: a parameter for each canopy of each drop, ``axial[1]@drop.canopy2``.

Canopies of different drops are treated as different members of the same population, even if they are the same article.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayeschute.aero.coefficient import Coefficient, shared_name
from bayeschute.core.random import stream
from bayeschute.likelihood.priors import Prior
from bayeschute.study.study import Flight, Study

Array = NDArray[np.float64]


def is_of_canopy(name: str) -> bool:
    """Whether a parameter is that of one canopy of one flight."""
    one = Coefficient.parse(name)
    return one is not None and one.flight is not None and one.canopy is not None


def each(priors: Sequence[Prior], vary: Sequence[str], flights: Sequence[str], canopies: int) -> tuple[Prior, ...]:
    """Priors with one for each canopy in the place of those that vary, independent of each other.

    Args:
        priors: Of all parameters.
        vary: Names of those that differ from canopy to canopy.
        flights: Names of the flights that are fitted together.
        canopies: Number of canopies.
    """
    members = [(flight, i + 1) for flight in flights for i in range(canopies)]
    made: list[Prior] = []
    for p in priors:
        one = Coefficient.parse(p.name) if p.name in vary else None
        made += [p] if one is None else [replace(p, name=str(one.of(*member))) for member in members]
    return tuple(made)


def together(priors: Sequence[Prior]) -> list[Prior]:
    """The priors of which `each` made these."""
    made = {(name := shared_name(p.name)): replace(p, name=name) for p in reversed(priors)}
    return list(reversed(made.values()))


def in_flight(names: Sequence[str], flight: str) -> tuple[str, ...]:
    """What parameters are in a flight's model, as of `cluster_flight.with_parameters`: empty for other flights'.

    Args:
        names: Of the parameters.
        flight: Name of the flight.
    """
    made = []
    for name in names:
        one = Coefficient.parse(name)
        if one is None or one.canopy is None or one.flight is None:
            made.append(name)
        else:
            made.append(str(replace(one, flight=None)) if one.flight == flight else "")
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
