"""The joint optimum of a group of flights, and the terms that it settles on."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayeschute.aero.coefficient import APPARENT_MASS, KINDS, Coefficient, is_coefficient, shared_name
from bayeschute.aero.term_names import is_pairwise
from bayeschute.core.errors import FitError
from bayeschute.likelihood.joint import FlightData
from bayeschute.likelihood.priors import Prior, conflict_variance_factor, given_zero, saturation_of
from bayeschute.posterior.assess import alternatives
from bayeschute.posterior.assess.score_test import scores
from bayeschute.posterior.fit.joint_fit import Begin, JointFit, joint_fit
from bayeschute.posterior.fit.marginal_mode import marginal_mode
from bayeschute.posterior.fit.smaller_model import Smaller, beside_smaller, carried_over
from bayeschute.posterior.marginal import marginalise
from bayeschute.posterior.noise_evidence import NoisePrior
from bayeschute.posterior.term_search import choose
from bayeschute.study.assembly import canopies
from bayeschute.study.assembly.fits import Group, data_of
from bayeschute.study.assembly.fitted_terms import terms_left_out, with_terms
from bayeschute.study.assembly.missing_terms import missing_terms
from bayeschute.study.job import Job, Say, part_of
from bayeschute.study.run.fit import saturation, several_starts

Array = NDArray[np.float64]
_HELD_SD = 0.02  # of the prior of the apparent mass until terms are chosen, at most
_WIDENINGS, _WIDER = 3, 1.2  # most times that priors are widened; least factor on their standard deviations
_LIBRARY_NEAR = 1.0  # standard deviations of the last step to the library's mode: terms are weighed there
SCORE = 4.0  # standard errors from zero at which a term that was left out is added
TAKEN_BACK = "taken back by the score test at the mode of the fit without it"


def settle(
    job: Job, group: Group, prior: NoisePrior, say: Callable[[float, str], None]
) -> tuple[Group, JointFit, dict[str, float]]:
    """Joint optimum of a group; left-out terms that pass the score test on the simulated flight are added.

    A fit without a necessary term converges to a different optimum. So the next one starts at the prior means and,
    for comparison, there; the greater evidence is kept. Where the study searches in the fit, the terms are those of
    the whole library that the flights support.

    Args:
        job: The run; priors that the fit changed are kept in its folder (`revise`).
        group: Flights to be fitted, with their priors.
        prior: Priors of the noise parameters.
        say: Progress callback: share done and words.

    Returns:
        The group with the priors that were used, its optimum, and the last scores of left-out terms.
    """
    if _searches(job):
        return _searched(job, group, prior, say)
    # The score test of a term takes what the noise model leaves to the residuals for evidence: latent models only.
    here = {p.name for p in group.priors}
    latent = job.study.noise.model == "latent"
    latent = latent and not job.study.priors.vary  # drops that are joined have the same parameters
    left_out, z = [p for p in terms_left_out(job) if latent and p.name not in here], dict[str, float]()
    begins: list[Begin | None] = [None]
    while True:
        if job.study.sampler.starts is None:
            flights = [data_of(job, f, group.priors) for f in group.flights]
            settled = _best(flights, group.priors, prior, begins, say)
        else:
            settled = several_starts.settled(job, group, prior, begins, say)
        if not left_out:
            break
        whole, kept = with_terms(job.study, group.priors, left_out)
        theta = np.zeros(len(whole))
        theta[kept] = settled.optimum.theta
        everything = [data_of(job, f, whole) for f in group.flights]
        step, se = scores(everything, settled.hyper, whole, theta, settled.optimum.flights, kept)
        z = {p.name: float(step[i] / se[i]) for i, p in enumerate(whole) if not kept[i]}
        asked = [p for p in left_out if abs(z[p.name]) > SCORE]
        if not asked:
            break
        priors, old = with_terms(job.study, group.priors, asked)
        theta = np.zeros(len(priors))
        theta[old] = settled.optimum.theta
        begins = [None, (theta, settled.optimum.flights, settled.hyper)]
        left_out = [p for p in left_out if p not in asked]
        group = replace(group, priors=tuple(priors))
        revise(job, priors)
    return group, settled, z


def _best(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    prior: NoisePrior,
    begins: Sequence[Begin | None],
    say: Callable[[float, str], None],
) -> JointFit:
    """The optimum of greatest evidence from several begins; one that fails counts only where all do."""
    found: list[JointFit] = []
    for i, begin in enumerate(begins):
        try:
            found.append(joint_fit(flights, priors, prior, progress=say, begin=begin))
        except FitError:
            if i + 1 == len(begins) and not found:
                raise
    return min(found, key=lambda s: s.evidence)


def _searched(
    job: Job, group: Group, prior: NoisePrior, say: Callable[[float, str], None]
) -> tuple[Group, JointFit, dict[str, float]]:
    """Joint optimum of a group with the terms of the library that its flights support (Bayes factors).

    Motion tells forces over masses: with a canopy's apparent mass all coefficients of transverse force grow, and an
    optimisation that starts far off follows that ridge to a lower maximum. So the apparent mass is held until the terms
    are chosen.

    Returns:
        The group with the priors that were used, its optimum, and the log evidence for every term that may be left out.
    """
    assert job.study.structure is not None
    asked = group
    own = {p.name: p for p in group.priors if p.name == APPARENT_MASS}
    held = tuple(replace(p, scale=min(p.scale, _HELD_SD)) if p.name in own else p for p in group.priors)
    group = replace(group, priors=held)
    flights = [data_of(job, f, group.priors) for f in group.flights]
    core = set(job.study.structure.core)
    may_go = [p.name for p in group.priors if is_coefficient(p.name) and shared_name(p.name) not in core]

    def tell(start: float, end: float) -> Say:
        return part_of(lambda share, words: say(share, f"full library of terms: {words}"), start, end)

    library = _joint(job, group, prior, tell(0.0, 0.4))
    begin_mode = beside_smaller(flights, group.priors, prior, library, _fewest(job, group, may_go), tell(0.4, 0.6))
    mode = marginal_mode(flights, group.priors, begin_mode, tell(0.6, 0.9), near=_LIBRARY_NEAR)
    told = group.priors
    for _ in range(_WIDENINGS):
        wider = _wider(job, group.priors, told, mode.theta)
        if wider == told:
            break
        told = wider
        mode = marginal_mode(flights, told, begin_mode._replace(optimum=mode), tell(0.6, 0.9), near=_LIBRARY_NEAR)
    group = replace(group, priors=told)
    if (saturated := saturation.needed(job, asked)) is not None:
        hyper = begin_mode.hyper
        lost = saturation.lost(marginalise(flights, hyper, told, mode), hyper, job.study.seed)
        say(0.9, f"{100.0 * lost:.0f} % of flights with the full library of terms are lost")
        if lost > saturation.MANY:
            return _searched(job, saturated, prior, part_of(say, 0.9, 1.0))
    chosen = choose(group.priors, mode.theta, mode.covariance, may_go)
    say(0.9, f"{int(chosen.kept.sum())} of {chosen.kept.size} parameters selected")
    smaller = replace(group, priors=tuple(own.get(p.name, p) for p in chosen.priors))
    settled: JointFit | None = None
    if job.study.sampler.starts is None:
        some = [data_of(job, f, smaller.priors) for f in smaller.flights]
        settled = carried_over(some, smaller.priors, prior, library, chosen.theta, mode.flights)
        say(1.0, "the chosen terms start where the full library led")
    if settled is None:
        begin = (chosen.theta, mode.flights, library.hyper)
        settled = _joint(job, smaller, prior, part_of(say, 0.9, 1.0), begin)
    revise(job, smaller.priors)
    return smaller, settled, chosen.evidence


def _searches(job: Job) -> bool:
    """Whether terms are chosen in the fit.

    A search takes what the noise model leaves to the residuals for evidence; drops that are joined share their terms.
    """
    table, study = job.study.structure, job.study
    latent = study.noise.model == "latent"
    return table is not None and table.fit == "search" and latent and not study.priors.hierarchical


def with_demanded(
    job: Job, asked: Group, group: Group, place: JointFit, prior: NoisePrior
) -> tuple[Group, JointFit] | None:
    """A searched group with terms that a flight demands after all, where the mode without them is.

    The search weighs terms about the mode of the whole library, under the noise parameters of its joint optimum. Both
    are others once the terms are chosen: a term that was not worth its penalty there may be off zero by many standard
    errors here (score test at the mode of the marginal density, `posterior.assess.alternatives`). Of ten sets of
    other programs' flights nine had none beyond 2.7, one had two beyond 6.

    Args:
        job: The run.
        asked: The group before the search.
        group: With the terms that were chosen.
        place: Their mode, from `mode_and_noise`.
        prior: Priors of the noise parameters.

    Returns:
        The group, and a place to seek its marginal mode from; None where no term is off zero by more than `SCORE`
        standard errors on any flight, or flights with those that are don't follow the record from there.
    """
    here = {p.name for p in group.priors}
    if not _searches(job):
        return None
    if saturation_of(group.priors) is not None:
        asked = saturation.needed(job, asked) or asked
    terms = [(p.name, one) for p in asked.priors if p.name not in here and (one := Coefficient.parse(p.name))]
    library = {kind: [one.term for _, one in terms if one.kind == kind] for kind in KINDS}
    demanded = _demanded(job, group, place, library) if terms else set[str]()
    if not demanded:
        return None
    larger = replace(group, priors=_taken_back(asked.priors, group.priors, demanded))
    kept = np.array([p.name in here for p in larger.priors])
    theta = np.zeros(kept.size)
    theta[kept] = place.optimum.theta
    flights = [data_of(job, f, larger.priors) for f in larger.flights]
    begin = carried_over(flights, larger.priors, prior, place, theta, place.optimum.flights)
    return None if begin is None else (larger, begin)


def _demanded(job: Job, group: Group, place: JointFit, library: Mapping[str, Sequence[str]]) -> set[str]:
    """Coefficients of a library that are off zero on a flight, at the mode without them."""
    flights = [data_of(job, f, group.priors) for f in group.flights]
    marginal, found = marginalise(flights, place.hyper, group.priors, place.optimum), set[str]()
    for number, flight in enumerate(flights):
        lacking = list(missing_terms(flight, library))
        names = {alternative.what: str(coefficient) for coefficient, alternative in lacking}
        tested = alternatives.scores(marginal, number, [alternative for _, alternative in lacking])
        found |= {names[one.what] for one in tested if abs(one.estimate) > SCORE * one.se}
    return found


def _taken_back(library: Sequence[Prior], chosen: Sequence[Prior], more: Collection[str]) -> tuple[Prior, ...]:
    """Priors of the chosen terms and more, the library's others known to be zero; as wide as those of the chosen."""
    here, made = {p.name for p in chosen}, list(library)
    for kind in KINDS:
        factor = max((p.widened for p in chosen if p.name.startswith(f"{kind}[")), default=1.0)
        for i, p in enumerate(made):
            if p.name.startswith(f"{kind}["):
                source = f"{p.source}; {TAKEN_BACK}" if p.name in more else p.source
                made[i] = replace(p, scale=factor * p.scale, widened=factor * p.widened, source=source)
    return tuple(given_zero(made, [p.name for p in library if p.name not in here and p.name not in more]))


def _wider(job: Job, priors: tuple[Prior, ...], told: tuple[Prior, ...], theta: Array) -> tuple[Prior, ...]:
    """Priors whose coefficients of a kind of force are wider where the flights contradict equation error.

    Equation error takes the recorded wind for exact. Where the angle of attack is small, its error draws all powers of
    it towards zero, and the standard errors, which tell of scatter, do not know.

    Args:
        job: The run.
        priors: By equation error.
        told: What was used so far.
        theta: Where that led (P,).
    """
    if any(table.use == "prior" for table in job.study.knowledge):
        return told
    made = list(priors)
    for kind in KINDS:
        names = [p.name for p in priors if p.name.startswith(f"{kind}[")]
        factor = conflict_variance_factor(priors, theta, names)
        if factor > 1.0:
            more = factor**0.5
            made = [replace(p, scale=more * p.scale, widened=more) if p.name in names else p for p in made]
    far = any(new.scale > _WIDER * old.scale for new, old in zip(made, told, strict=True))
    return tuple(made) if far else told


def _fewest(job: Job, group: Group, may_go: Sequence[str]) -> Smaller:
    """The core, and what canopies do to each other: without that no cluster follows its record."""
    terms = {name: found.term for name in may_go if (found := Coefficient.parse(name))}
    gone = [name for name, term in terms.items() if not is_pairwise(term)]
    priors = given_zero(group.priors, gone)
    kept = np.array([p.name not in gone for p in group.priors])
    return Smaller([data_of(job, f, priors) for f in group.flights], priors, kept)


def _joint(
    job: Job, group: Group, prior: NoisePrior, say: Callable[[float, str], None], begin: Begin | None = None
) -> JointFit:
    """Joint optimum of a group, from one start or several."""
    if job.study.sampler.starts is not None:
        return several_starts.settled(job, group, prior, [begin], say)
    return joint_fit(
        [data_of(job, f, group.priors) for f in group.flights], group.priors, prior, progress=say, begin=begin
    )


def revise(job: Job, priors: Sequence[Prior]) -> None:
    """Keep priors that the fit used in the place of those that the stage before it left."""
    job.save("fit/priors.json", [p.__dict__ for p in canopies.together(priors)])
