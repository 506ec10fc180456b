"""Airflow along the fitted paths, and the ranges over which curves are supported by data.

Ranges are of the fitted paths, not of records differentiated twice: noise of the sensors would widen them. They are the
central 99 % of all samples of all canopies and flights: beyond, a curve is extrapolated (the report's F-11, F-12).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.aero.curve_names import ANGLE, DISTANCE
from bayeschute.core.vectors import dot
from bayeschute.dynamics.cluster_flight import ClusterFlight
from bayeschute.likelihood.flow_along import Along, flow_along
from bayeschute.study.assembly.fits import data_of, groups, load_optimum
from bayeschute.study.job import Job

Array = NDArray[np.float64]
_TAILS = (0.005, 0.995)


class FlownFlight(NamedTuple):
    """A fitted flight: its name, the airflow and latent forces of its canopies, and the terms of its fit.

    At the angle of attack `saturation` [rad] its powers level off in these terms; None: nowhere.
    """

    name: str
    along: Along
    axial: tuple[str, ...]
    transverse: tuple[str, ...]
    saturation: float | None = None


def flown(job: Job) -> list[FlownFlight]:
    """Airflow and latent forces along the paths of all fitted flights of a cluster; none of a point mass.

    Args:
        job: A run that was fitted.
    """
    if job.study.model != "cluster":
        return []
    found = []
    for group in groups(job):
        best = load_optimum(job, group)
        for flight, at in zip(group.flights, best.flights, strict=True):
            data = data_of(job, flight, group.priors)
            assert isinstance(data.model, ClusterFlight)
            structure = data.model.structure
            along = flow_along(data, best.theta, at.path, at.error)
            found.append(FlownFlight(flight.name, along, structure.axial, structure.transverse, structure.saturation))
    return found


def ranges(flights: list[FlownFlight]) -> dict[str, tuple[float, float]]:
    """Central 99 % of what the flights flew, by symbol: alpha [rad]; D_prox, reduced rate and V/V_o [1].

    Args:
        flights: From `flown`, one at least.
    """
    values: dict[str, list[Array]] = {ANGLE: [], DISTANCE: [], "rate": [], "speed": []}
    for one in flights:
        flow = one.along.flow
        values[ANGLE].append(np.sqrt(flow.alpha_squared))
        values["rate"].append(np.sqrt(np.asarray(dot(flow.rate, flow.rate))))
        values["speed"].append(1.0 + flow.speed_ratio)
        values[DISTANCE] += [near.distance for near in flow.neighbours]
    made = {}
    for name, parts in values.items():
        if parts:
            every = np.concatenate([np.ravel(part) for part in parts])
            low, high = np.quantile(every, _TAILS)
            made[name] = float(low), float(high)
    return made
