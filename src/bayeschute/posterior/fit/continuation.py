"""Starting values for a whole record by continuation: fits to longer and longer first parts of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayeschute.likelihood.joint import FlightData, NoiseParameters, Unknowns
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior import joint_mode as optimum

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]
HORIZONS = (0.2, 0.5, 1.0)  # shares fitted in turn: an unstable pendulum far from its optimum is lost late
_SMALL_STEPS = tuple(0.1 * i for i in range(1, 11))  # where those lead astray
_MOST, _MOST_SMALL = 12, 40  # most iterations of a fit to a first part, and to one of the small steps
_LEAST_FIRST_PART = 0.05  # share of the record at which the first part is shortened no more
_LEAST_GAIN = 0.05  # share of the record by which the fitted part must at least be lengthened


def _until(flight: FlightData, share: float) -> FlightData:
    """The flight with data beyond a share of its samples absent; shapes stay, so compiled functions serve."""
    seen = np.array(flight.present)
    seen[int(np.ceil(share * len(seen))) :] = False
    return replace(flight, present=seen)


def lengthened(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    hyper: NoiseParameters,
    theta: Array,
    say: Progress,
    unknowns: Sequence[Unknowns] | None = None,
) -> tuple[Array, Sequence[Unknowns]]:
    """Starting values for the whole record by continuation: fits to longer and longer first parts of it.

    Where the trajectory of one part diverges before the end of the next, the next is shortened; so is the first where
    its simulation fails. Where that doesn't help, a fit went to a wrong optimum, and the continuation starts again with
    small steps, each converged.

    Args:
        flights: Records.
        priors: Priors of the parameters.
        hyper: Noise parameters, fixed.
        theta: Where to begin, working coordinates (P,).
        say: Progress callback: share done and words.
        unknowns: Where to begin, per flight; prior means where None.

    Returns:
        Parameters and unknowns near the optimum for the whole record.

    Raises:
        FloatingPointError: If neither helps.
    """
    todo, most, done, begin = list(HORIZONS), _MOST, 0.0, (theta, unknowns)
    while todo:
        share = todo[0]
        say(0.0, f"first {100 * share:.0f} % of the record")
        seen = [_until(f, share) for f in flights]
        try:
            best = optimum.fit(seen, hyper, priors, theta, unknowns, tolerance=0.5, most=most, first_part=share < 1.0)
        except FloatingPointError:
            if share - done >= (_LEAST_FIRST_PART if done == 0.0 else 2.0 * _LEAST_GAIN):
                todo.insert(0, 0.5 * (done + share))
                continue
            if done == 0.0 or most == _MOST_SMALL:
                raise
            todo, most, done, (theta, unknowns) = list(_SMALL_STEPS), _MOST_SMALL, 0.0, begin
            continue
        theta, unknowns, done = best.theta, best.unknowns, todo.pop(0)
    assert unknowns is not None
    return theta, unknowns
