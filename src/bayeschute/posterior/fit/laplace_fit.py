"""The marginal posterior of the parameters by Laplace's approximation: mode, noise parameters, corrections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bayeschute.core.random import stream
from bayeschute.likelihood.joint import FlightData, Linear, NoiseParameters
from bayeschute.likelihood.kalman import MeanCorrection
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior import laplace, noise_evidence
from bayeschute.posterior.fit.continuation import Progress
from bayeschute.posterior.fit.joint_fit import JointFit, NoFitError, joint_fit
from bayeschute.posterior.fit.marginal_mode import marginal_mode
from bayeschute.posterior.joint_mode import Optimum
from bayeschute.posterior.laplace import Way
from bayeschute.posterior.marginal import Marginal, Quadratic, marginalise, place_at
from bayeschute.posterior.mode_checks import PLACES, Profile, profile
from bayeschute.posterior.noise_evidence import NoisePrior
from bayeschute.posterior.noise_uncertainty import NoiseEffect, noise_parameter_slope, noise_parameter_spread
from bayeschute.posterior.quasi_newton import length
from bayeschute.posterior.score_dispersion import Dispersion, dispersion, parts_of

Array = NDArray[np.float64]
_TURNS, _SETTLED = 3, 0.4  # most turns of noise parameters and mode; a step of the mode after which there is no other
_MODE_TURN = 2  # most steps of the mode in each of them
_BESIDE, _NEARER = 1.0, 0.3  # steps [standard deviations] to where Laplace's approximation is taken; where flights fail
_LOST_BEND = "the curvature correction of the conditional mode, which along some axis outweighs the density"
_LOST_MEAN = "the shift of the noise parameters from their mode to their mean, where no mode was found"
_AT_MODE, _BESIDE_MODE = 0.2, 0.5  # root mean square distance from there, along all axes, that ends it, or will do
_MOVES = 3  # most steps to the mode of the posterior with all its corrections
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
        determinant_error: Root mean square error of the log density over the posterior, Laplace's at the same points.
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
    best = marginal_mode(flights, priors, settled, lambda share, words: say(0.3 * share, words))
    hyper, value = settled.hyper, settled.evidence
    for turn in range(_TURNS):
        say(0.3 + 0.2 * turn / _TURNS, f"noise parameters at the mode {turn + 1}")
        made = marginalise(flights, hyper, priors, best)
        hyper, value = noise_evidence.maximise(
            flights, _linear(made), priors, hyper, prior, 12, _mean_corrections(made)
        )
        before, best = best, marginal_mode(flights, priors, JointFit(best, hyper, value), most=_MODE_TURN)
        if length(best.theta - before.theta, before.covariance) < _SETTLED:
            break
    made = marginalise(flights, hyper, priors, best)
    say(0.5, "uncertainty of the noise parameters")
    slope = noise_parameter_slope(made)
    known = noise_evidence.noise_parameter_covariance(
        flights, _linear(made), priors, hyper, prior, slope, _mean_corrections(made)
    )
    moved = noise_evidence.mean_less_mode(flights, _linear(made), priors, hyper, prior, known, _mean_corrections(made))
    scale = np.asarray(made.scale)
    candidates = [("most probable noise parameters", hyper)]
    if np.max(np.abs(scale @ slope @ moved) / np.linalg.norm(scale, axis=1)) <= _FAR:
        mean = jax.tree.map(np.asarray, noise_evidence.from_vector(noise_evidence.to_vector(hyper) + moved, hyper))
        candidates.insert(0, ("noise parameters at their mean", mean))
    began = JointFit(replace(best, converged=settled.optimum.converged), hyper, value)
    best, hyper, made, lost, seen = _last(
        flights, priors, began, candidates, lambda share, words: say(0.8 + 0.2 * share, words)
    )
    wrong = _determinant_error(made)
    slope = scipy.linalg.solve_triangular(np.asarray(made.scale), scale @ slope, lower=True)
    spread, excess = noise_parameter_spread(made, known)
    agree = dispersion(*parts_of(made))
    effect = NoiseEffect(slope, spread, excess + agree.widening if widen else excess)
    return LaplaceFit(best, hyper, made, value, known, effect, wrong, seen, agree, lost)


def _determinant_error(made: Marginal) -> float:
    """Error of Laplace's approximation, always at the same points, so that decisions do not depend on a seed."""
    return laplace.error(made, 8, stream(0, "points of the log determinant"))


class _Place(NamedTuple):
    """A place on the way to the mode, the posterior about it, what is left out of that, and the way on."""

    optimum: Optimum
    marginal: Marginal
    lost: tuple[str, ...]
    way: Way

    @property
    def away(self) -> float:
        """Root mean square of the step on in standard coordinates."""
        return float(np.sqrt(np.mean(self.way.step**2)))


def _last(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    began: JointFit,
    candidates: Sequence[tuple[str, NoiseParameters]],
    progress: Progress | None = None,
) -> tuple[Optimum, NoiseParameters, Marginal, tuple[str, ...], Profile]:
    """The mode under the first noise parameters that lead to one, the posterior, corrections left out, the density.

    A point that turns out to lie beside the mode, once what the linear models lack is known, is left for it; a point
    about which the density has no mode, for where it is highest within reach.

    Raises:
        NoFitError: If none does.
    """
    say = progress or (lambda share, words: None)
    tried, ended, reason = list[str](), began.optimum, ""
    for words, hyper in candidates:
        found = list[_Place]()
        try:
            start = JointFit(began.optimum, hyper, began.evidence)
            here = marginal_mode(flights, priors, start, lambda share, words: say(0.3 * share, words))
            for move in range(1 + _MOVES):
                near = marginalise(flights, hyper, priors, here)
                say(0.3 + 0.5 * move / (1 + _MOVES), f"log determinant along the axes, place {move + 1}")
                found.append(_Place(here, *_corrected(near)))
                if not found[-1].lost and found[-1].away < _AT_MODE:
                    break
                here = _ahead(near, here, found[-1].way.step)
        except FloatingPointError as error:
            if not found:
                reason = str(error)
                tried.append(f"{words}: {reason}")
                continue
        sound = [place for place in found if not place.lost] or [_without_bend(found[-1])]
        best, made, lost, way = place = min(sound, key=lambda one: one.away)
        seen = max((profile(made), profile(made, way.step)), key=lambda one: (one.is_mode, one.worst))
        if seen.is_mode and place.away < _BESIDE_MODE:
            lost = lost if hyper is candidates[0][1] else (*lost, _LOST_MEAN)
            return replace(best, converged=began.optimum.converged), hyper, made, lost, seen
        why = (
            f"after {len(found)} steps towards it the mode is still off by {place.away:.2g} standard deviations, root "
            f"mean square of all axes, and less than {_BESIDE_MODE:g} is wanted"
            if seen.is_mode
            else f"one standard deviation away from it the log density falls by {seen.worst:.3g}, about 0.5 is expected"
        )
        ended, reason = best, f"the search for the mode of the marginal posterior did not end at one: {why}"
        lengths = ", ".join(f"{one.away:.2g}" for one in found)
        tried.append(f"{words}: steps left from {len(found)} places (root mean square of all axes): {lengths}; {why}")
    raise NoFitError(reason, tried, ended, priors, candidates[-1][1])


def _ahead(near: Marginal, best: Optimum, step: Array) -> Optimum:
    """The point a step in standard coordinates away."""
    shift = np.asarray(near.scale) @ step
    pairs = zip(near.flights, near.along, strict=True)
    flights = tuple(place_at(flight, along, jnp.asarray(shift)) for flight, along in pairs)
    return replace(best, theta=best.theta + shift, flights=flights)


def _corrected(made: Marginal) -> tuple[Marginal, tuple[str, ...], Way]:
    """The posterior with its corrections about a point, what is to be left out if that is the last, and the way on.

    Raises:
        FloatingPointError: If flights fail beside the point.
    """
    try:
        one, way = laplace.corrected(made, _BESIDE)
    except FloatingPointError:
        one, way = laplace.corrected(made, _NEARER)
    return one, () if way.is_mode else (_LOST_BEND,), way


def _without_bend(place: _Place) -> _Place:
    """A place about which the density has no mode, without the correction that is to blame.

    The way on is to the mode; where there is none either, to the best of the places at which the density was looked at.
    """
    made = replace(place.marginal, bend=Quadratic.none(len(place.marginal.bend.slope)))
    seen = profile(made)
    fall = np.where(np.isfinite(seen.fall), seen.fall, np.inf)
    axis, at = np.unravel_index(np.argmin(fall), fall.shape)
    step = PLACES[at] * seen.direction[axis] * float(fall[axis, at] < 0.0)
    return place._replace(marginal=made, way=Way(step, seen.is_mode))


def _linear(made: Marginal) -> list[Linear]:
    return [along.linear for along in made.along]


def _mean_corrections(made: Marginal) -> list[MeanCorrection]:
    return [along.mean_correction for along in made.along]


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
