"""From data and priors to the marginal posterior: joint optimum, noise parameters, mode, log determinant."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bayeschute.core.errors import FitError
from bayeschute.core.random import stream
from bayeschute.likelihood.joint import FlightData, Lifted, Linear, NoiseParameters, Unknowns
from bayeschute.likelihood.kalman import MeanCorrection
from bayeschute.likelihood.priors import Prior, working
from bayeschute.posterior import along_record, laplace, noise_evidence
from bayeschute.posterior import joint_mode as optimum
from bayeschute.posterior.along_record import LiftedFit
from bayeschute.posterior.joint_mode import Optimum
from bayeschute.posterior.marginal import Marginal, Quadratic, marginalise, mean_correction_slope, place_at
from bayeschute.posterior.mode_checks import PLACES, Profile, profile
from bayeschute.posterior.noise_evidence import NoisePrior
from bayeschute.posterior.noise_uncertainty import NoiseEffect, noise_parameter_slope, noise_parameter_spread
from bayeschute.posterior.quasi_newton import length, secant_step

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]
HORIZONS = (
    0.2,
    0.5,
    1.0,
)  # shares fitted in turn: an unstable pendulum far from its optimum is lost late in the record
_SMALL_STEPS = tuple(0.1 * i for i in range(1, 11))  # where those lead astray
_MOST, _MOST_SMALL = 12, 40  # most iterations of a fit to a first part, and to one of the small steps
_MODE_STEPS, _NEAR = 16, 0.2  # most steps to the marginal mode; length of the last, in standard deviations
_SMALL_LEVELS = (5.0, 3.0, 1.7, 1.0, 0.6, 0.3, 0.17, 0.1, 0.05, 0.02, 0.0)  # where the usual ones don't do
_FEW_DEFECTS = 0.02  # of the last level's slack, at which single shooting can go on
_TURN_NEAR = along_record.Near(20.0, np.inf, 0.05)  # end of a turn
_LAST_NEAR = along_record.Near(1.0, 0.5, _FEW_DEFECTS)  # and of the last: the marginal mode is sought from there
_JOINT_NEAR = along_record.Near(0.1, 0.1, _FEW_DEFECTS)  # where joint optima are compared
_LOOSE = 3.0  # times the prior medians of all standard deviations, until noise parameters are found
_TURNS, _SETTLED = 3, 0.4  # most turns of noise parameters and mode; a step of the mode after which there is no other
_HALVINGS = 10  # of a step to the mode at most
_TRUSTED = 3.0  # standard deviations up to which the last step of a search that did not end is gone all the same
_RISE = 20.0  # of minus the marginal log density over a step, beyond which half of it is tried
_SAME_SLOPE = 0.5  # standard deviations within which the slope of what linear models lack is taken for the same
_MODE_TURN = 2  # most steps of the mode in each of them
_BESIDE = (1.0, 0.3)  # steps [standard deviations] at which Laplace's approximation is taken
_DETERMINANT = 0.2  # error of the polynomials beyond which the log determinant's gets all products
_LOST_BEND = "the curvature correction of the conditional mode, which along some axis outweighs the density"
_BREAKS = "no flight of the model follows the record: steps along the best path break the equations of motion"
_LOST_MEAN = "the shift of the noise parameters from their mode to their mean, where no mode was found"
_AT_MODE, _BESIDE_MODE = 0.2, 0.5  # root mean square distance from there, along all axes, that ends it, or will do
_MOVES = 3  # most steps to the mode of the posterior with all its corrections
_FAR = 1.0  # standard deviations by which noise parameters at their mean may move a parameter
_LEAST_FIRST_PART = 0.05  # share of the record at which the first part is shortened no more
_LEAST_GAIN = 0.05  # share of the record by which the fitted part must at least be lengthened


@dataclass(frozen=True)
class LaplaceFit:
    """The optimum, its noise parameters, the marginal posterior there, and how well the noise parameters are known.

    Attributes:
        optimum: Mode of the marginal posterior, with start and process noise there.
        hyper: Noise parameters: the means of their logarithms, or the most probable ones (see `marginal_fit`).
        marginal: The marginal posterior about the optimum.
        evidence: Minus the log evidence of the most probable noise parameters, up to a constant.
        noise_parameter_covariance: Of the logarithms of the noise parameters (V, V).
        noise_effect: How the parameters' conditional posterior follows those logarithms.
        determinant_error: Root mean square error of the log density over the posterior, Laplace's at the same points.
        profile: The density along the axes about the mode.
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
    lost: tuple[str, ...] = ()


def _until(flight: FlightData, share: float) -> FlightData:
    """The flight with data beyond a share of its samples absent; shapes stay, so compiled functions serve."""
    seen = np.array(flight.present)
    seen[int(np.ceil(share * len(seen))) :] = False
    return replace(flight, present=seen)


Begin = tuple[Array, Sequence[Lifted] | None, NoiseParameters]
"""Parameters, where every flight begins (None: on the path of its record), noise parameters."""


class NoJointFitError(FitError):
    """A fit that ended without an optimum.

    Attributes:
        best: The fit along the record whose defects are least.
        priors: Of its parameters.
        hyper: Noise parameters of the turn.
    """

    def __init__(self, tried: Iterable[str], best: LiftedFit, priors: Sequence[Prior], hyper: NoiseParameters) -> None:
        """A `FitError` with the best fit found."""
        self.best, self.priors, self.hyper = best, tuple(priors), hyper
        super().__init__(_BREAKS, tried)


class JointFit(NamedTuple):
    """The joint optimum over parameters and disturbances, its noise parameters, and minus the log evidence there."""

    optimum: Optimum
    hyper: NoiseParameters
    evidence: float


def lengthened(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    hyper: NoiseParameters,
    theta: Array,
    say: Progress,
    unknowns: Sequence[Unknowns] | None = None,
) -> tuple[Array, Sequence[Unknowns]]:
    """Starting values for the whole record by continuation: fits to longer and longer first parts of it.

    Where the trajectory of one part diverges before the end of the next, the next is shortened; so is the first where
    its simulation fails. Where that doesn't help, a fit went to a wrong optimum, and the continuation starts again with
    small steps, each converged.

    Args:
        flights: Records.
        priors: Priors of the parameters.
        hyper: Noise parameters, fixed.
        theta: Where to begin, working coordinates (P,).
        say: Progress callback: share done and words.
        unknowns: Where to begin, per flight; prior means where None.

    Returns:
        Parameters and unknowns near the optimum for the whole record.

    Raises:
        FloatingPointError: If neither helps.
    """
    todo, most, done, begin = list(HORIZONS), _MOST, 0.0, (theta, unknowns)
    while todo:
        share = todo[0]
        say(0.0, f"first {100 * share:.0f} % of the record")
        seen = [_until(f, share) for f in flights]
        try:
            best = optimum.fit(seen, hyper, priors, theta, unknowns, tolerance=0.5, most=most, first_part=share < 1.0)
        except FloatingPointError:
            if share - done >= (_LEAST_FIRST_PART if done == 0.0 else 2.0 * _LEAST_GAIN):
                todo.insert(0, 0.5 * (done + share))
                continue
            if done == 0.0 or most == _MOST_SMALL:
                raise
            todo, most, done, (theta, unknowns) = list(_SMALL_STEPS), _MOST_SMALL, 0.0, begin
            continue
        theta, unknowns, done = best.theta, best.unknowns, todo.pop(0)
    assert unknowns is not None
    return theta, unknowns


def joint_fit(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    prior: NoisePrior,
    rounds: int = 1,
    progress: Progress | None = None,
    begin: Begin | None = None,
) -> JointFit:
    """Fit parameters, start, latent disturbances and noise parameters, by turns.

    Args:
        flights: Records.
        priors: Priors of the parameters.
        prior: Priors of the noise parameters.
        rounds: Turns of optimum and evidence before the last optimum.
        progress: Progress callback: share done and words.
        begin: Where to begin; at the prior means, on the path of the record, where None. Models without such a path
            begin with first parts of the record.

    Raises:
        FloatingPointError: If the simulation at the prior means is not finite.
    """
    say = progress or (lambda share, words: None)
    if all(f.path is not None for f in flights):
        return _settle_along(flights, priors, prior, say, begin)
    theta, hyper, value = working(priors)[0], prior.median, np.nan
    unknowns: Sequence[Unknowns] | None = None
    if begin is not None:
        theta, places, hyper = begin
        unknowns = [x.unknowns for x in places] if places is not None else None
    if unknowns is None:
        theta, unknowns = lengthened(flights, priors, hyper, theta, say)
    for turn in range(rounds + 1):
        last = turn == rounds

        def tell(iteration: int, cost: float, step: float, turn: int = turn) -> None:
            share = (turn + min(iteration / 12.0, 0.8)) / (rounds + 1)
            say(share, f"optimum {turn + 1}: cost {cost:.1f}, step {step:.3f} standard errors")

        best = optimum.fit(flights, hyper, priors, theta, unknowns, 0.01 if last else 0.1, progress=tell)
        theta, unknowns = best.theta, best.unknowns
        if not last:
            say((turn + 0.9) / (rounds + 1), f"noise parameters {turn + 1}")
            linear = best.linear(flights)
            hyper, value = noise_evidence.maximise(flights, linear, priors, hyper, prior, most=20 if turn == 0 else 12)
    return JointFit(best, hyper, value)


def _looser(hyper: NoiseParameters) -> NoiseParameters:
    """Noise parameters whose noise and disturbances are stronger: with these a flight follows its record more easily.

    As a likelihood to a small power does, they leave more of the say to the priors and make a wrong path cheaper.
    """
    noise, processes = hyper.noise, (np.asarray(one, float) for one in hyper.disturbance_parameters)
    noise = replace(noise, white=_LOOSE * np.asarray(noise.white), correlated=_LOOSE * np.asarray(noise.correlated))
    stronger = tuple(np.concatenate([_LOOSE * one[:1], one[1:]]) for one in processes)
    return replace(hyper, noise=noise, disturbance_parameters=stronger)


def _along_record(
    flights: Sequence[FlightData],
    hyper: NoiseParameters,
    priors: Sequence[Prior],
    theta: Array,
    at: Sequence[Lifted] | None,
    near: along_record.Near,
    tell: Callable[[along_record.Row], None],
    begins: bool = False,
) -> LiftedFit:
    """A fit along the record whose path obeys the equations of motion, from where it is or from the record's path.

    What is fast is tried first, then what gets further. One that begins, so that noise parameters are still to be
    found, has stronger noise than they say.

    Raises:
        NoJointFitError: If defects are left whatever was tried.
    """
    whole, anew = (*along_record.LEVELS, 0.0), "from the path of the record"
    begun: list[tuple[str, NoiseParameters, Sequence[Lifted] | None, tuple[float, ...]]] = [
        (anew, hyper, None, whole),
        (f"{anew}, in smaller steps", hyper, None, _SMALL_LEVELS),
    ]
    if at is not None:
        begun.insert(0, ("from the path of the turn before", hyper, at, (0.0,)))
    elif begins:
        looser = _looser(hyper)
        begun = [(f"{words}, noise stronger", looser, None, levels) for words, _, _, levels in begun]
        begun.insert(1, (anew, hyper, None, whole))
    tried: list[str] = []
    best: LiftedFit | None = None
    for words, noise, places, levels in begun:
        made = along_record.descend(flights, noise, priors, theta, places, levels, near=near, progress=tell)
        said = f"{len(made.rows)} steps, the last {made.rows[-1] if made.rows else 'none: not finite'}"
        if made.rows and made.rows[-1].level == 0.0 and made.rows[-1].defect < max(near.defect, _FEW_DEFECTS):
            return made
        tried.append(f"{words}: {said}")
        if best is None or (made.rows and (not best.rows or made.rows[-1].defect < best.rows[-1].defect)):
            best = made
    assert best is not None
    raise NoJointFitError(tried, best, priors, hyper)


def _settle_along(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    prior: NoisePrior,
    say: Progress,
    begin: Begin | None,
) -> JointFit:
    """`joint_fit` along the record: the trajectory is kept between updates of the noise parameters."""
    theta, hyper = working(priors)[0], prior.median
    at: Sequence[Lifted] | None = None
    if begin is not None:
        theta, at, hyper = begin
    turns = 1 if at is None else 0  # noise parameters that come with a path are of a fit before
    for turn in range(turns + 1):

        def tell(row: along_record.Row, turn: int = turn) -> None:
            say((turn + 0.3) / (turns + 1), f"along the record {turn + 1}, {row}")

        near = _LAST_NEAR if turn == turns else _TURN_NEAR
        made = _along_record(flights, hyper, priors, theta, at, near, tell, begins=at is None)
        theta, at = made.theta, made.flights
        best = _optimum(made)
        if turn < turns:
            hyper, value = noise_evidence.maximise(flights, best.linear(flights), priors, hyper, prior, most=20)
            say((turn + 0.9) / (turns + 1), f"noise parameters: log evidence {-value:.1f}")
    value = noise_evidence.function_of(flights, best.linear(flights), priors, prior)(noise_evidence.to_vector(hyper))[0]
    return JointFit(best, hyper, value)


def carried_over(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    prior: NoisePrior,
    larger: JointFit,
    theta: Array,
    at: Sequence[Lifted],
) -> JointFit | None:
    """A fit of a smaller model at the place where a larger one has led, with the noise parameters of that one.

    The marginal mode of a model can lie a hundred standard deviations from its joint optimum; where one of a larger
    model is known, the way through the joint optimum of the smaller one and back is spared.

    Args:
        flights: Records, for the parameters of the smaller model.
        priors: Priors of its parameters.
        prior: Priors of the noise parameters.
        larger: The fit of the larger model.
        theta: Parameters of the smaller one there, working coordinates (P,).
        at: Start, process noise and path of every flight there.

    Returns:
        A place to seek the marginal mode from, no joint optimum; None where flights don't follow the record.
    """
    conditional = along_record.conditional_optimum(flights, larger.hyper, priors, theta, at)
    if conditional is None or not conditional.defect < _FEW_DEFECTS:
        return None
    found = replace(
        larger.optimum,
        theta=theta,
        flights=conditional.flights,
        covariance=scipy.linalg.inv(conditional.matrix),
        cost=conditional.cost,
    )
    evidence = noise_evidence.function_of(flights, found.linear(flights), priors, prior)
    return JointFit(found, larger.hyper, evidence(noise_evidence.to_vector(larger.hyper))[0])


def joint(
    flights: Sequence[FlightData],
    hyper: NoiseParameters,
    priors: Sequence[Prior],
    theta: Array,
    at: Sequence[Lifted] | None = None,
) -> Optimum:
    """The joint mode of parameters and disturbances for fixed noise parameters.

    Args:
        flights: Records.
        hyper: Noise parameters.
        priors: Priors of the parameters.
        theta: Where to begin, working coordinates (P,).
        at: Likewise, every flight; on the path of the record, or with undisturbed flights, where None.

    Raises:
        NoJointFitError: If no flight follows the record.
        FloatingPointError: If models without a path of the record don't fly at the start.
    """
    if all(f.path is not None for f in flights):
        return _optimum(_along_record(flights, hyper, priors, theta, at, _JOINT_NEAR, lambda row: None))
    unknowns = None if at is None else [x.unknowns for x in at]
    return optimum.fit(flights, hyper, priors, theta, unknowns, 0.01)


def _optimum(made: LiftedFit) -> Optimum:
    """Where a fit along the record ended."""
    rows = made.rows
    trace, last = tuple(row.cost for row in rows if row.level == 0.0), rows[-1]
    return Optimum(made.theta, made.flights, made.covariance, last.cost, made.converged, len(rows), last.step, trace)


class _Lacking(NamedTuple):
    """What the linear models about a point lack (`laplace.Lack`), by theta.

    Attributes:
        theta: The point (P,).
        slope: (P,).
        information: (P, P).
    """

    theta: Array
    slope: Array
    information: Array

    @classmethod
    def at(cls, made: Marginal) -> _Lacking:
        """At the centre of a posterior."""
        lack, inverse = laplace.lack(made), np.linalg.inv(np.asarray(made.scale))
        return cls(np.asarray(made.centre), inverse.T @ lack.slope, inverse.T @ lack.information @ inverse)


class _Placed(NamedTuple):
    """A point at rest on the way to the marginal mode, what the mean correction adds to the slope, and the step on."""

    theta: Array
    conditional: along_record.ConditionalOptimum
    correction: Array
    step: Array

    def onward(self, flights: Sequence[FlightData], hyper: NoiseParameters) -> tuple[Array, tuple[Lifted, ...]]:
        """Parameters and flights at the end of the step."""
        return self.theta + self.step, along_record.onward(flights, hyper, self.conditional, self.step)

    def rise(self, theta: Array, conditional: along_record.ConditionalOptimum) -> float:
        """By how much minus the marginal log density is greater at another point, the mean correction linear."""
        return conditional.marginal - self.conditional.marginal + float(self.correction @ (theta - self.theta))


def marginal_mode(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    settled: JointFit,
    progress: Progress | None = None,
    most: int = _MODE_STEPS,
    near: float = _NEAR,
) -> Optimum:
    """Mode of the marginal posterior, from the joint mode: minimises cost, log determinant and mean correction.

    The mode is often five and more standard errors away. In between, the marginal density may be nearly flat, which the
    Gauss-Newton matrix of the cost doesn't show: it contains neither the curvature of the determinant nor that of the
    residuals, and its steps become short long before the mode. So steps are corrected by the change of the gradient
    over earlier ones (`quasi_newton`), and the gradient is taken at the conditional mode of start and disturbances. A
    remaining distance below 0.2 standard deviations is left to the sampler, which is exact.

    Args:
        flights: Records.
        priors: Priors of the parameters.
        settled: Where to begin, and the noise parameters.
        progress: Progress callback: share done and words.
        most: Most steps.
        near: Length of the last step, in standard deviations.

    Returns:
        The mode, start and process noise at their best for it; `converged` is false where steps did not become short.
    """
    say = progress or (lambda share, words: None)
    begun, hyper, distance = settled.optimum, settled.hyper, np.inf
    theta, places, covariance = begun.theta, begun.flights, begun.covariance
    bends: list[tuple[Array, Array]] = []
    last: tuple[Array, Array] | None = None
    lacking: _Lacking | None = None
    before: _Placed | None = None
    turn = halvings = 0
    while turn < most:
        conditional = along_record.conditional_optimum(flights, hyper, priors, theta, places)
        try:
            if conditional is None:
                raise FloatingPointError(
                    "a step of the flights at the conditional optimum, or its derivative, is not finite"
                )
            if before is not None and halvings < _HALVINGS and before.rise(theta, conditional) > _RISE:
                raise FloatingPointError("a step towards the marginal mode lost the record")
            covariance = scipy.linalg.inv(conditional.matrix)
            best = replace(begun, theta=theta, flights=conditional.flights, covariance=covariance)
            made = marginalise(flights, hyper, priors, best)
            if lacking is None or length(theta - lacking.theta, covariance) > _SAME_SLOPE:
                lacking = _Lacking.at(made)
        except FloatingPointError:
            if before is None or halvings == _HALVINGS:
                raise
            halvings, before = halvings + 1, before._replace(step=0.5 * before.step)
            theta, places = before.onward(flights, hyper)
            continue
        turn, halvings = turn + 1, 0
        covariance = scipy.linalg.inv(conditional.matrix + lacking.information)
        correction = mean_correction_slope(made)
        slope = conditional.gradient + lacking.slope + correction
        if last is not None:
            bends.append((theta - last[0], slope - last[1]))
        step, last = secant_step(slope, covariance, bends), (theta, slope)
        distance = length(step, covariance)
        say((turn - 1) / most, f"marginal mode: cost {conditional.cost:.2f}, step {distance:.3f} standard deviations")
        before = _Placed(theta, conditional, correction, step)
        theta, places = before.onward(flights, hyper)
        if distance < near:
            break
    if before is not None and distance > _TRUSTED:  # where that step leads nobody has looked
        theta, places = before.theta, before.conditional.flights
    converged = begun.converged and distance < near
    return replace(begun, theta=theta, flights=places, covariance=covariance, converged=converged)


def marginal_fit(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    prior: NoisePrior,
    settled: JointFit,
    progress: Progress | None = None,
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
    candidates = [hyper]
    if np.max(np.abs(scale @ slope @ moved) / np.linalg.norm(scale, axis=1)) <= _FAR:
        candidates = [
            jax.tree.map(np.asarray, noise_evidence.from_vector(noise_evidence.to_vector(hyper) + moved, hyper)),
            hyper,
        ]
    began = JointFit(replace(best, converged=settled.optimum.converged), hyper, value)
    best, hyper, made, lost, seen = _last(
        flights, priors, began, candidates, lambda share, words: say(0.8 + 0.2 * share, words)
    )
    wrong = _determinant_error(made)
    slope = scipy.linalg.solve_triangular(np.asarray(made.scale), scale @ slope, lower=True)
    effect = NoiseEffect(slope, *noise_parameter_spread(made, known))
    return LaplaceFit(best, hyper, made, value, known, effect, wrong, seen, lost)


def _determinant_error(made: Marginal) -> float:
    """Error of Laplace's approximation, always at the same points, so that decisions do not depend on a seed."""
    return laplace.error(made, 4, stream(0, "points of the log determinant"))


def _last(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    began: JointFit,
    candidates: Sequence[NoiseParameters],
    progress: Progress | None = None,
) -> tuple[Optimum, NoiseParameters, Marginal, tuple[str, ...], Profile]:
    """The mode under the first noise parameters that lead to one, the posterior, corrections left out, the density.

    A point that turns out to lie beside the mode, once what the linear models lack is known, is left for it.

    Raises:
        FitError: If none does.
        FloatingPointError: If flights fail on the way under the last of them.
    """
    say = progress or (lambda share, words: None)
    failed: Exception = ValueError("no noise parameters")
    for hyper in candidates:
        try:
            start = JointFit(began.optimum, hyper, began.evidence)
            here = marginal_mode(flights, priors, start, lambda share, words: say(0.3 * share, words))
            found = []
            for move in range(1 + _MOVES):
                near = marginalise(flights, hyper, priors, here)
                say(0.3 + 0.5 * move / (1 + _MOVES), f"log determinant along the axes, place {move + 1}")
                found.append((here, *_corrected(near)))
                if _away(found[-1][3]) < _AT_MODE:
                    break
                here = _ahead(near, here, found[-1][3])
        except FloatingPointError as error:
            failed = error
            continue
        best, made, lost, ahead, step = min(found, key=lambda one: _away(one[3]))
        if step and _determinant_error(made) > _DETERMINANT:
            say(0.8, "log determinant between all axes")
            made, there = laplace.corrected(made, step, crossed=len(priors))
            ahead = ahead if there is None else there
        away = _away(ahead)
        seen = max((profile(made), profile(made, ahead)), key=lambda one: (one.is_mode, one.worst))
        if seen.is_mode and away < _BESIDE_MODE:
            lost = lost if hyper is candidates[0] else (*lost, _LOST_MEAN)
            return replace(best, converged=began.optimum.converged), hyper, made, lost, seen
        why = (
            f"after {len(found)} steps towards it the mode is still off by {away:.2g} standard deviations, root mean "
            f"square of all axes, and less than {_BESIDE_MODE:g} is wanted"
            if seen.is_mode
            else f"one standard deviation away from it the log density falls by {seen.worst:.3g}, about 0.5 is expected"
        )
        failed = FitError(f"the search for the mode of the marginal posterior did not end at one: {why}")
    raise failed


def _away(step: Array) -> float:
    """Root mean square of a step in standard coordinates."""
    return float(np.sqrt(np.mean(step**2)))


def _ahead(near: Marginal, best: Optimum, step: Array) -> Optimum:
    """The point a step in standard coordinates away."""
    shift = np.asarray(near.scale) @ step
    pairs = zip(near.flights, near.along, strict=True)
    flights = tuple(place_at(flight, along, jnp.asarray(shift)) for flight, along in pairs)
    return replace(best, theta=best.theta + shift, flights=flights)


def _corrected(made: Marginal) -> tuple[Marginal, tuple[str, ...], Array, float]:
    """The posterior with the corrections that can be trusted about a point, which had to be left out, and a way on.

    Returns:
        The posterior; what is lost; and a step in standard coordinates to its mode, or, where it has none, to the best
        of the places at which the density was looked at; and how far beside the point Laplace's approximation was
        taken, 0 where it has no part in it.

    Raises:
        FloatingPointError: If flights fail beside the point.
    """
    plain: Marginal | None = None
    failed: FloatingPointError | None = None
    for step in _BESIDE:
        try:
            one, ahead = laplace.corrected(made, step)
        except FloatingPointError as error:
            failed = error
            continue
        if ahead is not None:
            return one, (), ahead, step
        plain = plain or replace(one, bend=Quadratic.none(len(one.bend.slope)))
    if plain is None:
        assert failed is not None
        raise failed
    seen = profile(plain)
    fall = np.where(np.isfinite(seen.fall), seen.fall, np.inf)
    axis, place = np.unravel_index(np.argmin(fall), fall.shape)
    ahead = PLACES[place] * seen.direction[axis] * float(fall[axis, place] < 0.0)
    return plain, (_LOST_BEND,), ahead, 0.0


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
