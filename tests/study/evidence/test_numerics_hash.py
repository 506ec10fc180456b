"""The hash of the numerics changes with code and engine, not with prose."""

from __future__ import annotations

from bayeschute.study.evidence.numerics_hash import NO_NUMBERS, PACKAGE, ROOMS, code_of, hash_of, numerics

CODE = '"""Prose."""\n\n\ndef f(x):\n    """More prose\n    on two lines."""\n    # why\n    return 2 * x  # twice\n'


def test_prose_is_no_code():
    assert code_of(CODE) == "def f(x):\n    return 2 * x"
    assert code_of('a = "# no comment"\n') == 'a = "# no comment"'


def test_code_and_engine_are_hashed_and_reports_are_not(tmp_path):
    for room in ("core", "report"):
        (tmp_path / room).mkdir()
    (tmp_path / "core/one.py").write_text(CODE)
    first = hash_of(tmp_path, "jax 1.0")
    (tmp_path / "core/one.py").write_text(CODE.replace("Prose", "Other prose"))
    (tmp_path / "report/page.py").write_text("x = 1\n")
    (tmp_path / "records/plausibility").mkdir(parents=True)
    (tmp_path / "records/plausibility/words.py").write_text("x = 1\n")
    assert hash_of(tmp_path, "jax 1.0") == first != hash_of(tmp_path, "jax 1.1")
    (tmp_path / "core/one.py").write_text(CODE.replace("2 * x", "3 * x"))
    assert hash_of(tmp_path, "jax 1.0") != first


def test_every_room_is_there():
    assert all((PACKAGE / name).exists() for name in (*ROOMS, *NO_NUMBERS)) and len(numerics()) == 64
