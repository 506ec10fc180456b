"""A campaign: one row of results per replicate, made anywhere, kept as it comes, the same whoever made it.

Rows are appended to a file of JSON lines under a first line that names the campaign's hash. A campaign that was stopped
goes on where it was; a file of another campaign is refused. Replicates run in this process, in local processes, or on a
Dask cluster; a worker that dies costs its replicate, which Dask gives to another.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from bayeschute.calibration.workers import Lost, client_of, finished
from bayeschute.errors import Fault, InputError

Row = dict[str, Any]
Task = Callable[[int], Row]
Progress = Callable[[float, str], None]


def read_rows(path: Path, identity: str) -> dict[int, Row]:
    """Rows of a campaign's file by seed; none where there is no file. A last line cut by a kill is dropped.

    Raises:
        InputError: If the file belongs to another campaign or holds something else.
    """
    if not path.exists():
        return {}
    lines = path.read_text(encoding="utf-8").splitlines()
    rows: dict[int, Row] = {}
    do = "Choose another --out, or remove the file to begin anew."
    try:
        found = json.loads(lines[0])["campaign"] if lines else identity
        if found != identity:
            raise InputError(Fault(str(path), f"rows of campaign {found[:12]}", f"campaign {identity[:12]}", do))
        for number, line in enumerate(lines[1:], 2):
            try:
                row = json.loads(line)
            except json.JSONDecodeError:
                if number == len(lines):
                    break
                raise
            rows[int(row["seed"])] = row
    except (json.JSONDecodeError, KeyError, TypeError) as error:
        raise InputError(Fault(str(path), f"a line that is no row ({error})", "rows of a campaign", do)) from error
    return rows


def _rewrite(path: Path, identity: str, rows: dict[int, Row]) -> None:
    """Whole lines only, so that appending begins on a line of its own."""
    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_name(f".{path.name}.part")
    aside.write_text("\n".join(json.dumps(r) for r in [{"campaign": identity}, *rows.values()]) + "\n", "utf-8")
    aside.replace(path)


def run(
    task: Task,
    seeds: Sequence[int],
    path: Path,
    identity: str,
    workers: int = 1,
    address: str | None = None,
    progress: Progress | None = None,
) -> list[Row]:
    """Make the rows of all seeds that the file does not hold yet.

    Args:
        task: Makes the row of a seed; it counts its own failures as rows with ``ok`` false. Sent to workers, so it must
            be a function of a module or a partial of one.
        seeds: Seeds wanted.
        path: The file of rows.
        identity: Hash of all that rows depend on beside the seed.
        workers: Local processes; 1: this one.
        address: Of a Dask scheduler, in place of local processes.
        progress: Called with the share done and words.

    Returns:
        Rows of the seeds, in their order, whoever made them and whenever.

    Raises:
        InputError: See `read_rows` and `bayeschute.calibration.workers`.
    """
    say = progress or (lambda share, words: None)
    rows = read_rows(path, identity)
    _rewrite(path, identity, rows)
    todo = [seed for seed in seeds if seed not in rows]
    began, kept = time.perf_counter(), len(seeds) - len(todo)
    say(kept / max(len(seeds), 1), f"{kept} of {len(seeds)} kept from earlier" if kept else "begins")
    cluster = client_of(workers if todo else 1, address if todo else None)
    with cluster as client, path.open("a", encoding="utf-8") as out:
        for done, (seed, made) in enumerate(finished(task, todo, client), 1):
            lost = {"seed": seed, "ok": False, "wall_s": 0.0}
            row = lost | {"error": f"worker lost: {made.why}"} if isinstance(made, Lost) else made
            rows[seed] = row
            out.write(json.dumps(row) + "\n")
            out.flush()
            failed = sum(not rows[seed]["ok"] for seed in seeds if seed in rows)
            left = (time.perf_counter() - began) / done * (len(todo) - done)
            words = f"{kept + done} of {len(seeds)}, {failed} failed, about {left / 60.0:.0f} min left"
            say((kept + done) / len(seeds), words)
    return [rows[seed] for seed in seeds]
