"""Results of a failed fit: the reason, what was tried, the best trajectories found; summary and report."""

from __future__ import annotations

from typing import Any

import numpy as np

from bayeschute.core.errors import FitError
from bayeschute.core.trees import save_tree
from bayeschute.posterior.best_path import BestPath
from bayeschute.study.assembly import assemble
from bayeschute.study.job import Job, load_priors
from bayeschute.study.run.stage_report import heading, origin

LABEL = "no fit"


def keep(job: Job, error: FitError | FloatingPointError) -> str:
    """Write ``fit/failed.npz``, ``fit/failed.json``, ``summary.json`` and ``report.html`` of a fit that failed.

    Args:
        job: The run; its stages before the fit are done.
        error: The error that ended the fit.

    Returns:
        A line for the progress.
    """
    from bayeschute.report.page import build_report

    if not isinstance(error, FitError):
        error = FitError(str(error), (str(error),))
    paths: tuple[BestPath, ...] = error.paths
    save_tree(job.out / "fit" / "failed.npz", paths)
    facts = {"reason": error.reason, "tried": error.tried, "residuals": {p.flight: _residuals(p) for p in paths}}
    job.save("fit/failed.json", assemble.as_plain(facts | {"parameters": _parameters(job, error)}))
    fit = {"fit": {"converged": False, **facts}}
    job.save("summary.json", assemble.as_plain(heading(job, LABEL) | fit | origin(job)))
    build_report(job.out)
    return f"failed: {error.reason}"


def forget(job: Job) -> None:
    """Delete the results of an earlier failed fit."""
    for name in ("failed.json", "failed.npz"):
        (job.out / "fit" / name).unlink(missing_ok=True)


def _residuals(path: BestPath) -> dict[str, dict[str, Any]]:
    """Per output: root mean square of the residuals, standard deviation of the sensor noise, number of samples."""
    counts = np.isfinite(path.residual).sum(axis=0)
    rows = zip(path.outputs, path.rms(), path.noise, counts, strict=True)
    return {name: {"rms": rms, "noise": noise, "samples": count} for name, rms, noise, count in rows}


def _parameters(job: Job, error: FitError) -> list[dict[str, Any]]:
    """Parameters at the best point, and their priors."""
    before = {prior.name: prior.moments() for prior in load_priors(job)}
    rows = []
    for name, value, se, unit in error.parameters:
        row = {"name": name, "value": value, "standard_error": se, "unit": unit}
        known = dict(zip(("prior_mean", "prior_sd"), before.get(name, ()), strict=False))
        rows.append(row | known)
    return rows
