"""Compiled programs in the cache folder: made once, found again, made anew when damaged."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.compiler import machine
from bayeschute.compiler.emit import Code

pytest.importorskip("llvmlite")


def halves(lanes):
    """Halves every number of one block."""
    code = Code(lanes)
    code.store(code.operation("mul", "float", [code.load("%data", 0), code.constant(0.5)]), "%data", 0)
    return code.program("halve", ("data",), ("unused",), 0)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("BAYESCHUTE_CACHE", str(tmp_path))
    monkeypatch.setattr(machine, "_loaded", {})
    return tmp_path / "kernels"


def run(lanes=8):
    data = machine.aligned(lanes)
    data[:] = np.arange(lanes) + 1.0
    machine.compiled(halves(lanes))(data, 0)
    return data


def forgotten(monkeypatch):
    monkeypatch.setattr(machine, "_loaded", {})


def test_second_process_finds_the_code(folder, monkeypatch):
    np.testing.assert_array_equal(run(), (np.arange(8) + 1.0) / 2.0)
    assert len(list(folder.iterdir())) == 1
    forgotten(monkeypatch)
    monkeypatch.setattr(machine, "_object", lambda *_: pytest.fail("compiled again"))
    np.testing.assert_array_equal(run(), (np.arange(8) + 1.0) / 2.0)


def test_a_function_is_made_once_in_a_process(folder, monkeypatch):
    run()
    monkeypatch.setattr(machine, "_load", lambda *_: pytest.fail("made again"))
    np.testing.assert_array_equal(run(), (np.arange(8) + 1.0) / 2.0)


def test_other_program_has_its_own_file(folder):
    run(8), run(1), run(8)
    assert len(list(folder.iterdir())) == 2


def test_damaged_file_is_made_anew(folder, monkeypatch):
    run()
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])
    forgotten(monkeypatch)
    np.testing.assert_array_equal(run(), (np.arange(8) + 1.0) / 2.0)
    assert file.read_bytes() == whole


def test_folder_that_cannot_be_written_is_no_obstacle(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("BAYESCHUTE_CACHE", str(tmp_path / "file"))
    forgotten(monkeypatch)
    np.testing.assert_array_equal(run(), (np.arange(8) + 1.0) / 2.0)


def test_arrays_out_of_order_are_refused(folder):
    with pytest.raises(AssertionError):
        machine.compiled(halves(8))(np.zeros(16)[::2], 0)
