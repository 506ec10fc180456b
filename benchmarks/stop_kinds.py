"""Ways to stop a run from outside: signals, a full disk, rights, memory, clocks, another run; see `hard_stops`."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bayeschute.study.stage_keys import STAGES

AGAIN = 0.25  # share of kills that are followed by another one
YEARS = 10 * 365.25 * 86400.0  # by which files are dated ahead or back [s]
AHEAD, BACK = "Etc/GMT-14", "Etc/GMT+12"  # 26 hours apart
MARGIN = 64e6  # of memory that is left at most [bytes]
FINISHED = "it had finished"
MOST_AGAIN = 5  # tries to kill a run before its end
REFUSED = (0, 3)  # exit codes where the system refuses something; 0 where the run needed it no more
PATIENCE = 3600.0  # for a run to end [s]


_over = threading.Event()
_under_way: list[Running] = []


@dataclass(frozen=True)
class Place:
    """Where and how runs are made.

    Attributes:
        study: The study file.
        work: Folder of all tries.
        seconds: Time that the reference took [s].
        size: Bytes of its folder.
    """

    study: Path
    work: Path
    seconds: float = 0.0
    size: int = 0

    @property
    def reference(self) -> Path:
        """Folder of the run that nothing stopped."""
        return self.work / "reference"

    def begin(self, out: Path, *options: str, zone: str | None = None) -> Running:
        """Start the command as a user would, in a process group of its own."""
        if _over.is_set():
            raise NotTriedError("the benchmark was stopped")
        command = [sys.executable, "-m", "bayeschute", "run", str(self.study), "--out", str(out), "--quick", *options]
        told = self.work / "told" / f"{out.parent.name}-{time.monotonic_ns()}.txt"
        told.parent.mkdir(parents=True, exist_ok=True)
        own = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        own |= {} if zone is None else {"TZ": zone}
        with told.open("wb") as file:
            process = subprocess.Popen(
                command, env=os.environ | own, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=file,
                start_new_session=True,
            )  # fmt: skip
        made = Running(process, told, time.perf_counter())
        _under_way.append(made)
        return made


@dataclass(frozen=True)
class Running:
    """A run under way: its process, the file with what it tells, when it began [s]."""

    process: subprocess.Popen[bytes]
    told: Path
    began: float

    def until(self, moment: float) -> bool:
        """Wait until a moment since the beginning [s]; returns whether the run still goes on."""
        try:
            self.process.wait(max(moment - (time.perf_counter() - self.began), 0.0))
        except subprocess.TimeoutExpired:
            return True
        return False

    def send(self, what: signal.Signals) -> None:
        """Send a signal to the whole group; nothing where it has ended."""
        try:
            os.killpg(self.process.pid, what)
        except ProcessLookupError:
            pass

    def end(self) -> Ended:
        """Wait for the end; what is left of the group is killed."""
        try:
            code = self.process.wait(PATIENCE)
        finally:
            self.send(signal.SIGKILL)
            self.process.wait()
            if self in _under_way:
                _under_way.remove(self)
        lines = self.told.read_text(encoding="utf-8", errors="replace").splitlines()
        said = [line.strip() for line in lines if line.strip()]
        trace = any(line.startswith(("Traceback (most", "Exception ignored")) for line in said)
        return Ended(code, said[-1] if said else "", trace, time.perf_counter() - self.began)


@dataclass(frozen=True)
class Ended:
    """How a run ended: exit code, last line on stderr, whether a traceback was shown, seconds."""

    code: int
    said: str
    traceback: bool
    seconds: float


@dataclass(frozen=True)
class Stopped:
    """A run after its stop.

    Attributes:
        out: Its folder.
        moment: Of the stop, since the start [s]; None where there was none.
        stage: What was under way, by the run's log.
        ended: How the stopped run ended.
        how: By which means it was stopped, or why it was not.
        sound: Whether it ended as it should, apart from tracebacks and files.
        zone: Time zone in which it is resumed.
    """

    out: Path
    moment: float | None
    stage: str
    ended: Ended
    how: str = ""
    sound: bool = True
    zone: str | None = None


class NotTriedError(RuntimeError):
    """A stop that isn't possible here, and why."""


def end_all() -> None:
    """Kill all runs that are under way, and begin no other."""
    _over.set()
    for run in list(_under_way):
        run.send(signal.SIGKILL)


def under_way(out: Path) -> str:
    """The last line of a run's log that tells of a stage, without its times."""
    path = out / "log.txt"
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines() if path.is_file() else []
    words = [" ".join(line.partition(" s  ")[2].split()) for line in lines]
    return next((one for one in reversed(words) if one.partition(" ")[0] in STAGES), "before the first stage")


def _killed(place: Place, out: Path, moment: float, *options: str, zone: str | None = None) -> Stopped:
    """A run that is killed at a moment."""
    run = place.begin(out, *options, zone=zone)
    goes_on = run.until(moment)
    run.send(signal.SIGKILL)
    return Stopped(out, moment, under_way(out), run.end(), "signal 9" if goes_on else FINISHED)


def _surely_killed(place: Place, out: Path, share: float, zone: str | None = None) -> Stopped:
    """A run that is killed after a share of its time; one that was faster than thought and ended is made again."""
    seconds = place.seconds
    for _ in range(MOST_AGAIN):
        made = _killed(place, out, share * seconds, zone=zone)
        if made.how != FINISHED:
            break
        seconds = min(made.ended.seconds, seconds)
        shutil.rmtree(out)
    return made


@contextmanager
def none(place: Place, folder: Path, number: int, rng: np.random.Generator) -> Iterator[Stopped]:
    """No stop."""
    run = place.begin(folder / "run")
    yield Stopped(folder / "run", None, "", run.end())


@contextmanager
def kill(place: Place, folder: Path, number: int, rng: np.random.Generator) -> Iterator[Stopped]:
    """Signal 9, sometimes twice."""
    first, second, again = rng.random(), rng.random(), rng.random() < AGAIN
    made = _surely_killed(place, folder / "run", first)
    if again:
        later = _killed(place, made.out, second * (1.0 - first) * place.seconds, "--resume")
        where = f"{made.stage}; resumed, {later.stage}"
        made = replace(made, stage=where, how=f"{made.how}, again after {later.moment:.1f} s", ended=later.ended)
    yield made


@contextmanager
def ctrl_c(place: Place, folder: Path, number: int, rng: np.random.Generator) -> Iterator[Stopped]:
    """The signal of Ctrl-C to all processes of the run, as a terminal sends it."""
    out, moment = folder / "run", place.seconds * rng.random()
    run = place.begin(out)
    goes_on = run.until(moment)
    stage = under_way(out)
    run.send(signal.SIGINT)
    ended = run.end()
    sound = ended.code in (130, -signal.SIGINT) or (ended.code == 0 and (not goes_on or stage.startswith("report 100")))
    yield Stopped(out, moment, stage, ended, "signal 2" if goes_on else FINISHED, sound)


@contextmanager
def disk(place: Place, folder: Path, number: int, rng: np.random.Generator) -> Iterator[Stopped]:
    """A disk with room for a part of the results (even numbers), or that others fill at a moment.

    Root makes a disk of memory for that. Others, and where that is forbidden, limit the size of a file.
    """
    share, moment, size = rng.uniform(0.02, 0.98), place.seconds * rng.random(), place.size
    mount, ballast = folder / "disk", folder / "disk" / "ballast"
    mount.mkdir()
    room = int(share * size) if number % 2 == 0 else 4 * size
    out = mount / "run"
    if os.geteuid() != 0 or not _done("mount", "-t", "tmpfs", "-o", f"size={room}", "tmpfs", str(mount)):
        most = int(share * max(path.stat().st_size for path in place.reference.rglob("*")))
        run = place.begin(out)
        _limit(run, resource.RLIMIT_FSIZE, most)
        ended, how = run.end(), f"limit on the size of a file, {most / 1e6:.2f} MB (no disk of memory here)"
        yield Stopped(out, ended.seconds, under_way(out), ended, how, ended.code in REFUSED)
        return
    try:
        run, how = place.begin(out), f"disk of memory, {room / 1e6:.2f} MB"
        if number % 2:
            run.until(moment)
            how += ", filled"
            _fill(ballast)
        ended = run.end()
        ballast.unlink(missing_ok=True)
        _done("mount", "-o", "remount,size=4g", str(mount))
        at = moment if number % 2 else ended.seconds
        yield Stopped(out, at, under_way(out), ended, how, ended.code in REFUSED)
    finally:
        _done("umount", str(mount))


@contextmanager
def read_only(place: Place, folder: Path, number: int, rng: np.random.Generator) -> Iterator[Stopped]:
    """A folder that no file can be made in: the one around it from the start, or its own from a moment on."""
    out, moment = folder / "run", 0.0 if number == 0 else place.seconds * rng.random()
    closed: list[Path] = []
    try:
        if number == 0:
            how = _close(folder, closed)
            ended = (run := place.begin(out)).end()
            stage = "before the start"
        else:
            run = place.begin(out)
            run.until(moment)
            stage, how = under_way(out), "it had not begun"
            for one in [out, *(path for path in out.rglob("*") if path.is_dir())] if out.is_dir() else []:
                how = _close(one, closed)
            ended = run.end()
    finally:
        for one in reversed(closed):
            _open(one)
    yield Stopped(out, moment, stage, ended, how, ended.code in REFUSED)


@contextmanager
def memory(place: Place, folder: Path, number: int, rng: np.random.Generator) -> Iterator[Stopped]:
    """A limit on the process's memory, little above what it has, from a moment on."""
    statm = Path("/proc/self/statm")
    if not statm.is_file() or not hasattr(resource, "prlimit"):
        raise NotTriedError("no /proc or no prlimit: the memory of a process that runs can't be limited")
    out, moment = folder / "run", place.seconds * rng.random()
    run = place.begin(out)
    goes_on, stage, how = run.until(moment), under_way(out), FINISHED
    if goes_on:
        left = MARGIN * rng.random()
        held = int(Path(f"/proc/{run.process.pid}/statm").read_text().split()[0]) * resource.getpagesize()
        _limit(run, resource.RLIMIT_AS, held + int(left))
        how = f"{left / 1e6:.0f} MB of addresses left"
    yield Stopped(out, moment, stage, run.end(), how)


@contextmanager
def clock(place: Place, folder: Path, number: int, rng: np.random.Generator) -> Iterator[Stopped]:
    """Killed, then resumed at an earlier hour, with files dated ahead (even numbers) or back."""
    made = _surely_killed(place, folder / "run", rng.random(), zone=AHEAD)
    when = time.time() + (YEARS if number % 2 == 0 else -YEARS)
    for path in sorted(made.out.rglob("*")):
        os.utime(path, (when, when))
    how = f"{made.how}; files ten years {'ahead' if number % 2 == 0 else 'back'}, clock 26 h back"
    yield replace(made, how=how, zone=BACK)


@contextmanager
def two_runs(place: Place, folder: Path, number: int, rng: np.random.Generator) -> Iterator[Stopped]:
    """A second run in the folder: the same command at once (number 0), or a resume at a moment."""
    out, moment = folder / "run", 0.0 if number == 0 else place.seconds * rng.random()
    first = place.begin(out)
    first.until(moment)
    stage = under_way(out)
    second = place.begin(out, *(["--resume"] if number else []))
    ends = [second.end(), first.end()]
    codes = [ended.code for ended in ends]
    shown = next((one for one in ends if one.traceback), ends[0] if codes[0] else ends[1])
    how = f"exit codes: first {codes[1]}, second {codes[0]}"
    yield Stopped(out, moment, stage, shown, how, sorted(codes) in ([0, 0], [0, 2]))


Stop = Callable[[Place, Path, int, np.random.Generator], AbstractContextManager[Stopped]]
STOPS: dict[str, Stop] = {
    "none": none, "kill": kill, "ctrl-c": ctrl_c, "disk": disk, "read-only": read_only, "memory": memory,
    "clock": clock, "two-runs": two_runs,
}  # fmt: skip


def _done(*command: str) -> bool:
    """Whether a command of the system was there and succeeded."""
    try:
        return subprocess.run(command, capture_output=True, timeout=60).returncode == 0
    except (OSError, subprocess.SubprocessError):
        return False


def _fill(path: Path) -> None:
    """Fill a disk to its last byte."""
    with path.open("wb", buffering=0) as file:
        for block in (65536, 1):
            try:
                while file.write(bytes(block)):
                    pass
            except OSError:
                pass


def _limit(run: Running, which: int, most: int) -> None:
    """Limit a process that runs; nothing where it has ended."""
    if not hasattr(resource, "prlimit"):
        raise NotTriedError("no prlimit: the limits of a process that runs can't be set")
    try:
        resource.prlimit(run.process.pid, which, (most, most))
    except ProcessLookupError:
        pass


def _close(folder: Path, closed: list[Path]) -> str:
    """Let no file be made in a folder; returns by which means. Rights don't bind root, who has another one."""
    folder.chmod(0o555)
    closed.append(folder)
    if not _takes_files(folder):
        return "rights"
    if _done("chattr", "+i", str(folder)) and not _takes_files(folder):
        return "chattr +i (rights don't bind root)"
    raise NotTriedError("rights don't bind root, and chattr +i isn't possible here")


def _takes_files(folder: Path) -> bool:
    path = folder / f".try{time.monotonic_ns()}"
    try:
        path.touch()
    except OSError:
        return False
    path.unlink()
    return True


def _open(folder: Path) -> None:
    """Undo `_close`."""
    if os.geteuid() == 0:
        _done("chattr", "-i", str(folder))
    folder.chmod(0o755)
