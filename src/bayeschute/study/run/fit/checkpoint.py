"""Checkpoints of a fit: a run that was stopped continues from there and gives the same draws bit by bit.

Stored are the joint optimum of every group (and of every start, where there are several) and the draws of every
sampler, in `fit/kept`, under the hash of all that the fit depends on: a checkpoint of another model, record, setting or
version is not used. Steps in between are computed again, with the same results. A finished fit deletes its checkpoints.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from bayeschute.core.trees import load_tree, save_tree
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior.fit.drawn_density import Sampled
from bayeschute.posterior.fit.joint_fit import JointFit
from bayeschute.study.job import Job

T = TypeVar("T")


class _Kept(NamedTuple):
    """A group's joint optimum, with the priors of its parameters and the scores of left-out terms."""

    priors: tuple[Prior, ...]
    settled: JointFit
    scores: dict[str, float]


def clear(job: Job) -> None:
    """Delete the checkpoints."""
    shutil.rmtree(_folder(job), ignore_errors=True)


def put_settled(job: Job, name: str, priors: Sequence[Prior], settled: JointFit, scores: dict[str, float]) -> None:
    """Keep a group's joint optimum.

    Args:
        job: The run.
        name: Of the group.
        priors: Of its parameters, terms that were added among them.
        settled: The optimum.
        scores: Of left-out terms.
    """
    _write(job, name, _Kept(tuple(priors), settled, scores))


def get_settled(job: Job, name: str) -> tuple[list[Prior], JointFit, dict[str, float]] | None:
    """A group's joint optimum as `put_settled` took it; None where this run has kept none."""
    kept = _read(job, name, _Kept)
    return None if kept is None else (list(kept.priors), kept.settled, kept.scores)


def put_draws(job: Job, name: str, kind: str, drawn: Sampled) -> None:
    """Keep the draws of a group by a sampler, with their density."""
    _write(job, f"{name}.{kind}", drawn)


def get_draws(job: Job, name: str, kind: str) -> Sampled | None:
    """Draws as `put_draws` took them; None where this run has kept none."""
    return _read(job, f"{name}.{kind}", Sampled)


def put_said(job: Job, name: str, value: Any) -> None:
    """Keep plain values under a name."""
    _write(job, name, json.dumps(value))


def get_said(job: Job, name: str) -> Any:
    """Plain values as `put_said` took them; None where this run has kept none."""
    said = _read(job, name, str)
    return None if said is None else json.loads(said)


def _folder(job: Job) -> Path:
    return job.out / "fit" / "kept"


def _write(job: Job, name: str, value: Any) -> None:
    save_tree(_folder(job) / f"{name}.npz", {"hash": job.hash, "kept": value})


def _read(job: Job, name: str, kind: type[T]) -> T | None:
    path = _folder(job) / f"{name}.npz"
    if not path.exists() or load_tree(path, str, "hash") != job.hash:
        return None
    return load_tree(path, kind, "kept")
