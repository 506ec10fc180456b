"""Stage `report`: summary and report."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayeschute.aero.coefficient import APPARENT_MASS, Coefficient, is_coefficient
from bayeschute.calibration.label import MOST_LOST, lost_simulations
from bayeschute.dynamics.cluster_flight import OF_INERTIA
from bayeschute.likelihood.kalman_gradient import to_vector
from bayeschute.likelihood.priors import Prior, saturation_of
from bayeschute.posterior.term_search import PENALTY
from bayeschute.prediction.bands import OPENING
from bayeschute.records.record import repairs
from bayeschute.study import formulation
from bayeschute.study.aerodynamics.run_curves import told_curves
from bayeschute.study.assembly import assemble, canopies
from bayeschute.study.assembly.fits import groups, load_noise_parameters, posterior_groups, summary_draws
from bayeschute.study.assembly.fitted_terms import ADDED
from bayeschute.study.assembly.lessons import lessons
from bayeschute.study.assembly.populations import DIVERGING
from bayeschute.study.evidence.calibration_status import status
from bayeschute.study.evidence.recalibrate import applied_recalibration
from bayeschute.study.evidence.record_misfit import NAME as PREDICTIVE
from bayeschute.study.job import Job, load_flight, load_priors
from bayeschute.study.run.fit import structures
from bayeschute.study.run.forecasts import when_lost
from bayeschute.study.run.stage_identifiability import noise_labels
from bayeschute.study.schema.belief_schema import NOISE_UNITS
from bayeschute.study.study import Flight, Study, apparent_mass_taken_as_known, study_hash

Array = NDArray[np.float64]
_AT_LIMIT = 0.01  # of the logarithm of a noise parameter: as near to a limit counts as at it
_UNIT_OF = {"time constant": " s", "frequency": " Hz"}
_PROGRAMS = ("bayeschute", "jax", "numpyro", "emcee", "arviz-base", "numpy", "scipy")


def report(job: Job) -> str:
    """Summary and report."""
    from bayeschute.report.page import build_report

    job.save("summary.json", assemble.as_plain(_summary(job)))
    build_report(job.out)
    return str(job.out / "report.html")


def _summary(job: Job) -> dict[str, Any]:
    study, facts, checked = job.study, job.load("fit/facts.json"), job.load("checks.json")
    coverage = job.load("coverage.json")
    (draws, units), (prior, stats) = summary_draws(job), _prior_and_stats(job)
    checks = checked["checks"] | bands_check(coverage, when_lost(job))
    found = status(job, checks, coverage)
    calibration = found.check
    label = "; ".join(filter(None, (found.claim.label, formulation.label(study.noise.model))))
    some = next(iter(draws.values()))
    seconds = sum(v for k, v in facts["wall"].items() if k != "fit_s")
    return {
        **heading(job, label), "claim": found.claim.plain(),
        "fit": {"converged": checked["checks"]["optimum"]["passed"]},
        "parameters": _parameters(job, draws, prior, units, checked),
        "sampling": {
            "sampler": formulation.sampler(study), "chains": some.shape[0], "draws": some.shape[1],
            "divergences": sum(int(stats[name].sum()) for name in ("diverging", DIVERGING) if name in stats),
            "failed_solves": facts["failed"], "wall_s": seconds,
            "wall": facts["wall"], "min_ess_per_s": min(checked["ess_bulk"].values()) / seconds,
        },
        **told_curves(job, draws, prior), **_taught(job, draws),
        **_stored(job, "predictive", PREDICTIVE), **_disturbances(job),
        **_stored(job, "output_error", "fit/output_error.json"),
        **_stored(job, "identifiability", "identifiability.json"), **_recalibration(job),
        **_fitted_terms(job), **({"structures": stacked} if (stacked := structures.summary_rows(job)) else {}),
        "coverage": coverage,
        "checks": checks | {"calibration": calibration},
        "requirements": job.load("risk/requirements.json"),
        "notes": [*facts["notes"], *structures.note(stacked), *_notes(job)],
        **origin(job),
    }  # fmt: skip


def heading(job: Job, label: str) -> dict[str, Any]:
    """First part of the summary: the study, its flights, and the label of its intervals."""
    study = job.study
    return {
        "title": study.title, "model": study.model, "quick": job.quick, "label": label, "seed": study.seed,
        "vehicle": study.vehicle.name if study.vehicle is not None else None,
        "flights": {f.name: _flight_entry(job, f) for f in study.flights},
    }  # fmt: skip


def origin(job: Job) -> dict[str, Any]:
    """Provenance of the summary: versions of the packages, and hashes."""
    return {
        "versions": {name: version(name) for name in _PROGRAMS} | {"python": platform.python_version()},
        "hashes": {"study": study_hash(job.study), "run": job.hash},
    }


def bands_check(coverage: dict[str, Any], remedy: str = "") -> dict[str, dict[str, Any]]:
    """The check `bands`, of a run with flights that lost more than `MOST_LOST` of their simulations alone.

    Args:
        coverage: By flight and quantity.
        remedy: What to do then; empty: not known.
    """
    share, told = 0.0, list[str]()
    for name, table in coverage.items():
        failed, drawn = max(((one["failed"], one["failed"] + one["draws"]) for one in table.values()), default=(0, 0))
        if words := lost_simulations(name, failed, drawn):
            share = max(share, failed / drawn)
            told.append(words)
    if not told:
        return {}
    return {
        "bands": {
            "passed": False,
            "value": share,
            "bound": MOST_LOST,
            "detail": "; ".join([*told, *([remedy] if remedy else [])]),
        }
    }


def _parameters(
    job: Job, draws: dict[str, Array], prior: dict[str, Array], units: dict[str, str], checked: dict[str, Any]
) -> dict[str, dict[str, Any]]:
    """Posterior and prior of every parameter in numbers, with the true value where it is known."""
    truth, parameters = true_values(job), {}
    for name, x in draws.items():
        before, flat = prior[name].ravel(), x.ravel()
        q05, q50, q95 = np.quantile(flat, [0.05, 0.5, 0.95])
        entry = {
            "mean": flat.mean(), "sd": flat.std(), "q05": q05, "q50": q50, "q95": q95, "rhat": checked["rhat"][name],
            "ess_bulk": checked["ess_bulk"][name], "ess_tail": checked["ess_tail"][name], "prior_mean": before.mean(),
            "prior_sd": before.std(), "contraction": 1.0 - (flat.std() / before.std()) ** 2, "unit": units[name],
        }  # fmt: skip
        parameters[name] = entry | ({"truth": truth[name]} if name in truth else {})
    return parameters


def _prior_and_stats(job: Job) -> tuple[dict[str, Array], dict[str, Array]]:
    """Draws of the prior by parameter, and what the sampler tells of its transitions (chain, draw)."""
    prior, told = ({str(k): v.values for k, v in one.items()} for one in posterior_groups(job, "prior", "sample_stats"))
    return prior, told


def _taught(job: Job, draws: dict[str, Array]) -> dict[str, Any]:
    """What the fitted flights taught; nothing of populations, whose members are no parameters of one fit."""
    told = what_flights_taught(load_priors(job), draws, [f.name for f in job.study.with_role("identify")])
    return {"taught": told} if told else {}


def what_flights_taught(priors: Sequence[Prior], draws: Mapping[str, Array], flights: Sequence[str]) -> dict[str, Any]:
    """What flights taught, and which coordinate of every parameter that is about.

    Args:
        priors: Before the flights.
        draws: After them, by parameter (chain, draw).
        flights: Their names.

    Returns:
        As `lessons`, every parameter with its ``coordinate``, in words.
    """
    told, fitted = lessons(priors, draws, flights), any(p.name == APPARENT_MASS for p in priors)
    for row, p in zip(told.get("parameters", ()), priors, strict=False):
        at_own = "at the vehicle's apparent mass" if fitted and p.air_share else "value"
        row["coordinate"] = "logarithm" if p.logarithmic else at_own
    return told


def _disturbances(job: Job) -> dict[str, Any]:
    """Noise of the channels and of the wind as found (of the first fit, where there are several)."""
    hyper = load_noise_parameters(job, groups(job)[0])
    noise = {
        name: {
            "white": hyper.noise.white[i],
            "correlated": hyper.noise.correlated[i],
            "time_constant": hyper.noise.time_constant[i],
            "unit": NOISE_UNITS[name],
        }
        | dict.fromkeys(formulation.unused_of(channel, job.study.noise.model))
        for i, (name, channel) in enumerate(job.study.noise.channels().items())
    }
    for name, parameters in zip(assemble.noise_parameter_names(job.study), hyper.disturbance_parameters, strict=True):
        facts = {"white": None, "correlated": parameters[0], "unit": "m/s" if "wind" in name else "1"}
        facts |= (
            {"frequency": parameters[1], "damping_ratio": parameters[2]}
            if parameters.size == 3
            else {"time_constant": parameters[1]}
        )
        noise[name] = facts
    return {"noise_model": job.study.noise.model, "noise": noise}


def _stored(job: Job, key: str, name: str) -> dict[str, Any]:
    """A file of the run as an entry of the summary; none where no stage, or an older version, has left it."""
    return {key: job.load(name)} if (job.out / name).exists() else {}


def _recalibration(job: Job) -> dict[str, Any]:
    """Factors by which bands were widened, if they were."""
    by = applied_recalibration(job)
    return {} if by is None else {"recalibration": by._asdict()}


def _flight_entry(job: Job, flight: Flight) -> dict[str, Any]:
    record = load_flight(job, flight.name)
    time = record["time"].values
    source = "virtual drop" if flight.virtual is not None else flight.path.name if flight.path else ""
    return {
        "roles": list(flight.roles),
        "samples": time.size,
        "duration_s": time[-1] - time[0],
        "repairs": [{k: v for k, v in vars(repair).items() if k != "times"} for repair in repairs(record)],
        "source": source,
    }


def flown_terms(study: Study) -> dict[str, float]:
    """Coefficients of the terms that the vehicle's virtual drops fly with, by parameter; none in a descent."""
    return {} if study.vehicle is None else study.vehicle.aero.coefficients()


def true_values(job: Job) -> dict[str, float]:
    """Values the virtual drop was flown with; terms that were selected but not flown have the true value 0."""
    study = job.study
    if study.vehicle is None or any(f.virtual is None for f in study.with_role("identify")):
        return {}
    risers, capsule, canopies = study.vehicle.risers, study.vehicle.capsule, study.vehicle.canopies
    flown = flown_terms(study)
    flown |= {"capsule_mass": capsule.mass, "canopy_mass": canopies.dry_mass}
    flown |= dict.fromkeys(("enclosed_air_factor", "canopy_position_scale", *OF_INERTIA), 1.0)
    for name in ("axial_force", "normal_force_slope", "pitch_moment_slope", "pitch_damping"):
        flown[f"capsule_{name}"] = getattr(capsule, name) or 0.0
    for name in ("pitch_moment_slope", "pitch_damping"):
        flown[f"canopy_{name}"] = getattr(canopies, name)
    flown |= {"riser_length": risers.length, "riser_stiffness": risers.stiffness, "riser_damping": risers.damping}
    return {p.name: float(flown.get(p.name, 0.0)) for p in load_priors(job)} | _of_members(study, flown)


def _of_members(study: Study, flown: dict[str, float]) -> dict[str, float]:
    """True values of canopies' own coefficients, and of the standard deviation between canopies where drops agree."""
    made: dict[str, float] = {}
    flights = study.with_role("identify")
    for name in study.priors.vary_canopies or ():
        spread = {(f.virtual.canopy_sd or {}).get(name, 0.0) for f in flights if f.virtual is not None}
        made |= {f"sd({name})": spread.pop()} if len(spread) == 1 else {}
        for flight in flights:
            drawn = canopies.flown(study, flight, assemble.flight_seed(study, flight)).get(name)
            assert study.vehicle is not None
            every = np.full(study.vehicle.canopies.number, flown.get(name, 0.0)) if drawn is None else drawn
            common = Coefficient.parse(name)
            assert common is not None
            made |= {str(common.of(flight.name, i + 1)): float(v) for i, v in enumerate(every)}
    return made


def _notes(job: Job) -> list[str]:
    """Approximations and assumptions that a reader of the numbers must know."""
    notes = [
        "Parameters are drawn conditionally on the noise parameters, which are fixed at their posterior mean, or at "
        "their mode where the mean is too far from it. The draws are then widened by the uncertainty of the noise "
        "parameters, to first order.",
        "Initial states and latent disturbances are integrated out by Laplace's approximation given the parameters; "
        "its log determinant is interpolated by a polynomial in the parameters (the error is among the checks).",
    ]
    study, by = job.study, applied_recalibration(job)
    notes += formulation.notes(study.noise) + _at_limits(job)
    if by is not None:
        notes.append(
            by.words[0].upper() + by.words[1:] + "; requirements and risk files are computed from the widened draws, "
            "and their column widened_by gives the factor."
        )
    if study.model != "cluster":
        air = "Air density is taken from the record, or from the standard atmosphere by altitude, and treated as known."
        return [*notes, air]
    notes.append(
        f"Predictions of a flight use the first {OPENING:g} s of its record (for the initial state) and its recorded "
        "wind; bands are scored after that."
    )
    notes += apparent_mass_taken_as_known(study) + _saturation(job)
    if study.priors.vary_canopies:
        notes.append(
            f"Hierarchical model over canopies for {', '.join(study.priors.vary_canopies)}: the name alone is the "
            "population mean, sd(..) the population standard deviation, ..@drop.canopy1 the value of one canopy. The "
            "likelihood enters the hierarchy as a Gaussian. Canopies of a predicted flight are new members of the "
            "population. With few canopies the population standard deviation is determined mostly by its prior."
        )
    if study.priors.vary:
        fitted = ", ".join(f.name for f in study.with_role("identify"))
        notes.append(
            f"{fitted} were fitted separately and joined in a hierarchical model, each likelihood as a Gaussian. It "
            f"holds for {', '.join(study.priors.vary)}: the name alone is the population mean, sd(..) the population "
            "standard deviation, ..@drop the value of one drop. A predicted drop is a new member of the population. "
            "With few drops the population standard deviation is determined mostly by its prior."
        )
    added = [p.name for p in load_priors(job) if ADDED in p.source]
    if added:
        notes.append(
            f"Not selected by equation error, added by the score test of the fitted flight: {', '.join(added)}."
        )
    missed = set(flown_terms(study)) - {p.name for p in load_priors(job) if is_coefficient(p.name)}
    if missed and study.flights[0].virtual is not None:
        notes.append("True terms of the virtual flight that were not selected: " + ", ".join(sorted(missed)) + ".")
    return notes


def _saturation(job: Job) -> list[str]:
    """The note on the angle of attack at which its powers level off; none: no note."""
    saturation = saturation_of(load_priors(job))
    if saturation is None:
        return []
    table, angle = job.study.structure, np.rad2deg(saturation)
    why = ", since flights with powers that go on were lost" if table and table.saturate == "auto" else ""
    return [
        f"At {angle:.3g} deg, which few samples of the fitted record exceed, powers of the angle of attack level off "
        f"in all terms{why}: how forces go on from there is assumed, not identified."
    ]


def _at_limits(job: Job) -> list[str]:
    """The note on noise parameters that came to rest at a limit of what is sought (of the first fit); none: no note."""
    found = np.asarray(to_vector(load_noise_parameters(job, groups(job)[0])))
    (low, high), (labels, used) = assemble.noise_prior(job.study).limits(), noise_labels(job)
    told = [
        f"{label} ({word} {np.exp(limit):.3g}{_UNIT_OF.get(label.rpartition(', ')[2], '')})"
        for limits, sign, word in ((low, -1.0, "at least"), (high, 1.0, "at most"))
        for label, value, limit, u in zip(labels, found, limits, used, strict=True)
        if u and sign * (value - limit) >= -_AT_LIMIT
    ]
    if not told:
        return []
    return [
        "At the limit of the values that are sought, beyond which the record alone would go: " + "; ".join(told) + "."
    ]


def _fitted_terms(job: Job) -> dict[str, Any]:
    """Terms that the simulated flight was fitted with, and the evidence for each where a search chose them."""
    table, here = job.study.structure, [p.name for p in load_priors(job) if is_coefficient(p.name)]
    if table is None or not here:
        return {}
    searched = table.fit == "search"
    evidence = job.load("fit/facts.json")["scores"] if searched else {}
    known = {name: value for name, value in evidence.items() if value is not None}
    told = {"log_bayes_factors": known, "threshold": PENALTY} if known else {}
    return {"fitted_terms": {"terms": here, "how": table.fit, **told}}
