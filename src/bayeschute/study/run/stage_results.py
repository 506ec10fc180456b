"""Stages `check`, `predict` and `risk`: checks of the fit, predictions, risk files."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import arviz_stats
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayeschute.core.files import write_whole
from bayeschute.core.plain import to_plain
from bayeschute.core.trees import load_tree, save_tree
from bayeschute.likelihood.joint import FlightData, as_seen, stepped
from bayeschute.likelihood.kalman import Seen, innovations
from bayeschute.posterior.assess.identifiability_result import FitIdentifiability
from bayeschute.posterior.fit.correction_fit import MOST_SHIFT
from bayeschute.posterior.marginal import Linearisation
from bayeschute.posterior.sampling.sampler_checks import MOST_K, judge_rhat
from bayeschute.posterior.score_dispersion import Dispersion, dispersion, parts_of
from bayeschute.prediction import bands, risk_files
from bayeschute.prediction.flight_statistics import flight_statistics
from bayeschute.prediction.predictive_checks import verdict
from bayeschute.records.reconstruct import reconstruct
from bayeschute.study.assembly import assemble
from bayeschute.study.assembly.fits import Stored, groups, load_fit, summary_draws
from bayeschute.study.evidence.divergent_transitions import divergences_check
from bayeschute.study.evidence.recalibrate import NAME as RECALIBRATION
from bayeschute.study.evidence.recalibrate import applied_recalibration, widening
from bayeschute.study.evidence.record_misfit import NAME as PREDICTIVE
from bayeschute.study.evidence.record_misfit import Misfit, as_document, misfit_of_fit
from bayeschute.study.job import Job
from bayeschute.study.run.fit import several_starts, structures
from bayeschute.study.run.forecasts import FlightForecast, forecast_flights, widened
from bayeschute.study.run.stage_identifiability import of_fit
from bayeschute.study.study import Flight

Array = NDArray[np.float64]


STATISTICS = "fit/statistics.npz"
_FAR_DRAWS = 2.0  # standard deviations: farther off, draws are not about the mode that was found


class _InnovationShare(NamedTuple):
    """Share of a flight's one-step prediction errors inside their central 90 % interval, and the number of its data."""

    inside: float
    data: int

    @property
    def tolerance(self) -> float:
        """Largest difference from 0.9 of a sound fit; of few data, what one in a hundred exceeds by chance."""
        return max(0.04, 2.58 * float(np.sqrt(0.9 * 0.1 / self.data)))

    @property
    def excess(self) -> float:
        """The difference over that."""
        return abs(self.inside - 0.9) / self.tolerance


class _Fits(NamedTuple):
    """Diagnostics of the fits of a run.

    Attributes:
        converged: Whether every optimum did.
        failed: Simulations that failed while sampling.
        evaluations: Of the exact density.
        step_errors: See `_step_error`, by flight.
        shares: See `_innovation_share`, by flight.
        determinant_errors: What those of the log density imply, by fit; see `correction_fit`.
        least_falls: Of the log density at one standard deviation along any axis, by fit.
        modes: Whether it falls to both sides along every axis, by fit.
        away: Distance of the draws' mean from the mode [Laplace's standard deviations], by fit.
        tails: Pareto k, by fit that has one.
        dispersions: Of the scores of parts of the records, by fit whose records have enough of them.
        identifiability: Identifiability by fit; empty if not requested.
        misfit: Predictive checks of the records, by fit.
    """

    converged: bool
    failed: int
    evaluations: int
    step_errors: list[float]
    shares: list[_InnovationShare]
    determinant_errors: list[float]
    least_falls: list[float]
    modes: list[bool]
    away: list[float]
    tails: list[float]
    dispersions: list[Dispersion]
    identifiability: dict[str, FitIdentifiability]
    misfit: list[Misfit]


def _of_fits(job: Job, identify: bool) -> _Fits:
    todo = groups(job)
    stored, steps, shares, misfit = [], [], [], []
    identifiability: dict[str, FitIdentifiability] = {}
    for i, group in enumerate(todo):
        one = load_fit(job, group)
        for flight, along in zip(one.marginal.flights, one.marginal.along, strict=True):
            steps.append(_step_error(flight, one.optimum.theta, along))
            shares.append(_innovation_share(flight, along))
        misfit.append(misfit_of_fit(job, group, one))
        if identify:
            identifiability[group.name] = of_fit(job, group, one)
        stored.append(one)
        job.say("check")((i + 1) / len(todo), group.name)
    return _Fits(
        all(one.optimum.converged for one in stored),
        sum(one.failed for one in stored),
        sum(one.evaluations for one in stored),
        steps,
        shares,
        [one.determinant_error for one in stored],
        [one.least_fall for one in stored],
        [one.is_mode for one in stored],
        [_away(one) for one in stored],
        [one.pareto_k for one in stored if one.pareto_k is not None],
        [made for made in (dispersion(*parts_of(one.marginal)) for one in stored) if np.isfinite(made.ratio)],
        identifiability,
        misfit,
    )


def _away(stored: Stored) -> float:
    """Largest distance of the draws' mean from the mode along an axis of its Gaussian approximation."""
    flat = stored.held.reshape(-1, stored.optimum.theta.size).mean(axis=0) - stored.optimum.theta
    return float(np.max(np.abs(np.linalg.solve(np.asarray(stored.marginal.scale), flat))))


def check(job: Job, identify: bool = True) -> str:
    """Convergence diagnostics and checks of the fit, and the identifiability analysis.

    Args:
        job: The run.
        identify: Whether to run the identifiability analysis; replicates don't need it.
    """
    checks: dict[str, dict[str, Any]] = {}

    def add(name: str, value: float, bound: float, passed: bool, detail: str) -> None:
        checks[name] = {"passed": bool(passed), "value": float(value), "bound": bound, "detail": detail}

    tree = xr.open_datatree(job.out / "posterior.nc", engine="h5netcdf")
    # Of the sampler's own draws, where the uncertainty of the noise parameters was added to the posterior.
    posterior = tree["posterior"].ds.load().assign(tree["conditional"].ds.load().data_vars)
    stats = {str(name): row.values for name, row in tree["sample_stats"].ds.data_vars.items()}
    tree.close()
    rhat, bulk, tail = (_over(posterior, f) for f in (arviz_stats.rhat, _ess_bulk, _ess_tail))
    chains = judge_rhat(list(rhat.values()), posterior.sizes["chain"], posterior.sizes["draw"])
    add("rhat", chains.largest, chains.bound, chains.passed, "largest R-hat of any parameter")
    add(
        "ess_bulk",
        min(bulk.values()),
        400.0,
        min(bulk.values()) > 400.0,
        "smallest bulk effective sample size of any parameter",
    )
    add(
        "ess_tail",
        min(tail.values()),
        400.0,
        min(tail.values()) > 400.0,
        "smallest tail effective sample size of any parameter",
    )
    checks |= divergences_check(stats)
    fits = _of_fits(job, identify)
    add("optimum", float(not fits.converged), 0.0, fits.converged, "number of fits whose optimisation did not converge")
    if starts := job.load("fit/facts.json").get("starts"):
        checks["optima"] = several_starts.check(starts)
    if stacked := structures.summary_rows(job):
        checks["structures"] = structures.check(stacked)
    add(
        "failed_solves",
        fits.failed / max(fits.evaluations, 1),
        0.01,
        fits.failed <= 0.01 * fits.evaluations,
        f"{fits.failed} of {fits.evaluations} simulations failed while sampling",
    )
    add(
        "step_error",
        max(fits.step_errors),
        0.2,
        max(fits.step_errors) < 0.2,
        "largest integration error relative to the white measurement noise of the channel",
    )
    add(
        "mode",
        min(fits.least_falls),
        0.0,
        all(fits.modes),
        "smallest decrease of the log density one standard deviation away from the mode, along any axis; 0.5 for a "
        "Gaussian, and positive at a maximum",
    )
    add(
        "draws_distance",
        max(fits.away),
        _FAR_DRAWS,
        max(fits.away) < _FAR_DRAWS,
        "largest distance of the mean of the draws from the mode along any axis, in standard deviations of the "
        "Gaussian approximation",
    )
    worst = max(fits.shares, key=lambda share: share.excess)
    add(
        "innovations",
        worst.inside,
        0.9,
        worst.excess < 1.0,
        f"share of the {worst.data:,} standardised innovations (one-step prediction errors) of a flight inside their "
        f"central 90 % interval; the bound is the target, with a tolerance of {worst.tolerance:.2g}",
    )
    add(
        "log_determinant",
        max(fits.determinant_errors),
        MOST_SHIFT,
        max(fits.determinant_errors) < MOST_SHIFT,
        "largest change of a mean, in standard deviations, or relative of a standard deviation, that the error of the "
        "log density implies: against Laplace's approximation at points of the posterior, by importance weights, and "
        "at draws, by a regression of the errors",
    )
    if fits.tails:
        detail = (
            "Pareto k of the importance ratios exact/surrogate density at the surrogate's proposals; below 0.7 the "
            "proposals cover the exact posterior and the correction is reliable"
        )
        add("pareto_k", max(fits.tails), MOST_K, max(fits.tails) < MOST_K, detail)
    if fits.dispersions:
        worst_parts = max(fits.dispersions, key=lambda one: one.ratio / one.bound)
        detail = (
            "scatter of the scores of parts of the records over that by their information; 1 where the model is right. "
            "Beyond the bound, which one right model in a hundred exceeds, parts disagree about the parameters, and "
            "the posterior of a model with latent disturbances is widened by the ratio"
        )
        add("score_dispersion", worst_parts.ratio, worst_parts.bound, not worst_parts.widens, detail)
    checks["predictive"] = verdict([one for fit in fits.misfit for one in fit.checks])
    job.save(PREDICTIVE, assemble.as_plain(as_document(fits.misfit)))
    if identify:
        job.save("identifiability.json", assemble.as_plain(to_plain(fits.identifiability, without_none=True)))
    job.save("checks.json", {"checks": checks, "rhat": rhat, "ess_bulk": bulk, "ess_tail": tail})
    missed = [name for name, c in checks.items() if not c["passed"]]
    return "all passed" if not missed else "missed: " + ", ".join(missed)


def _ess_bulk(x: xr.DataArray) -> Any:
    return arviz_stats.ess(x, method="bulk")


def _ess_tail(x: xr.DataArray) -> Any:
    return arviz_stats.ess(x, method="tail")


def _over(posterior: xr.Dataset, function: Any) -> dict[str, float]:
    return {str(name): float(np.asarray(function(posterior[name]))) for name in posterior.data_vars}


def _step_error(flight: FlightData, theta: Array, along: Linearisation) -> float:
    """Largest change of a one-step prediction error when the integration step is halved [standard deviations]."""
    model: Any = flight.model
    finer = replace(flight, model=replace(model, substeps=2 * model.substeps))
    latent_path = along.at.latent_path(flight)
    coarse, fine = (np.asarray(stepped(one, theta, latent_path)[1]) for one in (flight, finer))
    change = Seen(np.zeros((*np.shape(flight.observed), 1)), (fine - coarse)[..., None])
    return float(np.max(np.abs(np.asarray(innovations(along.gains, *change)))))


def _innovation_share(flight: FlightData, along: Linearisation) -> _InnovationShare:
    """Of the linear model at the optimum."""
    unit = np.asarray(innovations(along.gains, *as_seen(along.linear).column(0)))[..., 0]
    inside = np.abs(unit[np.asarray(flight.present)]) < 1.6449
    return _InnovationShare(float(np.mean(inside)), inside.size)


def predict(job: Job) -> str:
    """Bands and statistics of every flight that is fitted or predicted, both of the draws as recalibrated."""
    wanted = job.study.predict.quantities or ()
    made: dict[str, xr.Dataset] = {}
    statistics: dict[str, dict[str, dict[str, Array]]] = {}
    coverage: dict[str, Any] = {}
    without: list[str] = []
    changed: list[str] = []
    by = widening(job)
    for one in (widened(foreseen, by) for foreseen in forecast_flights(job)):
        name, prediction, truth, counted = one.flight.name, one.prediction, one.truth, one.counted
        recorded = recorded_quantities(job, one.flight, one.record)
        role = "predict" if one.held_out.any() else "identify"
        made[name] = bands.dataset(prediction, one.time, wanted, truth, recorded, one.held_out, role)
        coverage[name] = {
            q: {
                "truth": None if truth is None else bands.coverage(prediction.draws[q], truth[q].values, counted),
                "record": _record_coverage(job, one, q, recorded),
                "draws": int(np.isfinite(prediction.draws[q]).all(axis=1).sum()),
                "failed": prediction.failed,
            }
            for q in wanted
            if q in prediction.draws
        }
        without += [name] if not any(entry["draws"] for entry in coverage[name].values()) else []
        statistics[name] = flight_statistics(prediction, counted)
        changed += [name] if one.widened_by else []
    write_whole(
        job.out / "predictions.nc",
        lambda p: xr.DataTree.from_dict({f"/{k}": v for k, v in made.items()}).to_netcdf(p, engine="h5netcdf"),
    )
    job.save("coverage.json", assemble.as_plain(coverage))
    (job.out / RECALIBRATION).unlink(missing_ok=True)
    if by is not None:
        job.save(RECALIBRATION, by._replace(flights=tuple(changed))._asdict())
    save_tree(job.out / STATISTICS, statistics)
    none = f", no bands of {', '.join(without)}: every simulation failed" if without else ""
    return f"{len(made)} flights{none}"


def _record_coverage(job: Job, one: FlightForecast, quantity: str, recorded: dict[str, Array]) -> float | None:
    """Share of recorded samples inside the band, the channel's noise added where the quantity has a channel.

    A quantity derived from several channels has no noise model here: compared with the wide band of an unseen flight
    that is negligible; for the narrow one of a fitted flight it would mislead, so there it is omitted.
    """
    noise = _channel_noise(job, one.stored, quantity)
    if quantity not in recorded or (noise is None and not one.held_out.any()):
        return None
    seen = bands.recorded_draws(one.prediction, quantity, noise, one.seed)
    return bands.coverage(seen, recorded[quantity], one.counted)


def _channel_noise(job: Job, stored: Stored, quantity: str) -> tuple[float, float, float] | None:
    """Residual noise of the channel that records a quantity directly; None where it is derived from several."""
    channel = {"descent_rate": "descent_rate" if job.study.model == "descent" else "capsule_velocity"}.get(quantity)
    names = list(job.study.noise.channels())
    if channel not in names:
        return None
    noise, k = stored.hyper.noise, names.index(channel)
    return float(noise.white[k]), float(noise.correlated[k]), float(noise.time_constant[k])


def recorded_quantities(job: Job, flight: Flight, record: xr.Dataset) -> dict[str, Array]:
    """Quantities of interest as the record has them."""
    if job.study.model == "descent":
        return {"descent_rate": record["descent_rate"].values}
    seen = reconstruct(record, assemble.geometry(job.study.vehicle_of(flight), flight.capsule_mass))
    names = ("swing_angle", "descent_rate", "sea_level_descent_rate", "flyout_angle")
    return {name: seen[name].values for name in names}


def risk(job: Job) -> str:
    """Files for risk assessment, and the requirements, from the draws of the bands (recalibrated where these are)."""
    study, tables = job.study, load_tree(job.out / STATISTICS, dict[str, dict[str, dict[str, Array]]])
    by = applied_recalibration(job)
    widened = {} if by is None else dict.fromkeys(by.flights, by.factors)
    draws, units = summary_draws(job)
    ess = job.load("checks.json")["ess_bulk"]
    independent = int(min(min(ess.values()), study.predict.draws))
    rows = []
    predicted = [f.name for f in study.flights if "predict" in f.roles]
    for wanted in study.requirements:
        limit = {"at_most": wanted.at_most} if wanted.at_most is not None else {"at_least": wanted.at_least}
        for name in predicted:
            samples = tables[name][wanted.statistic].get(wanted.quantity)
            if samples is not None:
                rows.append(
                    risk_files.requirement_check(
                        samples, name=wanted.name, quantity=wanted.quantity, unit=bands.UNITS[wanted.quantity],
                        run=name, statistic=wanted.statistic, independent=independent,
                        widened_by=widened.get(name, {}).get(wanted.quantity, 1.0), **limit,
                    )
                )  # fmt: skip
    risk_files.write_risk(
        job.out / "risk", draws, tables, units, None, ess, assemble.as_plain(rows), independent, widened
    )
    return f"{len(rows)} requirements checked"
