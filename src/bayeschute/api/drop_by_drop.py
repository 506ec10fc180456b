"""Drop by drop: priors made of a posterior, and the table of the information gained from each drop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayeschute.aero.coefficient import is_coefficient
from bayeschute.api.beliefs import Priors
from bayeschute.api.flight import Flight
from bayeschute.core.errors import Fault, InputError
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior.combine.sequential import as_priors, moments
from bayeschute.study.assembly.lessons import working_draws
from bayeschute.study.study import Study as StudySpec

Array = NDArray[np.float64]
HISTORY = "history.json"
"""Information gained from the drops before a posterior's own: a list of `lessons`, in the order of the drops."""


def priors_of(spec: StudySpec, priors: Sequence[Prior], draws: Mapping[str, Array], flights: Sequence[str]) -> Priors:
    """Priors of the next drop from the draws of a posterior, as one Gaussian in working coordinates.

    Args:
        spec: The study that was fitted.
        priors: Of its parameters.
        draws: Of the posterior by parameter (chain, draw).
        flights: Names of all flights that it contains.

    Raises:
        InputError: If parameters are those of populations or of several bodies.
    """
    theta = working_draws([replace(p, air_share=0.0) for p in priors], draws)  # values, as another vehicle has them
    if theta is None:
        got = "a posterior of populations, or of several bodies"
        do = "Fit all drops together (`vary`, `vary_canopies`), or each body by itself."
        raise InputError(Fault("update", got, "one whose parameters all drops share", do))
    made = as_priors(priors, *moments(theta), f"posterior of {', '.join(flights)}")
    candidates = spec.structure
    if candidates is not None:  # the terms are those that the posterior has
        candidates = candidates.model_copy(update={"fit": "selected", "stack": None})
    known = tuple(k for k in spec.knowledge if k.use == "prior")
    return Priors(tuple(made), spec.priors, candidates, {"coefficients": {}}, known)


def next_priors(made: Priors, spec: StudySpec, taught: Sequence[str], flights: Sequence[Flight]) -> Priors:
    """Priors of the next flights: constant errors of records begin anew, as do masses and risers of another vehicle.

    Args:
        made: From `priors_of`.
        spec: The study of the posterior.
        taught: Names of all flights that the posterior contains.
        flights: The next ones.

    Raises:
        InputError: If there are none, or the posterior contains one of them already, or they are of another model.
    """
    if not flights:
        raise InputError(Fault("update", "no flight", "at least one"))
    faults = []
    for flight in flights:
        if flight.name in taught:
            do = "Its data would count twice. If it is another flight: `flight.changed(name=...)`."
            faults.append(Fault(f"flight {flight.name}", "a flight that taught this posterior", "another one", do))
    if flights[0].study.model != spec.model:
        got = f"flights of the model {flights[0].study.model!r}"
        faults.append(Fault("update", got, f"flights of the posterior's: {spec.model!r}"))
    elif spec.model == "descent" and len(flights) > 1:
        faults.append(Fault("update", f"{len(flights)} descents", "one at a time: each is a fit of its own"))
    if faults:
        raise InputError(faults)
    if spec.model == "descent":
        return made
    from bayeschute.study.assembly.flight_parameters import is_bias
    from bayeschute.study.run.stage_data import given_priors

    same = flights[0].vehicle == spec.vehicle
    if same and not any(is_bias(p.name) for p in made.parameters):
        return made
    left = [p for p in made.parameters if (same or is_coefficient(p.name)) and not is_bias(p.name)]
    alike = [{name: r for name, r in p.correlation.items() if not is_bias(name)} for p in left]
    kept = tuple(replace(p, correlation=r) for p, r in zip(left, alike, strict=True))
    of_vehicle = () if same else tuple(p for p in given_priors(flights[0].study) if not is_bias(p.name))
    errors = tuple(p for p in given_priors(spec) if is_bias(p.name))
    known = [p.name for p in kept]
    return replace(made, parameters=(*kept, *(p for p in (*of_vehicle, *errors) if p.name not in known)))


def taught_table(history: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """Information gained, a row a drop and parameter, in working coordinates: column ``coordinate``.

    Args:
        history: From `what_flights_taught`, in the order of the drops.

    Returns:
        Columns of `posterior.combine.sequential.Taught`; ``attrs["joint"]``: information about all parameters together
        by drop [nats].
    """
    rows = [
        {"drop": ", ".join(one["flights"]), "parameter": p["name"], **{k: v for k, v in p.items() if k != "name"}}
        for one in history
        for p in one["parameters"]
    ]
    made = pd.DataFrame(rows)
    made = made.set_index(["drop", "parameter"]) if rows else made
    made.attrs["joint"] = {", ".join(one["flights"]): one["joint"] for one in history}
    return made
