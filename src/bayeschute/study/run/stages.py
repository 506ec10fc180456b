"""The run: stages in order, each cached by the hash of its inputs and resumable.

``ingest -> structure -> priors -> fit -> check -> predict -> risk -> report``. A stage reads what earlier ones wrote;
it counts as finished while its marker contains its key (`bayeschute.study.stage_keys`) and its result is there, whether
or not a stage before it was run again because of inputs that it does not read.
Files are written to a temporary name and moved into place, so a run killed at any moment leaves whole files only. A fit
that fails ends the run with a summary and a report of the results that need no fit; ``log.txt`` is the log.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from bayeschute.core.errors import Fault, FitError, InputError
from bayeschute.core.files import write_whole
from bayeschute.core.version import __version__
from bayeschute.study import kept_inputs
from bayeschute.study.evidence.identity import places, stored
from bayeschute.study.evidence.recalibrate import NAME as RECALIBRATION
from bayeschute.study.folder_lock import alone_in
from bayeschute.study.job import Job, Progress
from bayeschute.study.load import load_study
from bayeschute.study.run.log import NAME as LOG
from bayeschute.study.run.log import Log, warnings_to
from bayeschute.study.stage_keys import STAGES, readers, stage_keys
from bayeschute.study.study import Study, study_hash

RESULTS = (
    "flights", "fit", "risk", "figures", "structure.json", "structure.txt", "priors.json", "posterior.nc",
    "posterior.emcee.nc", "checks.json", "predictive.json",
    "identifiability.json", "predictions.nc", "coverage.json", RECALIBRATION,
    "curves.csv", "summary.json", "report.html", "study.toml", LOG,
)  # fmt: skip
"""All that a run writes into its folder and ``--force`` removes. Markers of finished stages, and ``inputs``, which the
study to be run may itself name, are brought up to date instead."""


_ALWAYS = {"fit": "posterior.nc", "check": "checks.json", "report": "report.html"}  # of a stage, whatever the study


def _marker(folder: Path, stage: str) -> Path:
    return folder / ".stages" / stage


def has_ended(folder: Path, stage: str) -> bool:
    """Whether a folder has the results of a stage, made from those of earlier stages that lie beside them."""
    return _marker(folder, stage).is_file()


def run_study(
    path: Path | str | Study,
    out: Path | str,
    until: str | None = None,
    resume: bool = False,
    quick: bool = False,
    data_dir: Path | str | None = None,
    seed: int | None = None,
    progress: Progress | None = None,
    workers: int = 1,
    address: str | None = None,
    force: bool = False,
) -> dict[str, Any]:
    """Run a study.

    Args:
        path: Study file, or a study that was read.
        out: Folder of the run; made where missing.
        until: Last stage to run; all where None.
        resume: Continue in the folder of an earlier run; stages whose inputs are unchanged are reused.
        quick: Few draws, same code; the result is marked as not for use.
        data_dir: Replaces ``${DATA}`` in the study's files.
        seed: Replaces the study's seed.
        progress: Called with stage, share done and words.
        workers: Local processes that predictions are spread over; 1: this one. Results are the same.
        address: Of a Dask scheduler, in place of local processes.
        force: Start again in the folder of an earlier run; its results are removed first.

    Returns:
        ``summary.json``; empty if the last stage has not run. After a fit that failed, which ends the run: ``label``
        is "no fit", and ``fit`` contains the reason, what was tried and the residuals of the best trajectories.

    Raises:
        InputError: If the study, its files or `until` are not sound; if `out` holds something else, or an earlier run
            and neither `resume` nor `force` is given, or both are; if another run is under way in it; if Dask is wanted
            and not there; if bands are to be recalibrated and no stored calibration gives the factors.
    """
    from bayeschute.study.assembly import assemble
    from bayeschute.study.evidence.recalibrate import widening

    if until is not None and until not in STAGES:
        raise InputError(Fault("--until", repr(until), "one of " + ", ".join(STAGES)))
    study = path if isinstance(path, Study) else load_study(path, data_dir)
    if seed is not None:
        study = replace(study, seed=seed)
    whole, folder = study, Path(out)
    if quick:
        study = assemble.smaller(study)
    with alone_in(folder):
        _check_folder(folder, resume, force)
        job = Job(study, folder, quick, "", progress or (lambda *_: None), resume, workers, address)
        learned = widening(job)  # fails before anything slow if it is missing
        if force:
            _remove(folder)
        (folder / ".stages").mkdir(parents=True, exist_ok=True)
        missing = kept_inputs.keep(whole, folder, _heading(job), data_dir)
        with Log(folder / LOG) as log, warnings_to(log):
            log.line(f"bayeschute {__version__}, seed {study.seed}, {study.path.name}: {study.title}")
            if missing:
                log.line(f"this run can't be made again from its folder: {missing}")
            by = None if learned is None else learned._asdict()
            _run_stages(replace(job, progress=log.beside(progress)), until, by)
    summary = folder / "summary.json"
    return dict(json.loads(summary.read_text())) if summary.exists() else {}


def _check_folder(folder: Path, resume: bool, force: bool) -> None:
    """Refuse a folder with other files, and an earlier run without `resume` or `force`."""
    earlier = (folder / ".stages").is_dir()
    if folder.exists() and any(folder.iterdir()) and not earlier:
        wanted = "a new folder or one of an earlier run"
        raise InputError(Fault(str(folder), "a folder with other files", wanted, "Choose another --out."))
    if resume and force:
        raise InputError(Fault("--force", "--resume together with it", "one of the two"))
    if earlier and not resume and not force:
        do = "Add --resume to go on and reuse what is unchanged, or --force to remove its results and begin anew."
        raise InputError(Fault(str(folder), "an earlier run", "a new folder, --resume or --force", do))


def _remove(folder: Path) -> None:
    """Remove the files that runs write into their folder, and nothing else."""
    for marker in (folder / ".stages").glob("*"):  # first, so that what is left, if this is stopped, counts as not done
        marker.unlink()
    for path in (folder / name for name in RESULTS):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)


def _run_stages(job: Job, until: str | None, learned: Any) -> None:
    """Do every stage that isn't done, up to the last one wanted or to a fit that fails."""
    from bayeschute.study.run import failure, stage_list

    # The label depends on stored replicates: the report is written again where others were stored since.
    held = stored(job.study, job.quick, places(job))
    keys = stage_keys(job.study, job.quick, {"predict": learned, "report": held})
    for stage in STAGES:  # results of other inputs must not remain next to new ones
        if _marker(job.out, stage).exists() and not _is_done(job, stage, keys[stage]):
            _forget(job, stage)
    for stage in STAGES:
        if _is_done(job, stage, keys[stage]):
            job.progress(stage, 1.0, "kept from an earlier run")
        else:
            _forget(job, stage)
            own = replace(job, hash=keys[stage])
            job.progress(stage, 0.0, "")
            try:
                words = getattr(stage_list, stage)(own)
            except (FitError, FloatingPointError) as error:
                if stage != "fit":
                    raise
                job.progress(stage, 0.0, failure.keep(own, error))
                return
            write_whole(_marker(job.out, stage), partial(Path.write_text, data=keys[stage]))
            job.progress(stage, 1.0, words)
        if stage == until:
            return


def _is_done(job: Job, stage: str, key: str) -> bool:
    """Whether a stage has finished with its present inputs, and its result was not removed since."""
    marker, result = _marker(job.out, stage), _ALWAYS.get(stage)
    return marker.exists() and marker.read_text() == key and (result is None or (job.out / result).exists())


def _forget(job: Job, stage: str) -> None:
    """Mark a stage and those that read its results as not done, and remove the summary of their results."""
    from bayeschute.study.run import failure

    failure.forget(job)
    for later in readers(stage):
        _marker(job.out, later).unlink(missing_ok=True)
    for name in ("report.html", "summary.json"):
        (job.out / name).unlink(missing_ok=True)


def _heading(job: Job) -> str:
    """Comment lines with the identity of a run, and how it is made again."""
    study = job.study
    sizes = "quick, not for use" if job.quick else "full sizes"
    quick = " --quick" if job.quick else ""
    return (
        f"# bayeschute {__version__}; seed {study.seed}; {sizes}\n"
        f"# sha256 of study, vehicle and records: {study_hash(study)}\n"
        f"# The same run again: bayeschute run study.toml --out FOLDER{quick}"
    )
