"""Log file of a run: progress of its stages and warnings of libraries, line by line."""

from __future__ import annotations

import logging
import re
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import TextIO

from bayeschute.core.errors import harmless
from bayeschute.core.pace import Pace, percent

NAME = "log.txt"
"""The file's name in a run's folder."""
_APART = 1.0
"""Least time between lines of a stage that differ in their numbers only [s]."""
_NUMBERS = re.compile(r"-?\d+(\.\d+)?(e[+-]?\d+)?")

Progress = Callable[[str, float, str], None]


class Log:
    """A file that is written and flushed line by line; a later run appends to it.

    A line contains date and time, seconds since the log was opened, and text: of a stage, how much of it is done and,
    where its pace tells that, about how long it still takes.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: TextIO | None = None
        self._lock = threading.Lock()  # warnings come from any thread
        self._pace = Pace()
        self._said: dict[str, tuple[float, str, float]] = {}  # per stage: share, words, when

    def __enter__(self) -> Log:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._file, self._began = self._path.open("a", encoding="utf-8"), time.perf_counter()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None:
            self.line("stopped" if issubclass(kind, KeyboardInterrupt) else f"ended by {kind.__name__}: {error}")
        if self._file is not None:
            self._file.close()

    def line(self, words: str) -> None:
        """Write a line."""
        now, since = datetime.now().astimezone(), time.perf_counter() - self._began
        with self._lock:
            if self._file is not None and not self._file.closed:
                self._file.write(f"{now:%Y-%m-%d %H:%M:%S%z} {since:9.1f} s  {harmless(' '.join(words.split()))}\n")
                self._file.flush()

    def progress(self, stage: str, share: float, words: str) -> None:
        """Write a progress message of a stage, unless it repeats the last one.

        Lines that differ in nothing but numbers are written once a second at most; the last line of a stage, at share
        1, always is.
        """
        now, last = time.perf_counter(), self._said.get(stage)
        if last is not None and share < 1.0:
            _, before, when = last
            alike = _NUMBERS.sub("#", words) == _NUMBERS.sub("#", before)
            if words == before or not words or (alike and now - when < _APART):
                return
        if last is not None and last[:2] == (share, words):
            return
        self._said[stage] = (share, words, now)
        left = self._pace.left(stage)
        self.line(f"{stage:<9} {percent(share):3d} %  {words or 'begins'}{left and f' ({left})'}")

    def beside(self, progress: Progress | None) -> Progress:
        """A progress function that writes here and then calls another, both with shares that never fall."""

        def both(stage: str, share: float, words: str) -> None:
            share = self._pace.at(stage, share)
            self.progress(stage, share, words)
            if progress is not None:
                progress(stage, share, words)

        return both


class _Handler(logging.Handler):
    """Logging handler that passes the messages of libraries to a function."""

    def __init__(self, tell: Callable[[str], None]) -> None:
        super().__init__(logging.WARNING)
        self._tell = tell

    def emit(self, record: logging.LogRecord) -> None:
        """Hand a record on."""
        self._tell(f"{record.levelname.lower()} of {record.name}: {record.getMessage()}")


@contextmanager
def warnings_to(log: Log) -> Iterator[None]:
    """Send warnings of libraries, raised or logged, to the log and not to the terminal; each is written once.

    Which warnings are shown at all stays as it was set: one that was made an error still is.
    """
    seen = set[str]()

    def tell(words: str) -> None:
        if words not in seen:
            seen.add(words)
            log.line(words)

    def show(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        where = filename.replace("\\", "/").rpartition("site-packages/")[2]
        tell(f"{category.__name__}: {message} ({where}:{lineno})")

    handler, root = _Handler(tell), logging.getLogger()
    with warnings.catch_warnings():
        warnings.showwarning = show
        root.addHandler(handler)
        try:
            yield
        finally:
            root.removeHandler(handler)
