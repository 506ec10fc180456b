"""The log of a run: lines as they come, none twice, warnings of libraries among them and not on the screen."""

from __future__ import annotations

import logging
import re
import warnings
from pathlib import Path

import numpy as np
import pytest

from bayeschute.study.run import log as module
from bayeschute.study.run.log import Log, warnings_to

LINE = re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d[+-]\d{4} +\d+\.\d s  (.*)")


def _said(path: Path) -> list[str]:
    """What the lines say, each with its time in front."""
    found = [LINE.fullmatch(line) for line in path.read_text(encoding="utf-8").splitlines()]
    assert all(found)
    return [" ".join(match[1].split()) for match in found if match]


def test_lines_are_there_at_once_and_a_later_run_goes_on_beneath(tmp_path: Path):
    path = tmp_path / "new" / "log.txt"
    with Log(path) as log:
        log.line("a\nb")
        assert _said(path) == ["a b"]
    log.line("too late")
    with Log(path) as log:
        log.line("c")
    assert _said(path) == ["a b", "c"]


def test_what_ended_it_is_said(tmp_path: Path):
    for error in (KeyboardInterrupt(), ValueError("lost\non purpose")):
        with pytest.raises(type(error)), Log(tmp_path / "log.txt"):
            raise error
    assert _said(tmp_path / "log.txt") == ["stopped", "ended by ValueError: lost on purpose"]


def test_words_are_written_when_they_change(tmp_path: Path, monkeypatch):
    clock = iter(np.arange(0.0, 100.0, 0.12).tolist())  # read several times a message
    monkeypatch.setattr(module.time, "perf_counter", lambda: next(clock))
    heard = []
    with Log(tmp_path / "log.txt") as log:
        tell = log.beside(lambda *said: heard.append(said))
        tell("fit", 0.0, "")
        for i in range(1000):
            tell("fit", i / 2000, "opening")
            if i == 50:
                break
        for i in range(20):
            tell("fit", 0.5 + i / 100, f"nuts: {i} of 20, cost -1.5e-{i}")
        tell("fit", 1.0, "done")
        tell("fit", 1.0, "done")
        tell("check", 1.0, "kept")
    said = _said(tmp_path / "log.txt")
    counts = [line for line in said if "nuts" in line]
    assert said[:2] == ["fit 0 % begins", "fit 0 % opening"] and said[-2:] == ["fit 100 % done", "check 100 % kept"]
    assert 4 <= len(counts) <= 10 and counts[0] == "fit 50 % nuts: 0 of 20, cost -1.5e-0"
    assert len(said) == 4 + len(counts) and len(heard) == 1 + 51 + 20 + 3


def test_shares_never_fall_and_the_time_left_of_a_steady_pace_is_told(tmp_path: Path, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(module.time, "perf_counter", lambda: now[0])
    heard = []
    with Log(tmp_path / "log.txt") as log:
        tell = log.beside(lambda *said: heard.append(said))
        for step in range(101):
            now[0] = 3.0 * step
            tell("fit", 0.005 * step, "a" if step else "")
        for seconds, share, words in [(305.0, 0.5, "b"), (306.0, 0.4, "c"), (900.0, 0.55, "d"), (990.0, 1.0, "e")]:
            now[0] = seconds
            tell("fit", share, words)
    assert [share for _, share, _ in heard][-5:] == [0.5, 0.5, 0.5, 0.55, 1.0]
    assert _said(tmp_path / "log.txt") == [
        "fit 0 % begins",
        "fit 0 % a",
        "fit 50 % b (about 4 to 8 min left)",
        "fit 50 % c (about 4 to 8 min left)",
        "fit 55 % d",
        "fit 100 % e",
    ]


def test_warnings_go_to_the_log_once_each(tmp_path: Path, capfd):
    def careless() -> None:
        for _ in range(3):
            np.log(np.array([-1.0]))
        warnings.warn("deaf", UserWarning, stacklevel=1)
        for _ in range(2):
            logging.getLogger("jax._src.xla_bridge").warning("no %s found", "GPU")
        logging.getLogger("some.library").info("not worth a word")

    before = warnings.showwarning, list(logging.getLogger().handlers)
    with Log(tmp_path / "log.txt") as log, warnings_to(log):
        warnings.simplefilter("always")
        careless()
    assert (warnings.showwarning, list(logging.getLogger().handlers)) == before
    said = _said(tmp_path / "log.txt")
    assert len(said) == 3 and "invalid value encountered in log" in said[0] and "test_log.py:" in said[0]
    assert said[1].startswith("UserWarning: deaf (") and said[2] == "warning of jax._src.xla_bridge: no GPU found"
    out, err = capfd.readouterr()
    assert out == err == ""


def test_a_warning_that_was_made_an_error_still_is_one(tmp_path: Path):
    with Log(tmp_path / "log.txt") as log, warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(UserWarning, match="deaf"), warnings_to(log):
            warnings.warn("deaf", UserWarning, stacklevel=1)
