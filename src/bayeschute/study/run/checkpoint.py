"""What a fit keeps while it goes on: a run that was stopped goes on from there, to the same draws bit by bit.

Kept are the joint optimum of every group (and of every start, where there are several) and the draws of every sampler,
in `fit/kept`, under the hash of all that the fit depends on: what was kept for another model, record, setting or
version is not used. What lies between the two is made again, and is the same. A fit that has ended leaves nothing
there.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.files import write_whole
from bayeschute.likelihood.joint import Hyper
from bayeschute.likelihood.noise import Noise
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior.fit import Settled
from bayeschute.posterior.joint_mode import Optimum
from bayeschute.posterior.sampling.protocol import Draws
from bayeschute.study.assembly.fits import as_arrays, from_arrays
from bayeschute.study.job import Job

Arrays = dict[str, NDArray[Any]]
_NOISE = ("white", "correlated", "time_constant")


def clear(job: Job) -> None:
    """Forget what was kept."""
    shutil.rmtree(_folder(job), ignore_errors=True)


def put_settled(job: Job, name: str, priors: Sequence[Prior], settled: Settled, scores: dict[str, float]) -> None:
    """Keep a group's joint optimum.

    Args:
        job: The run.
        name: Of the group.
        priors: Of its parameters, terms that were added among them.
        settled: The optimum.
        scores: Of left-out terms.
    """
    best, hyper = settled.optimum, settled.hyper
    arrays: Arrays = {
        "said": np.array(json.dumps({"priors": [p.__dict__ for p in priors], "scores": scores})),
        "theta": best.theta,
        "covariance": best.covariance,
        "facts": np.array([best.cost, best.converged, best.iterations, best.last_step, settled.evidence]),
        "trace": np.array(best.trace),
        **{key: np.asarray(getattr(hyper.noise, key)) for key in _NOISE},
        **{f"law{i}": np.asarray(law) for i, law in enumerate(hyper.laws)},
    }
    for i, at in enumerate(best.flights):
        arrays |= as_arrays(at, i)
    _write(job, name, arrays)


def get_settled(job: Job, name: str) -> tuple[list[Prior], Settled, dict[str, float]] | None:
    """A group's joint optimum as `put_settled` took it; None where this run has kept none."""
    a = _read(job, name)
    if a is None:
        return None
    said = json.loads(str(a["said"]))
    cost, converged, iterations, last, evidence = a["facts"]
    flights = tuple(from_arrays(a, i) for i in range(_count(a, "path")))
    best = Optimum(
        a["theta"], flights, a["covariance"], float(cost), bool(converged), int(iterations), float(last),
        tuple(map(float, a["trace"])),
    )  # fmt: skip
    hyper = Hyper(Noise(*(a[key] for key in _NOISE)), tuple(a[f"law{i}"] for i in range(_count(a, "law"))))
    return [Prior(**p) for p in said["priors"]], Settled(best, hyper, float(evidence)), said["scores"]


def put_draws(job: Job, name: str, kind: str, draws: Draws) -> None:
    """Keep the draws of a group by a sampler."""
    said = {"failed": draws.failed, "evaluations": draws.evaluations, "notes": draws.notes}
    stats = {f"stats.{key}": np.asarray(value) for key, value in draws.stats.items()}
    arrays = {"said": np.array(json.dumps(said)), "xi": draws.xi, "log_density": draws.log_density, **stats}
    _write(job, f"{name}.{kind}", arrays)


def get_draws(job: Job, name: str, kind: str) -> Draws | None:
    """Draws as `put_draws` took them; None where this run has kept none."""
    a = _read(job, f"{name}.{kind}")
    if a is None:
        return None
    said = json.loads(str(a["said"]))
    stats = {key.removeprefix("stats."): value for key, value in a.items() if key.startswith("stats.")}
    return Draws(a["xi"], a["log_density"], stats, said["failed"], said["evaluations"], tuple(said["notes"]))


def put_said(job: Job, name: str, value: Any) -> None:
    """Keep plain values under a name."""
    _write(job, name, {"said": np.array(json.dumps(value))})


def get_said(job: Job, name: str) -> Any:
    """Plain values as `put_said` took them; None where this run has kept none."""
    a = _read(job, name)
    return None if a is None else json.loads(str(a["said"]))


def _folder(job: Job) -> Path:
    return job.out / "fit" / "kept"


def _count(arrays: Arrays, stem: str) -> int:
    return sum(key.startswith(stem) and key[len(stem) :].isdigit() for key in arrays)


def _write(job: Job, name: str, arrays: Arrays) -> None:
    def write(path: Path) -> None:
        with path.open("wb") as file:
            np.savez(file, hash=np.array(job.hash), allow_pickle=False, **arrays)

    write_whole(_folder(job) / f"{name}.npz", write)


def _read(job: Job, name: str) -> Arrays | None:
    path = _folder(job) / f"{name}.npz"
    if not path.exists():
        return None
    with np.load(path, allow_pickle=False) as file:
        return {key: file[key] for key in file.files} if str(file["hash"]) == job.hash else None
