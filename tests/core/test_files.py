"""Files appear whole or not at all, also where several threads write the same one."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import pytest

from bayeschute.core.files import write_whole


def test_a_file_is_there_only_when_it_is_whole(tmp_path: Path):
    path = tmp_path / "new" / "a.txt"
    seen = []

    def write(aside: Path) -> None:
        aside.write_text("whole")
        seen.append((path.exists(), aside.suffix, aside.name[0]))

    write_whole(path, write)
    (path.parent / ".a.part.txt").write_text("what a killed process left")
    write_whole(path, write)
    assert seen == [(False, ".txt", "."), (True, ".txt", ".")] and path.read_text() == "whole"
    assert list(path.parent.iterdir()) == [path]


def test_what_fails_leaves_the_file_that_was_there(tmp_path: Path):
    path = tmp_path / "a.txt"
    path.write_text("before")

    def write(aside: Path) -> None:
        aside.write_text("half")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_whole(path, write)
    assert path.read_text() == "before" and list(tmp_path.iterdir()) == [path]


def test_threads_that_write_one_file_do_not_disturb_each_other(tmp_path: Path):
    path, texts = tmp_path / "a.txt", [str(i) * 200_000 for i in range(8)]
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda text: write_whole(path, partial(Path.write_text, data=text), True), texts * 4))
    assert path.read_text() in texts and list(tmp_path.iterdir()) == [path]
