"""Priors of named parameters; every one is Gaussian in its working coordinate (the value, or its logarithm)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Prior:
    """The prior of one parameter.

    Attributes:
        name: Parameter.
        centre: Mean of the working coordinate.
        scale: Standard deviation of the working coordinate.
        logarithmic: Whether the working coordinate is the logarithm of the value.
        unit: Unit of the value.
        source: Where it comes from, in words.
    """

    name: str
    centre: float
    scale: float
    logarithmic: bool
    unit: str
    source: str

    def value(self, working: NDArray[np.float64]) -> NDArray[np.float64]:
        """The value from the working coordinate."""
        return np.exp(working) if self.logarithmic else np.asarray(working)

    def moments(self) -> tuple[float, float]:
        """Mean and standard deviation of the value."""
        if not self.logarithmic:
            return self.centre, self.scale
        mean = float(np.exp(self.centre + 0.5 * self.scale**2))
        return mean, mean * float(np.sqrt(np.expm1(self.scale**2)))


def from_equation_error(
    name: str, estimate: float, se: float, inflation: float, floor: float, unit: str = "1", flight: str = ""
) -> Prior:
    """A prior centred on an equation-error estimate (METHODS 4).

    Args:
        name: Parameter.
        estimate: Its equation-error estimate.
        se: Its colored standard error.
        inflation: Factor on the standard error, against using the data twice.
        floor: Least scale.
        unit: Unit of the value.
        flight: Where the estimate comes from, for the report.

    Returns:
        The prior.
    """
    scale = max(inflation * se, floor)
    return Prior(
        name, estimate, scale, False, unit, f"equation error on {flight}, {inflation:g} x colored standard error"
    )


def working(priors: Sequence[Prior]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centres and scales of several priors, (P,) each."""
    return np.array([p.centre for p in priors]), np.array([p.scale for p in priors])


def values(priors: Sequence[Prior], theta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values of working coordinates whose last axis is the parameter."""
    return np.stack([p.value(theta[..., i]) for i, p in enumerate(priors)], axis=-1)
