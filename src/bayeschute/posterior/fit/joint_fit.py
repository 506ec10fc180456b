"""Joint mode of the parameters, start and latent disturbances, with the noise parameters of greatest evidence there."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.errors import FitError
from bayeschute.likelihood.joint import FlightData, Lifted, NoiseParameters, Unknowns
from bayeschute.likelihood.priors import Prior, working
from bayeschute.posterior import joint_mode as optimum
from bayeschute.posterior import noise_evidence
from bayeschute.posterior.along_record import lifted_fit
from bayeschute.posterior.along_record.lifted_fit import LiftedFit
from bayeschute.posterior.along_record.slack_level import LEVELS, Near
from bayeschute.posterior.fit.continuation import Progress, lengthened
from bayeschute.posterior.joint_mode import Optimum
from bayeschute.posterior.noise_evidence import Evidence, NoisePrior

Array = NDArray[np.float64]
_SMALL_LEVELS = (5.0, 3.0, 1.7, 1.0, 0.6, 0.3, 0.17, 0.1, 0.05, 0.02, 0.0)  # where the usual ones don't do
FEW_DEFECTS = 0.02
"""Defects over the last level's slack at which a path is a flight of the model: single shooting can go on from it."""
_FALL = 10.0  # of the marginal log density, from where no optimum of the cost is worth a step
_TURN_NEAR = Near(20.0, np.inf, 0.05, _FALL)  # end of a turn
_LAST_NEAR = Near(1.0, 0.5, FEW_DEFECTS, _FALL)  # and of the last: the marginal mode is sought from there
_JOINT_NEAR = Near(0.1, 0.1, FEW_DEFECTS)  # where joint optima are compared
_NOISE_STEPS = (4, 20)  # most steps of the noise parameters, turn by turn: the first are of too loose a path
_LOOSE = (3.0, 10.0, 30.0)  # times the prior medians of all standard deviations, until noise parameters are found
_BREAKS = "no flight of the model follows the record: steps along the best path break the equations of motion"


Begin = tuple[Array, Sequence[Lifted] | None, NoiseParameters]
"""Parameters, where every flight begins (None: on the path of its record), noise parameters."""


class NoFitError(FitError):
    """A fit that ended without an optimum, and the best place it came to.

    Attributes:
        best: The fit along the record whose defects are least, or where the search for the marginal mode ended.
        priors: Of its parameters.
        hyper: Noise parameters there.
    """

    def __init__(
        self,
        reason: str,
        tried: Iterable[str],
        best: LiftedFit | Optimum,
        priors: Sequence[Prior],
        hyper: NoiseParameters,
    ) -> None:
        """A `FitError` with the best fit found."""
        self.best, self.priors, self.hyper = best, tuple(priors), hyper
        super().__init__(reason, tried)


class JointFit(NamedTuple):
    """The joint optimum over parameters and disturbances, its noise parameters, and minus the log evidence there."""

    optimum: Optimum
    hyper: NoiseParameters
    evidence: float


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
            evidence = noise_evidence.function_of(flights, best.linear(flights), priors, prior)
            hyper, value = noise_evidence.maximise(evidence, hyper, prior, most=20 if turn == 0 else 12)
    return JointFit(best, hyper, value)


def _looser(hyper: NoiseParameters, times: float) -> NoiseParameters:
    """Noise parameters whose noise and disturbances are stronger: with these a flight follows its record more easily.

    As a likelihood to a small power does, they leave more of the say to the priors and make a wrong path cheaper. A
    model without disturbances, whose noise stands for gusts, asks for ten times the noise that its instruments have.
    """
    return hyper.with_deviations(lambda sd: times * sd)


class _Way(NamedTuple):
    """A way to fit along the record: its words, noise parameters, where flights begin (None: the record), slacks."""

    words: str
    hyper: NoiseParameters
    at: Sequence[Lifted] | None
    levels: tuple[float, ...]


def _from_path(hyper: NoiseParameters, at: Sequence[Lifted]) -> _Way:
    return _Way("from the path of the turn before", hyper, at, (0.0,))


def _from_record(hyper: NoiseParameters, also: str = "") -> list[_Way]:
    """What is fast first, then what gets further."""
    words = "from the path of the record"
    return [
        _Way(words + also, hyper, None, (*LEVELS, 0.0)),
        _Way(f"{words}, in smaller steps{also}", hyper, None, _SMALL_LEVELS),
    ]


def _along_record(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    theta: Array,
    several: Sequence[Sequence[_Way]],
    near: Near,
    tell: Callable[[lifted_fit.Row], None],
) -> list[Optimum]:
    """Where fits along the record lead: of every list of ways, the first that leaves no defects, if one does.

    In small steps: along the path of a record risers jolt, and go slack where long steps overshoot.

    Raises:
        NoFitError: If all ways leave some.
    """
    flights = [flight.in_small_steps() for flight in flights]
    found, tried = list[Optimum](), list[tuple[_Way, LiftedFit]]()
    for ways in several:
        for way in ways:
            made = lifted_fit.descend(flights, way.hyper, priors, theta, way.at, way.levels, near=near, progress=tell)
            tried.append((way, made))
            if made.rows and made.rows[-1].level == 0.0 and made.rows[-1].defect < max(near.defect, FEW_DEFECTS):
                found.append(_optimum(made))
                break
    if not found:
        way, best = min(tried, key=lambda one: one[1].rows[-1].defect if one[1].rows else np.inf)
        raise NoFitError(_BREAKS, [_in_words(*one) for one in tried], best, priors, way.hyper)
    return found


def _in_words(way: _Way, made: LiftedFit) -> str:
    return f"{way.words}: {len(made.rows)} steps, the last {made.rows[-1] if made.rows else 'none: not finite'}"


def _settle_along(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    prior: NoisePrior,
    say: Progress,
    begin: Begin | None,
) -> JointFit:
    """`joint_fit` along the record: the trajectory is kept between updates of the noise parameters.

    The first turn has stronger noise than the prior medians, and may come to another path than that of greatest
    density. So the second begins there and on the record's path again, and goes on where the evidence is greater.
    """
    theta, hyper = working(priors)[0], prior.median
    at: Sequence[Lifted] | None = None
    if begin is not None:
        theta, at, hyper = begin
    begins = at is None  # noise parameters that come with a path are of a fit before
    turns = len(_NOISE_STEPS) if begins else 0
    scale: Array | None = None

    def evidence(best: Optimum) -> Evidence:
        return noise_evidence.function_of(flights, best.linear(flights), priors, prior)

    def value_at(best: Optimum) -> float:
        return evidence(best)(noise_evidence.to_vector(hyper))[0]

    for turn in range(turns + 1):

        def tell(row: lifted_fit.Row, turn: int = turn) -> None:
            say((turn + 0.3) / (turns + 1), f"along the record {turn + 1}, {row}")

        near, anew = _LAST_NEAR if turn == turns else _TURN_NEAR, _from_record(hyper)
        if at is None:
            first, *further = [
                way
                for times in _LOOSE
                for way in _from_record(_looser(hyper, times), f", noise {times:g} times as strong")
            ]
            several = [[first, anew[0], *further]]
        elif turn == 1:
            several = [[_from_path(hyper, at)], anew]
        else:
            several = [[_from_path(hyper, at), *anew]]
        found = _along_record(flights, priors, theta, several, near, tell)
        best = min(found, key=value_at) if len(found) > 1 else found[0]
        theta, at = best.theta, best.flights
        if turn < turns:
            there = evidence(best)
            if scale is None:
                scale = noise_evidence.scales(there, hyper, prior)
            hyper, value = noise_evidence.maximise(there, hyper, prior, _NOISE_STEPS[turn], scale)
            say((turn + 0.9) / (turns + 1), f"noise parameters: log evidence {-value:.1f}")
    return JointFit(best, hyper, value_at(best))


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
        NoFitError: If no flight follows the record.
        FloatingPointError: If models without a path of the record don't fly at the start.
    """
    if all(f.path is not None for f in flights):
        ways = _from_record(hyper) if at is None else [_from_path(hyper, at), *_from_record(hyper)]
        return _along_record(flights, priors, theta, [ways], _JOINT_NEAR, lambda row: None)[0]
    unknowns = None if at is None else [x.unknowns for x in at]
    return optimum.fit(flights, hyper, priors, theta, unknowns, 0.01)


def _optimum(made: LiftedFit) -> Optimum:
    """Where a fit along the record ended."""
    rows = made.rows
    trace, last = tuple(row.cost for row in rows if row.level == 0.0), rows[-1]
    return Optimum(made.theta, made.flights, made.covariance, last.cost, made.converged, len(rows), last.step, trace)
