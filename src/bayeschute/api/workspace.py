"""Temporary run folder of a function of the public interface; its files are kept in memory."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from bayeschute.study.job import Job, Progress
from bayeschute.study.study import Study

Files = Mapping[str, bytes]
KEPT = (
    "flights/*.nc", "structure.*", "priors.json", "fit/**/*", "checks.json", "identifiability.json", "predictive.json",
    "history.json",
)  # fmt: skip
"""Files that a stored posterior needs for later predictions."""


@contextmanager
def workspace(study: Study, files: Files | None = None, progress: Progress | None = None) -> Iterator[Job]:
    """A run in a temporary folder, which is deleted afterwards.

    Args:
        study: The study.
        files: Initial content of the folder, by name.
        progress: Called with stage, share done and words.
    """
    with tempfile.TemporaryDirectory(prefix="bayeschute-") as name:
        folder = Path(name)
        for at, content in (files or {}).items():
            path = folder / at
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        drawn_with = str((study.sampler, study.seed))  # draws that a fit has kept serve these sizes and this seed only
        yield Job(study, folder, False, drawn_with, progress or (lambda *_: None), resume=bool(files))


def collected(folder: Path, patterns: tuple[str, ...] = KEPT) -> dict[str, bytes]:
    """Files of a run's folder by name."""
    found = sorted({path for pattern in patterns for path in folder.glob(pattern) if path.is_file()})
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in found}
