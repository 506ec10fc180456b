"""What the flights of a fit taught about its parameters, from priors and draws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayeschute.likelihood.priors import Prior, of_values
from bayeschute.posterior.combine.sequential import moments, taught

Array = NDArray[np.float64]


def working_draws(priors: Sequence[Prior], draws: Mapping[str, Array]) -> Array | None:
    """Draws in working coordinates (chain, draw, P); None where they are not of these parameters, as of populations.

    Args:
        priors: Of the parameters.
        draws: By parameter (chain, draw), in their units.
    """
    if {p.name for p in priors} != set(draws):
        return None
    return of_values(priors, np.stack([np.asarray(draws[p.name]) for p in priors], axis=-1))


def lessons(priors: Sequence[Prior], draws: Mapping[str, Array], flights: Sequence[str]) -> dict[str, Any]:
    """What flights taught, as plain values; empty where draws are not of these parameters.

    Args:
        priors: Before the flights.
        draws: After them, by parameter (chain, draw).
        flights: Their names.

    Returns:
        ``flights``; ``parameters``: a list of `sequential.Taught`, each with its ``unit`` and whether it is of a
        logarithm; ``joint``: information gained about all parameters together [nats].
    """
    theta = working_draws(priors, draws)
    if theta is None:
        return {}
    rows, joint = taught(priors, *moments(theta))
    listed = [
        {**row._asdict(), "unit": p.unit, "logarithmic": p.logarithmic} for row, p in zip(rows, priors, strict=True)
    ]
    return {"flights": list(flights), "parameters": listed, "joint": joint}
