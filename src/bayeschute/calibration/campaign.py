"""Simulation campaign: one row of results per replicate, stored as it is computed, resumable and reproducible.

Rows are stored one by one (`bayeschute.calibration.replicate_rows`). A campaign that was stopped continues where it
was; rows of another campaign are refused. Replicates run in this process, in local processes, or on a Dask cluster; the
replicate of a worker that dies is lost, or run again by Dask on another worker.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

from bayeschute.calibration.replicate_rows import Row, read_rows, write_row
from bayeschute.calibration.workers import Lost, client_of, finished

Task = Callable[[int], Row]
Progress = Callable[[float, str], None]


def run(
    task: Task,
    seeds: Sequence[int],
    folder: Path,
    identity: str,
    workers: int = 1,
    address: str | None = None,
    progress: Progress | None = None,
) -> list[Row]:
    """Compute the rows of all seeds that the folder does not contain yet.

    Args:
        task: Makes the row of a seed; it counts its own failures as rows with ``ok`` false. Sent to workers, so it must
            be a function of a module or a partial of one.
        seeds: Seeds wanted.
        folder: Of the rows.
        identity: Hash of all that rows depend on except the seed.
        workers: Local processes; 1: this one.
        address: Of a Dask scheduler, in place of local processes.
        progress: Called with the share done and words.

    Returns:
        Rows of the seeds, in their order, whoever made them and whenever.

    Raises:
        InputError: See `read_rows` and `bayeschute.calibration.workers`.
    """
    say = progress or (lambda share, words: None)
    rows = read_rows(folder, identity)
    todo = [seed for seed in seeds if seed not in rows]
    began, kept = time.perf_counter(), len(seeds) - len(todo)
    say(kept / max(len(seeds), 1), f"{kept} of {len(seeds)} kept from earlier" if kept else "begins")
    cluster = client_of(workers if todo else 1, address if todo else None)
    with cluster as client:
        for done, (seed, made) in enumerate(finished(task, todo, client), 1):
            lost = {"seed": seed, "ok": False, "wall_s": 0.0}
            row = lost | {"error": f"worker lost: {made.why}"} if isinstance(made, Lost) else made
            rows[seed] = row
            write_row(folder, identity, row)
            failed = sum(not rows[seed]["ok"] for seed in seeds if seed in rows)
            left = (time.perf_counter() - began) / done * (len(todo) - done)
            words = f"{kept + done} of {len(seeds)}, {failed} failed, about {left / 60.0:.0f} min left"
            say((kept + done) / len(seeds), words)
    return [rows[seed] for seed in seeds]
