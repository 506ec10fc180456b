"""Console output of the commands: lines, input faults, progress bars, results as JSON."""

from __future__ import annotations

import errno
import os
import re
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType, TracebackType
from typing import TYPE_CHECKING, Any

import typer

from bayeschute.core.errors import Fault, InputError, harmless
from bayeschute.core.pace import Pace, percent

if TYPE_CHECKING:
    from rich.progress import Progress, ProgressColumn, Task, TaskID


_EVERY = 20.0  # between lines of progress where there is no terminal [s]
_REFUSALS = ("ENOSPC", "EDQUOT", "EFBIG", "EROFS", "EACCES", "EPERM", "EIO", "ENOMEM", "EMFILE", "ENFILE")
_OF_SYSTEM = {getattr(errno, name) for name in _REFUSALS if hasattr(errno, name)}
_NUMBER = re.compile(r"\berrno = (\d+)")  # as HDF5 tells it when a file can't be closed
_NO_MEMORY = (  # of libraries
    "RESOURCE_EXHAUSTED", "Unable to allocate", "can't start new thread", "failed to map segment",
    "Cannot allocate memory", "std::bad_alloc",
)  # fmt: skip


_asked_to_stop = threading.Event()  # by Ctrl-C


def say(text: str = "", error: bool = False) -> None:
    """Print a line, to stderr if it reports an error."""
    typer.echo(harmless(text), err=error)


@contextmanager
def reporting_faults(when_stopped: str = "") -> Iterator[None]:
    """Turn invalid input into one line per fault and exit code 2, Ctrl-C into 130, what the system refuses into 3.

    Args:
        when_stopped: How a command that was stopped goes on.

    Raises:
        typer.Exit: In their place; every other error passes.
    """
    try:
        with _hearing_every_stop():
            yield
    except InputError as error:
        for fault in error.faults:
            say(" ".join(str(fault).split()), error=True)
        raise typer.Exit(2) from error
    except KeyboardInterrupt as stop:
        say(f"Stopped. {when_stopped}".strip(), error=True)
        raise typer.Exit(130) from stop
    except (OSError, RuntimeError, MemoryError, ImportError) as error:
        why = refused(error)
        if not why:
            raise
        say(f"Stopped by the system: {why}. {when_stopped}".strip(), error=True)
        raise typer.Exit(3) from error


@contextmanager
def _hearing_every_stop() -> Iterator[None]:
    """Remember a Ctrl-C, for the next sign of progress: one that falls into a callback of a library is lost there."""
    before, usual = signal.getsignal(signal.SIGINT), sys.unraisablehook
    if before is not signal.default_int_handler or threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: FrameType | None) -> None:
        _asked_to_stop.set()
        raise KeyboardInterrupt

    def tell(lost: sys.UnraisableHookArgs) -> None:
        if not isinstance(lost.exc_value, KeyboardInterrupt):
            usual(lost)

    signal.signal(signal.SIGINT, stop)
    sys.unraisablehook = tell
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        sys.unraisablehook = usual
        _asked_to_stop.clear()


def refused(error: BaseException) -> str:
    """What the system refused, in words: room on a disk, rights, memory; empty where an error is another one's fault.

    Args:
        error: As it was raised; libraries hide the system's number in their text.
    """
    text = " ".join(str(error).split())
    if isinstance(error, MemoryError) or any(words in text for words in _NO_MEMORY):
        return "the memory is used up"
    hidden = _NUMBER.search(text)
    number = error.errno if isinstance(error, OSError) and error.errno else int(hidden[1]) if hidden else 0
    if number not in _OF_SYSTEM:
        return ""
    where = error.filename if isinstance(error, OSError) else None
    return os.strerror(number) + (f": {os.fsdecode(where)}" if isinstance(where, str | bytes) else "")


class Bars:
    """Progress bars, one per stage; an instance is the progress callback of long computations.

    Call it with the stage's name, the share that is done (0 to 1), and a few words; the words given with 1 remain on
    the terminal as the summary of the stage. A bar never goes back; where the stage goes on at a steady pace it tells
    about how long it still takes, and nothing about that where it doesn't. Where standard error is a file or a pipe,
    lines take the place of bars, some a minute; they tell the time that passed where that left is not known.
    """

    def __init__(self) -> None:
        self._pace = Pace()
        self._progress: Progress | None = None
        self._tasks: dict[str, TaskID] = {}
        self._in_lines = False
        self._last_line, self._last_time = "", -_EVERY

    def __enter__(self) -> Bars:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        stage, words = TextColumn("{task.description:<10}", markup=False), _words_column(self._pace)
        bar, console = BarColumn(bar_width=16), Console(stderr=True)
        if not (console.is_terminal or console.is_jupyter):
            self._in_lines = True
            return self
        self._progress = Progress(stage, bar, TimeElapsedColumn(), words, console=console, expand=True)
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._progress is not None:
            self._progress.stop()

    def __call__(self, stage: str, done: float, words: str = "") -> None:
        """Move the bar of a stage; stop where that was asked for and is not done."""
        if _asked_to_stop.is_set():
            _asked_to_stop.clear()
            raise KeyboardInterrupt
        if self._progress is None and not self._in_lines:
            return
        words, done = harmless(words), self._pace.at(stage, done)
        if self._progress is None:
            told = ": ".join(part for part in (self._pace.told(stage), words) if part)
            line, now = f"{stage:<10} {percent(done):3d} % {told}".rstrip(), time.monotonic()
            if line != self._last_line and (done >= 1.0 or now - self._last_time >= _EVERY):
                say(line, error=True)
                self._last_line, self._last_time = line, now
            return
        if stage not in self._tasks:
            self._tasks[stage] = self._progress.add_task(stage, total=1.0, words="")
        self._progress.update(self._tasks[stage], completed=done, words=words)


def _words_column(pace: Pace) -> ProgressColumn:
    """The column of words, with the time left in front: as it is now, also where no step has ended for long."""
    from rich.progress import ProgressColumn
    from rich.table import Column
    from rich.text import Text

    class Words(ProgressColumn):
        def render(self, task: Task) -> Text:
            parts = (pace.left(task.description), task.fields["words"])
            return Text(": ".join(part for part in parts if part))

    return Words(Column(ratio=1, no_wrap=True, overflow="ellipsis"))  # on a narrow screen words are cut, not the bar


def place_for_json(where: str | None) -> None:
    """Refuse a path for results where no file can be written."""
    if where not in (None, "-") and (Path(where).is_dir() or not Path(where).absolute().parent.is_dir()):
        raise InputError(
            Fault(f"--json {where}", "a path where no file can be written", "a file in a folder that exists")
        )


def write_json(content: dict[str, Any], where: str) -> None:
    """Write JSON to a file, or to standard output where the file is ``-``."""
    import json

    text = json.dumps(content, indent=2, allow_nan=False)
    if where == "-":
        say(text)
        return
    try:
        Path(where).write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(Fault(f"--json {where}", str(error), "a file that can be written")) from error
