"""Search for the mode of the marginal posterior with all its corrections, under candidate noise parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.likelihood.joint import FlightData, NoiseParameters
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior.beyond_linear import laplace, polynomials
from bayeschute.posterior.beyond_linear.expansion import FARTHEST, Expansion
from bayeschute.posterior.beyond_linear.polynomials import Sides
from bayeschute.posterior.fit.continuation import Progress
from bayeschute.posterior.fit.joint_fit import JointFit, NoFitError
from bayeschute.posterior.fit.marginal_mode import marginal_mode
from bayeschute.posterior.joint_mode import Optimum
from bayeschute.posterior.marginal import Marginal, marginalise
from bayeschute.posterior.mode_checks import Profile, best_profile

Array = NDArray[np.float64]
_BESIDE, _NEARER = 1.0, 0.3  # steps [standard deviations] to where Laplace's approximation is taken; where flights fail
_LOST_BEND = "part of the corrections' curvature, which along some axis outweighs the density"
_AT_MODE, _BESIDE_MODE = 0.2, 0.5  # root mean square distance from there, along all axes, that ends it, or will do
_MOVES = 5  # most steps to the mode of the posterior with all its corrections
_ROUNDING = 1e-6
_NAMED = 4  # most parameters by which an axis is told
_RADII, _ENOUGH = (3.0, 1.5, 0.75), 0.1  # lengths of such a step; share of the promised gain at which it is taken


class _Place(NamedTuple):
    """A place on the way to the mode, the posterior about it, and what is left out of that."""

    optimum: Optimum
    marginal: Marginal
    expansion: Expansion
    lost: tuple[str, ...] = ()

    @property
    def step(self) -> Array:
        """To the mode, standard coordinates (P,)."""
        return self.expansion.step()

    @property
    def away(self) -> float:
        """Root mean square of that step."""
        return float(np.sqrt(np.mean(self.step**2)))

    @property
    def distance(self) -> str:
        """That in words: of a step as long as one may be, the mode may lie beyond its end."""
        beyond = np.linalg.norm(self.step) > (1.0 - _ROUNDING) * FARTHEST
        return f"{self.away:.2g} standard deviations{' or more' if beyond else ''}"


class Candidate(NamedTuple):
    """Noise parameters under which a mode is sought.

    Attributes:
        words: What they are.
        hyper: The noise parameters.
        lost: What a posterior under them leaves out, in words.
    """

    words: str
    hyper: NoiseParameters
    lost: tuple[str, ...] = ()


class Ended(NamedTuple):
    """Where the search for the mode ended: what `search` returns."""

    optimum: Optimum
    hyper: NoiseParameters
    marginal: Marginal
    lost: tuple[str, ...]
    profile: Profile


class _Missed(NamedTuple):
    """A search that did not end at a mode.

    Attributes:
        optimum: Where it ended; None where nothing flies.
        reason: Why.
        words: On what was tried, for users.
    """

    optimum: Optimum | None
    reason: str
    words: str


def search(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    began: JointFit,
    candidates: Sequence[Candidate],
    others: Sequence[Candidate] = (),
    progress: Progress | None = None,
) -> Ended:
    """The mode under the first noise parameters that lead to one, the posterior, corrections left out, the density.

    A point that turns out to lie beside the mode, once what the linear models lack is known, is left for it; a point
    about which the density has no mode, for where it is highest within reach. Where the density is no higher on the
    way, the point stays. If it has no mode there, the next noise parameters are tried; only if none leads to one are
    corrections left out, as far as they outweigh the density.

    Args:
        flights: Records.
        priors: Priors of the parameters.
        began: Where to begin.
        candidates: Noise parameters, tried in turn.
        others: Likewise, where no candidate leads to a mode even with corrections left out.
        progress: Progress callback: share done and words.

    Raises:
        NoFitError: If none does.
    """
    say, missed = progress or (lambda share, words: None), list[_Missed]()
    for several in (candidates, others):
        flat: Ended | None = None
        for one in several:
            found = _sought(flights, priors, JointFit(began.optimum, one.hyper, began.evidence), one, say)
            if isinstance(found, _Missed):
                missed.append(found)
            elif _LOST_BEND not in found.lost:
                return found
            else:
                flat = flat or found
        if flat is not None:
            return flat
    first = missed[: len(candidates)]
    ended = next((one.optimum for one in reversed(first) if one.optimum is not None), began.optimum)
    raise NoFitError(first[-1].reason, [one.words for one in missed], ended, priors, candidates[-1].hyper)


def _sought(
    flights: Sequence[FlightData], priors: Sequence[Prior], start: JointFit, one: Candidate, say: Progress
) -> Ended | _Missed:
    """Where the search for the mode under a candidate's noise parameters ended, or why at none."""
    try:
        found, highest, steps = _places(flights, priors, start, say)
    except FloatingPointError as error:
        return _Missed(None, str(error), f"{one.words}: {error}")
    sound = [place for place in found[-1 if highest else 0 :] if place.expansion.has_mode]
    best, made, _, lost = place = min(sound or [_flattened(found[-1])], key=lambda one: one.away)
    seen = best_profile(made, place.step)
    if seen.is_mode and (highest or place.away < _BESIDE_MODE):
        best = replace(best, converged=start.optimum.converged)
        return Ended(best, one.hyper, made, (*lost, *one.lost), seen)
    why = (
        f"after {steps} steps towards it the mode is still off by {place.distance}, root "
        f"mean square of all axes, and less than {_BESIDE_MODE:g} is wanted"
        if seen.is_mode
        else seen.why_not + _in_names(priors, made, seen.blamed)
    )
    lengths = ", ".join(f"{one.away:.2g}" for one in found)
    words = f"{one.words}: steps left from {len(found)} places (root mean square of all axes): {lengths}; {why}"
    return _Missed(best, f"the search for the mode of the marginal posterior did not end at one: {why}", words)


def _in_names(priors: Sequence[Prior], made: Marginal, axis: Array | None) -> str:
    """Words for an axis of standard coordinates (P,): what changes along it by half as much as what changes most."""
    if axis is None or len(priors) == 1:
        return ""
    root = np.asarray(made.scale)
    change = np.abs(root @ axis) / np.linalg.norm(root, axis=1)
    most = sorted(np.flatnonzero(change >= 0.5 * change.max()), key=lambda i: -change[i])[:_NAMED]
    return f" (an axis of {', '.join(priors[int(i)].name for i in most)})"


def _places(
    flights: Sequence[FlightData], priors: Sequence[Prior], start: JointFit, say: Progress
) -> tuple[list[_Place], bool, int]:
    """Places on the way to the mode, whether the density is no higher in reach of the last, and how many were reached.

    Those far from it are passed by without corrections at corners, which cost most, where the axes alone show the way.

    Raises:
        FloatingPointError: If there is none: flights fail.
    """
    found, passed = list[_Place](), list[tuple[Optimum, Marginal, Sides]]()
    try:
        here = marginal_mode(flights, priors, start, lambda share, words: say(0.3 * share, words))
        for move in range(1 + _MOVES):
            near = marginalise(flights, start.hyper, priors, here)
            heard = partial(_heard, say, move)
            beside = _sides(near, partial(heard, (0.0, 0.2), "along the axes"))
            passed.append((here, near, beside))
            place = _Place(here, near, polynomials.expanded(near, beside))
            ahead = _ahead(near, place) if move < _MOVES and place.away > _BESIDE_MODE else None
            if ahead is not None:
                here = ahead
                continue
            pairs = partial(heard, (0.2, 1.0), "along pairs of axes")
            found.append(_Place(here, *polynomials.corrected(near, near=beside, progress=pairs)))
            if found[-1].expansion.has_mode and found[-1].away < _AT_MODE:
                break
            ahead = _ahead(near, found[-1])
            if ahead is None:
                return found, True, len(passed)
            here = ahead
    except FloatingPointError:
        if not passed:
            raise
    if not found:
        here, near, beside = passed[-1]
        found.append(_Place(here, *polynomials.corrected(near, near=beside)))
    return found, False, len(passed)


def _heard(say: Progress, move: int, part: tuple[float, float], where: str, done: int, wanted: int) -> None:
    """Progress of Laplace's approximation about a place; every further one is half as likely."""
    begin, end = part
    share = 1.0 - 0.5 ** (move + begin + (end - begin) * done / wanted)
    say(0.3 + 0.7 * share, f"log density about place {move + 1}, {where}: {done} of {wanted} points")


def _ahead(near: Marginal, place: _Place) -> Optimum | None:
    """The point a step towards the mode away; None where the density rises over no such step as it should.

    Args:
        near: The posterior about the place, without corrections.
        place: Where the step begins.
    """
    here = laplace.at(near, np.zeros(len(place.step)))
    for radius in _RADII:
        step = place.expansion.step(radius)
        there = laplace.at(near, step)
        if there.rise(here) < _ENOUGH * place.expansion.change(step):
            return replace(
                place.optimum, theta=place.optimum.theta + np.asarray(near.scale) @ step, flights=there.flights
            )
    return None


def _sides(made: Marginal, progress: laplace.Progress | None = None) -> Sides:
    """Laplace's approximation beside a point.

    Raises:
        FloatingPointError: If flights fail there.
    """
    try:
        return polynomials.sides(made, _BESIDE, progress)
    except FloatingPointError:
        return polynomials.sides(made, _NEARER, progress)


def _flattened(place: _Place) -> _Place:
    """A place about which the density has no mode, without what is to blame."""
    return _Place(place.optimum, *polynomials.flattened(place.marginal, place.expansion), (_LOST_BEND,))
