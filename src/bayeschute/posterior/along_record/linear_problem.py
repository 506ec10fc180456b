"""The linear problem of a flight along a path: what its solution is, and steps of the flight by it."""

from __future__ import annotations

from typing import NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

from bayeschute.core.vectors import Component
from bayeschute.likelihood.disturbances import disturbances
from bayeschute.likelihood.joint import (
    FlightData,
    Lifted,
    Linear,
    NoiseParameters,
    Unknowns,
    as_seen,
    filter_gains,
    moved,
)
from bayeschute.likelihood.kalman import Gains, Seen, smooth_driven
from bayeschute.likelihood.noise import whiten

Array = NDArray[np.float64]


class Terms(NamedTuple):
    """Contribution of a flight to the merit function of a fit, and the size of its defects.

    Attributes:
        data: Half the sum of squares of innovations, start and process noise.
        squares: Half the squares of the defects over the slack.
        sizes: Sum of their sizes.
        largest: The largest of them.
    """

    data: float
    squares: float
    sizes: float
    largest: float


class Solved(NamedTuple):
    """The linear problem of a flight along a path, solved for all but the parameters, K of which the flight has.

    Attributes:
        gram: Products of the innovations of data and of the derivatives by parameters (1 + K, 1 + K).
        start: Standard start, and its derivatives by the parameters, sign turned (D, 1 + K).
        process_noise: Likewise of the process noise of the latent processes (T, L, 1 + K).
        states: Likewise of how far the path moves (T, X, 1 + K).
        determinant: Log determinant of the innovations.
        parameters: Numbers of these parameters among all (K,).
    """

    gram: Component
    start: Component
    process_noise: Component
    states: Component
    determinant: Component
    parameters: Component


def terms(flight: FlightData, hyper: NoiseParameters, slack: Component, at: Lifted, made: Linear) -> Terms:
    """Contribution of a flight to the merit function; not finite where a step or an output is too large."""
    unit = _whitened(hyper.outputs(flight), flight.dt, flight.present, made.residual)
    with np.errstate(over="ignore", invalid="ignore"):
        data = 0.5 * sum(float(np.sum(np.asarray(a) ** 2)) for a in (unit, *at.unknowns))
        sizes = np.abs(made.defects / slack)
        return Terms(data, 0.5 * float(np.sum(sizes**2)), float(np.sum(sizes)), float(np.max(sizes)))


_whitened = jax.jit(whiten)


def solve(flight: FlightData, hyper: NoiseParameters, slack: Component | None, made: Linear) -> tuple[Solved, Gains]:
    """Solve the linear problem of a flight for trajectory, start and process noise.

    Args:
        flight: The record.
        hyper: Noise parameters.
        slack: Standard deviations of the states' defects (X,); None: none are left.
        made: The flight linearised along a path.

    Returns:
        The solution, and the filter, which is as large as the linearised flight.
    """
    filtered = filter_gains(flight, hyper, made, slack)
    got = smooth_driven(filtered, as_seen(made))
    process_noise = got.process_noise[:, : flight.latent.size]
    flat = np.reshape(got.innovations, (-1, got.innovations.shape[2]))
    gram = flat.T @ flat
    solved = Solved(gram, got.start, process_noise, got.states, filtered.log_determinant, made.parameters)
    return solved, filtered


def led(flight: FlightData, hyper: NoiseParameters, at: Lifted, solved: Solved, step: Component) -> Lifted:
    """Start, process noise and trajectory after a step of the parameters (P,) in the linear problem."""
    own = step[solved.parameters]
    start, process_noise, away = (
        a[..., 0] - a[..., 1:] @ own for a in (solved.start, solved.process_noise, solved.states)
    )
    error = disturbances(hyper.dynamics(flight), process_noise)
    return Lifted(Unknowns(start, process_noise), error, at.path + away)


def closed(flight: FlightData, hyper: NoiseParameters, at: Lifted, made: Linear) -> Lifted:
    """A trajectory whose defects are closed in the linear problem, by the most probable change of the unknowns.

    The data are not used: repeated, it removes the defects as Newton's method does.

    Args:
        flight: The record.
        hyper: Noise parameters; the disturbances must be those of the process noise under them.
        at: The path.
        made: The flight linearised along it.
    """
    filtered = filter_gains(flight, hyper, made)
    got = smooth_driven(filtered, Seen(np.zeros((*np.shape(made.residual), 1)), made.defects[..., None]))
    process_noise = at.unknowns.process_noise + got.process_noise[..., 0]
    unknowns = Unknowns(at.unknowns.start + got.start[:, 0], process_noise)
    return Lifted(unknowns, disturbances(hyper.dynamics(flight), process_noise), at.path + got.states[..., 0])


def shortened(flight: FlightData, at: Lifted, there: Lifted, share: float, theta: Component, step: Component) -> Lifted:
    """A fraction of a linear step of flight and parameters (P,)."""
    there = jax.tree.map(lambda a, b: a + share * (b - a), at, there)
    return there._replace(path=moved(flight, at.path, there.path - at.path, theta, share * step))
