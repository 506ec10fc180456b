"""A folder is held by one run at a time, and free again however that ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from bayeschute.cli import app
from bayeschute.core.errors import Fault, InputError
from bayeschute.study.folder_lock import alone_in

pytest.importorskip("fcntl", reason="no such locks on this system")
HOLD = """
import sys, time
from bayeschute.study.folder_lock import alone_in
with alone_in(sys.argv[1]):
    print("held", flush=True)
    time.sleep(600)
"""


def test_a_second_run_is_refused_and_the_folder_free_again_afterwards(tmp_path: Path):
    out = tmp_path / "deep" / "run"
    with alone_in(out):
        (out / "a").touch()
        with pytest.raises(InputError, match="another run is under way"), alone_in(out):
            pass
    with alone_in(out):
        pass
    assert [path.name for path in out.iterdir()] == ["a"]


def test_a_folder_in_which_nothing_was_written_does_not_remain(tmp_path: Path):
    with pytest.raises(InputError, match="faulty"), alone_in(tmp_path / "run"):
        raise InputError(Fault("study", "faulty", "sound"))
    assert not (tmp_path / "run").exists()


def test_a_run_that_is_killed_lets_go(tmp_path: Path, descents):
    other = subprocess.Popen([sys.executable, "-c", HOLD, str(tmp_path / "run")], stdout=subprocess.PIPE)
    try:
        assert other.stdout is not None and other.stdout.readline() == b"held\n"
        said = CliRunner().invoke(app, ["run", str(descents.study), "--out", str(tmp_path / "run"), "--resume"])
        assert said.exit_code == 2 and "another run is under way" in said.stderr
        assert list((tmp_path / "run").iterdir()) == []
    finally:
        os.kill(other.pid, signal.SIGKILL)
        other.communicate()
    with alone_in(tmp_path / "run"):
        pass
