"""Draws whose density is compared with Laplace's approximation at the draws themselves, and corrected where it errs.

`correction_fit` compares at standard normal points before anything is drawn. A density that is too high beyond two
standard deviations along some axis is hardly seen by these, but the sampler goes there. So the corrections are compared
once more at draws. By Bayesian linear regression of the errors there (`correction_fit.changes`) a quadratic polynomial
tells what the errors do to means and standard deviations: all draws are weighed by it. If that is too much, the
polynomial is added to the corrections, the sampler draws again, and these draws are judged anew.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.random import stream
from bayeschute.posterior.beyond_linear import comparison
from bayeschute.posterior.beyond_linear.comparison import Compared
from bayeschute.posterior.beyond_linear.expansion import expansion_of
from bayeschute.posterior.felt_axes import groups
from bayeschute.posterior.fit.correction_fit import MOST_SHIFT, changes, shifted
from bayeschute.posterior.fit.laplace_fit import LaplaceFit
from bayeschute.posterior.marginal import Marginal, Quadratic
from bayeschute.posterior.sampling.protocol import Draws

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]
_BATCH, _MOST = 2, 8  # draws per parameter of each batch that is compared, and of all
_KNOWN = 0.05  # standard error of the mean error at which no more are compared
_LEAST = 0.75  # share of them where flights must not fail
_AGAIN = 2  # times that the corrections are changed
_LARGE = 100.0  # variance of log weights whose exponential is still a number


class Sampled(NamedTuple):
    """Draws, and the density that they are of.

    Attributes:
        draws: In standard coordinates.
        bend: The correction of the squares, as in `Marginal.bend`.
        shift: Largest change of a mean, in standard deviations, or relative of one of these, by what the log density
            lacks of Laplace's approximation; NaN where it was not to be compared.
    """

    draws: Draws
    bend: Quadratic
    shift: float

    def of(self, found: LaplaceFit) -> LaplaceFit:
        """The fit with the density that was drawn from."""
        return replace(found, marginal=replace(found.marginal, bend=self.bend), determinant_error=self.shift)


class Judged(NamedTuple):
    """A density at draws of it, compared with Laplace's approximation.

    Attributes:
        missing: What minus the log density lacks, as a polynomial.
        error: Standard deviation of that at the draws.
        shift: As in `Sampled`; NaN where flights fail at many of the draws.
        points: At how many draws they were compared.
    """

    missing: Quadratic
    error: float
    shift: float
    points: int


def sampled(found: LaplaceFit, sampler: Callable[[Marginal], Draws], say: Progress | None = None) -> Sampled:
    """Draw until the density is right where the draws are.

    Where two changes of the corrections do not make it so, or under one the density has no mode, the draws of least
    shift are kept.

    Args:
        found: The posterior, compared at standard normal points.
        sampler: Draws from it.
        say: Called with a share done and words.

    Returns:
        The draws. As long as the corrections are as found, the larger of the shifts at normal points and draws counts.
    """
    tell, tried, marginal = say or (lambda share, words: None), list[Sampled](), found.marginal
    for turn in range(1 + _AGAIN):
        draws = sampler(marginal)
        share = (turn + 1) / (1 + _AGAIN)

        def heard(count: int, share: float = share) -> None:
            tell(share, f"log density at {count} draws")

        seen = judged(marginal, draws.xi, heard, not tried and found.determinant_error >= MOST_SHIFT)
        words = (
            f"log density at {seen.points} draws: off by {seen.error:.2g}, "
            f"which shifts means by {seen.shift:.2g} standard deviations"
        )
        tell(share, words)
        shift = seen.shift if tried else float(np.maximum(seen.shift, found.determinant_error))
        tried.append(Sampled(draws, marginal.bend, shift))
        if not shift >= MOST_SHIFT:
            break
        bend = Quadratic(*(a + b for a, b in zip(marginal.bend, seen.missing, strict=True)))
        marginal = replace(marginal, bend=bend)
        if not expansion_of(marginal).has_mode:
            break
    return min(tried, key=lambda one: np.nan_to_num(one.shift, nan=np.inf))


def judged(
    marginal: Marginal, xi: Array, progress: Callable[[int], None] | None = None, fitted: bool = False
) -> Judged:
    """Compare a density with Laplace's approximation at draws of it, as many as it takes.

    Args:
        marginal: The posterior.
        xi: Draws (chain, draw, P).
        progress: Called with the number of draws that are compared.
        fitted: Whether the corrections are to be changed by what is found: that takes as many draws as there may be.
    """
    say = progress or (lambda count: None)
    parts, flat = groups(marginal), xi.reshape(-1, xi.shape[-1])
    size = max(len(group.axes) for group in parts)
    order = stream(0, "draws that are compared").permutation(len(flat))[: _MOST * size]
    seen, errors = Compared.none(len(parts)), np.zeros(0)
    for batch in np.split(order, range(_BATCH * size, len(order), _BATCH * size)):

        def heard(done: int, wanted: int, before: int = len(seen.own)) -> None:
            say(before + done)

        seen = seen.and_at(comparison.compared(marginal, flat[batch], heard))
        errors = seen.errors[seen.known]
        if seen.known.mean() < _LEAST:
            return Judged(Quadratic.none(flat.shape[1]), np.nan, np.nan, len(seen.own))
        if not fitted and np.std(errors) / np.sqrt(len(errors)) < _KNOWN:
            break
    at = flat[order[: len(seen.own)]]
    missing = changes(marginal, at[seen.known], seen.missing[:, seen.known]).polynomial
    shift, error = shifted(flat, np.zeros(len(flat)), -np.asarray(missing.at(flat.T))), float(np.std(errors))
    return Judged(missing, error, min(shift, _most(error)), len(at))


def _most(error: float) -> float:
    """Largest shift by log weights of a standard deviation: by the Cauchy-Schwarz inequality, if they are normal."""
    return float(np.sqrt(np.expm1(min(error**2, _LARGE))))
