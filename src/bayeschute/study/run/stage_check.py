"""Stage `check`: whether the draws mix, the fits are sound, and the records agree with the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import arviz_stats
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayeschute.core.plain import to_plain
from bayeschute.likelihood.joint import FlightData, as_seen, stepped
from bayeschute.likelihood.kalman import Seen, innovations
from bayeschute.posterior.assess.identifiability_result import FitIdentifiability
from bayeschute.posterior.fit.correction_fit import MOST_SHIFT
from bayeschute.posterior.marginal import Linearisation
from bayeschute.posterior.sampling.sampler_checks import FEWEST, MOST_K, judge_rhat
from bayeschute.posterior.score_dispersion import Dispersion, dispersion, parts_of
from bayeschute.prediction.predictive_checks import verdict
from bayeschute.study.assembly import assemble
from bayeschute.study.assembly.fits import Stored, groups, load_fit, posterior_groups
from bayeschute.study.evidence.divergent_transitions import divergences_check
from bayeschute.study.evidence.record_misfit import NAME as PREDICTIVE
from bayeschute.study.evidence.record_misfit import Misfit, as_document, misfit_of_fit
from bayeschute.study.job import Job
from bayeschute.study.run.fit import several_starts, structures
from bayeschute.study.run.stage_identifiability import of_fit

Array = NDArray[np.float64]
Checks = dict[str, dict[str, Any]]
"""By name: whether it passed, value, bound and what they are."""
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

    def of_search(self) -> Checks:
        """Whether an optimum was found, and what was simulated to find it is sound."""
        lost = f"{self.failed} of {self.evaluations} simulations failed while sampling"
        return {
            "failed_solves": _check(
                self.failed / max(self.evaluations, 1), 0.01, self.failed <= 0.01 * self.evaluations, lost
            ),
            "step_error": _below(
                0.2, self.step_errors,
                "largest integration error relative to the white measurement noise of the channel",
            ),
            "mode": _check(
                min(self.least_falls), 0.0, all(self.modes),
                "smallest decrease of the log density one standard deviation away from the mode, along any axis; 0.5 "
                "for a Gaussian, and positive at a maximum",
            ),
            "draws_distance": _below(
                _FAR_DRAWS, self.away,
                "largest distance of the mean of the draws from the mode along any axis, in standard deviations of the "
                "Gaussian approximation",
            ),
        }  # fmt: skip

    def of_noise_model(self) -> Checks:
        """Whether one-step prediction errors are as wide as they should be."""
        worst = max(self.shares, key=lambda share: share.excess)
        detail = (
            f"share of the {worst.data:,} standardised innovations (one-step prediction errors) of a flight inside "
            f"their central 90 % interval; the bound is the target, with a tolerance of {worst.tolerance:.2g}"
        )
        return {"innovations": _check(worst.inside, 0.9, worst.excess < 1.0, detail)}

    def of_density(self) -> Checks:
        """Whether the density that was sampled is right, and parts of the records agree about it."""
        made = {
            "log_determinant": _below(
                MOST_SHIFT, self.determinant_errors,
                "largest change of a mean, in standard deviations, or relative of a standard deviation, that the error "
                "of the log density implies: against Laplace's approximation at points of the posterior, by importance "
                "weights, and at draws, by a regression of the errors",
            )
        }  # fmt: skip
        if self.tails:
            made["pareto_k"] = _below(
                MOST_K, self.tails,
                "Pareto k of the importance ratios exact/surrogate density at the surrogate's proposals; below 0.7 the "
                "proposals cover the exact posterior and the correction is reliable",
            )  # fmt: skip
        if self.dispersions:
            worst = max(self.dispersions, key=lambda one: one.ratio / one.bound)
            detail = (
                "scatter of the scores of parts of the records over that by their information; 1 where the model is "
                "right. Beyond the bound, which one right model in a hundred exceeds, parts disagree about the "
                "parameters. Variances that the records determine are widened by the ratio to be expected "
                f"({worst.factor:.2g}) where the model has latent disturbances"
            )
            made["score_dispersion"] = _check(worst.ratio, worst.bound, not worst.disagree, detail)
        return made


def _check(value: float, bound: float, passed: bool, detail: str) -> dict[str, Any]:
    return {"passed": bool(passed), "value": float(value), "bound": bound, "detail": detail}


def _below(bound: float, values: Sequence[float], detail: str) -> dict[str, Any]:
    """All values must be less than a bound."""
    return _check(max(values), bound, max(values) < bound, detail)


def _of_fits(job: Job, identify: bool) -> _Fits:
    todo, say = groups(job), job.say("check")
    stored, steps, shares, misfit = [], [], [], []
    identifiability: dict[str, FitIdentifiability] = {}
    for i, group in enumerate(todo):
        one = load_fit(job, group)
        for flight, along in zip(one.marginal.flights, one.marginal.along, strict=True):
            steps.append(_step_error(flight, one.optimum.theta, along))
            shares.append(_innovation_share(flight, along))
        say((i + 0.1) / len(todo), f"{group.name}: predictive checks")
        misfit.append(misfit_of_fit(job, group, one))
        if identify:
            say((i + 0.4) / len(todo), f"{group.name}: identifiability")
            identifiability[group.name] = of_fit(job, group, one)
        stored.append(one)
        say((i + 1) / len(todo), group.name)
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


class _Mixing(NamedTuple):
    """How well the chains mixed, by parameter.

    Attributes:
        rhat: R-hat.
        ess_bulk: Effective number of draws in the bulk.
        ess_tail: In the tails.
        checks: That they suffice.
    """

    rhat: dict[str, float]
    ess_bulk: dict[str, float]
    ess_tail: dict[str, float]
    checks: Checks


def _mixing(job: Job) -> _Mixing:
    """Of the sampler's own draws, where the uncertainty of the noise parameters was added to the posterior."""
    posterior, conditional, told = posterior_groups(job, "posterior", "conditional", "sample_stats")
    posterior = posterior.assign(conditional.data_vars)
    stats = {str(name): row.values for name, row in told.data_vars.items()}
    rhat, bulk, tail = (_over(posterior, f) for f in (arviz_stats.rhat, _ess_bulk, _ess_tail))
    chains = judge_rhat(list(rhat.values()), posterior.sizes["chain"], posterior.sizes["draw"])
    checks = {"rhat": _check(chains.largest, chains.bound, chains.passed, "largest R-hat of any parameter")}
    for kind, sizes in (("bulk", bulk), ("tail", tail)):
        least = min(sizes.values())
        detail = f"smallest {kind} effective sample size of any parameter"
        checks[f"ess_{kind}"] = _check(least, FEWEST, least > FEWEST, detail)
    return _Mixing(rhat, bulk, tail, checks | divergences_check(stats))


def check(job: Job, identify: bool = True) -> str:
    """Convergence diagnostics and checks of the fit, and the identifiability analysis.

    Args:
        job: The run.
        identify: Whether to run the identifiability analysis; replicates don't need it.
    """
    mixing, fits = _mixing(job), _of_fits(job, identify)
    unsettled = "number of fits whose optimisation did not converge"
    checks = mixing.checks | {"optimum": _check(float(not fits.converged), 0.0, fits.converged, unsettled)}
    if starts := job.load("fit/facts.json").get("starts"):
        checks["optima"] = several_starts.check(starts)
    if stacked := structures.summary_rows(job):
        checks["structures"] = structures.check(stacked)
    checks |= fits.of_search() | fits.of_noise_model() | fits.of_density()
    checks["predictive"] = verdict([one for fit in fits.misfit for one in fit.checks])
    job.save(PREDICTIVE, assemble.as_plain(as_document(fits.misfit)))
    if identify:
        job.save("identifiability.json", assemble.as_plain(to_plain(fits.identifiability, without_none=True)))
    sizes = {"rhat": mixing.rhat, "ess_bulk": mixing.ess_bulk, "ess_tail": mixing.ess_tail}
    job.save("checks.json", {"checks": checks, **sizes})
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
    finer = replace(flight, model=replace(model, stepping=model.stepping.finer()))
    latent_path = along.at.latent_path(flight)
    coarse, fine = (np.asarray(stepped(one, theta, latent_path)[1]) for one in (flight, finer))
    change = Seen(np.zeros((*np.shape(flight.observed), 1)), (fine - coarse)[..., None])
    return float(np.max(np.abs(np.asarray(innovations(along.gains, *change)))))


def _innovation_share(flight: FlightData, along: Linearisation) -> _InnovationShare:
    """Of the linear model at the optimum."""
    unit = np.asarray(innovations(along.gains, *as_seen(along.linear).column(0)))[..., 0]
    inside = np.abs(unit[np.asarray(flight.present)]) < 1.6449
    return _InnovationShare(float(np.mean(inside)), inside.size)
