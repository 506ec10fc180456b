"""Campaigns: the same rows whoever makes them, whatever dies on the way."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from bayeschute.calibration.campaign import run
from bayeschute.calibration.replicate_rows import read_rows
from bayeschute.core.errors import InputError

SEEDS = range(40, 48)


def drawn(seed: int) -> dict[str, Any]:
    """A replicate whose row follows from its seed alone; one in eight fails."""
    if seed == 43:
        return {"seed": seed, "ok": False, "error": "lost"}
    return {"seed": seed, "ok": True, "value": float(np.random.default_rng(seed).standard_normal())}


def dies_once(seed: int, folder: str) -> dict[str, Any]:
    """The same, but the first worker that is given seed 45 is killed."""
    mark = Path(folder) / "killed"
    if seed == 45 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), 9)
    return drawn(seed)


def deadly(seed: int) -> dict[str, Any]:
    """The same, but whoever is given seed 45 is killed, every time."""
    if seed == 45:
        os.kill(os.getpid(), 9)
    return drawn(seed)


def refuses(seed: int) -> dict[str, Any]:
    raise AssertionError(f"replicate {seed} was there already")


def test_rows_come_in_the_order_of_seeds_and_failures_are_among_them(tmp_path: Path):
    rows = run(drawn, SEEDS, tmp_path / "rows", "a")
    assert rows == [drawn(seed) for seed in SEEDS]


def test_finished_rows_are_kept(tmp_path: Path):
    path = tmp_path / "rows"
    first = run(drawn, SEEDS[:5], path, "a")
    assert run(refuses, SEEDS[:5], path, "a") == first
    assert run(drawn, SEEDS, path, "a") == [drawn(seed) for seed in SEEDS]


def test_a_row_whose_writing_was_killed_is_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Nothing is seen of a file until it is whole."""

    def killed(*_: Any) -> None:
        raise KeyboardInterrupt

    folder = tmp_path / "rows"
    run(drawn, SEEDS[:3], folder, "a")
    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", killed)
        with pytest.raises(KeyboardInterrupt):
            run(drawn, SEEDS, folder, "a")
    assert sorted(read_rows(folder, "a")) == list(SEEDS[:3]) == sorted(set(pd.read_parquet(folder)["seed"]))
    assert run(drawn, SEEDS, folder, "a") == [drawn(seed) for seed in SEEDS]


def test_progress_tells_failures_and_what_is_left(tmp_path: Path):
    told: list[tuple[float, str]] = []
    run(drawn, SEEDS, tmp_path / "rows", "a", progress=lambda *said: told.append(said))
    assert told[-1][0] == 1.0 and "8 of 8, 1 failed" in told[-1][1]


def test_a_dead_scheduler_is_bad_input(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("bayeschute.calibration.workers.ANSWERS_WITHIN", 1.0)
    with pytest.raises(InputError, match="Dask scheduler"):
        run(drawn, SEEDS, tmp_path / "rows", "a", address="tcp://127.0.0.1:9")


def test_a_killed_worker_changes_nothing(tmp_path: Path):
    """Two processes, one killed in the middle: the folder holds the rows that one process makes."""
    path = tmp_path / "rows"
    rows = run(partial(dies_once, folder=str(tmp_path)), SEEDS, path, "a", workers=2)
    assert (tmp_path / "killed").exists()
    assert rows == [drawn(seed) for seed in SEEDS]
    assert read_rows(path, "a") == {row["seed"]: row for row in rows}


def test_a_replicate_that_kills_its_workers_takes_no_other_with_it(tmp_path: Path):
    rows = run(deadly, SEEDS, tmp_path / "rows", "a", workers=2)
    bad = rows.pop(SEEDS.index(45))
    assert bad["seed"] == 45 and not bad["ok"] and "worker lost" in bad["error"]
    assert rows == [drawn(seed) for seed in SEEDS if seed != 45]
