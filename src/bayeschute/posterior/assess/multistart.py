"""Multistart check of the joint optimum: several starts, the best is kept, differences are reported.

Every start ends with different noise parameters, and somewhat short of its optimum. So every optimum, the best one too,
is first re-optimised under the noise parameters of the best: only then are the optima and their densities those of one
function.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.errors import FitError
from bayeschute.core.random import stream
from bayeschute.likelihood.joint import FlightData
from bayeschute.likelihood.priors import Prior, factor, working
from bayeschute.posterior.fit.continuation import Progress
from bayeschute.posterior.fit.joint_fit import JointFit, joint, joint_fit
from bayeschute.posterior.joint_mode import Optimum
from bayeschute.posterior.noise_evidence import NoisePrior

Array = NDArray[np.float64]
SPREAD = 0.5  # of the starts about the prior means, in standard deviations of the priors
NEAR = 0.1  # standard errors within which optima count as one
CLEARLY = 5.0  # log density by which another optimum must be worse to be of no concern: less than 1 % of the mass


class Start(NamedTuple):
    """Where a start led.

    Attributes:
        number: 0 is the prior means; negative numbers are begins of another kind.
        settled: The joint optimum; None where a simulation was not finite.
        why: Reason of a failure; empty if there was none.
    """

    number: int
    settled: JointFit | None
    why: str = ""


class Told(NamedTuple):
    """Another optimum, compared with the one that is kept.

    Attributes:
        number: Of its start.
        why: Reason of a failure; empty if there was none. The numbers below are then NaN.
        converged: Whether its optimum converged, with its own noise parameters.
        evidence: Minus its log evidence up to a constant, less that of the one kept.
        away: Its largest distance from the one kept, in that one's standard errors.
        parameter: The parameter that differs most.
        worse: By how much its log density is less, noise parameters those of the one kept.
    """

    number: int
    why: str
    converged: bool
    evidence: float
    away: float
    parameter: str
    worse: float


def begin(priors: Sequence[Prior], number: int, seed: int, spread: float = SPREAD) -> Array:
    """Parameters of a start (P,), working coordinates: the prior means for number 0, else a draw about them.

    Args:
        priors: Of all parameters.
        number: Of the start.
        seed: Of all starts.
        spread: Of the draws, in standard deviations of the priors; 1: draws from the prior.
    """
    centre = working(priors)[0]
    if number == 0:
        return centre
    rng = stream(seed, "start of a fit", number)
    return np.asarray(centre + spread * factor(priors) @ rng.standard_normal(centre.size))


def settle_from(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    prior: NoisePrior,
    number: int,
    seed: int,
    rounds: int = 1,
    progress: Progress | None = None,
    spread: float = SPREAD,
) -> Start:
    """Joint fit from one start, as `joint_fit`.

    Args:
        flights: Records.
        priors: Priors of the parameters.
        prior: Priors of the noise parameters.
        number: Of the start, see `begin`.
        seed: Of all starts.
        rounds: Turns of optimum and evidence.
        progress: Called with a share done and words.
        spread: See `begin`.

    Returns:
        The start; a simulation that is not finite is recorded in it, not raised.
    """
    say = progress or (lambda share, words: None)
    try:
        if number == 0:
            return Start(0, joint_fit(flights, priors, prior, rounds, say))
        theta = begin(priors, number, seed, spread)
        return Start(number, joint_fit(flights, priors, prior, rounds, say, (theta, None, prior.median)))
    except (FloatingPointError, FitError) as error:
        return Start(number, None, str(error))


def best_of(tried: Sequence[Start]) -> Start:
    """The start of greatest evidence, among those that converged where any did.

    Raises:
        FloatingPointError: If every start failed.
    """
    good = [s for s in tried if s.settled is not None]
    if not good:
        raise FloatingPointError(f"{tried[0].why} (none of {len(tried)} starts led anywhere)")

    def rank(start: Start) -> tuple[bool, float]:
        assert start.settled is not None
        return not start.settled.optimum.converged, start.settled.evidence

    return min(good, key=rank)


def compare(
    flights: Sequence[FlightData], priors: Sequence[Prior], best: Start, others: Sequence[Start]
) -> tuple[Told, ...]:
    """How the other optima differ from the best.

    Args:
        flights: Records.
        priors: Priors of the parameters.
        best: From `best_of`.
        others: The other starts.
    """
    assert best.settled is not None
    hyper, evidence = best.settled.hyper, best.settled.evidence

    def refined(settled: JointFit) -> Optimum:
        return joint(flights, hyper, priors, settled.optimum.theta, settled.optimum.flights)

    kept: Optimum | str
    try:
        kept = refined(best.settled)
    except (FloatingPointError, FitError) as error:
        kept = f"the optimum that is kept: {error}"

    def row(start: Start) -> Told:
        if start.settled is None:
            return Told(start.number, start.why, False, np.nan, np.nan, "", np.nan)
        converged, more = start.settled.optimum.converged, start.settled.evidence - evidence
        if isinstance(kept, str):
            return Told(start.number, kept, converged, more, np.nan, "", np.nan)
        try:
            moved = refined(start.settled)
        except (FloatingPointError, FitError) as error:
            return Told(start.number, str(error), converged, more, np.nan, "", np.nan)
        off = np.abs(moved.theta - kept.theta) / np.sqrt(np.diag(kept.covariance))
        far = int(np.argmax(off))
        both = converged and moved.converged and kept.converged
        return Told(start.number, "", both, more, float(off[far]), priors[far].name, moved.cost - kept.cost)

    return tuple(row(start) for start in others)


class Verdict(NamedTuple):
    """Verdict of the multistart check.

    Attributes:
        passed: Whether at least one other start converged, and every one that did led to the same place or to one that
            is clearly worse, in log density and in evidence.
        away: Largest distance of an optimum that is not clearly worse [standard errors]; NaN without any.
        words: Counts, and every optimum that differs.
    """

    passed: bool
    away: float
    words: str


def judge(told: Sequence[Told], converged: bool) -> Verdict:
    """Count the starts that agree, and describe every optimum that differs.

    Args:
        told: From `compare`.
        converged: Whether the optimum that is kept converged.
    """
    reached = [t for t in told if t.converged]
    same = [t for t in reached if t.away <= NEAR]
    rivals = [t for t in reached if t.away > NEAR and min(t.worse, t.evidence) < CLEARLY]
    failed = [t for t in told if t.why]
    words = [f"{len(same) + 1} of {len(told) + 1} starts led to the same optimum within {NEAR:g} standard errors"]
    for t in sorted((t for t in reached if t.away > NEAR), key=lambda t: t.worse):
        sort = "a rival" if t in rivals else "clearly worse"
        words.append(
            f"start {t.number} lies {t.away:.2g} standard errors off in {t.parameter}, log density {-t.worse:+.3g}, "
            f"log evidence {-t.evidence:+.3g} ({sort})"
        )
    stuck = [str(t.number) for t in told if not t.converged and not t.why]
    if stuck:
        words.append(f"not converged: start {', '.join(stuck)}")
    if failed:
        words.append(f"{len(failed)} failed (start {', '.join(str(t.number) for t in failed)}: {failed[0].why})")
    away = max((t.away for t in (*same, *rivals)), default=np.nan)
    return Verdict(converged and bool(reached) and not rivals, away, "; ".join(words))
