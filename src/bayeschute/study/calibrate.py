"""Calibration of a study: coverage over replicate flights, stored as evidence for the calibration label."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from bayeschute.calibration.campaign import run
from bayeschute.calibration.coverage_tables import summarise
from bayeschute.calibration.domain import domain
from bayeschute.core.errors import Fault, InputError
from bayeschute.study.evidence.conditions import stored_conditions
from bayeschute.study.evidence.identity import configuration, identity, with_noise
from bayeschute.study.evidence.provenance import provenance
from bayeschute.study.evidence.scenarios import SCENARIOS
from bayeschute.study.job import write_json
from bayeschute.study.load import load_study
from bayeschute.study.replicate import replicate
from bayeschute.study.run.log import NAME as LOG
from bayeschute.study.run.log import Log, warnings_to
from bayeschute.study.study import Study

FIRST_SEED = 20_000
"""Seeds of replicates begin here, away from those that studies are tried with."""
NOISES = ("latent", "ar1", "ar1+white", "sandwich", "white")


def _sound(study: Study, disturbance: str, noise: str | None, replicates: int) -> None:
    faults = []
    if study.model != "cluster" or any(f.virtual is None for f in study.flights):
        wanted = "a cluster study whose flights are all virtual, so that truths are known"
        do = "Describe flights like yours in [flight.virtual] tables (bayeschute init DIR shows how)."
        faults.append(Fault(str(study.path), "a study with recorded flights", wanted, do))
    if disturbance not in SCENARIOS:
        faults.append(Fault("--disturbance", repr(disturbance), "one of " + ", ".join(SCENARIOS)))
    if noise is not None and noise not in NOISES:
        faults.append(Fault("--noise", repr(noise), "one of " + ", ".join(NOISES)))
    if study.predict.recalibrate is not None:
        do = "Leave that line out: recalibration learns from these replicates."
        faults.append(Fault("[predict] recalibrate", "a study whose bands are recalibrated", "bands as predicted", do))
    if replicates < 2:
        faults.append(Fault("--replicates", str(replicates), "at least 2"))
    if faults:
        raise InputError(faults)


def calibrate(
    study: Study | Path | str,
    out: Path | str,
    replicates: int = 100,
    disturbance: str = "none",
    noise: str | None = None,
    workers: int = 1,
    address: str | None = None,
    quick: bool = False,
    first_seed: int = FIRST_SEED,
    progress: Callable[[float, str], None] | None = None,
) -> dict[str, Any]:
    """Simulate replicates of a study, identify and predict each as in a run, and measure the coverage.

    Finished replicates are kept; called again with the same arguments, only those that are missing are made.

    Args:
        study: A study whose flights are virtual, or its file.
        out: Folder for rows and the result.
        replicates: How many.
        disturbance: Misspecification of the simulated flights, by its name in `SCENARIOS`.
        noise: Replaces ``[noise] model``; the study's where None.
        workers: Local processes.
        address: Of a Dask scheduler, in place of local processes.
        quick: Small sizes; the result is not for use.
        first_seed: Seed of the first replicate.
        progress: Called with the share done and words.

    Returns:
        The result, as written to ``<noise>.<disturbance>.json``: see `calibration.coverage_tables.summarise`, and
        study, noise, disturbance, the domain of the replicates, hashes of configuration and numerics, and command,
        commit, date, machine and versions.

    Raises:
        InputError: If study or arguments are invalid, or `out` contains rows of another campaign.
    """
    study = study if isinstance(study, Study) else load_study(study)
    _sound(study, disturbance, noise, replicates)
    study = with_noise(study, noise or study.noise.model)
    name, folder = f"{study.noise.model}.{disturbance}", Path(out)
    with Log(folder / LOG) as log, warnings_to(log):
        log.line(f"bayeschute {version('bayeschute')}, {replicates} replicates of {study.path.name}, {name}")
        progress_log = log.beside(None if progress is None else lambda _, share, words: progress(share, words))
        rows = run(
            partial(replicate, study=study, disturbance=disturbance, quick=quick),
            range(first_seed, first_seed + replicates),
            folder / f"{name}.rows",
            identity(study, disturbance, quick),
            workers,
            address,
            partial(progress_log, "calibrate"),
        )
    result = {
        "study": study.path.stem,
        "title": study.title,
        "noise": study.noise.model,
        "disturbance": disturbance,
        "says": SCENARIOS[disturbance].says,
        "quick": quick,
        "seeds": [first_seed, first_seed + replicates - 1],
        **summarise(rows),
        "domain": domain(stored_conditions(rows)),
        "hash": configuration(study, quick),
        **provenance(_command(study.path, replicates, disturbance, noise, quick)),
    }
    write_json(folder / f"{name}.json", result)
    return result


def _command(path: Path, replicates: int, disturbance: str, noise: str | None, quick: bool) -> str:
    """The command line that makes the same result, in the folder it was made in."""
    place, here = path.resolve(), Path.cwd()
    words = ["bayeschute calibrate", str(place.relative_to(here) if place.is_relative_to(here) else place.name)]
    words += [f"--replicates {replicates}"] + [f"--disturbance {disturbance}"] * (disturbance != "none")
    return " ".join(words + ([f"--noise {noise}"] if noise else []) + ["--quick"] * quick)
