"""The marginal posterior of the parameters by Laplace's approximation: mode, noise parameters, corrections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import jax
import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bayeschute.core.random import stream
from bayeschute.likelihood.joint import FlightData, NoiseParameters
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior import laplace, noise_evidence
from bayeschute.posterior.along_record import conditional_mode
from bayeschute.posterior.fit import correction_fit
from bayeschute.posterior.fit.continuation import Progress
from bayeschute.posterior.fit.joint_fit import JointFit, NoFitError, joint_fit
from bayeschute.posterior.fit.marginal_mode import marginal_mode
from bayeschute.posterior.joint_mode import Optimum
from bayeschute.posterior.laplace import Expansion, Sides
from bayeschute.posterior.marginal import Marginal, marginalise
from bayeschute.posterior.mode_checks import Profile, profile
from bayeschute.posterior.noise_evidence import Evidence, NoisePrior
from bayeschute.posterior.noise_uncertainty import NoiseEffect, noise_parameter_slope, noise_parameter_spread
from bayeschute.posterior.quasi_newton import length
from bayeschute.posterior.score_dispersion import Dispersion, dispersion, parts_of

Array = NDArray[np.float64]
_TURNS = 6  # most turns of noise parameters and mode
_SETTLED, _GAINED = 0.4, 3.0  # step of the mode, and gain of the log evidence, after which there is no other turn
_NOISE_STEPS = 24  # most of the noise parameters in each of them
_MODE_TURN = 2  # most steps of the mode in each of them
_SHARES = (1.0, 0.3, 0.1)  # of the way to the noise parameters of greatest evidence that are tried
_BESIDE, _NEARER = 1.0, 0.3  # steps [standard deviations] to where Laplace's approximation is taken; where flights fail
_LOST_BEND = "part of the corrections' curvature, which along some axis outweighs the density"
_LOST_MEAN = "the shift of the noise parameters from their mode to their mean, where no mode was found"
_AT_MODE, _BESIDE_MODE = 0.2, 0.5  # root mean square distance from there, along all axes, that ends it, or will do
_MOVES = 5  # most steps to the mode of the posterior with all its corrections
_ROUNDING = 1e-6
_NAMED = 4  # most parameters by which an axis is told
_RADII, _ENOUGH = (3.0, 1.5, 0.75), 0.1  # lengths of such a step; share of the promised gain at which it is taken
_FAR = 1.0  # standard deviations by which noise parameters at their mean may move a parameter


@dataclass(frozen=True)
class LaplaceFit:
    """The optimum, its noise parameters, the marginal posterior there, and how well the noise parameters are known.

    Attributes:
        optimum: Mode of the marginal posterior, with start and process noise there.
        hyper: Noise parameters: the means of their logarithms, or the most probable ones (see `marginal_fit`).
        marginal: The marginal posterior about the optimum.
        evidence: Minus the log evidence of the most probable noise parameters, up to a constant.
        noise_parameter_covariance: Of the logarithms of the noise parameters (V, V).
        noise_effect: How the parameters' posterior follows those logarithms, and how much wider it is than the
            conditional one without them: by the noise parameters and by `dispersion`.
        determinant_error: Largest change of a mean, in standard deviations, or relative of one of these, that the error
            of the log density over the posterior implies, Laplace's at the same points being right.
        profile: The density along the axes about the mode.
        dispersion: Whether parts of the records agree about the parameters.
        lost: Corrections that were left out since they can't be trusted, in words.
    """

    optimum: Optimum
    hyper: NoiseParameters
    marginal: Marginal
    evidence: float
    noise_parameter_covariance: Array
    noise_effect: NoiseEffect
    determinant_error: float
    profile: Profile
    dispersion: Dispersion
    lost: tuple[str, ...] = ()


def marginal_fit(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    prior: NoisePrior,
    settled: JointFit,
    progress: Progress | None = None,
    widen: bool = True,
) -> LaplaceFit:
    """Find the mode of the marginal posterior from the joint mode, and set the marginal posterior up there.

    The joint mode of parameters and disturbances is not the mode of the marginal posterior of the parameters: see
    `marginal_mode`. Nor are the noise parameters of maximum evidence the same at both points: they are estimated again
    at the mode, and the mode with them, until it converges. Then they are set to their posterior mean
    (`evidence.mean_less_mode`) and the mode is found again, unless that would move a parameter by more than its
    standard deviation, which is beyond the validity of an expansion about the mode.

    Args:
        flights: Records.
        priors: Priors of the parameters.
        prior: Priors of the noise parameters.
        settled: From `joint_fit`.
        progress: Progress callback: share done and words.
        widen: Whether parts of the records that disagree widen the posterior; not what classical methods do.
    """
    say = progress or (lambda share, words: None)
    best = marginal_mode(flights, priors, settled, lambda share, words: say(0.15 * share, words))
    best, hyper, value = _by_turns(
        flights, priors, prior, settled._replace(optimum=best), lambda share, words: say(0.15 + 0.2 * share, words)
    )
    made = marginalise(flights, hyper, priors, best)
    say(0.35, "uncertainty of the noise parameters")
    slope = noise_parameter_slope(made)
    evidence = _evidence(made, priors, prior)
    scale = np.asarray(made.scale)
    before = np.linalg.solve(np.asarray(made.prior_factor), scale)
    known = noise_evidence.noise_parameter_covariance(evidence, hyper, prior, slope, before.T @ before)
    moved = noise_evidence.mean_less_mode(evidence, hyper, known)
    candidates = [("most probable noise parameters", hyper)]
    if np.max(np.abs(scale @ slope @ moved) / np.linalg.norm(scale, axis=1)) <= _FAR:
        mean = jax.tree.map(np.asarray, noise_evidence.from_vector(noise_evidence.to_vector(hyper) + moved, hyper))
        candidates.insert(0, ("noise parameters at their mean", mean))
    began = JointFit(replace(best, converged=settled.optimum.converged), hyper, value)
    best, hyper, made, lost, seen = _last(
        flights, priors, began, candidates, lambda share, words: say(0.4 + 0.35 * share, words)
    )
    made, seen, wrong = _over_the_posterior(made, seen, lambda share, words: say(0.75 + 0.25 * share, words))
    slope = scipy.linalg.solve_triangular(np.asarray(made.scale), scale @ slope, lower=True)
    spread, excess = noise_parameter_spread(made, known)
    agree = dispersion(*parts_of(made))
    effect = NoiseEffect(slope, spread, excess)
    if widen:
        effect = effect._replace(excess=excess + agree.widening, misfit=agree.widening)
    return LaplaceFit(best, hyper, made, value, known, effect, wrong, seen, agree, lost)


def _by_turns(
    flights: Sequence[FlightData], priors: Sequence[Prior], prior: NoisePrior, place: JointFit, say: Progress
) -> JointFit:
    """Noise parameters of greatest evidence at a mode, and the mode under these, until either stays.

    The evidence of a linearised flight promises more than there is where the next mode lies far off. So every turn is
    judged at its end, by Laplace's approximation there. One after which the noise parameters with their mode are less
    probable is not kept: a part of the way is tried, and where that is no better either, they stay.
    """
    scale: Array | None = None
    least = _minus_log_evidence(flights, priors, prior, place)
    for turn in range(_TURNS):
        best, hyper, _ = place
        evidence = _evidence(marginalise(flights, hyper, priors, best), priors, prior)
        if scale is None:
            scale = noise_evidence.scales(evidence, hyper, prior)
        end = noise_evidence.maximise(evidence, hyper, prior, _NOISE_STEPS, scale)[0]
        for share in _SHARES:
            start = _part_of_the_way(evidence, place, end, share)
            bar = _prior_of_noise(start.hyper, prior) - 0.5 * float(np.linalg.slogdet(best.covariance)[1]) - least
            found = start._replace(optimum=marginal_mode(flights, priors, start, most=_MODE_TURN, least=bar))
            there = _minus_log_evidence(flights, priors, prior, found)
            part = "" if share == 1.0 else f", {share:g} of the way"
            words = f"noise parameters at the mode, turn {turn + 1}{part}: log evidence {least - there:+.2f}"
            say((turn + 1) / _TURNS, words if there < least else f"{words}, not kept")
            if there < least:
                break
        else:
            break
        gain, moved = least - there, length(found.optimum.theta - best.theta, best.covariance)
        place, least = found, there
        if gain < _GAINED or moved < _SETTLED:
            break
    return place


def _part_of_the_way(evidence: Evidence, place: JointFit, end: NoiseParameters, share: float) -> JointFit:
    """A place with noise parameters that go a share of the way to others, by their logarithms."""
    begin, last = (noise_evidence.to_vector(hyper) for hyper in (place.hyper, end))
    vector = begin + share * (last - begin)
    hyper = jax.tree.map(np.asarray, noise_evidence.from_vector(vector, end))
    return JointFit(place.optimum, hyper, evidence(vector)[0])


def _minus_log_evidence(
    flights: Sequence[FlightData], priors: Sequence[Prior], prior: NoisePrior, place: JointFit
) -> float:
    """Minus the log evidence of noise parameters by Laplace's method at the mode of theta, up to constants."""
    best, hyper, _ = place
    rest = conditional_mode.conditional_optimum(flights, hyper, priors, best.theta, best.flights)
    if rest is None:
        return np.inf
    return rest.marginal + _prior_of_noise(hyper, prior) - 0.5 * float(np.linalg.slogdet(best.covariance)[1])


def _prior_of_noise(hyper: NoiseParameters, prior: NoisePrior) -> float:
    """Minus the log prior density of noise parameters, up to a constant."""
    away = (noise_evidence.to_vector(hyper) - noise_evidence.to_vector(prior.median)) / prior.log_sd
    return 0.5 * float(away @ away)


def _evidence(made: Marginal, priors: Sequence[Prior], prior: NoisePrior) -> Evidence:
    """Of the noise parameters at the place where flights are linearised."""
    linear, corrections = [along.linear for along in made.along], [along.mean_correction for along in made.along]
    return noise_evidence.function_of(made.flights, linear, priors, prior, corrections)


def _over_the_posterior(made: Marginal, seen: Profile, say: Progress) -> tuple[Marginal, Profile, float]:
    """The posterior with corrections that hold where its mass is, its density along the axes, and what its error does.

    Always at the same points, so that decisions do not depend on a seed. Corrections under which the density has no
    mode are not taken.
    """
    fit = correction_fit.fitted(made, stream(0, "points of the log determinant"), say)
    if fit.marginal is made:
        return made, seen, fit.shift
    there = _seen(fit.marginal, laplace.expansion(fit.marginal).step())
    return (fit.marginal, there, fit.shift) if there.is_mode else (made, seen, fit.before)


def _seen(made: Marginal, step: Array) -> Profile:
    """The density along the axes about the centre, or about the mode a step (P,) away: where it shows a mode rather."""
    return max((profile(made), profile(made, step)), key=lambda one: (one.is_mode, one.worst))


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
        beyond = np.linalg.norm(self.step) > (1.0 - _ROUNDING) * laplace.FARTHEST
        return f"{self.away:.2g} standard deviations{' or more' if beyond else ''}"


class _Ended(NamedTuple):
    """Where the search for the mode ended: what `_last` returns."""

    optimum: Optimum
    hyper: NoiseParameters
    marginal: Marginal
    lost: tuple[str, ...]
    profile: Profile


def _last(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    began: JointFit,
    candidates: Sequence[tuple[str, NoiseParameters]],
    progress: Progress | None = None,
) -> _Ended:
    """The mode under the first noise parameters that lead to one, the posterior, corrections left out, the density.

    A point that turns out to lie beside the mode, once what the linear models lack is known, is left for it; a point
    about which the density has no mode, for where it is highest within reach. Where the density is no higher on the
    way, the point stays. If it has no mode there, other noise parameters are tried; only if none leads to one are
    corrections left out, as far as they outweigh the density.

    Raises:
        NoFitError: If none does.
    """
    say = progress or (lambda share, words: None)
    tried, ended, reason = list[str](), began.optimum, ""
    flat: _Ended | None = None
    for words, hyper in candidates:
        start = JointFit(began.optimum, hyper, began.evidence)
        try:
            found, highest, steps = _places(flights, priors, start, say)
        except FloatingPointError as error:
            reason = str(error)
            tried.append(f"{words}: {reason}")
            continue
        sound = [place for place in found[-1 if highest else 0 :] if place.expansion.has_mode] or [
            _flattened(found[-1])
        ]
        best, made, _, lost = place = min(sound, key=lambda one: one.away)
        seen = _seen(made, place.step)
        if seen.is_mode and (highest or place.away < _BESIDE_MODE):
            shift = () if hyper is candidates[0][1] else (_LOST_MEAN,)
            last = _Ended(replace(best, converged=began.optimum.converged), hyper, made, (*lost, *shift), seen)
            if not lost:
                return last
            flat = flat or last
            continue
        why = (
            f"after {steps} steps towards it the mode is still off by {place.distance}, root "
            f"mean square of all axes, and less than {_BESIDE_MODE:g} is wanted"
            if seen.is_mode
            else seen.why_not + _in_names(priors, made, seen.blamed)
        )
        ended, reason = best, f"the search for the mode of the marginal posterior did not end at one: {why}"
        lengths = ", ".join(f"{one.away:.2g}" for one in found)
        tried.append(f"{words}: steps left from {len(found)} places (root mean square of all axes): {lengths}; {why}")
    if flat is not None:
        return flat
    raise NoFitError(reason, tried, ended, priors, candidates[-1][1])


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
            place = _Place(here, near, laplace.expanded(near, beside))
            ahead = _ahead(near, place) if move < _MOVES and place.away > _BESIDE_MODE else None
            if ahead is not None:
                here = ahead
                continue
            pairs = partial(heard, (0.2, 1.0), "along pairs of axes")
            found.append(_Place(here, *laplace.corrected(near, near=beside, progress=pairs)))
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
        found.append(_Place(here, *laplace.corrected(near, near=beside)))
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
        change = there.square + there.determinant - here.square - here.determinant
        if change < _ENOUGH * place.expansion.change(step):
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
        return laplace.sides(made, _BESIDE, progress)
    except FloatingPointError:
        return laplace.sides(made, _NEARER, progress)


def _flattened(place: _Place) -> _Place:
    """A place about which the density has no mode, without what is to blame."""
    return _Place(place.optimum, *laplace.flattened(place.marginal, place.expansion), (_LOST_BEND,))


def find(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    prior: NoisePrior,
    rounds: int = 1,
    progress: Progress | None = None,
) -> LaplaceFit:
    """The marginal posterior of the parameters: `joint_fit`, then `marginal_fit`."""
    say = progress or (lambda share, words: None)
    settled = joint_fit(flights, priors, prior, rounds, lambda share, words: say(0.7 * share, words))
    return marginal_fit(flights, priors, prior, settled, lambda share, words: say(0.7 + 0.3 * share, words))
