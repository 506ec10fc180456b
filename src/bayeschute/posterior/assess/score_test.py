"""Score test (Lagrange multiplier test) of aerodynamic terms that the structure left out, on the simulated flight.

Equation error evaluates a term on an airflow that contains the error of the wind, which can hide the term altogether.
The test is therefore made at the optimum of the simulated flight: with the coefficients of all left-out terms at zero,
one Gauss-Newton step over all coefficients gives their estimates and standard errors (score test, Rao 1948), with start
and disturbances eliminated.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bayeschute.likelihood.joint import FlightData, Lifted, NoiseParameters, linearise
from bayeschute.likelihood.priors import Prior, precision
from bayeschute.posterior.joint_mode import conditional

Array = NDArray[np.float64]


def scores(
    flights: Sequence[FlightData],
    hyper: NoiseParameters,
    priors: Sequence[Prior],
    theta: Array,
    at: Sequence[Lifted],
    kept: NDArray[np.bool_],
) -> tuple[Array, Array]:
    """Step and standard error of every parameter, starting from zero for those left out.

    Args:
        flights: The flights with a structure that contains all terms.
        hyper: Noise parameters.
        priors: Priors of all parameters; those of left-out terms don't count.
        theta: The optimum, zero for left-out terms (P,).
        at: Start, process noise and trajectory at the optimum, per flight.
        kept: Which parameters were fitted (P,).

    Returns:
        Steps (P,), zero for kept ones' own gradients, and standard errors (P,).
    """
    matrix: Array = np.zeros((theta.size, theta.size))
    gradient: Array = np.zeros(theta.size)
    matrix[np.ix_(kept, kept)] = precision([p for p, here in zip(priors, kept, strict=True) if here])
    for flight, x in zip(flights, at, strict=True):
        conditional(flight, hyper, linearise(flight, theta, x.latent_path(flight))).add_to(matrix, gradient)
    covariance: Array = np.asarray(np.linalg.inv(matrix), np.float64)
    return -covariance @ np.where(kept, 0.0, gradient), np.sqrt(np.diag(covariance))
