"""What commands put before their user: exit codes, faults as lines, bars that keep within their ends, JSON."""

from __future__ import annotations

import errno
import json
import signal
from pathlib import Path

import pytest
import typer

from bayeschute.console import Bars, place_for_json, reporting_faults, say, write_json
from bayeschute.core.errors import Fault, InputError, harmless


@pytest.fixture
def stoppable():
    """A process that Ctrl-C stops: one that a shell started in the background ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("stoppable")
def test_a_stop_that_a_library_loses_is_heard_at_the_next_progress(capsys):
    """As one that falls into a callback of the garbage collector, of which Python prints that it is ignored."""

    class Lost:
        def __del__(self) -> None:
            signal.raise_signal(signal.SIGINT)

    reached = []
    with pytest.raises(typer.Exit) as stopped, reporting_faults("It goes on."):
        bars = Bars()
        bars("fit", 0.1)
        Lost()
        reached.append("after it")
        bars("fit", 0.2)
        reached.append("progress")
    assert reached == ["after it"] and stopped.value.exit_code == 130
    assert capsys.readouterr().err == "Stopped. It goes on.\n"
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    Bars()("fit", 0.3)  # nothing is left of it


def test_every_fault_is_one_line_on_stderr(capsys):
    faults = [Fault("a.toml:\n3", "x", "y"), Fault("b.toml", "u", "v", "Do w.")]
    with pytest.raises(typer.Exit) as stopped, reporting_faults():
        raise InputError(faults)
    assert stopped.value.exit_code == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2 and "a.toml: 3" in lines[0] and "Do w." in lines[1]


def test_a_stop_says_how_to_go_on(capsys):
    with pytest.raises(typer.Exit) as stopped, reporting_faults("The same command continues."):
        raise KeyboardInterrupt
    assert stopped.value.exit_code == 130
    assert "Stopped. The same command continues." in capsys.readouterr().err


HDF5 = "Can't decrement id ref count (file write failed: time = Mon, errno = 28, error message = 'No space left')"
REFUSED = {
    "No space left on device: runs/a.nc": OSError(errno.ENOSPC, "No space left on device", "runs/a.nc"),
    "Permission denied: runs/b": OSError(errno.EACCES, "Permission denied", b"runs/b"),
    "No space left on device": RuntimeError(HDF5),
    "the memory is used up": MemoryError(),
    "The memory is used up": RuntimeError("RESOURCE_EXHAUSTED: Out of memory allocating 8 bytes"),
    "the MEMORY is used up": RuntimeError("std::bad_alloc"),
    "THE MEMORY is used up": ImportError("_backend_agg.so: failed to map segment from shared object"),
}


@pytest.mark.parametrize("why", REFUSED)
def test_what_the_system_refuses_is_a_line_that_says_how_to_go_on(capsys, why):
    with pytest.raises(typer.Exit) as stopped, reporting_faults("The same command continues."):
        raise REFUSED[why]
    assert stopped.value.exit_code == 3
    line = f"Stopped by the system: {why}. The same command continues.\n"
    assert capsys.readouterr().err.lower() == line.lower()


@pytest.mark.parametrize(
    "error",
    [
        ZeroDivisionError(),
        FileNotFoundError(errno.ENOENT, "No such file", "a"),
        RuntimeError("errno = none"),
        ImportError("a"),
    ],
)
def test_what_is_no_fault_of_the_input_is_not_hidden(error):
    with pytest.raises(type(error)), reporting_faults():
        raise error


@pytest.fixture
def terminal(monkeypatch):
    """Standard error passes for a terminal."""
    monkeypatch.setenv("FORCE_COLOR", "1")


def test_bars_keep_the_last_words_of_a_stage(capsys, terminal):
    with Bars() as bars:
        bars("fit", -0.5, "begins")
        bars("fit", 7.0, "2 fits")
        task = bars._progress.tasks[0]
        assert task.completed == 1.0 and task.fields["words"] == "2 fits"
    assert "2 fits" in capsys.readouterr().err


def test_a_bar_never_goes_back_and_tells_the_time_left_of_a_steady_pace(capsys, monkeypatch, terminal):
    now = [0.0]
    monkeypatch.setattr("bayeschute.core.pace.time.perf_counter", lambda: now[0])

    def shown() -> str:
        return str(bars._progress.columns[-1].render(task))

    with Bars() as bars:
        for step in range(101):
            now[0] = 2.4 * step
            bars("fit", 0.005 * step, "along the record")
        task = bars._progress.tasks[0]
        assert shown() == "about 3 to 6 min left: along the record"
        bars("fit", 0.3, "noise parameters")
        assert task.completed == 0.5 and shown() == "about 3 to 6 min left: noise parameters"
        now[0] += 60.0
        assert shown() == "noise parameters"
        bars("fit", 1.0, "2 fits")
        assert shown() == "2 fits"
    assert "2 fits" in capsys.readouterr().err


def test_lines_tell_the_time_that_passed_where_shares_jump(capsys, monkeypatch):
    for name in ("FORCE_COLOR", "TTY_COMPATIBLE"):
        monkeypatch.delenv(name, raising=False)
    now = [0.0]
    for clock in ("bayeschute.core.pace.time.perf_counter", "bayeschute.console.time.monotonic"):
        monkeypatch.setattr(clock, lambda: now[0])
    with Bars() as bars:
        for seconds, share in [(0.0, 0.0), (24.0, 0.03), (107.0, 0.23), (231.0, 0.3), (1300.0, 0.33), (1400.0, 1.0)]:
            now[0] = seconds
            bars("fit", share, "mode")
    told = [" ".join(line.split()[3:]) for line in capsys.readouterr().err.splitlines()]
    assert told == ["mode", "mode", "1 min so far: mode", "3 min so far: mode", "21 min so far: mode", "mode"]


def test_in_a_file_progress_is_told_in_lines_now_and_then(capsys, monkeypatch):
    for name in ("FORCE_COLOR", "TTY_COMPATIBLE"):
        monkeypatch.delenv(name, raising=False)
    now = [0.0]
    monkeypatch.setattr("bayeschute.console.time.monotonic", lambda: now[0])
    with Bars() as bars:
        for second in range(61):
            now[0] = float(second)
            bars("fit", second / 100.0, f"step {second}")
        bars("fit", 1.0, "2 fits")
        bars("fit", 1.0, "2 fits")
    lines = capsys.readouterr().err.splitlines()
    assert [line.split()[0] for line in lines] == ["fit"] * 5
    assert [line.rsplit(" ", 1)[1] for line in lines] == ["0", "20", "40", "60", "fits"]
    assert lines[-1] == "fit        100 % 2 fits"


def test_bars_that_are_not_shown_are_silent(capsys):
    Bars()("fit", 0.5, "words")
    assert capsys.readouterr() == ("", "")


def test_json_goes_to_the_screen_or_into_a_file(tmp_path: Path, capsys):
    write_json({"a": 1.5}, "-")
    assert json.loads(capsys.readouterr().out) == {"a": 1.5}
    write_json({"a": 1.5}, str(tmp_path / "a.json"))
    assert json.loads((tmp_path / "a.json").read_text(encoding="utf-8")) == {"a": 1.5}
    with pytest.raises(ValueError, match="JSON"):
        write_json({"a": float("nan")}, "-")


def test_places_for_no_file_are_refused_beforehand(tmp_path: Path):
    place_for_json(None)
    place_for_json("-")
    place_for_json(str(tmp_path / "a.json"))
    for where in (tmp_path, tmp_path / "none" / "a.json"):
        with pytest.raises(InputError, match="no file can be written"):
            place_for_json(str(where))
    with pytest.raises(InputError, match="a file that can be written"):
        write_json({}, str(tmp_path))


HOSTILE = "\x1b[31mred \x1b]0;title\x07 \x9b2J \u202edesrever \udcff {0} {task} [red]x[/] [/] =cmd()"


def test_no_text_commands_the_terminal(capsys, monkeypatch):
    """Names of files and columns are not ours; a name of bytes that are no text could not even be printed."""
    monkeypatch.setenv("COLUMNS", "300")  # else a bar is cut to its line
    say(HOSTILE)
    with pytest.raises(typer.Exit), reporting_faults():
        raise InputError(Fault(HOSTILE, HOSTILE, "y"))
    with Bars() as bars:
        bars("[red]fit", 0.5, HOSTILE)
        bars("[red]fit", 1.0, HOSTILE)
    told = "".join(capsys.readouterr())
    assert told.count("[red]x[/] [/] =cmd()") >= 4 and "{0} {task}" in told and "[red]fit" in told
    assert "\\x1b[31mred" in told and "\\u202edesrever" in told and "\\udcff" in told
    assert not set(told) & set("\x1b\x07\x9b\u202e")


def test_lines_and_letters_stay_as_they_are():
    assert harmless("a\n\tüñ 中 ° → ²\u00a0x") == "a\n\tüñ 中 ° → ²\u00a0x"
