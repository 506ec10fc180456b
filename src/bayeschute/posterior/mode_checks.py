"""Checks of the mode: profile of the marginal density along its axes, and size of the corrections.

The marginal density is the sum of squares that one simulation gives, plus corrections that are expanded about the mode:
the curvature of the conditional mode, and the log determinant (`beyond_linear`). About a mode, in coordinates with
unit covariance, the log density of a Gaussian falls by 1/2 at one standard deviation along every axis, and by 2 at two.
Where a correction makes it rise there, or fall much more steeply, the expansion is not valid, however well a sampler
converges on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.posterior.marginal import Marginal, log_density

Array = NDArray[np.float64]
PLACES = (-2.0, -1.0, 1.0, 2.0)
_STEEPEST = 5.0  # fall at one standard deviation beyond which the density is far narrower than its covariance says


class Profile(NamedTuple):
    """How far the log density falls along axes of standard coordinates.

    Attributes:
        direction: Unit vectors (N, P).
        fall: From the centre to `PLACES` along them (N, 4); NaN where a simulation fails.
    """

    direction: Array
    fall: Array

    @property
    def worst(self) -> float:
        """Least fall at one standard deviation; a half about a Gaussian mode, negative where the density rises."""
        near = self.fall[:, [i for i, place in enumerate(PLACES) if abs(place) == 1.0]]
        return float(np.nanmin(near)) if np.isfinite(near).any() else -np.inf

    @property
    def is_mode(self) -> bool:
        """Whether the density falls to both sides along every axis, on and on, and nowhere like a cliff."""
        return not self.why_not

    @property
    def why_not(self) -> str:
        """Why this is no mode, in words; empty if it is one."""
        return self._fault[0]

    @property
    def blamed(self) -> Array | None:
        """The axis along which it is none (P,); None if it is one."""
        words, row = self._fault
        return self.direction[row] if words else None

    @property
    def _fault(self) -> tuple[str, int]:
        """Words, and the row of the axis that they speak of."""
        by_place = dict(zip(PLACES, self.fall.T, strict=True))
        near = np.array([by_place[-1.0], by_place[1.0]])
        far = np.array([by_place[-2.0], by_place[2.0]])
        if (failed := ~np.isfinite(near).all(axis=0)).any():
            return "one standard deviation away from it flights fail", int(np.argmax(failed))
        least, most, on = near.min(axis=0), near.max(axis=0), (far - near).min(axis=0)
        if (least <= 0.0).any():
            rise = abs(np.min(least))
            words = f"one standard deviation away from it the log density rises by {rise:.3g} along some axis"
            return words, int(np.argmin(least))
        if (most > _STEEPEST).any():
            words = f"one standard deviation away from it the log density falls by {np.max(most):.3g} along some axis, "
            return f"{words}where about 0.5 is expected", int(np.argmax(most))
        if (on <= 0.0).any():  # not where flights fail
            words = "two standard deviations away from it the log density is higher than at one, along some axis"
            return words, int(np.nanargmin(on))
        return "", 0


def profile(marginal: Marginal, middle: Array | None = None, more: Sequence[Array] = ()) -> Profile:
    """The log density along the axes of the parameters' covariance, and along those on which corrections bend most.

    Args:
        marginal: The posterior.
        middle: Its mode, standard coordinates (P,); the centre where None.
        more: Further directions (P,).
    """
    size = np.size(marginal.centre)
    found = [*np.eye(size)]
    curvature = np.asarray(marginal.correction.curvature)
    if curvature.any():
        found += [*np.linalg.eigh(curvature)[1][:, [0, -1]].T]
    found += [np.asarray(d) / np.linalg.norm(d) for d in more]
    direction = np.array(found)
    points = np.concatenate([np.zeros((size, 1)), *(place * direction.T for place in PLACES)], axis=1)
    points = points if middle is None else points + middle[:, None]
    value = np.asarray(log_density(marginal, points))
    return Profile(direction, (value[0] - value[1:]).reshape(len(PLACES), len(direction)).T)


def best_profile(made: Marginal, step: Array) -> Profile:
    """The density along the axes about the centre, or about the mode a step (P,) away: where it shows a mode rather."""
    return max((profile(made), profile(made, step)), key=lambda one: (one.is_mode, one.worst))
