"""The marginal posterior of the parameters by Laplace's approximation: mode, noise parameters, corrections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax
import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bayeschute.core.random import stream
from bayeschute.likelihood.joint import FlightData, NoiseParameters
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior import noise_evidence
from bayeschute.posterior.along_record import conditional_mode
from bayeschute.posterior.beyond_linear.expansion import expansion_of
from bayeschute.posterior.fit import correction_fit
from bayeschute.posterior.fit.continuation import Progress
from bayeschute.posterior.fit.joint_fit import JointFit, joint_fit
from bayeschute.posterior.fit.marginal_mode import marginal_mode
from bayeschute.posterior.fit.mode_search import Candidate, search
from bayeschute.posterior.joint_mode import Optimum
from bayeschute.posterior.marginal import Marginal, marginalise
from bayeschute.posterior.mode_checks import Profile, best_profile
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
_FAR = 1.0  # standard deviations by which noise parameters at their mean may move a parameter
_LOST_MEAN = "the shift of the noise parameters from their mode to their mean, where no mode was found"
_LOUDER = (0.5, 0.75, 1.0)  # of the way to the medians of their priors that standard deviations are raised
_QUIET_WORDS = (
    "standard deviations of noise and disturbances that are less than the medians of their priors are {:.0%} of the "
    "way there (in logarithms) from the most probable ones, about which the density has no mode that can be described; "
    "intervals and bands are wider than the record asks for"
)
_QUIET = 1.5  # times below its prior's median a standard deviation must be for that to make a difference


@dataclass(frozen=True)
class LaplaceFit:
    """The optimum, its noise parameters, the marginal posterior there, and how well the noise parameters are known.

    Attributes:
        optimum: Mode of the marginal posterior, with start and process noise there.
        hyper: Noise parameters: the means of their logarithms, or the most probable ones (see `about_mode`).
        marginal: The marginal posterior about the optimum.
        evidence: Minus the log evidence of the most probable noise parameters, up to a constant.
        noise_parameter_covariance: Of the logarithms of the noise parameters (V, V).
        noise_effect: How the parameters' posterior follows those logarithms, and how much wider it is than the
            conditional one without them: by the noise parameters and by `dispersion`.
        determinant_error: Largest change of a mean, in standard deviations, or relative of one of these, that the error
            of the log density over the posterior implies, Laplace's at the same points being right.
        profile: The density along the axes about the mode.
        dispersion: Whether parts of the records agree about the parameters.
        lost: What the posterior leaves out since it can't be trusted, in words: corrections, or how weak the noise is.
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
    """The marginal posterior from the joint mode: `mode_and_noise`, then `about_mode`, whose arguments these are."""
    say = progress or (lambda share, words: None)
    place = mode_and_noise(flights, priors, prior, settled, lambda share, words: say(0.35 * share, words))
    return about_mode(flights, priors, prior, place, lambda share, words: say(0.35 + 0.65 * share, words), widen)


def mode_and_noise(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    prior: NoisePrior,
    settled: JointFit,
    progress: Progress | None = None,
) -> JointFit:
    """The mode of the linearised marginal posterior, and the noise parameters of greatest evidence there.

    The joint mode of parameters and disturbances is not the mode of the marginal posterior of the parameters: see
    `marginal_mode`. Nor are the noise parameters of maximum evidence the same at both points: they are estimated again
    at the mode, and the mode with them, until it converges.

    Args:
        flights: Records.
        priors: Priors of the parameters.
        prior: Priors of the noise parameters.
        settled: From `joint_fit`.
        progress: Progress callback: share done and words.
    """
    say = progress or (lambda share, words: None)
    best = marginal_mode(flights, priors, settled, lambda share, words: say(0.4 * share, words))
    place = settled._replace(optimum=best)
    found = _by_turns(flights, priors, prior, place, lambda share, words: say(0.4 + 0.6 * share, words))
    return found._replace(optimum=replace(found.optimum, converged=settled.optimum.converged))


def about_mode(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    prior: NoisePrior,
    place: JointFit,
    progress: Progress | None = None,
    widen: bool = True,
) -> LaplaceFit:
    """The marginal posterior about its mode, with all corrections.

    The noise parameters are set to their posterior mean (`evidence.mean_less_mode`) and the mode is found again, unless
    that would move a parameter by more than its standard deviation, which is beyond the validity of an expansion about
    the mode. Where under neither a mode is found, and noise is weaker than its priors have it, stronger noise is tried:
    a wide answer rather than none.

    Args:
        flights: Records.
        priors: Priors of the parameters.
        prior: Priors of the noise parameters.
        place: From `mode_and_noise`.
        progress: Progress callback: share done and words.
        widen: Whether parts of the records that disagree widen the posterior; not what classical methods do.
    """
    say = progress or (lambda share, words: None)
    best, hyper, value = place
    made = marginalise(flights, hyper, priors, best)
    say(0.0, "uncertainty of the noise parameters")
    slope = noise_parameter_slope(made)
    evidence = _evidence(made, priors, prior)
    scale = np.asarray(made.scale)
    before = np.linalg.solve(np.asarray(made.prior_factor), scale)
    known = noise_evidence.noise_parameter_covariance(evidence, hyper, prior, slope, before.T @ before)
    moved = noise_evidence.mean_less_mode(evidence, hyper, known)
    most_probable = Candidate("most probable noise parameters", hyper)
    candidates, others = [most_probable], _louder(hyper, prior)
    if np.max(np.abs(scale @ slope @ moved) / np.linalg.norm(scale, axis=1)) <= _FAR:
        mean = jax.tree.map(np.asarray, noise_evidence.from_vector(noise_evidence.to_vector(hyper) + moved, hyper))
        candidates = [Candidate("noise parameters at their mean", mean), most_probable._replace(lost=(_LOST_MEAN,))]
    best, hyper, made, lost, seen = search(
        flights, priors, place, candidates, others, lambda share, words: say(0.1 + 0.5 * share, words)
    )
    made, seen, wrong = _over_the_posterior(made, seen, lambda share, words: say(0.6 + 0.4 * share, words))
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


def _louder(hyper: NoiseParameters, prior: NoisePrior) -> list[Candidate]:
    """Noise parameters with stronger noise than the most probable ones, where that is weaker than its prior's median.

    Where noise and gusts are weak the data may confine parameters that are hardly told apart to a curved valley,
    beyond the reach of any expansion about one place. Under stronger noise the posterior is wider and rounder: as a
    likelihood to a small power does, it leaves more of the say to the priors.
    """

    def made(share: float) -> NoiseParameters:
        return hyper.with_deviations(lambda sd, median: sd * np.maximum(median / sd, 1.0) ** share, prior.median)

    whole = noise_evidence.to_vector(made(1.0)) - noise_evidence.to_vector(hyper)
    if np.max(whole) < np.log(_QUIET):
        return []
    return [
        Candidate(
            f"standard deviations of the noise {share:.0%} of the way to the medians of their priors",
            made(share),
            (f"how weak the noise of the record is: {_QUIET_WORDS.format(share)}",),
        )
        for share in _LOUDER
    ]


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
    there = best_profile(fit.marginal, expansion_of(fit.marginal).step())
    return (fit.marginal, there, fit.shift) if there.is_mode else (made, seen, fit.before)


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
