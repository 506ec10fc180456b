"""A replicate: the virtual flights of a study simulated again, fitted and predicted as in a run, and scored."""

from __future__ import annotations

import tempfile
import time
import traceback
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bayeschute.calibration.mode_scores import score_modes, score_values
from bayeschute.calibration.recalibration import scaled_shares
from bayeschute.calibration.scores import inside, score
from bayeschute.core.numerics import clear_compiled
from bayeschute.prediction.flight_statistics import REDUCTIONS
from bayeschute.study.assembly import assemble
from bayeschute.study.assembly.fits import summary_draws
from bayeschute.study.evidence.conditions import conditions
from bayeschute.study.evidence.numerics_hash import PACKAGE
from bayeschute.study.evidence.scenarios import SCENARIOS
from bayeschute.study.job import Job
from bayeschute.study.run import stage_list
from bayeschute.study.run.forecasts import FlightForecast, forecast_flights
from bayeschute.study.run.stage_report import flown_terms, true_values
from bayeschute.study.study import Study

Row = dict[str, Any]
WINDOW = 30.0  # [s] of the time since the start by which scores are split


def replicate(seed: int, study: Study, disturbance: str = "none", quick: bool = False) -> Row:
    """Fly, identify, predict and score one replicate.

    Args:
        seed: Of its winds, noise and draws.
        study: The study, its noise model as wanted.
        disturbance: Misspecification of the simulated flights, by its name in `SCENARIOS`.
        quick: Small sizes; the result is not for use.

    Returns:
        A row for a campaign: ``ok`` false, with the error, where any step failed.
    """
    began = time.perf_counter()
    try:
        row = _scored(replace(study, seed=seed), disturbance, quick)
    except Exception as error:  # any error fails this replicate only: it is counted and reported
        frames = [f for f in traceback.extract_tb(error.__traceback__) if PACKAGE in Path(f.filename).parents]
        row = {
            "ok": False,
            "error": f"{type(error).__name__} in {frames[-1].name}: {' '.join(str(error).split())}"[:500],
        }
    clear_compiled()
    return {"seed": seed, **row, "wall_s": time.perf_counter() - began}


def _scored(study: Study, disturbance: str, quick: bool) -> Row:
    kind = SCENARIOS[disturbance]
    sized = assemble.smaller(study) if quick else study
    with tempfile.TemporaryDirectory(prefix="bayeschute-") as folder:
        job = Job(sized, Path(folder), quick, "", lambda *_: None)
        stage_list.ingest(replace(job, study=kind.flown(sized)))
        for stage in (stage_list.structure, stage_list.priors):
            stage(job)
        stage_list.fit(job, predictions=False)
        stage_list.check(job, identify=False)
        draws, _ = summary_draws(job)
        truth = true_values(job) if kind.terms_known else {}
        parameters = {
            name: {
                "truth": value,
                "mean": float(draws[name].mean()),
                "sd": float(draws[name].std()),
                "inside": inside(draws[name].ravel(), value),
            }
            for name, value in truth.items()
        }
        left_out = sorted(name for name in flown_terms(study) if name not in draws) if kind.terms_known else []
        checks = job.load("checks.json")["checks"]
        bands, modes, statistics = {}, {}, {}
        for one in forecast_flights(job):
            name = one.flight.name
            bands[name], modes[name], statistics[name] = _bands(one, job), _modes(one), _statistics(one, job)
        return {
            "ok": True,
            "parameters": parameters,
            "left_out": left_out,
            "bands": bands,
            "modes": modes,
            "statistics": statistics,
            "conditions": conditions(job)._asdict(),
            "missed_checks": [name for name, check in checks.items() if not check["passed"]],
            "pareto_k": checks["pareto_k"]["value"] if "pareto_k" in checks else None,
            "simulations_failed": int(checks["failed_solves"]["value"] > checks["failed_solves"]["bound"]),
        }


def _bands(one: FlightForecast, job: Job) -> dict[str, Any]:
    """Scores of every wanted quantity of a flight: over its counted samples, and by time since the start."""
    assert one.truth is not None
    since, made = one.time - one.time[0], {}
    part = np.minimum(
        np.floor(since / WINDOW + 1e-6), np.ceil(since[-1] / WINDOW - 1e-6) - 1.0
    )  # the last takes its end
    for name in job.study.predict.quantities or ():
        draws, truth = one.prediction.draws[name], one.truth[name].values
        windows = {}
        for k in range(int(np.ceil(since[-1] / WINDOW - 1e-6))):
            here = one.counted & (part == k)
            if here.any():
                windows[f"{k * WINDOW:.0f}-{min((k + 1) * WINDOW, since[-1]):.0f} s"] = score(
                    draws[:, here], truth[here]
                )
        whole = score(draws[:, one.counted], truth[one.counted])
        entry: dict[str, Any] = whole._asdict()
        entry["by_time"] = {key: value.coverage for key, value in windows.items()}
        entry["role"] = "predict" if one.held_out.any() else "identify"
        entry["scaled"] = scaled_shares(draws[:, one.counted], truth[one.counted])
        made[name] = entry
    return made


def _modes(one: FlightForecast) -> dict[str, Any]:
    """Scores of amplitude and frequency of the modes of a flight over its scored samples."""
    assert one.truth is not None
    drawn = {name: values[:, one.counted] for name, values in one.prediction.draws.items()}
    true = {name: one.truth[name].values[one.counted] for name in drawn if name in one.truth}
    return score_modes(drawn, true, float(one.time[1] - one.time[0]))


def _statistics(one: FlightForecast, job: Job) -> dict[str, Any]:
    """Scores of the statistics that requirements, exceedance and tolerance limits are about."""
    assert one.truth is not None
    drawn, true = {}, {}
    for name in job.study.predict.quantities or ():
        for statistic, reduced in REDUCTIONS.items():
            drawn[f"{statistic} {name}"] = reduced(one.prediction.draws[name][:, one.counted])
            true[f"{statistic} {name}"] = float(reduced(one.truth[name].values[None, one.counted])[0])
    return score_values(drawn, true)
