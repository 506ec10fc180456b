"""Which parameters are those of one flight, and what they are called in its model.

Constant errors of a record (`dynamics.parameters.BIASES`) are each flight's own: among several fitted flights they are
called after theirs, ``wind_bias.north@drop``. Those of a flight that was not fitted are as likely as their priors say.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayeschute.dynamics.parameters import BIASES
from bayeschute.likelihood.priors import Prior
from bayeschute.study.assembly import canopies

Array = NDArray[np.float64]
_OF = "@"


def is_bias(name: str) -> bool:
    """Whether a parameter is a constant error of a flight's record."""
    return name.partition(".")[0] in BIASES


def each(priors: Sequence[Prior], flights: Sequence[str]) -> tuple[Prior, ...]:
    """Priors with a constant error of each flight in the place of each, called after it.

    Args:
        priors: Of all parameters. Those that a fit has called after flights already, as a search of terms leaves them,
            stay as they are.
        flights: Names of the flights that are fitted together.
    """
    made: list[Prior] = []
    for p in priors:
        shared = is_bias(p.name) and _OF not in p.name
        made += [replace(p, name=p.name + _OF + flight) for flight in flights] if shared else [p]
    return tuple(made)


def in_flight(priors: Sequence[Prior], flight: str, without: Collection[str] = ()) -> tuple[str, ...]:
    """Names of the parameters in a flight's model, as of `cluster_flight.with_parameters`: empty where it has none.

    Args:
        priors: Of the parameters.
        flight: Name of the flight.
        without: Parameters that the flight does not take from the fit, such as the mass of a capsule of its own.
    """
    made = []
    for name in canopies.in_flight([p.name for p in priors], flight):
        shared, _, of = name.partition(_OF) if is_bias(name) else (name, "", "")
        made.append("" if shared in without or of not in ("", flight) else shared)
    return tuple(made)


def of_unseen(before: Sequence[Prior], after: Sequence[Prior]) -> list[Prior]:
    """What is known of the parameters of a flight that was not fitted: constant errors as before the fit.

    Args:
        before: Priors of the fit.
        after: Its posterior as priors of the same parameters, in the same order.
    """
    own = {p.name for p in before if is_bias(p.name)}
    return [
        replace(p, correlation={})
        if p.name in own
        else replace(q, correlation={name: r for name, r in q.correlation.items() if name not in own})
        for p, q in zip(before, after, strict=True)
    ]


def drawn_for_unseen(priors: Sequence[Prior], theta: Array, rng: np.random.Generator) -> Array:
    """Draws of the parameters (draw, P) for a flight that was not fitted: constant errors drawn from their priors."""
    made = np.array(theta, float)
    for i, p in enumerate(priors):
        if is_bias(p.name):
            made[:, i] = p.centre + p.scale * rng.standard_normal(len(made))
    return made


def biases(priors: Sequence[Prior]) -> tuple[str, ...]:
    """Constant errors among parameters, as a flight's model calls them: what no flight but a recorded one has."""
    return tuple({p.name.partition(_OF)[0]: None for p in priors if is_bias(p.name)})
