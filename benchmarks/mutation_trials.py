"""A change tried by test files, in a copy of the tree that is thrown away: the checkout is never touched.

Every worker has a copy of its own and runs one test file at a time, on one thread. What fails is run once more where
nothing is changed but one unused name per module: a test file that fails there too says nothing of the change.
"""

from __future__ import annotations

import importlib.util
import math
import os
import queue
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from threading import Lock
from time import perf_counter
from typing import Any, NamedTuple

LEFT_OUT = {
    ".git", ".venv", "runs", "build", "dist", "__pycache__", ".hypothesis", ".mypy_cache", ".pytest_cache",
    ".ruff_cache", ".import_linter_cache",
}  # fmt: skip
"""Folders that no copy needs."""
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS", "NPROC")
MEMORY = 16 * 2**30  # of a process [B]
OPTIONS = ["-x", "-q", "-p", "no:cacheprovider"]
if importlib.util.find_spec("hypothesis"):
    OPTIONS.append("--hypothesis-seed=0")  # the same examples every time
NO_TESTS = 5  # pytest's status where it selects none
UNUSED = "\n_unchanged = True\n"


@dataclass(frozen=True)
class Mutant:
    """One change of the sample.

    Attributes:
        number: Its place in the sample, from 1.
        room: Room that it lies in.
        file: Module, from the root.
        line: Where it begins, from 1.
        kind: What is changed.
        before: The line as it is.
        after: As it is changed.
        text: The whole module, changed.
    """

    number: int
    room: str
    file: str
    line: int
    kind: str
    before: str
    after: str
    text: str = field(repr=False)

    def told(self) -> dict[str, Any]:
        """All but the text."""
        return {name: value for name, value in asdict(self).items() if name != "text"}


class Tried(NamedTuple):
    """How a test file ended: ``passed``, ``failed``, ``timeout`` or ``none`` (no test selected).

    Attributes:
        outcome: One of these.
        seconds: It took [s].
        said: The first failure, in pytest's words.
    """

    outcome: str
    seconds: float
    said: str


class Trials:
    """Runs test files in copies of a tree: one copy per worker, and one that is unchanged but for unused names.

    Args:
        root: The tree.
        place: Folder for the copies.
        workers: How many changes are tried at once.
        limit: Longest time of a test file [s].
        keep: Takes a row about a test file where nothing is changed.
        known: Such rows, of an earlier part of the same sample.
    """

    def __init__(
        self,
        root: Path,
        place: Path,
        workers: int,
        limit: float,
        keep: Callable[[dict[str, Any]], None],
        known: Iterable[Mapping[str, Any]] = (),
    ) -> None:
        self.limit, self.root, self.keep = limit, root, keep
        self.free = queue.SimpleQueue[Path]()
        for worker in range(workers):
            self.free.put(self._copy(place / str(worker)))
        self.unchanged = self._copy(place / "unchanged")
        for path in (self.unchanged / "src").rglob("*.py"):
            path.write_text(path.read_text(encoding="utf-8") + UNUSED, encoding="utf-8")
        self.lock, self.locks = Lock(), dict[str, Lock]()
        self.unchanged_took = {row["baseline"]: row["seconds"] if row["sound"] else math.inf for row in known}
        self.running, self.ended = set[subprocess.Popen[bytes]](), False

    def _copy(self, to: Path) -> Path:
        def left_out(_: str, names: list[str]) -> set[str]:
            return LEFT_OUT & set(names)

        return Path(shutil.copytree(self.root, to, ignore=left_out, symlinks=True))

    def trusted(self, test: str, late: bool) -> bool:
        """Whether a test file passes where nothing is changed, which is tried once.

        Args:
            test: The file.
            late: It was too late with a change, so half of the time has to do for it without one.
        """
        with self.lock:
            lock = self.locks.setdefault(test, Lock())
        with lock:
            if test not in self.unchanged_took:
                tried = self.run(self.unchanged, test)
                sound = tried.outcome == "passed"
                self.keep({"baseline": test, "sound": sound} | tried._asdict())
                self.unchanged_took[test] = tried.seconds if sound else math.inf
        return self.unchanged_took[test] <= self.limit / (2.0 if late else 1.0)

    def judge(self, mutant: Mutant, tests: Sequence[tuple[str, bool]], most: int) -> dict[str, Any]:
        """Try a change: its row.

        Args:
            mutant: The change.
            tests: Test files in their order, and whether each mirrors the module.
            most: Files tried besides those that mirror.
        """
        start, passed, others = perf_counter(), list[str](), 0
        found: dict[str, Any] = {"result": "survived", "by": None, "said": ""}
        with self._changed(mutant) as place:
            for test, mirrors in tests:
                if others == most and not mirrors:
                    break
                if math.isinf(self.unchanged_took.get(test, 0.0)):
                    continue
                tried = self.run(place, test)
                late = tried.outcome == "timeout"
                if tried.outcome in ("failed", "timeout") and self.trusted(test, late):
                    found = {"result": "timeout" if late else "caught", "by": test, "said": tried.said}
                    break
                if tried.outcome == "passed":
                    passed.append(test)
                    others += not mirrors
        return mutant.told() | found | {"passed": passed, "seconds": round(perf_counter() - start, 1)}

    @contextmanager
    def _changed(self, mutant: Mutant) -> Iterator[Path]:
        """A copy with the change made, for a time."""
        place = self.free.get()
        path = place / mutant.file
        whole = path.read_bytes()
        try:
            _write(path, mutant.text.encode())
            yield place
        finally:
            _write(path, whole)
            self.free.put(place)

    def run(self, place: Path, test: str) -> Tried:
        """Run a test file in a copy, in a group of processes of its own that ends when its time is over."""
        command = [sys.executable, "-m", "pytest", *OPTIONS, test]
        others = [one for one in os.environ.get("PYTHONPATH", "").split(os.pathsep) if one]
        kept = [one for one in others if not Path(one).resolve().is_relative_to(self.root.resolve())]
        paths = os.pathsep.join([str(place / "src"), str(place), *kept])
        environment = {"JAX_PLATFORMS": "cpu"} | os.environ | dict.fromkeys(THREADS, "1") | {"PYTHONPATH": paths}
        start = perf_counter()
        if self.ended:
            raise InterruptedError("no test is run any more")
        with tempfile.TemporaryFile() as said:
            process = subprocess.Popen(
                command, cwd=place, env=environment, stdin=subprocess.DEVNULL, stdout=said, stderr=subprocess.STDOUT,
                start_new_session=True,
            )  # fmt: skip
            self.running.add(process)
            if sys.platform == "linux":  # a wrong size may ask for all memory there is
                with suppress(ProcessLookupError):
                    resource.prlimit(process.pid, resource.RLIMIT_DATA, (MEMORY, MEMORY))
            try:
                status: int | None = process.wait(self.limit)
            except subprocess.TimeoutExpired:
                status = None
                _end(process)
            self.running.discard(process)
            if self.ended:
                raise InterruptedError(f"{test} was ended")
            said.seek(0)
            text = said.read().decode(errors="replace")
        outcome = {None: "timeout", 0: "passed", NO_TESTS: "none"}.get(status, "failed")
        told = _first_failure(text, status) if outcome == "failed" else ""
        return Tried(outcome, round(perf_counter() - start, 1), told.replace(str(place), ""))

    def end(self) -> None:
        """End what still runs; nothing is run after that."""
        self.ended = True
        for process in tuple(self.running):
            _end(process)


def _write(path: Path, content: bytes) -> None:
    """Write a module without what Python has kept of it: size and second of the change may be those of before."""
    path.write_bytes(content)
    Path(importlib.util.cache_from_source(str(path))).unlink(missing_ok=True)


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a process that is still running, with all of its group."""
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _first_failure(text: str, status: int | None) -> str:
    """Pytest's line about the first failure, or its last words."""
    lines = [line for line in text.splitlines() if line.strip()] or [""]
    told = [line for line in lines if line.startswith(("FAILED ", "ERROR "))]
    return (told or [f"status {status}: {lines[-1]}"])[0][:300]
