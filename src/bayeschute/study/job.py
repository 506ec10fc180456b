"""A run in progress: its study, its folder, and the results that its stages exchange."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr

from bayeschute.core.files import write_whole
from bayeschute.likelihood.priors import Prior, read_priors
from bayeschute.records.record import load_record
from bayeschute.study.study import Study

Progress = Callable[[str, float, str], None]
Say = Callable[[float, str], None]


@dataclass(frozen=True)
class Job:
    """A run in progress.

    Attributes:
        study: The study, with ``--quick`` sizes if requested.
        out: The run's folder.
        quick: Whether sizes are cut; results are then not for use.
        hash: Key of the stage that is done: of everything its results depend on.
        progress: Called with stage, share done and words.
        resume: Whether checkpoints of an unfinished stage of an earlier run may be used.
        workers: Local processes that predictions are spread over; 1: this one.
        address: Of a Dask scheduler, in place of local processes.
    """

    study: Study
    out: Path
    quick: bool
    hash: str
    progress: Progress
    resume: bool = False
    workers: int = 1
    address: str | None = None

    def say(self, stage: str) -> Callable[[float, str], None]:
        """A progress function of one stage."""
        return lambda share, words: self.progress(stage, share, words)

    def save(self, name: str, value: Any) -> None:
        """Write JSON, whole or not at all."""
        write_json(self.out / name, value)

    def load(self, name: str) -> Any:
        """Read JSON that a stage left."""
        return json.loads((self.out / name).read_text())


def part_of(say: Say, start: float, end: float) -> Say:
    """Progress callback for a part of a longer task."""
    return lambda share, words: say(start + (end - start) * share, words)


def write_json(path: Path, value: Any) -> None:
    """Write JSON, whole or not at all."""
    write_whole(path, lambda aside: aside.write_text(json.dumps(value, indent=1) + "\n", encoding="utf-8"))


def load_flight(job: Job, name: str) -> xr.Dataset:
    """The ingested record of a flight."""
    return load_record(job.out / "flights" / f"{name}.nc")


def load_truth(job: Job, name: str) -> xr.Dataset | None:
    """Truth of a virtual flight; None for a measured one."""
    path = job.out / "flights" / f"{name}.truth.nc"
    return xr.load_dataset(path, engine="h5netcdf") if path.exists() else None


def load_priors(job: Job) -> list[Prior]:
    """The priors of all parameters: those of the stage `priors`, or with the terms that the fit added."""
    revised = "fit/priors.json" if (job.out / "fit" / "priors.json").exists() else "priors.json"
    return read_priors(job.load(revised))
