"""Curves of a published planar set (6.3.1-10..12) with the uncertainty that its standard errors say.

The set prints no correlations, so its parameters count as independent; their errors reach a curve to first order. Its
form has few parameters, whose errors a curve's points share; nothing says that the truth has that form. So a share of
every point's standard deviation is the point's own.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from bayeschute.aero.published import PublishedSet

CURVES = ("C_A", "C_N", "C_N_rate")
POINTS = 5
_STEP = 1e-4  # of a parameter, in standard errors
_FORM = 1.0 / 3.0  # of a point's standard deviation, what the form of the set may be off by, at each point its own


def planar_curve(
    found: PublishedSet, name: str, alpha: Float[np.ndarray, " K"], length: float, speed: float
) -> tuple[Float[np.ndarray, " K"], Float[np.ndarray, "K K"]]:
    """A curve of a planar set, and the covariance of its error.

    Args:
        found: The set, of the form ``planar``.
        name: One of `CURVES`.
        alpha: Angles of attack (K,) [rad].
        length: Reference length l, by which rates are reduced [m].
        speed: Reference speed V_o [m/s].

    Returns:
        Values (K,) and covariance (K, K) [1].
    """
    centre = found.estimates()

    def at(parameters: dict[str, float]) -> Float[np.ndarray, " K"]:
        trim = parameters["alpha_0"]
        if name == "C_A":
            return parameters["C_A0"] + 0.5 * parameters["C_Aalpha"] * trim * (alpha**2 / trim**2 - 1.0)
        if name == "C_N":
            return parameters["C_Nalpha"] / (2.0 * trim**2) * (alpha**3 - trim**2 * alpha)
        return np.full_like(alpha, parameters["C_Nalphadot"] * 2.0 * speed / length)

    slopes = []
    for p in found.parameters:
        step = _STEP * p.standard_error
        high, low = (at({**centre, p.name: centre[p.name] + sign * step}) for sign in (1.0, -1.0))
        slopes.append((high - low) / (2.0 * _STEP))  # times the standard error
    root = np.array(slopes)
    law = root.T @ root
    return at(centre), law + np.diag(_FORM**2 * np.diag(law))


def usual_angles(found: PublishedSet) -> Float[np.ndarray, " K"]:
    """Angles at which a planar set speaks: up to twice its trim angle, from near the axis, where C_N says nothing."""
    return np.linspace(0.2, 2.0, POINTS) * found.estimates()["alpha_0"]
