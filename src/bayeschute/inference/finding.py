"""From data and priors to the marginal posterior: joint optimum, noise parameters, mode, log determinant."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import jax
import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bayeschute.air.vector import Component
from bayeschute.errors import FitError
from bayeschute.inference import determinant, evidence, lifted
from bayeschute.inference import map as optimum
from bayeschute.inference.evidence import HyperPrior
from bayeschute.inference.fit_checks import PLACES, Profile, profile
from bayeschute.inference.following import follow
from bayeschute.inference.law_effect import LawEffect, law_slope, law_spread
from bayeschute.inference.lifted import Lifted, LiftedFit
from bayeschute.inference.map import Optimum
from bayeschute.inference.marginal import Marginal, gap_slope, marginalise
from bayeschute.inference.priors import Prior, working
from bayeschute.inference.quasi_newton import length, secant_step
from bayeschute.inference.target import FlightData, Hyper, Linear, Unknowns, course, linearise

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]
HORIZONS = (
    0.2,
    0.5,
    1.0,
)  # shares fitted in turn: an unstable pendulum far from its optimum is lost late in the record
_SMALL_STEPS = tuple(0.1 * i for i in range(1, 11))  # where those lead astray
_MOST, _MOST_SMALL = 12, 40  # most iterations of a fit to an opening, and to one of the small steps
_MODE_STEPS, _NEAR = 16, 0.2  # most steps to the marginal mode; length of the last, in standard deviations
_SMALL_LEVELS = (5.0, 3.0, 1.7, 1.0, 0.6, 0.3, 0.17, 0.1, 0.05, 0.02, 0.0)  # where the usual ones don't do
_FEW_DEFECTS = 0.02  # of the last level's slack, at which single shooting can go on
_TURN_NEAR = lifted.Near(20.0, np.inf, 0.05)  # end of a turn
_JOINT_NEAR = lifted.Near(0.1, 0.1, _FEW_DEFECTS)  # and of the last
_LOOSE = 3.0  # times the prior medians of all standard deviations, until noise parameters are found
_APART = 5.0  # log density by which a simulation may be worse than the path that it should follow
_POLISH = 10  # most steps of single shooting after the fit along the record
_TURNS, _REST = 6, 0.4  # most turns of noise parameters and mode; a step of the mode after which there is no other
_RISE = 20.0  # of minus the marginal log density over a step, beyond which half of it is tried
_SAME_SLOPE = 0.5  # standard deviations within which the log determinant's slope is taken for the same
_MODE_TURN = 2  # most steps of the mode in each of them
_FOLLOWING = (1.0, 0.3)  # steps [standard deviations] at which it is looked how start and disturbances follow
_DETERMINANT = 0.2  # error of the log determinant's polynomial beyond which it gets all products
_LOST_PULL = (
    "how start and disturbances change their effect with the parameters: along some axis it outweighs the density"
)
_BREAKS = "no flight of the model follows the record: steps along the best path break the equations of motion"
_STRAYS = (
    "a path was found that obeys the equations of motion, but the flight is so unstable there that a simulation from "
    "its start strays from the record; fit a shorter window, or split the record in several flights"
)
_LOST_MEAN = "that the mean of the noise parameters lies beside their most probable values: no mode was found there"
_CLIMBS = 1  # times that a search for the mode is begun again where the density is seen to be higher
_FAR = 1.0  # standard deviations by which noise parameters at their mean may move a parameter
_LEAST_OPENING = 0.05  # share of the record at which the first part is shortened no more
_LEAST_GAIN = 0.05  # share of the record by which the fitted part must at least be lengthened


@dataclass(frozen=True)
class Found:
    """The optimum, its noise parameters, the marginal posterior there, and how well the noise parameters are known.

    Attributes:
        optimum: Mode of the marginal posterior, with start and shocks there.
        hyper: Noise parameters: the means of their logarithms, or the most probable ones (see `conclude`).
        marginal: The marginal posterior about the optimum.
        evidence: Minus the log evidence of the most probable noise parameters, up to a constant.
        law_covariance: Of the logarithms of the noise parameters (V, V).
        law_effect: How the parameters' conditional posterior follows those logarithms.
        determinant_error: Root mean square error of the log determinant's polynomial over the posterior.
        profile: The density along the axes about the mode.
        lost: Corrections that were left out since they can't be trusted, in words.
    """

    optimum: Optimum
    hyper: Hyper
    marginal: Marginal
    evidence: float
    law_covariance: Array
    law_effect: LawEffect
    determinant_error: float
    profile: Profile
    lost: tuple[str, ...] = ()


def _until(flight: FlightData, share: float) -> FlightData:
    """The flight with data beyond a share of its samples absent; shapes stay, so compiled functions serve."""
    seen = np.array(flight.present)
    seen[int(np.ceil(share * len(seen))) :] = False
    return replace(flight, present=seen)


def _linearised(flights: Sequence[FlightData], hyper: Hyper, best: Optimum) -> list[Linear]:
    pairs = zip(flights, best.unknowns, strict=True)
    return [linearise(f, best.theta, course(f, hyper, x)) for f, x in pairs]


Begin = tuple[Array, Sequence[Unknowns | Lifted] | None, Hyper]
"""Parameters, where every flight begins (None: on the path of its record), noise parameters."""


class UnsettledError(FitError):
    """A fit that ended without an optimum.

    Attributes:
        best: The fit along the record whose defects are least.
        priors: Of its parameters.
        hyper: Noise parameters of the turn.
    """

    def __init__(self, tried: Iterable[str], best: LiftedFit, priors: Sequence[Prior], hyper: Hyper) -> None:
        """Keep the best fit beside what a `FitError` tells."""
        self.best, self.priors, self.hyper = best, tuple(priors), hyper
        super().__init__(_STRAYS if self.obeys else _BREAKS, tried)

    @property
    def obeys(self) -> bool:
        """Whether that fit's path obeys the equations of motion: its simulation alone strays from there."""
        rows = self.best.rows
        return bool(rows) and rows[-1].level == 0.0 and rows[-1].defect < _FEW_DEFECTS


class Settled(NamedTuple):
    """The joint optimum over parameters and disturbances, its noise parameters, and minus the log evidence there."""

    optimum: Optimum
    hyper: Hyper
    evidence: float


def lengthened(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    hyper: Hyper,
    theta: Array,
    say: Progress,
    unknowns: Sequence[Unknowns] | None = None,
) -> tuple[Array, Sequence[Unknowns]]:
    """Parameters and unknowns that follow the whole record, found on longer and longer openings of it.

    Where what one opening told is lost before the end of the next, the next is shortened; so is the first where the
    flight that begins there fails within it. Where that doesn't help, an opening has led astray, and all begins anew in
    small steps, each fitted to its end.

    Args:
        flights: Records.
        priors: Priors of the parameters.
        hyper: Noise parameters, held.
        theta: Where to begin, working coordinates (P,).
        say: Called with a share done and words.
        unknowns: Where to begin, per flight; prior means where None.

    Returns:
        Parameters and unknowns near the optimum for the whole record.

    Raises:
        FloatingPointError: If neither helps.
    """
    todo, most, done, begin = list(HORIZONS), _MOST, 0.0, (theta, unknowns)
    while todo:
        share = todo[0]
        say(0.0, f"opening {100 * share:.0f} % of the record")
        seen = [_until(f, share) for f in flights]
        try:
            best = optimum.fit(seen, hyper, priors, theta, unknowns, tolerance=0.5, most=most, opening=share < 1.0)
        except FloatingPointError:
            if share - done >= (_LEAST_OPENING if done == 0.0 else 2.0 * _LEAST_GAIN):
                todo.insert(0, 0.5 * (done + share))
                continue
            if done == 0.0 or most == _MOST_SMALL:
                raise
            todo, most, done, (theta, unknowns) = list(_SMALL_STEPS), _MOST_SMALL, 0.0, begin
            continue
        theta, unknowns, done = best.theta, best.unknowns, todo.pop(0)
    assert unknowns is not None
    return theta, unknowns


def settle(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    prior: HyperPrior,
    rounds: int = 1,
    progress: Progress | None = None,
    begin: Begin | None = None,
) -> Settled:
    """Fit parameters, start, latent disturbances and noise parameters, by turns.

    Args:
        flights: Records.
        priors: Priors of the parameters.
        prior: Priors of the noise parameters.
        rounds: Turns of optimum and evidence before the last optimum.
        progress: Called with a share done and words.
        begin: Where to begin; at the prior means, on the path of the record, where None. Models without such a path
            begin with openings of the record.

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
        unknowns = [x.unknowns if isinstance(x, Lifted) else x for x in places] if places is not None else None
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
            linear = _linearised(flights, hyper, best)
            hyper, value = evidence.maximise(flights, linear, priors, hyper, prior, most=20 if turn == 0 else 12)
    return Settled(best, hyper, value)


def _looser(hyper: Hyper) -> Hyper:
    """Noise parameters whose noise and disturbances are stronger: with these a flight follows its record more easily.

    As a likelihood to a small power does, they leave more of the say to the priors and make a wrong path cheaper.
    """
    noise, laws = hyper.noise, (np.asarray(law, float) for law in hyper.laws)
    noise = replace(noise, white=_LOOSE * np.asarray(noise.white), correlated=_LOOSE * np.asarray(noise.correlated))
    return replace(hyper, noise=noise, laws=tuple(np.concatenate([_LOOSE * law[:1], law[1:]]) for law in laws))


def _placed(flight: FlightData, hyper: Hyper, theta: Array, place: Unknowns | Lifted) -> Lifted | None:
    """A place along the record; of unknowns alone, that of their simulation."""
    return place if isinstance(place, Lifted) else lifted.flown(flight, hyper, theta, place)


def _along_record(
    flights: Sequence[FlightData],
    hyper: Hyper,
    priors: Sequence[Prior],
    theta: Array,
    at: Sequence[Lifted] | None,
    near: lifted.Near,
    tell: Callable[[lifted.Row], None],
) -> LiftedFit:
    """A fit along the record whose path obeys the equations of motion, from where it is or from the record's path.

    What is fast is tried first, then what gets further. A fit that begins anew is one whose noise parameters are still
    to be found, so it begins with stronger noise than they say. One that goes on must end so near the equations of
    motion that its simulation follows the record too.

    Raises:
        UnsettledError: If defects are left whatever was tried.
    """
    whole, looser = (*lifted.LEVELS, 0.0), _looser(hyper)
    anew = "from the path of the record"
    begun: list[tuple[str, Hyper, Sequence[Lifted] | None, tuple[float, ...]]] = [
        (f"{anew}, noise stronger", looser, None, whole),
        (anew, hyper, None, whole),
        (f"{anew}, noise stronger, in smaller steps", looser, None, _SMALL_LEVELS),
    ]
    if at is not None:
        on = ("from the path of the turn before", hyper, at, (0.0,))
        begun = [on, (anew, hyper, None, whole), (f"{anew}, in smaller steps", hyper, None, _SMALL_LEVELS)]
    tried: list[str] = []
    best: LiftedFit | None = None
    for words, noise, places, levels in begun:
        made = lifted.descend(flights, noise, priors, theta, places, levels, near=near, progress=tell)
        said = f"{len(made.rows)} steps, the last {made.rows[-1] if made.rows else 'none: not finite'}"
        if made.rows and made.rows[-1].level == 0.0 and made.rows[-1].defect < max(near.defect, _FEW_DEFECTS):
            if at is None:
                return made
            made = lifted.tightened(flights, noise, priors, made)
            apart = optimum.total_cost(flights, noise, priors, made.theta, made.unknowns) - made.rows[-1].cost
            if apart < _APART:
                return made
            said += f"; simulated from its start it strays, by {apart:.3g} in cost"
        tried.append(f"{words}: {said}")
        if best is None or (made.rows and (not best.rows or made.rows[-1].defect < best.rows[-1].defect)):
            best = made
    assert best is not None
    raise UnsettledError(tried, best, priors, hyper)


def _settle_along(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    prior: HyperPrior,
    say: Progress,
    begin: Begin | None,
) -> Settled:
    """`settle` along the record: the path is kept from turn to turn, whatever the noise parameters become."""
    theta, hyper = working(priors)[0], prior.median
    at: Sequence[Lifted] | None = None
    if begin is not None:
        theta, places, hyper = begin
        if places is not None:
            known = [y for f, x in zip(flights, places, strict=True) if (y := _placed(f, hyper, theta, x)) is not None]
            at = known if len(known) == len(flights) else None
    turns = 1 if at is None else 0  # noise parameters that come with a path are of a fit before
    for turn in range(turns + 1):

        def tell(row: lifted.Row, turn: int = turn) -> None:
            say((turn + 0.3) / (turns + 1), f"along the record {turn + 1}, {row}")

        made = _along_record(flights, hyper, priors, theta, at, _JOINT_NEAR if turn == turns else _TURN_NEAR, tell)
        theta, at = made.theta, made.flights
        linear = [lifted.linear(f, x, lifted.along(f, theta, x)) for f, x in zip(flights, at, strict=True)]
        if turn < turns:
            hyper, value = evidence.maximise(flights, linear, priors, hyper, prior, most=20)
            say((turn + 0.9) / (turns + 1), f"noise parameters: log evidence {-value:.1f}")
    value = evidence.function_of(flights, linear, priors, prior)(evidence.to_vector(hyper))[0]

    def polish(iteration: int, cost: float, step: float) -> None:
        say(0.95, f"optimum: cost {cost:.2f}, step {step:.3f} standard errors")

    best = optimum.fit(flights, hyper, priors, theta, made.unknowns, _JOINT_NEAR.step, _POLISH, progress=polish)
    return Settled(best, hyper, value)


class _Placed(NamedTuple):
    """A point at rest on the way to the marginal mode: the slope of what the cost lacks, and the step from there."""

    best: Optimum
    rest: optimum.Relaxed
    tilt: Array
    step: Array

    def onward(self, flights: Sequence[FlightData], hyper: Hyper, priors: Sequence[Prior]) -> Optimum:
        """The end of the step: Gauss-Newton's, under the tilt that makes it this one."""
        towards = -self.rest.matrix @ self.step - self.rest.gradient
        return optimum.fit(flights, hyper, priors, self.best.theta, self.best.unknowns, 0.01, most=1, tilt=towards)

    def rise(self, theta: Array, cost: float) -> float:
        """By how much minus the marginal log density is greater at parameters of this cost, the tilt held."""
        return cost - self.rest.cost + float(self.tilt @ (theta - self.best.theta))


def _at_rest(
    flights: Sequence[FlightData], hyper: Hyper, priors: Sequence[Prior], best: Optimum
) -> optimum.Relaxed | None:
    """Start and shocks at rest at parameters; None where no simulation flies there."""
    try:
        return optimum.relaxed(flights, hyper, priors, best.theta, best.unknowns)
    except FloatingPointError:
        return None


def marginal_mode(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    settled: Settled,
    progress: Progress | None = None,
    most: int = _MODE_STEPS,
) -> Optimum:
    """From the joint optimum to where cost, log determinant and what the gap adds are least together.

    The mode is often five and more standard errors away. Between, the marginal density may be nearly flat, which the
    cost's Gauss-Newton matrix doesn't see: it knows nothing of the determinant's curvature or of how the cost bends,
    and its steps grow short long before the mode. So steps are corrected by how the slope has changed over earlier
    ones (`quasi_newton`), and the slope is taken with start and shocks at rest. A rest of less than 0.2 standard
    deviations is left to the sampler, which is exact.

    Args:
        flights: Records.
        priors: Priors of the parameters.
        settled: Where to begin, and the noise parameters.
        progress: Called with a share done and words.
        most: Most steps.

    Returns:
        The mode, start and shocks at their best for it; `converged` is false where steps did not become short.
    """
    say = progress or (lambda share, words: None)
    best, hyper, distance = settled.optimum, settled.hyper, np.inf
    bends: list[tuple[Array, Array]] = []
    last: tuple[Array, Array] | None = None
    told: tuple[Array, Array] | None = None  # the log determinant's slope, and where
    before: _Placed | None = None
    for turn in range(most):
        say(turn / most, "log determinant")
        rest = _at_rest(flights, hyper, priors, best)
        if before is not None and (rest is None or before.rise(best.theta, rest.cost) > _RISE):
            before = before._replace(step=0.5 * before.step)  # a step that lost the record
            best = before.onward(flights, hyper, priors)
            continue
        if rest is None:
            raise FloatingPointError("the simulation at the conditional optimum, or its derivative, is not finite")
        best = replace(best, unknowns=rest.unknowns, covariance=scipy.linalg.inv(rest.matrix))
        made = marginalise(flights, hyper, priors, best)
        if told is None or length(best.theta - told[0], best.covariance) > _SAME_SLOPE:
            told = best.theta, scipy.linalg.solve_triangular(np.asarray(made.scale).T, determinant.slope(made))
        tilt = told[1] + gap_slope(made)
        slope = rest.gradient + tilt
        if last is not None:
            bends.append((best.theta - last[0], slope - last[1]))
        step, last = secant_step(slope, best.covariance, bends), (best.theta, slope)
        distance = length(step, best.covariance)
        before = _Placed(best, rest, tilt, step)
        best = before.onward(flights, hyper, priors)
        if distance < _NEAR or np.array_equal(best.theta, last[0]):
            break
    return replace(best, converged=settled.optimum.converged and distance < _NEAR)


def conclude(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    prior: HyperPrior,
    settled: Settled,
    progress: Progress | None = None,
) -> Found:
    """Go from the joint optimum to the mode of the marginal posterior, and set that up.

    The joint optimum over parameters and disturbances is not where the marginal posterior of the parameters is
    greatest: see `marginal_mode`. Nor are the noise parameters of greatest evidence the same at both places: they are
    sought again at the mode, and the mode with them, until the mode rests. Then they are put at the mean of their
    posterior (`evidence.mean_less_mode`), and the mode follows; not so where that would move a parameter by more than
    its standard deviation, farther than an expansion about the mode is good for.

    Args:
        flights: Records.
        priors: Priors of the parameters.
        prior: Priors of the noise parameters.
        settled: From `settle`.
        progress: Called with a share done and words.
    """
    say = progress or (lambda share, words: None)
    best = marginal_mode(flights, priors, settled, lambda share, words: say(0.3 * share, words))
    hyper, value = settled.hyper, settled.evidence
    for turn in range(_TURNS):
        say(0.3 + 0.2 * turn / _TURNS, f"noise parameters at the mode {turn + 1}")
        made = marginalise(flights, hyper, priors, best)
        hyper, value = evidence.maximise(flights, _linear(made), priors, hyper, prior, 12, _gaps(made))
        before, best = best, marginal_mode(flights, priors, Settled(best, hyper, value), most=_MODE_TURN)
        if length(best.theta - before.theta, before.covariance) < _REST:
            break
    made = marginalise(flights, hyper, priors, best)
    say(0.5, "uncertainty of the noise parameters")
    slope = law_slope(made)
    known = evidence.law_covariance(flights, _linear(made), priors, hyper, prior, slope, _gaps(made))
    moved = evidence.mean_less_mode(flights, _linear(made), priors, hyper, prior, known, _gaps(made))
    scale = np.asarray(made.scale)
    laws = [hyper]
    if np.max(np.abs(scale @ slope @ moved) / np.linalg.norm(scale, axis=1)) <= _FAR:
        laws = [jax.tree.map(np.asarray, evidence.from_vector(evidence.to_vector(hyper) + moved, hyper)), hyper]
    say(0.8, "log determinant at the mode")
    began = Settled(replace(best, converged=settled.optimum.converged), hyper, value)
    best, hyper, made, lost = _last(flights, priors, began, laws)
    wrong = determinant.error(made, 4, np.random.default_rng(0))
    if wrong > _DETERMINANT:
        made = replace(made, determinant=determinant.around(made, crossed=len(priors)))
        wrong = determinant.error(made, 4, np.random.default_rng(0))
    slope = scipy.linalg.solve_triangular(np.asarray(made.scale), scale @ slope, lower=True)
    effect = LawEffect(slope, *law_spread(made, known))
    return Found(best, hyper, made, value, known, effect, wrong, profile(made), lost)


class _NoModeError(FitError):
    """A point beside the mode; `seen` is the density about it without the corrections that follow theta."""

    def __init__(self, reason: str, seen: Profile) -> None:
        super().__init__(reason)
        self.seen = seen


def _last(
    flights: Sequence[FlightData], priors: Sequence[Prior], began: Settled, laws: Sequence[Hyper]
) -> tuple[Optimum, Hyper, Marginal, tuple[str, ...]]:
    """The mode under the first noise parameters that lead to one, the posterior there, and corrections left out.

    Raises:
        FitError: If none does.
        FloatingPointError: If simulations fail on the way under the last of them.
    """
    failed: Exception = ValueError("no noise parameters")
    for hyper in laws:
        here: Optimum | None = began.optimum
        for _ in range(1 + _CLIMBS):
            assert here is not None
            try:
                best = marginal_mode(flights, priors, Settled(here, hyper, began.evidence))
                near = marginalise(flights, hyper, priors, best)
                made, lost = _corrected(near, best.converged)
            except _NoModeError as error:
                failed, here = error, _higher(near, best, error.seen)
            except FloatingPointError as error:
                failed, here = error, None
            else:
                return best, hyper, made, lost if hyper is laws[0] else (*lost, _LOST_MEAN)
            if here is None:
                break
    raise failed


def _higher(near: Marginal, best: Optimum, seen: Profile) -> Optimum | None:
    """The best of the places at which a density that has no mode at its centre was looked at; None: the centre."""
    fall = np.where(np.isfinite(seen.fall), seen.fall, np.inf)
    axis, place = np.unravel_index(np.argmin(fall), fall.shape)
    if fall[axis, place] >= 0.0:
        return None
    shift = np.asarray(near.scale) @ (PLACES[place] * seen.direction[axis])
    moved = (
        jax.tree.map(lambda a, by: np.asarray(a + by @ shift), along.unknowns, along.unknowns_slope)
        for along in near.along
    )
    return replace(best, theta=best.theta + shift, unknowns=tuple(moved))


def _corrected(made: Marginal, converged: bool) -> tuple[Marginal, tuple[str, ...]]:
    """The posterior with the corrections that can be trusted about its mode, and which had to be left out.

    Raises:
        FitError: If the point is no mode with or without them, and its search did not end there either.
    """
    tried = []
    for step in _FOLLOWING:
        try:
            one = follow(made, step)
            one = replace(one, determinant=determinant.around(one))
        except FloatingPointError:
            continue
        tried.append(profile(one))
        if tried[-1].is_mode:
            return one, ()
    plain = replace(made, determinant=determinant.around(made))
    tried.append(profile(plain))
    if not (tried[-1].is_mode or converged):
        falls = ", ".join(f"{one.worst:.3g}" for one in tried)
        raise _NoModeError(
            "the search for the mode of the marginal posterior did not end at one: one standard deviation beside it "
            f"the log density falls by {falls} at least, with its corrections in turn and without; about 0.5 is wanted",
            tried[-1],
        )
    return plain, (_LOST_PULL,)


def _linear(made: Marginal) -> list[Linear]:
    return [along.linear for along in made.along]


def _gaps(made: Marginal) -> list[Component]:
    return [along.gap for along in made.along]


def find(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    prior: HyperPrior,
    rounds: int = 1,
    progress: Progress | None = None,
) -> Found:
    """The marginal posterior of the parameters: `settle`, then `conclude`."""
    say = progress or (lambda share, words: None)
    settled = settle(flights, priors, prior, rounds, lambda share, words: say(0.7 * share, words))
    return conclude(flights, priors, prior, settled, lambda share, words: say(0.7 + 0.3 * share, words))
