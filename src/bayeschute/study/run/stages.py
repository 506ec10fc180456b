"""The job: stages in order, each cached by the hash of its inputs and resumable, each leaving files and nothing else.

``ingest -> structure -> priors -> fit -> check -> predict -> risk -> report``. A stage reads what earlier ones wrote;
it counts as finished when its marker holds the hash of the study, of the program's version and of the stages before it;
the report also when what stored replicates held is still the same.
Files are written aside and moved into place, so a run killed at any moment leaves whole files only. A fit that fails
ends the run with a summary and a report of what is known all the same; ``log.txt`` tells line by line what was done.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from bayeschute.core.errors import Fault, FitError, InputError
from bayeschute.core.files import write_whole
from bayeschute.core.version import __version__
from bayeschute.study.evidence.calibration_status import calibration_check
from bayeschute.study.job import Job, Progress
from bayeschute.study.load import Study, load_study, study_hash
from bayeschute.study.run.log import NAME as LOG
from bayeschute.study.run.log import Log, warnings_to

STAGES = ("ingest", "structure", "priors", "fit", "check", "predict", "risk", "report")
LEFT = 3
"""What stages leave for each other: one more where a program can't, or mustn't, go on from what an earlier one left."""


def _marker(job: Job, stage: str) -> Path:
    return job.out / ".stages" / stage


def _stage_hashes(job: Job) -> dict[str, str]:
    hashes, before = {}, job.hash
    for stage in STAGES:
        before = hashlib.sha256(f"{before}:{stage}".encode()).hexdigest()
        hashes[stage] = before
    # The report's label is of what replicates held: it is written anew where others were stored since.
    held = json.dumps(calibration_check(job), sort_keys=True)
    return hashes | {"report": hashlib.sha256(f"{before}:{held}".encode()).hexdigest()}


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
) -> dict[str, Any]:
    """Run a study.

    Args:
        path: Study file, or a study that was read.
        out: Folder of the run; made where missing.
        until: Last stage to run; all where None.
        resume: Reuse stages that finished with the same inputs.
        quick: Small sizes, same code; the result says that it is not for use.
        data_dir: Replaces ``${DATA}`` in the study's files.
        seed: Replaces the study's seed.
        progress: Called with stage, share done and words.
        workers: Local processes that predictions are spread over; 1: this one. Results are the same.
        address: Of a Dask scheduler, in place of local processes.

    Returns:
        ``summary.json``; empty if the last stage has not run. After a fit that failed, which ends the run: ``label``
        is "no fit", and ``fit`` says why, what was tried and what the best flights leave of the data.

    Raises:
        InputError: If the study, its files or `until` are not sound, or `out` holds something else; if Dask is
            wanted and not there; if bands are to be recalibrated and no calibration tells how.
    """
    from bayeschute.study.assembly import assemble
    from bayeschute.study.evidence.recalibrate import widening

    if until is not None and until not in STAGES:
        raise InputError(Fault("--until", repr(until), "one of " + ", ".join(STAGES)))
    study = path if isinstance(path, Study) else load_study(path, data_dir)
    if seed is not None:
        study = replace(study, seed=seed)
    if quick:
        study = assemble.smaller(study)
    folder = Path(out)
    if folder.exists() and any(folder.iterdir()) and not (folder / ".stages").is_dir():
        wanted = "a new folder or one of an earlier run"
        raise InputError(Fault(str(folder), "a folder with other files", wanted, "Choose another --out."))
    text = f"{study_hash(study)}:{__version__}:{LEFT}:{quick}"
    digest = hashlib.sha256(text.encode()).hexdigest()
    job = Job(study, folder, quick, digest, progress or (lambda *_: None), resume, workers, address)
    learned = widening(job)  # told before anything slow where it is not there
    if learned is not None:
        job = replace(job, hash=hashlib.sha256(f"{digest}:{json.dumps(learned)}".encode()).hexdigest())
    (folder / ".stages").mkdir(parents=True, exist_ok=True)
    write_whole(folder / "study.toml", lambda p: p.write_text(_as_run(job)))
    with Log(folder / LOG) as log, warnings_to(log):
        log.line(f"bayeschute {__version__}, seed {study.seed}, {study.path.name}: {study.title}")
        _run_stages(replace(job, progress=log.beside(progress)), until)
    summary = folder / "summary.json"
    return dict(json.loads(summary.read_text())) if summary.exists() else {}


def _run_stages(job: Job, until: str | None) -> None:
    """Do every stage that isn't done, up to the last one wanted or to a fit that fails."""
    from bayeschute.study.run import failure, stage_list

    hashes, resume = _stage_hashes(job), job.resume
    for stage in STAGES:
        marker = _marker(job, stage)
        if resume and marker.exists() and marker.read_text() == hashes[stage]:
            job.progress(stage, 1.0, "kept from an earlier run")
        else:
            _forget(job, stage)
            resume = False
            job.progress(stage, 0.0, "")
            try:
                words = getattr(stage_list, stage)(job)
            except (FitError, FloatingPointError) as error:
                if stage != "fit":
                    raise
                job.progress(stage, 0.0, failure.keep(job, error))
                return
            write_whole(marker, partial(Path.write_text, data=hashes[stage]))
            job.progress(stage, 1.0, words)
        if stage == until:
            return


def _forget(job: Job, stage: str) -> None:
    """Count a stage and those after it as not done, and take away what tells of their results."""
    from bayeschute.study.run import failure

    failure.forget(job)
    for later in STAGES[STAGES.index(stage) :]:
        _marker(job, later).unlink(missing_ok=True)
    for name in ("report.html", "summary.json"):
        (job.out / name).unlink(missing_ok=True)


def _as_run(job: Job) -> str:
    """The study file as it ran, with what identifies the run in front."""
    study = job.study
    sizes = "quick, not for use" if job.quick else "full sizes"
    head = [
        f"# bayeschute {__version__}; seed {study.seed}; {sizes}",
        f"# sha256 of study, vehicle and records: {study_hash(study)}",
    ]
    return "\n".join([*head, "", study.text])
