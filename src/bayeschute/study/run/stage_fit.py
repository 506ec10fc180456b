"""The stage `fit`: data, optimum, noise parameters, draws, one DataTree."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayeschute.aero.coefficient import KINDS
from bayeschute.core.errors import FitError
from bayeschute.core.files import write_whole
from bayeschute.core.netcdf_files import write_netcdf
from bayeschute.core.random import seed_of, stream
from bayeschute.dynamics.cluster_flight import output_names
from bayeschute.likelihood.joint import linearise
from bayeschute.likelihood.priors import values_and_sds
from bayeschute.posterior.assess import output_error
from bayeschute.posterior.assess.data_tree import data_tree
from bayeschute.posterior.best_path import BestPath
from bayeschute.posterior.fit.drawn_density import Sampled, sampled
from bayeschute.posterior.fit.joint_fit import JointFit, NoFitError
from bayeschute.posterior.fit.laplace_fit import LaplaceFit, about_mode, mode_and_noise
from bayeschute.posterior.marginal import Marginal
from bayeschute.posterior.noise_evidence import NoisePrior
from bayeschute.posterior.noise_uncertainty import NoiseEffect, widened
from bayeschute.posterior.sampler import sample
from bayeschute.posterior.sampling.protocol import Draws
from bayeschute.posterior.sampling.sampler_checks import directions
from bayeschute.posterior.score_dispersion import told_in_words
from bayeschute.study.assembly import assemble, populations
from bayeschute.study.assembly.fits import Group, data_of, groups, save_fit
from bayeschute.study.job import Job, Say, load_flight, part_of
from bayeschute.study.run.fit import checkpoint, settled_terms, several_starts, structures

Array = NDArray[np.float64]
_FITTED = 0.85  # share of the time after which draws begin, on clusters of other programs
_SETTLED = 0.3  # of that, after which the terms are chosen
_RESTED = 0.5  # after which mode and noise parameters are found
_TAKEN_BACK = 2  # most times that a fit takes back terms
_DO = (
    "fit a shorter window, without gaps and opening transients, or give a prior to what else may be wrong (a mass, a "
    "constant error of the wind or of a channel)"
)
_DO_BY_LATENT = (
    "with noise of the channels alone a wrong wind has to be followed for a whole flight: let it be part of the flight "
    '(model = "latent" in [noise]), or fit a shorter window'
)


class Fitted(NamedTuple):
    """A group of flights that share their parameters, fitted: with the priors used, and scores of left-out terms."""

    group: Group
    found: LaplaceFit
    scores: dict[str, float]


class Drawn(NamedTuple):
    """Draws of a group: its DataTree, what the sampler returned, and seconds spent by sampler."""

    tree: xr.DataTree
    draws: Draws
    seconds: dict[str, float]


def fit(job: Job, predictions: bool = True) -> str:
    """Fit every group, draw, and store draws and DataTree.

    Args:
        job: The run.
        predictions: Whether the DataTree has predictions; replicates have no reader.
    """
    began = time.perf_counter()
    for name in ("priors.json", "output_error.json", "structures.json"):
        (job.out / "fit" / name).unlink(missing_ok=True)
    if not job.resume:
        checkpoint.clear(job)
    wall = {"optimum_s": 0.0}
    names, made, drawn, todo = fit_structures(job), list[Fitted](), list[Drawn](), groups(job)
    if names:
        wall["structures_s"] = time.perf_counter() - began
    for i, group in enumerate(todo):

        def say(share: float, words: str, i: int = i, name: str = group.name) -> None:
            job.say("fit")((i + share) / len(todo), f"{name}: {words}" if len(todo) > 1 else words)

        clock = time.perf_counter()
        made.append(fit_group(job, group, part_of(say, 0.0, _FITTED)))
        wall["optimum_s"] += time.perf_counter() - clock
        drawn.append(draw_group(job, made[i], part_of(say, _FITTED, 1.0), predictions))
    for one in drawn:
        wall |= {name: wall.get(name, 0.0) + spent for name, spent in one.seconds.items()}
    failed = store(job, made, drawn, wall | {"fit_s": time.perf_counter() - began}, names)
    checkpoint.clear(job)
    return f"{len(todo)} fits, {failed} failed simulations"


def store(
    job: Job,
    made: Sequence[Fitted],
    drawn: Sequence[Drawn],
    wall: Mapping[str, float] | None = None,
    structures_fitted: Sequence[str] = (),
) -> int:
    """Write the posterior of all groups, and the facts on their fits.

    Args:
        job: The run.
        made: Fits.
        drawn: Their draws.
        wall: Seconds by part of the work.
        structures_fitted: Names of fits of several structures.

    Returns:
        Simulations that failed.
    """
    chosen = [one.group for one in made]
    alone = len(chosen) == 1 and not job.study.priors.hierarchical
    tree = drawn[0].tree if alone else populations.joined(job, chosen, [one.tree for one in drawn])
    write_whole(job.out / "posterior.nc", partial(write_netcdf, tree))
    failed = sum(one.draws.failed for one in drawn)
    latent = job.study.noise.model == "latent"
    said = [
        note for fitted, one in zip(made, drawn, strict=True) for note in [*_notes(fitted, latent), *one.draws.notes]
    ]
    scored = {name: z for one in made for name, z in one.scores.items()}
    facts = {"wall": dict(wall or {}), "notes": said, "failed": failed, "scores": assemble.as_plain(scored)}
    if starts := several_starts.comparisons(job, [group.name for group in chosen] + list(structures_fitted)):
        facts |= {"starts": starts, "notes": [*said, *several_starts.note(starts)]}
    job.save("fit/facts.json", facts)
    return failed


def fit_structures(job: Job) -> list[str]:
    """Fit several structures and compute their weights if the study says so; returns the names of their fits."""
    table = job.study.structure
    return [] if table is None or table.stack is None else _structures(job, groups(job)[0])


def fit_group(job: Job, group: Group, say: Say) -> Fitted:
    """Fit a group of flights to its marginal posterior.

    Raises:
        FitError: If no flight of the model follows the records, or no mode is found.
    """
    try:
        return Fitted(*_found(job, group, say))
    except FitError as error:
        raise _with_paths(job, group, error) from error
    except (FloatingPointError, np.linalg.LinAlgError) as error:
        do = "look at priors.json and the vehicle (the model must fly from the prior means), or shorten the window"
        raise FitError(f"fit of {group.name}: {error}; {do}.", (f"{group.name}: {error}",)) from error


def _notes(one: Fitted, widened: bool) -> list[str]:
    """On corrections of the posterior that could not be computed, and on parts of the records that disagree."""
    made = [f"Omitted from the posterior of {one.group.name}: {lost}." for lost in one.found.lost]
    for kind in KINDS:
        more = max((p.widened for p in one.group.priors if p.name.startswith(f"{kind}[")), default=1.0)
        if more > 1.0:
            made.append(
                f"{one.group.name}: the flights contradict equation error on the {kind} force; its prior is {more:.2g} "
                "times as wide as that says."
            )
    if back := [p.name for p in one.group.priors if p.source.endswith(settled_terms.TAKEN_BACK)]:
        made.append(f"{one.group.name}: the search of terms had left out {', '.join(back)}, which a flight demands.")
    if one.found.dispersion.disagree:
        made.append(told_in_words(one.found.dispersion, [flight.name for flight in one.group.flights], widened))
    return made


def draw_group(job: Job, fitted: Fitted, say: Say, predictions: bool = True) -> Drawn:
    """Draw from the posterior of a group, and store the fit with its draws.

    Args:
        job: The run.
        fitted: It.
        say: Progress callback: share done and words.
        predictions: Whether the DataTree has predictions.

    Returns:
        Its draws; those of the first sampler where the study wants both.

    Raises:
        FitError: If the draws don't vary in all directions: they are no posterior.
    """
    study, (group, found, _) = job.study, fitted
    kinds = ["nuts", "emcee"] if study.sampler.kind == "both" else [study.sampler.kind]
    bounds = _bounds(job, group, found) if study.noise.model in ("white", "sandwich") else None
    if study.noise.model == "sandwich":  # its covariance doesn't come from the noise parameters
        kinds, found = ["sandwich"], replace(found, noise_effect=NoiseEffect.none(*found.noise_effect.slope.shape))
    flights, seed = [f.name for f in group.flights], seed_of(study.seed, "draws of a fit", group.name)
    times = [load_flight(job, name)["time"].values for name in flights]
    results: list[tuple[xr.DataTree, Draws]] = []
    seconds: dict[str, float] = {}
    for kind in kinds:
        clock = time.perf_counter()
        drawn = checkpoint.get_draws(job, group.name, kind)
        if drawn is None:
            drawn = _drawn(job, seed, found, bounds, kind, part_of(say, 0.0, 0.5))
            checkpoint.put_draws(job, group.name, kind, drawn)
        found, draws = drawn.of(found), drawn.draws
        _refuse_a_place(job, group, found.marginal, draws, kind)
        seconds[f"{kind}_s"] = time.perf_counter() - clock
        wide = widened(draws.xi, found.noise_effect, found.noise_parameter_covariance, seed)
        tree = data_tree(
            found.marginal, group.priors, draws, seed, flights, lambda s, w: say(0.5 + 0.5 * s, w), wide, times,
            predictions, (list(study.noise.channels()), assemble.noise_parameter_names(study)),
        )  # fmt: skip
        if results:
            write_whole(job.out / f"posterior.{kind}.nc", partial(write_netcdf, tree))
        else:
            save_fit(job, group, found, draws, wide)
        results.append((tree, draws))
    return Drawn(*results[0], seconds)


def _refuse_a_place(job: Job, group: Group, marginal: Marginal, draws: Draws, kind: str) -> None:
    """Refuse draws that don't vary in all directions: summaries and forecasts of them would be of no posterior.

    Raises:
        FitError: If they don't.
    """
    theta = np.asarray(marginal.centre) + draws.xi @ np.asarray(marginal.scale).T
    chains, length, count = theta.shape
    if (found := directions(theta)) == count:
        return
    if kind == "sandwich":
        why = "the standard errors of output error are below the rounding of its estimates: its flight is unstable"
        do = _DO_BY_LATENT
    else:
        why, do = "walks did not leave where they began", _advice(job)
    reason = f"fit of {group.name}: draws vary in {found} of {count} directions: {why}; {do}"
    raise FitError(reason, (f"{group.name}: {kind}, {chains} chains of {length} draws", *draws.notes))


def _advice(job: Job) -> str:
    return _DO if job.study.noise.model == "latent" else _DO_BY_LATENT


def _with_paths(job: Job, group: Group, error: FitError) -> FitError:
    """The error with what to do, the residuals of the best trajectory found, and the parameters there."""
    if not isinstance(error, NoFitError):
        return error
    group = replace(group, priors=error.priors)
    best, paths = error.best, []
    for flight, place in zip(group.flights, best.flights, strict=True):
        data, time = data_of(job, flight, group.priors), load_flight(job, flight.name)["time"].values
        model: Any = data.model
        if data.path is None:  # of a body alone: its states are no more than its record
            continue
        made = linearise(data, best.theta, place.latent_path(data))
        defect = np.max(np.abs(np.asarray(made.defects)[1:] / data.path.slack), axis=1)
        noise = error.hyper.outputs(data)
        names = output_names(model.channels, model.structure.canopies)
        residual = np.where(np.asarray(data.present), np.asarray(made.residual), np.nan)
        sd = np.hypot(np.asarray(noise.white), np.asarray(noise.correlated))
        paths.append(BestPath(flight.name, time, names, residual, sd, defect))
    rows = zip(group.priors, *values_and_sds(group.priors, best.theta, best.covariance), strict=True)
    parameters = [(p.name, float(value), float(sd), p.unit) for p, value, sd in rows]
    return FitError(f"fit of {group.name}: {error.reason}; {_advice(job)}", error.tried, paths, parameters)


def _structures(job: Job, group: Group) -> list[str]:
    """Fit several structures and compute their weights; the best is then continued like a resumed fit."""
    try:
        return structures.fit_all(job, group, lambda s, w: job.say("fit")(0.5 * s, w))
    except FloatingPointError as error:
        do = "look at structure.json and the vehicle (a model must fly from its prior means), or shorten the window"
        raise FitError(f"fits of the structures: {error}; {do}.", (f"every structure: {error}",)) from error


def _bounds(job: Job, group: Group, found: LaplaceFit) -> output_error.Bounds:
    """Cramer-Rao bounds of a group's estimates, and their table for the summary."""
    made = output_error.bounds(found.marginal.flights, found.hyper, group.priors, found.optimum)
    path = job.out / "fit" / "output_error.json"
    before = job.load("fit/output_error.json") if path.exists() else []
    rows = [row._asdict() for row in output_error.table(made, group.priors)]
    job.save("fit/output_error.json", [*before, *assemble.as_plain(rows)])
    return made


def _drawn(job: Job, seed: int, found: LaplaceFit, bounds: output_error.Bounds | None, kind: str, say: Say) -> Sampled:
    """Draws of the sampler, or about the estimates of output error."""
    table, marginal = job.study.sampler, found.marginal
    if kind == "sandwich":
        assert bounds is not None
        centre, scale = np.asarray(marginal.centre), np.asarray(marginal.scale)
        rng = stream(seed, "draws about output error")
        about = output_error.gaussian_draws(bounds, centre, scale, table.chains, table.draws, rng)
        return Sampled(about, marginal.bend, found.determinant_error)

    def sampler(marginal: Marginal) -> Draws:
        return sample(marginal, kind, table.chains, table.warmup, table.draws, seed, say)

    return sampled(found, sampler, say)


def _found(job: Job, group: Group, say: Say) -> tuple[Group, LaplaceFit, dict[str, float]]:
    """Fit a group, or continue from the checkpoint of an earlier run.

    Returns:
        The group with the priors that were used, the fit, and the last score tests of left-out terms.
    """
    prior, kept, asked = assemble.noise_prior(job.study), checkpoint.get_settled(job, group.name), group
    if kept is None:
        group, settled, z = settled_terms.settle(job, group, prior, part_of(say, 0.0, _SETTLED))
        checkpoint.put_settled(job, group.name, group.priors, settled, z)
    else:
        priors, settled, z = kept
        if tuple(priors) != group.priors:
            group = replace(group, priors=tuple(priors))
            settled_terms.revise(job, priors)
    places = _at_rest(job, asked, group, settled, prior, part_of(say, _SETTLED, _RESTED))
    widen = job.study.noise.model == "latent"
    while True:
        at, place = places.pop()
        flights = [data_of(job, f, at.priors) for f in at.flights]
        try:
            found = about_mode(flights, at.priors, prior, place, part_of(say, _RESTED, 1.0), widen)
            break
        except (FitError, FloatingPointError) as error:
            if not places:
                raise
            say(_RESTED, f"without the terms taken back: {error}")
    if at is not group:
        settled_terms.revise(job, at.priors)
    return at, found, z


def _at_rest(
    job: Job, asked: Group, group: Group, settled: JointFit, prior: NoisePrior, say: Say
) -> list[tuple[Group, JointFit]]:
    """A group at its mode, with the noise parameters there; then with terms that a flight demands at the last one.

    Args:
        job: The run.
        asked: The group before terms were chosen.
        group: With these terms.
        settled: Its joint optimum.
        prior: Priors of the noise parameters.
        say: Progress callback: share done and words.
    """

    def at_rest(group: Group, begin: JointFit, start: float) -> tuple[Group, JointFit]:
        flights = [data_of(job, f, group.priors) for f in group.flights]
        return group, mode_and_noise(flights, group.priors, prior, begin, part_of(say, start, 1.0))

    made = [at_rest(group, settled, 0.0)]
    for _ in range(_TAKEN_BACK):
        more = settled_terms.with_demanded(job, asked, *made[-1], prior)
        if more is None:
            break
        new = {p.name for p in more[0].priors} - {p.name for p in made[-1][0].priors}
        say(0.9, f"once more with terms that a flight demands after all: {', '.join(sorted(new))}")
        try:
            made.append(at_rest(*more, 0.9))
        except FloatingPointError as error:
            say(1.0, f"without them: {error}")
            break
    return made
